# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that turns each joint sample into the platform's orientation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import threading
import time

from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    TwistStamped,
)
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.meters import RateMeter
from spm_haptic_master.nodes import latency_status, runner
from spm_haptic_master.nodes.cdr import OrientationWriter, read_joints, SECOND
from spm_haptic_master.nodes.diagnostic_status import ERROR, Health, OK, STEADY, WARN
from spm_haptic_master.nodes.parameters import declare, FKM_SETTINGS
from spm_haptic_master.nodes.qos import SAMPLES, STATE
from spm_haptic_master.supervision.settings import make_supervisor

# s; how often the state is looked at for /diagnostics, and who listens.
HEALTH_PERIOD = 0.02
# Sample periods that the window of the angular velocity has at least: three samples, with jitter.
VELOCITY_PERIODS = 2.5


class Fkm(Node):
    """
    Publishes `orientation` as each joint sample comes, or nothing and why.

    After it, for those who listen: `measured_cp`, `pose_with_covariance`, `measured_cv`. A sample
    that is incomplete, misnamed, not finite, stale, out of order or inconsistent gives nothing.
    `state` tells, when it changes: starting, healthy, degraded: WHY, silent: WHY.

    Samples come by `take`, from a driver in the same process, or by `measured_js` after
    `subscribe`.

    Attributes
    ----------
    listener : callable or None
        Called with each `orientation`, serialized, once that is published.

    """

    def __init__(self):
        super().__init__('fkm')
        values = declare(self, FKM_SETTINGS)
        self._supervisor = make_supervisor(values)
        self._max_age = round(values['max_age'] * 1e9)
        self._sample_timeout = values['sample_timeout']
        self._clock = self.get_clock()
        self._see_clock()
        self.listener: Callable[[bytes], None] | None = None
        # Between the thread that brings samples and the one that tells of them.
        self._lock = threading.Lock()
        self.quaternion: tuple[float, float, float, float] | None = None
        self._received = RateMeter()
        self.timing = latency_status.Timing(self, values['rate'], values['latency_limit'])
        self._rejected: Counter[str] = Counter()
        self._rejection: RejectedError | None = None
        # Received and rejected at the last look, and when a sample last came.
        self._looked = (0, 0)
        self._heard: float | None = None
        self._state = String()
        self._state_out = self.create_publisher(String, 'state', STATE)
        self._health = Health(self, 'orientation', 'spherical parallel manipulator')
        window = max(values['velocity_window'], VELOCITY_PERIODS / values['rate'])
        self._make_outputs(values['frame_id'], round(window * 1e9))
        self.create_timer(HEALTH_PERIOD, self._look, clock=STEADY)
        self.create_timer(latency_status.PERIOD, self._tell_timing, clock=STEADY)

    def subscribe(self) -> None:
        """Take samples from `measured_js`."""
        self.create_subscription(
            JointState, 'measured_js', self._on_joints, SAMPLES, raw=True)

    def _make_outputs(self, frame_id: str, velocity_window: int) -> None:
        # One header and one quaternion for all: a sample's outputs have them in common.
        self._header = Header(frame_id=frame_id)
        self._orientation = Quaternion()

        def output(message_type, topic):
            return (message_type(header=self._header),
                    self.create_publisher(message_type, topic, SAMPLES))

        self._write_orientation = OrientationWriter(frame_id).write
        self._orientation_out = self.create_publisher(QuaternionStamped, 'orientation', SAMPLES)
        self._pose, self._pose_out = output(PoseStamped, 'measured_cp')
        self._covariance, self._covariance_out = output(
            PoseWithCovarianceStamped, 'pose_with_covariance')
        self._twist, self._twist_out = output(TwistStamped, 'measured_cv')
        self._pose.pose.orientation = self._orientation
        self._covariance.pose.pose.orientation = self._orientation
        self._velocity = AngularVelocity(velocity_window)
        self._pose_wanted = self._covariance_wanted = self._twist_wanted = False

    @property
    def state(self) -> str:
        """What /diagnostics says of the orientation."""
        return self._health.message

    def _on_joints(self, joints: bytes) -> None:
        try:
            stamp, angles = read_joints(joints)
        except RejectedError as rejection:
            with self._lock:
                self._received.count += 1
                self._reject(rejection)
            return
        self.take(stamp, angles)

    def take(self, stamp: int, angles: tuple[float, float, float, float]) -> None:
        """Publish the orientation of th1A, th1B, th1C, th3A (rad), sampled at `stamp` (ns)."""
        with self._lock:
            self._received.count += 1
            try:
                self._check_age(stamp)
                estimate = self._supervisor.take(stamp, angles)
            except RejectedError as rejection:
                self._reject(rejection)
            else:
                self._publish(stamp, estimate)

    def _reject(self, rejection: RejectedError) -> None:
        self._rejected[rejection.reason] += 1
        self._rejection = rejection

    def _publish(self, stamp: int, estimate: SampleEstimate) -> None:
        quaternion = estimate.quaternion
        orientation = self._write_orientation(stamp, quaternion)
        self._orientation_out.publish(orientation)
        self.timing.take(stamp, time.time_ns(), self._supervisor.parity)
        self.quaternion = quaternion
        if self.listener is not None:
            self.listener(orientation)
        if self._pose_wanted or self._covariance_wanted or self._twist_wanted:
            self._publish_others(stamp, estimate)

    def _check_age(self, stamp: int) -> None:
        """Refuse a sample that is not of now."""
        age = self._now() - stamp
        if not -self._max_age <= age <= self._max_age:
            raise RejectedError(
                'stale sample' if age > 0 else 'sample from the future',
                f'{age * 1e-9:.6f} s old, limit {self._max_age * 1e-9:g} s; '
                'are the clocks of two hosts apart?')

    def _publish_others(self, stamp: int, estimate: SampleEstimate) -> None:
        time_of_sample, orientation = self._header.stamp, self._orientation
        time_of_sample.sec, time_of_sample.nanosec = divmod(stamp, SECOND)
        orientation.x, orientation.y, orientation.z, orientation.w = estimate.quaternion
        if self._pose_wanted:
            self._pose_out.publish(self._pose)
        if self._covariance_wanted:
            self._publish_covariance(estimate.covariance)
        if self._twist_wanted:
            self._publish_twist(stamp)

    def _publish_covariance(self, covariance: tuple[float, ...]) -> None:
        # 6 x 6, x y z and rotations about the fixed x y z: the lower right block.
        field = self._covariance.pose.covariance
        field[21:24] = covariance[0:3]
        field[27:30] = covariance[3:6]
        field[33:36] = covariance[6:9]
        self._covariance_out.publish(self._covariance)

    def _publish_twist(self, stamp: int) -> None:
        self._velocity.add(stamp, self.quaternion)
        velocity = self._velocity.value()
        if velocity is None:
            return
        angular = self._twist.twist.angular
        angular.x, angular.y, angular.z = velocity
        self._twist_out.publish(self._twist)

    def _look(self) -> None:
        """See who listens, which clock holds, and judge what came since the last look."""
        self._see_clock()
        self._pose_wanted = self._pose_out.get_subscription_count() > 0
        self._covariance_wanted = self._covariance_out.get_subscription_count() > 0
        self._twist_wanted = self._twist_out.get_subscription_count() > 0
        with self._lock:
            self._judge()

    def _tell_timing(self) -> None:
        with self._lock:
            self.timing.tell()

    def _see_clock(self) -> None:
        """Read simulated time from the node's clock, the system's from where it is cheap."""
        self._now = self._ros_time if self._clock.ros_time_is_active else time.time_ns

    def _ros_time(self) -> int:
        return self._clock.now().nanoseconds

    def _judge(self) -> None:
        """Tell state and level, to /diagnostics and to `state`, when there is news."""
        now = time.monotonic()
        rejected = self._rejected.total()
        came = self._received.count - self._looked[0]
        refused = rejected - self._looked[1]
        self._looked = self._received.count, rejected
        if came:
            self._heard = now
        if self._heard is None:
            level, state = WARN, 'starting'
        elif now - self._heard > self._sample_timeout:
            level, state = ERROR, 'silent: no joint samples'
        elif not came:
            return  # a pause shorter than the time-out is no news
        elif refused < came:
            state = self._supervisor.state
            level = OK if state == 'healthy' else WARN
        elif self._rejection.reason == 'starting':
            level, state = WARN, 'starting'
        else:
            level, state = ERROR, f'silent: {self._rejection.reason}'
        if self._health.due(level, state):
            self._health.say(level, state, self._values())
        if state != self._state.data:
            self._state.data = state
            self._state_out.publish(self._state)

    def _values(self) -> dict[str, object]:
        values = {
            'sample rate (Hz)': self._received.rate(),
            'orientation rate (Hz)': self.timing.published.rate(),
            'samples rejected': self._rejected.total(),
            **{f'rejected: {reason}': count for reason, count in self._rejected.items()},
        }
        if self._rejection is not None:
            values['last rejected'] = str(self._rejection)
        if self._supervisor.parity is not None:
            values['parity (sigma)'] = self._supervisor.parity
        return values


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('fkm', lambda _, add: add(Fkm()).subscribe(), args)
