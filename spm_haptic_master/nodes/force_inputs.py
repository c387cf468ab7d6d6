# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What others command of the force feedback: wrenches, modes, and whether it is engaged."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import isfinite, nan
import threading
import time

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from spm_haptic_master.force import Wrench
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.vectors import times
from spm_haptic_master.nodes.force_modes import ClientModes
from spm_haptic_master.nodes.wrench_frames import WrenchFrame, WrenchFrames
from spm_haptic_master.parameters.fkm import BY_TELEOP
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.diagnostic_status import RIVALS_PERIOD
from spm_haptic_master.ros.duplicate_publishers import full_name
from spm_haptic_master.ros.inputs import Inputs
from spm_haptic_master.ros.qos import STATE, WRENCHES
from spm_haptic_master.teleoperation.conditions import NO_PRESENCE
from spm_haptic_master.teleoperation.engaging import Phase
from spm_haptic_master.timing import Periodic, SECOND
from std_msgs.msg import String

# Topics of wrenches.
WRENCH_TOPICS = ('servo_cf', 'spatial/servo_cf', 'body/servo_cf')
# Age at which the last `teleop_state` is ignored (s): its sender is gone. It repeats it every
# 0.2 s.
TELEOP_TIMEOUT = 0.6
# Phases by its first word.
PHASES = {phase.value: phase for phase in Phase}
# Its words where a hand is missing.
ABSENT = f'{Phase.DISENGAGED.value}: {NO_PRESENCE}'
# Bytes of an endpoint's identifier that are its participant's: one for each process.
PARTICIPANT = 12


class WrenchSources:
    """
    The nodes that publish wrenches: one may do so on all topics, as in CRTK.

    Attributes
    ----------
    count : int
        Number of nodes, or of publishers on one topic if these are more.
    caution : str
        Names of the nodes if there are several; else empty.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self.topics = tuple(map(node.resolve_topic_name, WRENCH_TOPICS))
        self.count = 0
        self.caution = ''

    def look(self) -> None:
        """
        Count the publishers.

        Names are sought only if there are several publishers.
        """
        counts = [self._node.count_publishers(topic) for topic in self.topics]
        self.count = sum(counts)
        self.caution = ''
        if self.count < 2:
            return
        largest = 0
        nodes = set()
        for topic in self.topics:
            found = self._node.get_publishers_info_by_topic(topic)
            largest = max(largest, len(found))
            nodes |= set(map(_node_of, found))
        self.count = max(len(nodes), largest)
        if self.count > 1:
            names = sorted(name for _, name in nodes)
            self.caution = f'wrenches from {", ".join(names)}; expected one node'


def _node_of(publisher: TopicEndpointInfo) -> tuple[bytes, str]:
    """Return participant and full name of a publisher's node: a name alone is not unique."""
    return bytes(publisher.endpoint_gid[:PARTICIPANT]), full_name(publisher)


class TeleopState:
    """
    What the tele-operation says, disengaged where it is silent.

    Attributes
    ----------
    phase : Phase
        Whether it is engaged, or the clutch pressed.
    is_absent : bool
        Whether no hand is on the handle.

    Parameters
    ----------
    released : callable
        Is called when the clutch is no longer pressed.

    """

    def __init__(self, released: Callable[[], None]) -> None:
        self._released = released
        self.phase = Phase.DISENGAGED
        self.is_absent = False
        self._received_at = 0.0  # s, monotonic

    def on_message(self, message: String) -> None:
        """
        Take the words of `teleop_state`.

        Parameters
        ----------
        message : String
            A word, and the reason after a colon. An unknown word counts as disengaged.

        """
        word = message.data.partition(':')[0]
        self._received_at = time.monotonic()
        phase = PHASES.get(word, Phase.DISENGAGED)
        self._enter(phase, message.data == ABSENT)

    def poll(self, now: float) -> None:
        """
        Ignore a state that is too old; `now` in s, monotonic.

        Parameters
        ----------
        now : float
            Present time.

        """
        if now - self._received_at > TELEOP_TIMEOUT:
            self._enter(Phase.DISENGAGED, False)

    def _enter(self, phase: Phase, is_absent: bool) -> None:
        """Store phase and absence, and report the end of a clutch."""
        was_clutched = self.phase is Phase.CLUTCHED
        self.phase = phase
        self.is_absent = is_absent
        if was_clutched and phase is not Phase.CLUTCHED:
            self._released()


class ForceInputs:
    """
    Subscriptions of the force feedback, and their latest content.

    Parameters
    ----------
    node : Node
        Of the subscriptions.
    values : Values
        Settings of `fkm`.
    frames : WrenchFrames
        Frames of wrenches.
    now : callable
        Returns the time on the clock of the samples, ns.
    orientation : callable
        Returns the latest R_base_platform, or None.
    lock : threading.Lock
        Guards what samples take: the caller of `latest_wrench` holds it.

    Attributes
    ----------
    modes : ClientModes
        What clients have set.
    teleop : TeleopState
        State of the tele-operation.
    sources : WrenchSources
        Who publishes wrenches.
    stale, refused : int
        Wrenches that were too old, and in an unknown frame.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        frames: WrenchFrames,
        now: Callable[[], int],
        orientation: Callable[[], Quaternion[float] | None],
        lock: threading.Lock,
    ) -> None:
        self._node = node
        self._frames = frames
        self._now = now
        self._lock = lock
        self._longest = values['force.wrench_timeout']
        self._timeout = round(self._longest * SECOND)
        # When this process last polled, s, monotonic, and whether that was late.
        self._polled_at = 0.0
        self._was_late = True
        self._wrench: Wrench | None = None
        # One that is not finite, until a sample has taken it.
        self._faulty: Wrench | None = None
        self._warned = False
        self._look = Periodic(RIVALS_PERIOD)
        self._unknown = ''
        self._unheard = ''
        self.stale = 0
        self.refused = 0
        self.sources = WrenchSources(node)
        self._inputs = Inputs(node)
        self.modes = ClientModes(node, values, self._inputs, orientation, self._drop_wrench)
        self.teleop = TeleopState(self.modes.lock.end)
        self._subscribe(values)

    def _subscribe(self, values: Values) -> None:
        """Subscribe to the wrenches, and to `teleop_state` if tele-operation engages the force."""
        wrench = partial(self._inputs.subscribe, WrenchStamped, qos=WRENCHES)
        wrench(topic='servo_cf', callback=self._on_any)
        wrench(topic='spatial/servo_cf', callback=self._on_spatial)
        wrench(topic='body/servo_cf', callback=self._on_body)
        if values['force.engaged_by'] == BY_TELEOP:
            self._inputs.subscribe(String, 'teleop_state', self.teleop.on_message, STATE)

    def latest_wrench(self) -> Wrench | None:
        """Return the latest wrench, for a sample; the caller holds the lock."""
        if self._faulty is not None:
            self._wrench = self._faulty
            self._faulty = None
        return self._wrench

    def age(self) -> float | None:
        """Return the age of the latest wrench, s; None before the first."""
        wrench = self._wrench
        if wrench is None:
            return None
        return (self._now() - wrench.received) / SECOND

    @property
    def caution(self) -> str:
        """Return which input is not heard, not understood or not alone; empty if none."""
        return self.sources.caution or self._unheard or self._unknown

    def poll(self) -> None:
        """Notice who publishes, and what does not come any more: call it all the time."""
        now = time.monotonic()
        self._was_late = now - self._polled_at > self._longest
        self._polled_at = now
        self.teleop.poll(now)
        if self._look.is_due(now):
            self._unheard = self._inputs.unheard()
            self.sources.look()
            self.modes.poll()

    # Wrenches -----------------------------------------------------------------------------------

    def _on_any(self, message: WrenchStamped) -> None:
        """Take a wrench on `servo_cf`, in the frame that its header names."""
        name = message.header.frame_id
        frame = self._frames.by_name.get(name)
        if frame is None:
            self._refuse(name)
            return
        self._take_wrench(message, frame)

    def _on_spatial(self, message: WrenchStamped) -> None:
        """Take a wrench on `spatial/servo_cf`, in the frame of `orientation`."""
        self._take_wrench(message, self._frames.spatial)

    def _on_body(self, message: WrenchStamped) -> None:
        """Take a wrench on `body/servo_cf`, in the handle's frame or that of `orientation`."""
        is_absolute = self.modes.is_body_absolute.value
        frame = self._frames.body
        if is_absolute:
            frame = self._frames.spatial
        self._take_wrench(message, frame)

    def _refuse(self, name: str) -> None:
        """Count a wrench in an unknown frame, and name that frame once."""
        self.refused += 1
        if self._unknown:
            return
        known = ', '.join(sorted(filter(None, self._frames.by_name)))
        topic = self.sources.topics[0]
        self._unknown = f'wrench on {topic} in frame {name!r}; expected {known} or none'
        node_log.error(self._node, self._unknown)

    def _take_wrench(self, message: WrenchStamped, frame: WrenchFrame) -> None:
        """
        Keep a wrench that is not too old, in the handle's or in the base frame.

        A wrench that is not finite reaches the next sample as a torque of nan, even if a good one
        comes before that sample.

        Parameters
        ----------
        message : WrenchStamped
            Wrench of a client; `scale` of the modes multiplies its torque.
        frame : WrenchFrame
            Frame of its numbers.

        """
        now = self._now()
        if self._is_old(message, now):
            self.stale += 1
            return
        self._unknown = ''
        self._warn_of_force(message)
        force = message.wrench.force
        torque = message.wrench.torque
        scale = self.modes.scale.value
        scaled = (scale * torque.x, scale * torque.y, scale * torque.z)
        found = times(frame.rotation, scaled)
        is_finite = isfinite(sum(found) + force.x + force.y + force.z)
        with self._lock:
            if self._wrench is not None and now == self._wrench.received:
                now += 1  # each has its own time of arrival
            if is_finite:
                self._wrench = Wrench(
                    received=now,
                    torque=found,
                    in_handle=frame.in_handle,
                )
            else:
                self._faulty = Wrench(
                    received=now,
                    torque=(nan, nan, nan),
                    in_handle=frame.in_handle,
                )

    def _is_old(self, message: WrenchStamped, now: int) -> bool:
        """
        Return whether a wrench is too old by its stamp, or may have waited for this process.

        Parameters
        ----------
        message : WrenchStamped
            Wrench of a client; without a stamp its age is not known.
        now : int
            Present time on the clock of the samples, ns.

        Returns
        -------
        bool
            True as well if this process has not polled for longer than a wrench may be old.

        """
        stamp = message.header.stamp
        stamped = stamp.sec * SECOND + stamp.nanosec
        # Clients of CRTK leave the header empty.
        if stamped and abs(now - stamped) > self._timeout:
            return True
        return self._was_late or time.monotonic() - self._polled_at > self._longest

    def _warn_of_force(self, message: WrenchStamped) -> None:
        """Say once that the force of a wrench has no effect."""
        force = message.wrench.force
        if self._warned or not any((force.x, force.y, force.z)):
            return
        self._warned = True
        node_log.warning(
            self._node,
            'the force of a wrench is ignored: this device renders torque about its centre alone',
        )

    def _drop_wrench(self) -> None:
        """Have no wrench, as before the first one."""
        with self._lock:
            self._wrench = None
