# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that reports how near the device is to a singularity, and the angles of all joints."""

from __future__ import annotations

from contextlib import suppress
from math import degrees
import time

from geometry_msgs.msg import QuaternionStamped
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import SettingError, SpmError
from spm_haptic_master.kinematics import mechanism_angles
from spm_haptic_master.kinematics.joints import (
    ALL_JOINT_NAMES,
    MECHANISM_JOINT_NAMES,
    SHORT_NAMES,
)
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion
from spm_haptic_master.kinematics.workspace import approach, Nearness, nearness
from spm_haptic_master.parameters.geometry import geometry_from, mechanism_checksum, mounting_from
from spm_haptic_master.parameters.nodes import DIAGNOSTICS_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import diagnostic_status, runner
from spm_haptic_master.ros.cdr import OrientationReader
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, STEADY, WARN
from spm_haptic_master.ros.duplicate_publishers import Rivals
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.supervision.orientation_state import read_state, received_state
from spm_haptic_master.timing import SECOND
from std_msgs.msg import Float64MultiArray, MultiArrayDimension, String

# Messages on /diagnostics while the sensors in use hardly determine the orientation, by level.
TEXTS = {
    WARN: 'near a singularity of the sensors in use',
    ERROR: 'at a singularity of the sensors in use',
}
# The same while they do, by the level that the three active joints alone would have.
COVERED_TEXTS = {
    OK: 'clear of singularities',
    WARN: 'near a parallel singularity; the sensors in use cover it',
    ERROR: 'at a parallel singularity; the sensors in use cover it',
}
# All of them: an orientation comes.
MESSAGES = frozenset((*TEXTS.values(), *COVERED_TEXTS.values()))
# Settings that may change while the node runs.
LIVE = ('dexterity_warn', 'dexterity_error', 'dexterity_hysteresis')
# Largest deviation of a unit quaternion's squared norm from 1 (unit 1): rounding, no error.
UNIT_TOLERANCE = 1e-6


class Levels:
    """
    Level and message along the dexterities of a moving device, with hysteresis.

    A level is entered below its threshold, and left above it by a margin. The level is that of the
    sensors in use; the message of level OK is that of the three active joints.

    Parameters
    ----------
    values : mapping
        Checked values of dexterity_warn, dexterity_error and dexterity_hysteresis.

    Attributes
    ----------
    level : bytes
        OK, WARN or ERROR, of the sensors in use.

    """

    def __init__(self, values: Values) -> None:
        self.level = OK
        self._of_three = OK
        self.use(values)

    def use(self, values: Values) -> None:
        """
        Use other thresholds.

        Parameters
        ----------
        values : mapping
            Checked values of dexterity_warn, dexterity_error and dexterity_hysteresis.

        Raises
        ------
        SettingError
            They contradict each other; those before stay in use.

        """
        warn = values['dexterity_warn']
        error = values['dexterity_error']
        if error > warn:
            raise SettingError(
                name='dexterity_error',
                value=error,
                expected=f'a number of at most dexterity_warn ({warn:g})',
            )
        self._warn = warn
        self._error = error
        self._leave = 1.0 + values['dexterity_hysteresis']

    def take(self, three: float, in_use: float) -> str:
        """
        Follow the device, and return the message of its place.

        Parameters
        ----------
        three, in_use : float
            Dexterity of the three active joints alone, and of the sensors in use (unit 1).

        Returns
        -------
        str
            The message; the level is in `level`.

        """
        self.level = self._next(in_use, self.level)
        self._of_three = self._next(three, self._of_three)
        if self.level == OK:
            return COVERED_TEXTS[self._of_three]
        return TEXTS[self.level]

    def _next(self, eta: float, before: bytes) -> bytes:
        """Return the level at a dexterity, by the level before: it is left above its threshold."""
        error = self._error
        if before == ERROR:
            error *= self._leave
        if eta < error:
            return ERROR
        warn = self._warn
        if before != OK:
            warn *= self._leave
        if eta < warn:
            return WARN
        return OK


class Diagnostics(ParameterNode):
    """
    Publishes `dexterity` and the nearest singularity at a set rate, from the latest `orientation`.

    `joint_states` has the angles of all nine joints at a rate of its own, while it has a
    subscriber. Without a new orientation neither is published, and /diagnostics has the reason.
    An `fkm` in the same process passes orientations to `take`; after `subscribe` they come from
    the topic.

    Parameters
    ----------
    parameters : Parameters
        Files and arguments of the process.

    Raises
    ------
    SettingError
        A parameter is not valid, or two of them contradict each other.

    Attributes
    ----------
    sensors : int
        Number of sensors.
    levels : Levels
        Level on /diagnostics, with its thresholds.
    dexterities : Nearness or None
        Latest dexterities, of three and of all sensors; None without a usable orientation.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('diagnostics', parameters)
        self._values = self.declare(DIAGNOSTICS_SETTINGS)
        self._geometry = geometry_from(self._values)
        self._mounting = mounting_from(self._values)
        self._working_mode = self._values['working_mode']
        self.sensors: int = self._values['sensors']
        self._left_out: tuple[int, ...] = ()
        self._unknown_state = ''  # words on `state` that are not a state; else empty
        self.levels = Levels(self._values)
        self.on_change(LIVE, self._apply)
        self._read = OrientationReader().read
        # Stamp (ns) and quaternion of the latest orientation; None once it is evaluated, or shown
        # on `joint_states`.
        self._latest: tuple[int, Quaternion[float]] | None = None
        self._latest_to_show: tuple[int, Quaternion[float]] | None = None
        # When an orientation last came (s, monotonic).
        self._last_received: float | None = None
        # Latest dexterities, of three and of all sensors; None without a usable orientation.
        self.dexterities: Nearness | None = None
        further = SHORT_NAMES[3 : self.sensors]
        names = ' '.join(f'th{name}' for name in further)
        self._message = Float64MultiArray()
        self._message.layout.dim = [
            MultiArrayDimension(
                label=(
                    'dexterity of 3 sensors (th1A th1B th1C), of '
                    f'{self.sensors} sensors (+ {names})'
                ),
                size=2,
                stride=2,
            )
        ]
        self._status = diagnostic_status.StatusPublisher(
            node=self,
            aspect='singularity',
            hardware_id=diagnostic_status.MECHANISM,
            logs=False,
        )
        self._rivals = Rivals(self, 'orientation', 'measured_js')
        self._publisher = self.create_publisher(Float64MultiArray, 'dexterity', SAMPLES)
        self._joints = JointState(name=list(MECHANISM_JOINT_NAMES))
        self._joints_out = self.create_publisher(JointState, 'joint_states', SAMPLES)
        self.create_subscription(String, 'state', self._on_state, STATE)
        self.create_timer(1.0 / self._values['dexterity_rate'], self._evaluate, clock=STEADY)
        self.create_timer(
            1.0 / self._values['joint_states_rate'], self._publish_joints, clock=STEADY
        )

    def subscribe(self) -> None:
        """Take orientations from the topic `orientation`."""
        self.create_subscription(
            QuaternionStamped, 'orientation', self._on_orientation, SAMPLES, raw=True
        )

    @property
    def state(self) -> str:
        """State of the singularity, as on /diagnostics."""
        return self._status.message

    def _apply(self, changed: Values) -> None:
        """Use changed settings; SettingError, and no change, if they contradict each other."""
        values = {**self._values, **changed}
        self.levels.use(values)
        self._values = values

    def _on_orientation(self, data: bytes) -> None:
        """Take a serialized orientation from the topic."""
        self.take(*self._read(data))

    def _on_state(self, message: String) -> None:
        """Store which sensors the orientation is computed without."""
        state = received_state(message.data)
        left_out = []
        for index, name in enumerate(ALL_JOINT_NAMES[: self.sensors]):
            if name in state.left_out:
                left_out.append(index)
        self._left_out = tuple(left_out)
        is_known = read_state(message.data) is not None
        self._unknown_state = '' if is_known else state.text

    def take(
        self,
        stamp: int,
        quaternion: Quaternion[float],
        level: float = 0.0,
    ) -> None:
        """
        Store an orientation and its stamp (ns) as the latest, at any protection level.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        quaternion : tuple of 4 float
            Orientation as published, x, y, z, w.
        level : float
            Protection level, rad: not used, but the followers of `fkm` get it.

        """
        orientation = (stamp, quaternion)
        self._latest = orientation
        self._latest_to_show = orientation

    def _evaluate(self) -> None:
        """
        Publish dexterity and level of the latest orientation, or why there is none.

        An obstacle, an orientation that does not come, a quaternion that is not of unit norm, and
        a pose outside the working mode are reported in place of a dexterity.
        """
        latest = self._latest
        self._latest = None
        now = time.monotonic()
        if latest is not None:
            self._last_received = now
        obstacle = self._rivals.found() or self._unknown_state
        if obstacle:
            self._report(ERROR, obstacle)
            return
        if latest is None:
            if self._last_received is None:
                self._report(WARN, 'starting: no orientation yet')
            elif now - self._last_received > self._values['orientation_timeout']:
                self._report(ERROR, 'no orientation')
            return
        _, given = latest
        quaternion = self._unmounted(given)
        if quaternion is None:
            self._report(
                ERROR, 'the quaternion on orientation is not a unit quaternion', quaternion=given
            )
            return
        try:
            dexterities = nearness(
                quaternion, self._geometry, self._working_mode, self.sensors, self._left_out
            )
        except SpmError as error:
            self._report(ERROR, 'outside the working mode', error=str(error))
            return
        self.dexterities = dexterities
        self._message.data = [dexterities.three, dexterities.every]
        self._publisher.publish(self._message)
        text = self.levels.take(dexterities.three, dexterities.in_use)
        if self._status.is_due(self.levels.level, text):
            figures = self._figures(quaternion, dexterities)
            self._status.publish(self.levels.level, text, figures)

    def _publish_joints(self) -> None:
        """Publish the angles of all joints at the latest orientation, if there is a new one."""
        latest = self._latest_to_show
        self._latest_to_show = None
        if latest is None or not self._joints_out.get_subscription_count():
            return
        if self._rivals.found() or self._unknown_state:
            return
        stamp, given = latest
        quaternion = self._unmounted(given)
        if quaternion is None:
            return
        with suppress(SpmError):  # `_evaluate` reports it
            rotation = rotation_from_quaternion(*quaternion)
            self._joints.position = mechanism_angles(rotation, self._geometry, self._working_mode)
            at = self._joints.header.stamp
            at.sec, at.nanosec = divmod(stamp, SECOND)
            self._joints_out.publish(self._joints)

    def _unmounted(self, quaternion: Quaternion[float]) -> Quaternion[float] | None:
        """
        Return R_base_platform's quaternion; None if the given one is not of unit norm.

        Parameters
        ----------
        quaternion : tuple of 4 float
            Orientation as published, x, y, z, w.

        Returns
        -------
        tuple of 4 float, or None
            The platform in the base frame: without the rotations of the mounting.

        """
        # Any node may publish on the topic.
        square = sum(each * each for each in quaternion)
        if not abs(square - 1.0) < UNIT_TOLERANCE:
            return None
        if self._mounting is None:
            return quaternion
        return self._mounting.unmounted(quaternion)

    def _figures(self, quaternion: Quaternion[float], dexterities: Nearness) -> dict[str, object]:
        """
        Return the values of the entry: dexterities, thresholds, and the nearest singularity.

        Parameters
        ----------
        quaternion : tuple of 4 float
            R_base_platform, x, y, z, w.
        dexterities : Nearness
            Dexterities at this orientation.

        Returns
        -------
        dict
            Values by key; the way to the nearest singularity is missing if there is none.

        """
        left_out = [ALL_JOINT_NAMES[index] for index in self._left_out]
        figures: dict[str, object] = {
            'dexterity of 3 sensors': dexterities.three,
            f'dexterity of {self.sensors} sensors': dexterities.every,
            'dexterity of the sensors in use': dexterities.in_use,
            'sensors left out': ', '.join(left_out) or 'none',
            'warn below': self._values['dexterity_warn'],
            'error below': self._values['dexterity_error'],
            diagnostic_status.CHECKSUM_KEY: mechanism_checksum(self._values),
        }
        way = approach(quaternion, self._geometry, self._working_mode)
        if way is not None:
            axis = [f'{component:.3f}' for component in way.axis]
            figures['singularity at (deg)'] = degrees(way.distance)
            figures['by a turn about, in the base frame'] = ' '.join(axis)
        return figures

    def _report(self, level: bytes, text: str, **values: object) -> None:
        """Publish on /diagnostics why there is no dexterity."""
        self.dexterities = None
        if self._status.is_due(level, text):
            self._status.publish(level, text, values)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('diagnostics', lambda _, add: add(Diagnostics).subscribe(), args)
