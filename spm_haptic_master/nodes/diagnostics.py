# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that says how near the device is to a singularity."""

from __future__ import annotations

from math import degrees
import time

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import Float64MultiArray, MultiArrayDimension

from spm_haptic_master.exceptions import SettingError, SpmError
from spm_haptic_master.geometry_settings import geometry_from
from spm_haptic_master.kinematics.singularity import approach, Nearness, nearness
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.diagnostic_status import ERROR, Health, OK, STEADY, WARN
from spm_haptic_master.nodes.parameters import declare, DIAGNOSTICS_SETTINGS, on_change
from spm_haptic_master.nodes.qos import SAMPLES

TEXTS = {
    OK: 'clear of singularities',
    WARN: 'near a parallel singularity',
    ERROR: 'at a parallel singularity',
}
OUTSIDE = 'outside the working mode'
NO_QUATERNION = 'no unit quaternion on orientation'
# Squared norm less 1 up to which a quaternion is one (unit 1).
UNIT_TOLERANCE = 1e-6


class Hysteresis:
    """
    A level from a dexterity: entered below a threshold, left above it by a margin.

    Parameters
    ----------
    warn, error : float
        Dexterity below which the level is WARN, ERROR.
    margin : float
        Fraction above a threshold at which its level is left again.

    Raises
    ------
    SettingError
        If `error` is above `warn`.

    """

    def __init__(self, warn: float, error: float, margin: float):
        if error > warn:
            raise SettingError('dexterity_error', error,
                               f'a number of at most dexterity_warn ({warn:g})')
        self._warn, self._error, self._margin = warn, error, margin

    def level(self, eta: float, before: bytes) -> bytes:
        """Return the level at a dexterity, given the level before."""
        leave = 1.0 + self._margin
        if eta < self._error * (leave if before == ERROR else 1.0):
            return ERROR
        if eta < self._warn * (leave if before in (WARN, ERROR) else 1.0):
            return WARN
        return OK


class Diagnostics(Node):
    """
    Publishes `dexterity` at a set rate, from the latest `orientation`.

    Without a new orientation nothing goes out but the reason, on /diagnostics. Orientations come by
    `take`, from an `fkm` in the same process, or by the topic after `subscribe`.
    """

    def __init__(self):
        super().__init__('diagnostics')
        self._values = declare(self, DIAGNOSTICS_SETTINGS)
        self._geometry = geometry_from(self._values)
        self._working_mode = self._values['working_mode']
        self._apply({})
        on_change(self, DIAGNOSTICS_SETTINGS, self._apply)
        # Serialized: of the many that come in, only those evaluated are worth a message object.
        self._latest: bytes | None = None
        self._heard: float | None = None
        self.level = OK
        self.dexterities: Nearness | None = None
        self._message = Float64MultiArray()
        self._message.layout.dim = [MultiArrayDimension(
            label='dexterity of 3 sensors (th1A th1B th1C), of 4 sensors (+ th3A)',
            size=2, stride=2)]
        self._health = Health(self, 'singularity', 'spherical parallel manipulator', logs=False)
        self._publisher = self.create_publisher(Float64MultiArray, 'dexterity', SAMPLES)
        self.create_timer(1.0 / self._values['dexterity_rate'], self._evaluate, clock=STEADY)

    def subscribe(self) -> None:
        """Take orientations from `orientation`."""
        self.create_subscription(
            QuaternionStamped, 'orientation', self.take, SAMPLES, raw=True)

    @property
    def state(self) -> str:
        """What /diagnostics says of the singularity."""
        return self._health.message

    def _apply(self, changed: dict[str, object]) -> None:
        values = {**self._values, **changed}
        self._hysteresis = Hysteresis(values['dexterity_warn'], values['dexterity_error'],
                                      values['dexterity_hysteresis'])
        self._values = values

    def take(self, orientation: bytes) -> None:
        """Keep a serialized QuaternionStamped, the latest."""
        self._latest = orientation

    def _evaluate(self) -> None:
        latest, self._latest = self._latest, None
        now = time.monotonic()
        if latest is None:
            self._without_orientation(now)
            return
        self._heard = now
        q = deserialize_message(latest, QuaternionStamped).quaternion
        quaternion = q.x, q.y, q.z, q.w
        # Anybody may publish here.
        if not abs(sum(component * component for component in quaternion) - 1.0) < UNIT_TOLERANCE:
            self.dexterities = None
            if self._health.due(ERROR, NO_QUATERNION):
                self._health.say(ERROR, NO_QUATERNION, {'quaternion': quaternion})
            return
        try:
            self.dexterities = nearness(quaternion, self._geometry, self._working_mode)
        except SpmError as error:
            self.dexterities = None
            if self._health.due(ERROR, OUTSIDE):
                self._health.say(ERROR, OUTSIDE, {'error': str(error)})
            return
        self._message.data = self.dexterities
        self._publisher.publish(self._message)
        self.level = self._hysteresis.level(self.dexterities.three, self.level)
        if self._health.due(self.level, TEXTS[self.level]):
            self._health.say(self.level, TEXTS[self.level], self._facts(quaternion))

    def _facts(self, quaternion) -> dict[str, object]:
        facts = {
            'dexterity of 3 sensors': self.dexterities.three,
            'dexterity of 4 sensors': self.dexterities.four,
            'warn below': self._values['dexterity_warn'],
            'error below': self._values['dexterity_error'],
        }
        way = approach(quaternion, self._geometry, self._working_mode)
        if way is not None:
            facts['singularity at (deg)'] = degrees(way.distance)
            facts['by a turn about, in the base frame'] = ' '.join(f'{c:.3f}' for c in way.axis)
        return facts

    def _without_orientation(self, now: float) -> None:
        if self._heard is None:
            level, text = WARN, 'starting: no orientation yet'
        elif now - self._heard > self._values['orientation_timeout']:
            level, text = ERROR, 'no orientation'
            self.dexterities = None
        else:
            return  # a pause shorter than the time-out is no news
        if self._health.due(level, text):
            self._health.say(level, text, {})


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('diagnostics', lambda _, add: add(Diagnostics()).subscribe(), args)
