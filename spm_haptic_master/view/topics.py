# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The topics of one device: what they say, and since when they say nothing."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import hypot, inf, isfinite, nan
from typing import Any

from geometry_msgs.msg import QuaternionStamped, WrenchStamped
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from spm_haptic_master.force import FORCE_STATES
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.nodes.guidance_publisher import COVERAGE_TOPIC
from spm_haptic_master.nodes.simulation_control import ORIENTATION_TOPIC
from spm_haptic_master.ros.inputs import SampledTopic
from spm_haptic_master.ros.qos import DISPLAY, STATE
from spm_haptic_master.timing import Periodic
from spm_haptic_master.view import messages
from std_msgs.msg import Float64MultiArray, String

# Topics by which a device is there.
JOINTS_TOPIC = 'joint_states'
STATE_TOPIC = 'state'
SOURCE_TOPIC = 'source'
# Topics of words that are shown as they are.
FORCE_TOPIC = 'force_state'
TELEOP_TOPIC = 'teleop_state'
CRTK_TOPIC = 'operating_state_text'
# Time after which a `teleop_state` is nobody's (s): it is repeated every 0.2 s.
TELEOP_TIMEOUT = 0.7
# Topics of the torques commanded and rendered, in the handle's frame; time without a message after
# which a torque ends (s).
TORQUE_TOPICS = ('body/servo_cf', 'body/measured_cf')
TORQUE_TIMEOUT = 0.25
NO_TORQUE = 0.0, 0.0, 0.0
# Topics of the encoders that are in no set, by their names; time without a message after which
# there is no reading (s).
FURTHER_TOPICS = {'insertion': 'insertion/measured_js', 'gripper': 'gripper/measured_js'}
READING_TIMEOUT = 0.5
# Period of looking for them (s), and the node whose gripper is no encoder: it publishes a joystick
# or a constant, and only for those who subscribe.
FURTHER_PERIOD = 1.0
NO_ENCODER = 'fkm'


class DeviceTopics:
    """
    Subscriptions to a device's topics, and the newest of each.

    Parameters
    ----------
    node : Node
        Subscribes to the topics of which every message is taken.
    taker : Node
        A node without an executor. It has the topics of which only the newest message is taken,
        while a page is open.
    name : callable
        Returns the name of a topic in the device's namespace.
    on_joints : callable
        Is called with stamp, ns, and angles of all nine joints, rad.
    on_state, on_source : callable
        Are called with the words of the topics `state` and `source`.

    Attributes
    ----------
    calibration : Calibration or None
        State of a calibration; None without one, and after its end.
    dexterities : tuple of two float, or None
        Dexterity of the three motor encoders and of all encoders; None before the first message,
        and after one that is not valid.
    readings : tuple of float
        Angle of each encoder as read last, rad; empty before the first message.

    """

    def __init__(
        self,
        node: Node,
        taker: Node,
        name: Callable[[str], str],
        on_joints: Callable[[messages.StampedAngles], None],
        on_state: Callable[[str], None],
        on_source: Callable[[str], None],
    ) -> None:
        self._node = node
        self._name = name
        self._on_joints = on_joints
        # Words by topic, and when they came (s).
        self._words: dict[str, tuple[str, float]] = {}
        self._now = 0.0
        self.calibration: messages.Calibration | None = None
        self._subscriptions: list[Subscription] = [
            node.create_subscription(
                JointState,
                name(JOINTS_TOPIC),
                self._take_joints,
                DISPLAY,
            ),
            self._subscribe(STATE_TOPIC, on_state),
            self._subscribe(SOURCE_TOPIC, on_source),
            self._subscribe(COVERAGE_TOPIC, self._take_calibration),
        ]
        for topic in (FORCE_TOPIC, TELEOP_TOPIC, CRTK_TOPIC):
            self._subscriptions.append(self._subscribe(topic, partial(self._take_words, topic)))
        sampled = partial(SampledTopic, taker)
        self._dexterity = sampled(Float64MultiArray, name('dexterity'))
        self._readings = sampled(JointState, name('readings'))
        self._wrenches = [sampled(WrenchStamped, name(topic)) for topic in TORQUE_TOPICS]
        self._further = {
            sensor: sampled(JointState, name(topic)) for sensor, topic in FURTHER_TOPICS.items()
        }
        self._truth = sampled(QuaternionStamped, name(ORIENTATION_TOPIC))
        self.dexterities: tuple[float, float] | None = None
        self.readings: tuple[float, ...] = ()
        self._read_at = [nan] * len(ALL_JOINT_NAMES)
        # Torques commanded and rendered, N m, and when they came (s).
        self._torques = [(-inf, NO_TORQUE)] * len(TORQUE_TOPICS)
        # Positions of the encoders that are in no set, and when they came (s).
        self._positions: dict[str, tuple[float | None, float]] = {}
        self._look_for_further = Periodic(FURTHER_PERIOD)

    def _subscribe(
        self,
        topic: str,
        take: Callable[[str], None],
    ) -> Subscription:
        """Subscribe to a topic of words."""

        def on_words(message: String) -> None:
            take(message.data)

        return self._node.create_subscription(
            String,
            self._name(topic),
            on_words,
            STATE,
        )

    def _take_joints(self, message: JointState) -> None:
        """Take the angles of all nine joints, if the message has them."""
        joints = messages.mechanism_joints(message)
        if joints is not None:
            self._on_joints(joints)

    def _take_words(self, topic: str, words: str) -> None:
        """Keep the words of a topic, with the time at which they came."""
        self._words[topic] = words, self._now

    def _take_calibration(self, words: str) -> None:
        """Take the state of a calibration; an empty one ends it."""
        found = messages.calibration(words)
        if found is not None:
            self.calibration = found if found.shares else None

    def close(self) -> None:
        """End all subscriptions."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for topic in self._sampled():
            topic.unsubscribe()
        for further in self._further.values():
            further.unsubscribe()
        self._truth.unsubscribe()

    def publishers(self) -> int:
        """
        Return the number of publishers by which the device is there.

        Returns
        -------
        int
            Publishers of `joint_states`, `state` and `calibration/coverage` together.

        """
        topics = JOINTS_TOPIC, STATE_TOPIC, COVERAGE_TOPIC
        return sum(self._node.count_publishers(self._name(topic)) for topic in topics)

    def is_calibrating(self) -> bool:
        """Return whether the program of a calibration still runs."""
        return self._node.count_publishers(self._name(COVERAGE_TOPIC)) > 0

    def _sampled(self) -> list[SampledTopic[Any]]:
        """Return the topics of which the newest message is taken while a page is open."""
        return [self._dexterity, self._readings, *self._wrenches]

    def tick(
        self,
        now: float,
        watched: bool,
    ) -> messages.StampedAngles | None:
        """
        Take what is new at a time, s, while a page is open; return new readings.

        Parameters
        ----------
        now : float
            Present time, s, monotonic: the time of whatever comes until the next call.
        watched : bool
            Whether a page is open; if not, the sampled topics have no subscription.

        Returns
        -------
        StampedAngles or None
            Angles as read, rad, and their stamp, ns; None without a new message.

        """
        self._now = now
        for topic in self._sampled():
            if watched:
                topic.subscribe()
            else:
                topic.unsubscribe()
        self._take_dexterity()
        self._take_torques(now)
        if self._look_for_further.is_due(now):
            self._find_further(watched)
        self._take_further(now)
        return self._take_readings(now)

    def truth(self, wanted: bool) -> tuple[int, Quaternion[float]] | None:
        """
        Return stamp and true orientation of a simulation, new ones, while they are wanted.

        Parameters
        ----------
        wanted : bool
            Whether a story is played; the subscription exists only meanwhile.

        Returns
        -------
        tuple of int and tuple of 4 float, or None
            Stamp, ns, and quaternion x, y, z, w.

        """
        if not wanted:
            self._truth.unsubscribe()
            return None
        self._truth.subscribe()
        message = self._truth.take()
        if message is None:
            return None
        return messages.orientation(message)

    def _take_dexterity(self) -> None:
        """Take the newest dexterities."""
        message = self._dexterity.take()
        if message is not None:
            self.dexterities = messages.dexterities(message)

    def _take_torques(self, now: float) -> None:
        """Take the newest torques, with the time at which they came."""
        for index, topic in enumerate(self._wrenches):
            message = topic.take()
            if message is not None:
                self._torques[index] = now, messages.torque(message)

    def _find_further(self, watched: bool) -> None:
        """
        Subscribe to encoders that are in no set, where they are, while a page is open.

        A publisher other than `fkm` has to be there: the gripper of `fkm` is no encoder.
        """
        for sensor, topic in self._further.items():
            name = self._name(FURTHER_TOPICS[sensor])
            publishers = self._node.get_publishers_info_by_topic(name)
            if watched and any(publisher.node_name != NO_ENCODER for publisher in publishers):
                topic.subscribe()
            else:
                topic.unsubscribe()
            if not publishers:
                self._positions.pop(sensor, None)

    def _take_further(self, now: float) -> None:
        """Take the newest positions of the encoders that are in no set."""
        for sensor, topic in self._further.items():
            message = topic.take()
            if message is not None:
                self._positions[sensor] = messages.one_joint(message), now

    def _take_readings(self, now: float) -> messages.StampedAngles | None:
        """Take and return the newest readings, and note which encoders have one."""
        message = self._readings.take()
        if message is None:
            found = None
        else:
            found = messages.readings(message)
        if found is not None:
            self.readings = found.angles
            for index, angle in enumerate(found.angles):
                if isfinite(angle):
                    self._read_at[index] = now
        return found

    def ages(self) -> tuple[float, ...]:
        """Return how long ago each encoder was read, s; nan: never."""
        return messages.ages(self._read_at, self._now)

    def unread(self) -> tuple[str, ...]:
        """
        Return the joints without a reading for a while, although others have one.

        Returns
        -------
        tuple of str
            Names of joints; empty if no encoder has been read within READING_TIMEOUT.

        """
        ages = self.ages()[: len(self.readings)]
        if not ages or not any(age < READING_TIMEOUT for age in ages):
            return ()
        return tuple(
            name
            for name, age in zip(ALL_JOINT_NAMES, ages, strict=False)
            if not age < READING_TIMEOUT
        )

    def torques(self) -> list[tuple[float, float, float]]:
        """
        Return the torques commanded and rendered, N m, zero where none comes.

        Returns
        -------
        list of two tuples of 3 float
            x, y, z in the handle's frame.

        """
        return [
            torque if self._now - came <= TORQUE_TIMEOUT else NO_TORQUE
            for came, torque in self._torques
        ]

    def torque_sizes(self) -> tuple[float, float]:
        """Return the sizes of the torques commanded and rendered, N m; nan before any came."""
        if all(came == -inf for came, _ in self._torques):
            return nan, nan
        commanded, rendered = (hypot(*torque) for torque in self.torques())
        return commanded, rendered

    def further(self) -> dict[str, float | None]:
        """
        Return the positions of the encoders that are in no set, None without a reading.

        Returns
        -------
        dict
            Position by name: insertion, m; gripper, rad. Encoders without a publisher are left
            out.

        """
        return {
            sensor: position if self._now - came <= READING_TIMEOUT else None
            for sensor, (position, came) in self._positions.items()
        }

    def force(self) -> str:
        """Return the state of the force feedback; empty: not known."""
        words = self._words.get(FORCE_TOPIC, ('', 0.0))[0]
        return words if words in FORCE_STATES else ''

    def teleop(self) -> str:
        """
        Return the state of the slave's lead; empty without teleop.

        Words older than TELEOP_TIMEOUT are replaced by a warning.
        """
        words, came = self._words.get(TELEOP_TOPIC, ('', 0.0))
        if words and self._now - came > TELEOP_TIMEOUT:
            return 'no news from teleop: not led'
        return words

    def crtk(self) -> str:
        """Return the CRTK operating state; empty: not known."""
        return self._words.get(CRTK_TOPIC, ('', 0.0))[0]
