"""The node that turns each joint sample into the platform's orientation."""

from __future__ import annotations

from collections import Counter
from math import isfinite
import time

from geometry_msgs.msg import QuaternionStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState

from spm_haptic_master.encoders.sample import JOINT_NAMES
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics import theta3a_quaternion
from spm_haptic_master.manipulator import geometry_from
from spm_haptic_master.nodes import process
from spm_haptic_master.nodes.health import ERROR, Health, OK, WARN
from spm_haptic_master.nodes.meters import LatencyMeter, RateMeter
from spm_haptic_master.nodes.parameters import declare, FKM_SETTINGS
from spm_haptic_master.nodes.qos import SAMPLES

NAMES = list(JOINT_NAMES)
# s; how often the state is looked at for /diagnostics.
HEALTH_PERIOD = 0.02


class Fkm(Node):
    """
    Publishes `orientation` in the callback of each `measured_js`, or nothing and why.

    The forward model is the paper's Case 2 (eqs. 15 and 16). A sample that is incomplete,
    misnamed, not finite, stale, out of order or inconsistent gives no orientation.
    """

    def __init__(self):
        super().__init__('fkm')
        values = declare(self, FKM_SETTINGS)
        self._geometry = geometry_from(values)
        self._max_age = round(values['max_age'] * 1e9)
        self._timeout = values['sample_timeout']
        self._message = QuaternionStamped()
        self._message.header.frame_id = values['frame_id']
        self.quaternion: tuple[float, float, float, float] | None = None
        self._stamp = 0
        self._received = RateMeter()
        self._published = RateMeter()
        self.latency = LatencyMeter()
        self._rejected: Counter[str] = Counter()
        self._reason = ''
        self._detail = ''
        # Received and rejected at the last look, and when a sample last came; None before any did.
        self._looked = (0, 0)
        self._heard: float | None = None
        self._health = Health(self, 'orientation', 'spherical parallel manipulator')
        self._publisher = self.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
        self.create_timer(HEALTH_PERIOD, self._report)
        self.create_subscription(JointState, 'measured_js', self._on_joints, SAMPLES)

    @property
    def rate(self) -> float:
        """Orientations published a second."""
        return self._published.rate()

    @property
    def level(self) -> bytes:
        """Level of its entry on /diagnostics."""
        return self._health.level

    @property
    def state(self) -> str:
        """What /diagnostics says of the orientation."""
        return self._health.message

    def _on_joints(self, joints: JointState) -> None:
        self._received.count += 1
        header = joints.header.stamp
        stamp = header.sec * 1_000_000_000 + header.nanosec
        age = self.get_clock().now().nanoseconds - stamp
        position = joints.position
        if joints.name != NAMES:
            return self._reject('misnamed sample', f'{joints.name}, expected {NAMES}')
        if len(position) != 4:
            return self._reject('incomplete sample', f'{len(position)} positions, expected 4')
        th1a, th1b, th1c, th3a = position
        # One sum is finite only where all four are.
        if not isfinite(th1a + th1b + th1c + th3a):
            return self._reject('angle not finite', str(list(position)))
        if stamp <= self._stamp:
            return self._reject('sample not newer than the last',
                                f'{(self._stamp - stamp) * 1e-9:.6f} s older')
        if not -self._max_age <= age <= self._max_age:
            return self._reject('stale sample' if age > 0 else 'sample from the future',
                                f'{age * 1e-9:.6f} s old, clocks of two hosts apart?')
        try:
            x, y, z, w = theta3a_quaternion(th1a, th1b, th1c, th3a, self._geometry)
        except SpmError as error:
            return self._reject(type(error).__name__, str(error))
        last = self.quaternion
        if (w < 0.0) if last is None else \
                (x * last[0] + y * last[1] + z * last[2] + w * last[3] < 0.0):
            x, y, z, w = -x, -y, -z, -w
        message = self._message
        message.header.stamp = header
        quaternion = message.quaternion
        quaternion.x, quaternion.y, quaternion.z, quaternion.w = x, y, z, w
        self._publisher.publish(message)
        self.latency.add(time.time_ns() - stamp)
        self.quaternion = (x, y, z, w)
        self._stamp = stamp
        self._published.count += 1

    def _reject(self, reason: str, detail: str) -> None:
        """Give no orientation, and remember why for /diagnostics."""
        self._rejected[reason] += 1
        self._reason, self._detail = reason, detail

    def _report(self) -> None:
        """Judge what came since the last look."""
        now = time.monotonic()
        rejected = self._rejected.total()
        came = self._received.count - self._looked[0]
        refused = rejected - self._looked[1]
        self._looked = self._received.count, rejected
        if came:
            self._heard = now
        if self._heard is None:
            level, text = WARN, 'starting: no joint sample yet'
        elif now - self._heard > self._timeout:
            level, text = ERROR, 'silent: no joint samples'
        elif not came:
            return  # a pause shorter than the time-out is no news
        elif not refused:
            level, text = OK, 'publishing'
        elif refused < came:
            level, text = WARN, f'some samples rejected: {self._reason}'
        else:
            level, text = ERROR, f'silent: {self._reason}'
        if self._health.due(level, text):
            self._health.say(level, text, self._values())

    def _values(self) -> dict[str, object]:
        values = {
            'sample rate (Hz)': self._received.rate(),
            'orientation rate (Hz)': self.rate,
            'samples rejected': self._rejected.total(),
            **{f'rejected: {reason}': count for reason, count in self._rejected.items()},
        }
        if self._detail:
            values['last rejected'] = f'{self._reason}: {self._detail}'
        percentiles = self.latency.percentiles(0.5, 0.99)
        if percentiles:
            values['latency p50 (us)'], values['latency p99 (us)'] = percentiles
        return values


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return process.run('fkm', lambda _, add: add(Fkm()), args)
