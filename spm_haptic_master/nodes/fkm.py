# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node that turns each joint sample into the platform's orientation."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable
from math import degrees, radians
import threading
import time
from typing import Any

from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    QuaternionStamped,
    TwistStamped,
)
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.geometry_settings import mechanism_checksum, mounting_from
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity
from spm_haptic_master.kinematics.number_backends import Quaternion as Quaternion4
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.meters import RateMeter
from spm_haptic_master.nodes import runner
from spm_haptic_master.nodes.calibration_status import CalibrationStatus
from spm_haptic_master.nodes.cdr import JointsFormat, OrientationWriter, SECOND
from spm_haptic_master.nodes.crtk_state import CrtkState
from spm_haptic_master.nodes.diagnostic_status import (
    CALIBRATION_KEY,
    CHECK_PERIOD,
    CHECKSUM_KEY,
    ERROR,
    MECHANISM,
    OK,
    REPEAT_PERIOD,
    RIVALS_PERIOD,
    StatusPublisher,
    STEADY,
    UNNAMED,
    WARN,
)
from spm_haptic_master.nodes.driver_watch import DriverWatch, host
from spm_haptic_master.nodes.gripper import Gripper
from spm_haptic_master.nodes.latency_status import LatencyStatus
from spm_haptic_master.nodes.mounting_frames import MountingFrames
from spm_haptic_master.nodes.parameters import ParameterNode
from spm_haptic_master.nodes.qos import SAMPLES, STATE
from spm_haptic_master.nodes.rivals import Rivals
from spm_haptic_master.overload import more_than, Overload, TOO_BUSY
from spm_haptic_master.resolver import Parameters
from spm_haptic_master.settings import Values
from spm_haptic_master.shared_settings import CALIBRATION_SETTING
from spm_haptic_master.stamp_grid import StampGrid
from spm_haptic_master.supervision.remedies import with_remedy
from spm_haptic_master.supervision.settings import (
    FKM_SETTINGS,
    make_supervisor,
    VELOCITY_PERIODS,
)
from spm_haptic_master.supervision.supervisor import Verified
from std_msgs.msg import (
    Float64MultiArray,
    Header,
    MultiArrayDimension,
    MultiArrayLayout,
    String,
)
from std_srvs.srv import Trigger

# Reason of the silence and its cure where a driver differs, by the key of its entry on
# /diagnostics.
DIFFERENCES = {
    CHECKSUM_KEY: ('another mechanism in the driver',
                   'give geometry.* and working_mode for all nodes, /**'),
    CALIBRATION_KEY: ('another calibration in the driver',
                      'give fkm the calibration file of the driver')}


class Fkm(ParameterNode):
    """
    Publishes `orientation` for each joint sample that passes the supervision.

    `pose_with_covariance` follows while it has subscribers, and so do `measured_cp`,
    `setpoint_cp`, `measured_cv`, `crtk/measured_js` and `gripper/measured_js`, at `crtk_rate`. A
    sample that is incomplete, misnamed, not finite, stale, out of order or inconsistent is
    rejected, and nothing is published for it. `state` is published when it changes: starting,
    healthy, degraded: WHY, silent: WHY; the operating state follows it.

    A driver in the same process passes samples to `take`; after `subscribe` they come from the
    topic `measured_js`.

    Attributes
    ----------
    listener : callable or None
        Called with each `orientation`, serialized, once that is published.
    follower : callable or None
        Called with stamp (ns), quaternion x, y, z, w and protection level (rad) of each
        `orientation`, once that is published: before any other output.
    quaternion : tuple of 4 float or None
        Orientation published last, x, y, z, w, as mounted; None before the first.
    protection_level : float or None
        Of the orientation published last, rad; None before the first.
    caution : str
        What should be investigated although orientations are published; empty if nothing.
    latency_status : LatencyStatus
        Rate and latency of the orientations.
    driver_overload : callable
        Returns the words of a driver of this machine that loses time; empty if none does.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('fkm', parameters)
        values = self.declare(FKM_SETTINGS)
        self._supervisor = make_supervisor(values)
        self._calibration = CalibrationStatus(self._supervisor, values)
        self._joints = ALL_JOINT_NAMES[:values['sensors']]
        self._read_joints = JointsFormat(len(self._joints)).read
        self._mechanism = mechanism_checksum(values)
        self._mounting = mounting_from(values)
        self._frames = MountingFrames(self, values)
        # Where the samples come from the topic: what has to be the same in their driver.
        self._shared = {CHECKSUM_KEY: self._mechanism,
                        CALIBRATION_KEY: values[CALIBRATION_SETTING.name] or UNNAMED}
        self._watch: DriverWatch | None = None
        self._hosts = {host()}
        self._rivals = Rivals(self, 'orientation', 'measured_js')
        self._overload = Overload(CHECK_PERIOD)
        self.driver_overload: Callable[[], str] = str
        self._max_age = round(values['max_age'] * SECOND)
        self._sample_timeout = values['sample_timeout']
        self._clock: Any = self.get_clock()
        self._select_clock()
        self.listener: Callable[[bytes], None] | None = None
        self.follower: Callable[[int, Quaternion4[float], float], None] | None = None
        # Guards all below: shared by the thread of the samples and the timers.
        self._lock = threading.Lock()
        self.quaternion: Quaternion4[float] | None = None
        self.protection_level: float | None = None
        self.caution = ''
        self._received = RateMeter()
        self.latency_status = LatencyStatus(self, values['rate'], values['latency_limit'])
        self._rejected: Counter[str] = Counter()
        self._rejection: RejectedError | None = None
        # Samples received and rejected until the last poll, and when one last came (s, monotonic).
        self._polled = (0, 0)
        self._last_received: float | None = None
        self._state = String()
        self._state_out = self.create_publisher(String, 'state', STATE)
        self._status = StatusPublisher(self, 'orientation', MECHANISM)
        # Why no sample can be taken, whatever it is (reason and detail: more than one source of
        # samples or orientations, another mechanism or calibration in the driver), and when to
        # poll it again.
        self._obstacle: tuple[str, str] | None = None
        self._find_obstacle_at = 0.0
        window = max(values['velocity_window'], VELOCITY_PERIODS / values['rate'])
        self._make_outputs(self._frames.reference, round(window * SECOND))
        self._make_crtk_outputs(values)
        self.create_service(Trigger, '~/acknowledge', self._acknowledge)
        self.on_change(FKM_SETTINGS, self._apply)
        self.create_timer(CHECK_PERIOD, self._poll, clock=STEADY)
        self.create_timer(REPEAT_PERIOD, self._publish_latency, clock=STEADY)

    def destroy_node(self) -> None:
        """Publish the end to what drives a slave, and destroy the node."""
        self._crtk.end()
        super().destroy_node()

    def subscribe(self) -> None:
        """Take samples from the topic `measured_js`."""
        self._watch = DriverWatch(self, self._shared)
        self._hosts = set()
        self.driver_overload = self._watch.overload
        self.create_subscription(
            JointState, 'measured_js', self._on_joints, SAMPLES, raw=True)

    def _apply(self, changed: Values) -> None:
        if 'alert_limit_deg' in changed:
            with self._lock:
                self._supervisor.alert_limit = radians(changed['alert_limit_deg'])

    def _acknowledge(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Allow a fault to clear that only a person may clear: two sensors that jumped."""
        with self._lock:
            response.success = self._supervisor.acknowledge()
        response.message = 'acknowledged: consistent samples clear the fault' \
            if response.success else 'no fault waits for an acknowledgement'
        return response

    def _make_outputs(self, frame_id: str, velocity_window: int) -> None:
        # The outputs of a sample share one header and one quaternion.
        self._header = Header(frame_id=frame_id)
        self._orientation = Quaternion()

        def output(message_type: type, topic: str) -> tuple[Any, Publisher]:
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
        labels = ('protection_level_deg', *(f'unchecked_{name}_s' for name in self._joints))
        self._level = Float64MultiArray(layout=MultiArrayLayout(dim=[
            MultiArrayDimension(label=', '.join(labels), size=len(labels), stride=len(labels))]))
        self._level_out = self.create_publisher(Float64MultiArray, 'protection_level', SAMPLES)
        self._covariance_wanted = self._level_wanted = False

    def _make_crtk_outputs(self, values: Values) -> None:
        # Of the CRTK topics, which share the stamp of a sample; the grid chooses the sample.
        self._crtk = CrtkState(self, self._frames.reference)
        self._crtk_grid = StampGrid(values['crtk_rate'], values['rate'])
        # An unpowered device is where it is commanded to be: clients ask for the setpoint, too.
        self._setpoint_out = self.create_publisher(PoseStamped, 'setpoint_cp', SAMPLES)
        self._joint_state = JointState(header=self._header, name=list(self._joints))
        self._joint_state_out = self.create_publisher(JointState, 'crtk/measured_js', SAMPLES)
        self._gripper = Gripper(self, values, self._header)
        self._crtk_wanted = self._pose_wanted = self._setpoint_wanted = False
        self._twist_wanted = self._joint_state_wanted = self._gripper_wanted = False

    @property
    def state(self) -> str:
        """State of the orientation, as on the topic `state`; empty before the first."""
        return str(self._state.data)

    def _on_joints(self, joints: bytes) -> None:
        try:
            stamp, angles = self._read_joints(joints)
        except RejectedError as rejection:
            with self._lock:
                self._received.count += 1
                self._reject(rejection)
            return
        self.take(stamp, angles)

    def take(self, stamp: int, angles: tuple[float, ...]) -> None:
        """Publish the orientation of the sensors' angles (rad), sampled at `stamp` (ns)."""
        with self._lock:
            self._received.count += 1
            try:
                if self._obstacle is not None:
                    raise RejectedError(*self._obstacle)
                self._check_age(stamp)
                verified = self._supervisor.take(stamp, angles)
            except RejectedError as rejection:
                self._reject(rejection)
            else:
                self._publish(stamp, angles, verified)

    def _reject(self, rejection: RejectedError) -> None:
        self._rejected[rejection.reason] += 1
        self._rejection = rejection

    def _publish(self, stamp: int, angles: tuple[float, ...], verified: Verified) -> None:
        estimate = verified.estimate
        if self._mounting is not None:
            estimate = self._mounting.applied(estimate)
        quaternion = estimate.quaternion
        orientation = self._write_orientation(stamp, quaternion)
        self._orientation_out.publish(orientation)
        published = time.time_ns()
        if self.follower is not None:
            self.follower(stamp, quaternion, verified.protection_level)
        # The supervisor has a parity since the first sample that it has not rejected.
        self.latency_status.add(
            stamp, published, self._supervisor.parity)  # type: ignore[arg-type]
        self.quaternion = quaternion
        self.protection_level = verified.protection_level
        if self.listener is not None:
            self.listener(orientation)
        if self._level_wanted:
            self._publish_level(verified.protection_level)
        if self._covariance_wanted or self._crtk_wanted:
            self._publish_others(stamp, angles, estimate)

    def _check_age(self, stamp: int) -> None:
        """Reject a sample older than `max_age`, or from the future by as much."""
        age = self._now() - stamp
        if not -self._max_age <= age <= self._max_age:
            is_local = self._hosts == {host()} and not self._clock.ros_time_is_active
            if age > 0 and is_local:
                raise RejectedError(TOO_BUSY, f'a sample is {more_than(age / SECOND)} old, '
                                    f'limit {self._max_age / SECOND:g} s')
            raise RejectedError(
                'stale sample' if age > 0 else 'sample from the future',
                f'{age / SECOND:.6f} s old, limit {self._max_age / SECOND:g} s'
                + ('; are the clocks of the two hosts synchronized?'
                   if self._hosts - {host()} else ''))

    def _publish_others(self, stamp: int, angles: tuple[float, ...],
                        estimate: SampleEstimate) -> None:
        if self._twist_wanted:
            self._velocity.add(stamp, estimate.quaternion)
        is_crtk_due = self._crtk_wanted and self._crtk_grid.is_due(stamp)
        if not (self._covariance_wanted or is_crtk_due):
            return
        time_of_sample, orientation = self._header.stamp, self._orientation
        time_of_sample.sec, time_of_sample.nanosec = divmod(stamp, SECOND)
        orientation.x, orientation.y, orientation.z, orientation.w = estimate.quaternion
        if self._covariance_wanted:
            self._publish_covariance(estimate.covariance)
        if not is_crtk_due:
            return
        if self._pose_wanted:
            self._pose_out.publish(self._pose)
        if self._setpoint_wanted:
            self._setpoint_out.publish(self._pose)
        if self._twist_wanted:
            self._publish_twist()
        if self._joint_state_wanted:
            self._joint_state.position = angles
            self._joint_state_out.publish(self._joint_state)
        if self._gripper_wanted:
            self._gripper.publish()

    def _publish_level(self, level: float) -> None:
        self._level.data = array('d', (degrees(level), *self._supervisor.unchecked()))
        self._level_out.publish(self._level)

    def _publish_covariance(self, covariance: tuple[float, ...]) -> None:
        # Of the 6 x 6 matrix (x, y, z, rotations about the fixed x, y, z) the lower right block.
        field = self._covariance.pose.covariance
        field[21:24] = covariance[0:3]
        field[27:30] = covariance[3:6]
        field[33:36] = covariance[6:9]
        self._covariance_out.publish(self._covariance)

    def _publish_twist(self) -> None:
        velocity = self._velocity.value()
        if velocity is None:
            return
        angular = self._twist.twist.angular
        angular.x, angular.y, angular.z = velocity
        self._twist_out.publish(self._twist)

    def _poll(self) -> None:
        """Update the clock and the subscribed outputs, and evaluate the samples since then."""
        self._select_clock()
        self._covariance_wanted = self._covariance_out.get_subscription_count() > 0
        self._level_wanted = self._level_out.get_subscription_count() > 0
        self._pose_wanted = self._pose_out.get_subscription_count() > 0
        self._setpoint_wanted = self._setpoint_out.get_subscription_count() > 0
        self._twist_wanted = self._twist_out.get_subscription_count() > 0
        self._joint_state_wanted = self._joint_state_out.get_subscription_count() > 0
        self._gripper_wanted = self._gripper.is_wanted()
        self._crtk_wanted = self._pose_wanted or self._setpoint_wanted or self._twist_wanted \
            or self._joint_state_wanted or self._gripper_wanted
        self._overload.tick(time.monotonic(), reported=self.driver_overload())
        self.latency_status.busy = self._overload.words or self.latency_status.busy
        obstacle = self._find_obstacle()
        with self._lock:
            self._obstacle = obstacle
            self._evaluate()
        self._crtk.take(self.state)

    def _find_obstacle(self) -> tuple[str, str] | None:
        """Return reason and detail of what forbids any orientation, polled now and then."""
        now = time.monotonic()
        if now < self._find_obstacle_at:
            return self._obstacle
        self._find_obstacle_at = now + RIVALS_PERIOD
        rivals = self._rivals.found()
        if rivals is not None:
            return rivals, 'expected one'
        if self._watch is not None:
            self._hosts = self._watch.hosts()
        difference = None if self._watch is None else self._watch.difference()
        if difference is None:
            return None
        reason, cure = DIFFERENCES[difference.key]
        return reason, (f'{difference.driver} has {difference.found}, expected '
                        f'{difference.expected}: {cure}')

    def _publish_latency(self) -> None:
        with self._lock:
            self.latency_status.publish()
            self._calibration.poll()

    def _select_clock(self) -> None:
        """Read simulated time from the node's clock, but system time by the cheaper call."""
        self._now: Callable[[], int] = \
            self._ros_time if self._clock.ros_time_is_active else time.time_ns

    def _ros_time(self) -> int:
        nanoseconds: int = self._clock.now().nanoseconds
        return nanoseconds

    def _evaluate(self) -> None:
        """Derive state and level from the samples since the last poll, and publish changes."""
        now = time.monotonic()
        total_rejected = self._rejected.total()
        received = self._received.count - self._polled[0]
        rejected = total_rejected - self._polled[1]
        self._polled = self._received.count, total_rejected
        if received:
            self._last_received = now
        caution: dict[str, str] = {}
        if self._obstacle is not None:
            level, state = ERROR, f'silent: {self._obstacle[0]}'
        elif self._last_received is None:
            level, state = WARN, 'starting'
        elif now - self._last_received > self._sample_timeout:
            level, state = ERROR, 'silent: no joint samples'
        elif not received:
            return  # a pause shorter than the time-out changes nothing
        elif self._rejection is None or rejected < received:
            state = self._supervisor.state
            level = OK if state == 'healthy' else WARN
            caution = self._supervisor.cautions() | self._calibration.cautions()
        elif self._rejection.reason == 'starting':
            level, state = WARN, 'starting'
        else:
            level, state = ERROR, f'silent: {self._rejection.reason}'
        state, message = self._named(level, state)
        logged = level, message
        message = with_remedy(message)
        self.caution = ', '.join(caution.values())
        if caution and level == OK:
            level, message = WARN, f'{state}; {self.caution}'
        # The figures in a caution grow; which sensors it names is what changes.
        change = state + ', '.join(caution)
        if self._status.is_due(level, change):
            self._status.publish(level, message, self._figures(), change, logged)
        if state != self._state.data:
            self._state.data = state
            self._state_out.publish(self._state)

    def _named(self, level: bytes, state: str) -> tuple[str, str]:
        """Return state and message: where the machine is too busy, that is what they say."""
        symptom = state if level == ERROR and self._obstacle is None else ''
        if self._overload.explains(symptom):
            return f'silent: {TOO_BUSY}', f'silent: {self._overload.words}'
        if state == f'silent: {TOO_BUSY}':
            return state, f'silent: {self._rejection}'
        return state, state

    def _figures(self) -> dict[str, object]:
        figures: dict[str, object] = {
            CHECKSUM_KEY: self._mechanism,
            'sample rate (Hz)': self._received.rate(),
            'orientation rate (Hz)': self.latency_status.published.rate(),
            'samples rejected': self._rejected.total(),
            **{f'rejected: {reason}': count for reason, count in self._rejected.items()},
        }
        if self._frames.text:
            figures['mounting'] = self._frames.text
        if self._rejection is not None:
            figures['last rejected'] = str(self._rejection)
        if self._supervisor.parity is not None:
            figures['parity (sigma)'] = self._supervisor.parity
        figures |= self._calibration.figures()
        if self.protection_level is not None:
            figures['protection level (deg)'] = degrees(self.protection_level)
        for name, noise, unchecked in zip(
                self._joints, self._supervisor.noise(), self._supervisor.unchecked(), strict=True):
            figures[f'{name} noise (deg)'] = degrees(noise)
            figures[f'{name} unchecked (s)'] = unchecked
        return figures


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('fkm', lambda _, add: add(Fkm).subscribe(), args)
