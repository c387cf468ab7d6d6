# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `fkm` publishes beside `orientation`: each output is computed while it has a subscriber."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Collection, Sequence
from math import degrees, isfinite, radians

from geometry_msgs import msg as geometry
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState, Joy
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.mounting import IDENTITY
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import AngularVelocity
from spm_haptic_master.nodes.joint_reader import JointReader
from spm_haptic_master.parameters.axes import INSERTION
from spm_haptic_master.parameters.fkm import check_frames, NO_GRIPPER, VELOCITY_PERIODS
from spm_haptic_master.parameters.geometry import mounting_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.qos import EVENTS, SAMPLES, STATE
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.timing import SECOND, StampGrid
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout

# Topics that are computed for each sample.
LEVEL = 'protection_level'
COVARIANCE = 'pose_with_covariance'
# Topics of CRTK, which share the samples that are due at `crtk_rate`.
TWIST = 'measured_cv'
JOINTS = 'crtk/measured_js'
GRIPPER = 'gripper/measured_js'
# Topics with the pose of the handle.
POSES = ('measured_cp', 'setpoint_cp')
# Age of an insertion that belongs to an orientation: in periods, and for its way (s).
INSERTION_PERIODS = 3.0
INSERTION_WAY = 0.01
# Value of the setting of the gripper's axis without one.
NO_AXIS = -1
# Topic of static transforms, of all nodes: latched.
STATIC_TRANSFORMS = '/tf_static'


def publish_mounting(node: Node, values: Values) -> tuple[str, str]:
    """
    Publish the mounting for tf; return the frame of the outputs, and the mounting in words.

    The frame is that of the table if the base is mounted on one, else of the base. Without a
    mounting the words are empty. SettingError if two frames have the same name.
    """
    mounting = mounting_from(values)
    base = str(values['frame_id'])
    if mounting is None:
        return base, ''
    check_frames(values)
    table = values['mounting.table_frame_id']
    platform = values['mounting.platform_frame_id']
    handle = values['mounting.handle_frame_id']
    transforms = []
    if mounting.base != IDENTITY:
        transforms.append(
            _transform(
                node=node,
                parent=table,
                child=base,
                rotation=mounting.base,
            )
        )
    if mounting.handle != IDENTITY:
        transforms.append(
            _transform(
                node=node,
                parent=platform,
                child=handle,
                rotation=mounting.handle,
            )
        )
    parents = {each.child_frame_id: each.header.frame_id for each in transforms}
    reference = parents.get(base, base)
    mounted = [f'{child} on {parent}' for child, parent in parents.items()]
    text = ', '.join(mounted)
    try:
        # A message of ROS's own package, which the client library alone does not bring.
        from tf2_msgs.msg import TFMessage
    except ImportError:
        return reference, f'{text} (not on {STATIC_TRANSFORMS}: no tf2_msgs)'
    out = node.create_publisher(TFMessage, STATIC_TRANSFORMS, STATE)
    out.publish(TFMessage(transforms=transforms))
    return reference, text


def _transform(
    node: Node,
    parent: str,
    child: str,
    rotation: Quaternion[float],
) -> geometry.TransformStamped:
    """Return the message of a static transform from a frame to its parent."""
    found = geometry.TransformStamped(child_frame_id=child)
    found.header.frame_id = parent
    found.header.stamp = node.get_clock().now().to_msg()
    q = found.transform.rotation
    q.x, q.y, q.z, q.w = rotation
    return found


def _labelled(names: Sequence[str]) -> Float64MultiArray:
    """
    Return the message of the protection level, labelled for the joints.

    Parameters
    ----------
    names : sequence of str
        Names of the joints with sensors.

    Returns
    -------
    Float64MultiArray
        Without values; its only dimension is labelled with the names of all values: the protection
        level (deg), the time unchecked (s) of each joint, and the bound (deg) of each joint.

    """
    labels = [f'{LEVEL}_deg']
    labels += [f'unchecked_{name}_s' for name in names]
    labels += [f'bound_{name}_deg' for name in names]
    size = len(labels)
    dimension = MultiArrayDimension(label=', '.join(labels), size=size, stride=size)
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension]))


class OrientationOutputs:
    """
    Publishes protection level, covariance and the CRTK topics of an orientation.

    The gripper has the position of an axis of `gripper/joy`, or a constant one.

    Parameters
    ----------
    node : Node
        Node that publishes.
    values : mapping
        Checked settings of `fkm`.
    frame_id : str
        frame_id of all headers, as of `publish_mounting`.
    supervisor : Supervisor
        Knows the bounds of the sensors; the caller of `publish` holds the lock that guards it.

    Attributes
    ----------
    wanted : frozenset of str
        Topics with a subscriber.
    effort : callable or None
        Returns the torque of each joint, N m; None without force feedback.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        frame_id: str,
        supervisor: Supervisor,
    ) -> None:
        self._supervisor = supervisor
        names = ALL_JOINT_NAMES[: values['sensors']]
        # The messages of a sample share one header and one quaternion.
        self._header = Header(frame_id=frame_id)
        header = self._header
        self._orientation = geometry.Quaternion()
        self._level = _labelled(names)
        self._covariance = geometry.PoseWithCovarianceStamped(header=header)
        self._covariance.pose.pose.orientation = self._orientation
        pose = geometry.PoseStamped(header=header)
        pose.pose.orientation = self._orientation
        self._twist = geometry.TwistStamped(header=header)
        self._joints = JointState(header=header, name=list(names))
        self._gripper = JointState(header=header, name=['gripper'])
        # The setpoint of an unpowered device is its pose: clients ask for it.
        self._crtk = {
            'measured_cp': pose,
            'setpoint_cp': pose,
            TWIST: self._twist,
            JOINTS: self._joints,
            GRIPPER: self._gripper,
        }
        self._outs = self._make_publishers(node)
        self._position = pose.pose.position
        # Stamp, ns, and length, m, of the latest insertion; None before the first.
        self._insertion: tuple[int, float] | None = None
        longest = INSERTION_PERIODS / values['rate'] + INSERTION_WAY
        self._insertion_age = round(SECOND * longest)
        self._read_insertion = JointReader(INSERTION).read
        node.create_subscription(
            JointState, f'{INSERTION}/measured_js', self._take_insertion, SAMPLES, raw=True
        )
        self._grid = StampGrid(values['crtk_rate'], values['rate'])
        window = max(values['velocity_window'], VELOCITY_PERIODS / values['rate'])
        self._velocity = AngularVelocity(round(window * SECOND))
        self._axis: int = values['gripper.axis']
        self._closed, self._open = map(radians, values['gripper.range_deg'])
        self._begin_gripper(node, values)
        self.effort: Callable[[], list[float]] | None = None
        self.wanted: frozenset[str] = frozenset()

    def _make_publishers(self, node: Node) -> dict[str, Publisher]:
        """Return a publisher for each message, by topic."""
        # A client may need the first message within 20 ms, before the next poll.
        matched = PublisherEventCallbacks(matched=lambda _: self.count_subscribers())
        messages = {LEVEL: self._level, COVARIANCE: self._covariance, **self._crtk}
        publishers = {}
        for topic, message in messages.items():
            publishers[topic] = node.create_publisher(
                type(message), topic, SAMPLES, event_callbacks=matched
            )
        return publishers

    def _begin_gripper(self, node: Node, values: Values) -> None:
        """
        Set a constant angle of the gripper, or subscribe to the axis that has it.

        Parameters
        ----------
        node : Node
            Node that subscribes.
        values : mapping
            Checked settings of `fkm`; the angle of the gripper is in deg.

        """
        # Nothing is published without a constant angle, or before the first value of the axis.
        constant = values['gripper.position_deg']
        if self._axis == NO_AXIS and constant != NO_GRIPPER:
            self._gripper.position = [radians(constant)]
        elif self._axis != NO_AXIS:
            node.create_subscription(Joy, 'gripper/joy', self._take_gripper, EVENTS)

    def count_subscribers(self) -> None:
        """Find which topics have a subscriber: at each poll, and for each new subscriber."""
        wanted = set()
        for topic, out in self._outs.items():
            has_value = topic != GRIPPER or len(self._gripper.position) > 0
            if has_value and out.get_subscription_count() > 0:
                wanted.add(topic)
        self.wanted = frozenset(wanted)

    def publish(
        self,
        stamp: int,
        angles: Sequence[float],
        estimate: SampleEstimate,
        level: float,
    ) -> None:
        """
        Publish what has a subscriber and is due.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : sequence of float
            The sensors' angles, rad; NaN without a reading.
        estimate : SampleEstimate
            The orientation as published, with its covariance, rad^2.
        level : float
            Its protection level, rad.

        """
        wanted = self.wanted  # another thread may change it meanwhile
        if LEVEL in wanted:
            self._publish_level(level)
        if TWIST in wanted:
            self._velocity.add(stamp, estimate.quaternion)
        is_crtk_due = not wanted.isdisjoint(self._crtk) and self._grid.is_due(stamp)
        if not (COVARIANCE in wanted or is_crtk_due):
            return
        self._fill_header(stamp, estimate)
        if COVARIANCE in wanted:
            self._publish_covariance(estimate)
        if is_crtk_due:
            self._publish_crtk(stamp, wanted, angles)

    def _publish_level(self, level: float) -> None:
        """Publish the protection level, the times unchecked and the bound of each sensor."""
        bounds = map(degrees, self._supervisor.parts)
        unchecked = self._supervisor.unchecked()
        self._level.data = array('d', (degrees(level), *unchecked, *bounds))
        self._outs[LEVEL].publish(self._level)

    def _fill_header(self, stamp: int, estimate: SampleEstimate) -> None:
        """Set stamp (ns) and orientation, which the messages of a sample share."""
        time_of_sample = self._header.stamp
        time_of_sample.sec, time_of_sample.nanosec = divmod(stamp, SECOND)
        q = self._orientation
        q.x, q.y, q.z, q.w = estimate.quaternion

    def _publish_covariance(self, estimate: SampleEstimate) -> None:
        """Publish the pose with its covariance, rad^2 about the fixed axes."""
        # The lower right block of the 6 x 6 matrix (x, y, z, rotations about fixed x, y, z).
        field = self._covariance.pose.covariance
        block = estimate.covariance
        field[21:24] = block[0:3]
        field[27:30] = block[3:6]
        field[33:36] = block[6:9]
        self._outs[COVARIANCE].publish(self._covariance)

    def _publish_crtk(
        self,
        stamp: int,
        wanted: Collection[str],
        angles: Sequence[float],
    ) -> None:
        """
        Publish the topics of CRTK that have a subscriber.

        A pose whose position is not known, and a twist that is not known yet, are left out.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        wanted : collection of str
            Topics with a subscriber.
        angles : sequence of float
            The sensors' angles, rad; NaN without a reading.

        """
        for topic, message in self._crtk.items():
            if topic not in wanted:
                continue
            if topic == TWIST and not self._fill_twist():
                continue
            if topic in POSES and not self._fill_position(stamp):
                continue
            if topic == JOINTS:
                self._joints.position = angles
                if self.effort is not None:
                    self._joints.effort = self.effort()
            self._outs[topic].publish(message)

    def _fill_twist(self) -> bool:
        """Set the angular velocity in the base frame; return whether it is known."""
        velocity = self._velocity.value()
        if velocity is None:
            return False
        angular = self._twist.twist.angular
        angular.x, angular.y, angular.z = velocity
        return True

    def _take_insertion(self, data: bytes) -> None:
        """Keep an insertion and its stamp; a message without one changes nothing."""
        self._insertion = self._read_insertion(data) or self._insertion

    def _fill_position(self, stamp: int) -> bool:
        """
        Set the position: insertion times the handle's axis z in the base frame; 0 without one.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.

        Returns
        -------
        bool
            Whether the position is known: an insertion that was lost is no position.

        """
        if self._insertion is None:
            return True
        read_at, insertion = self._insertion
        if abs(stamp - read_at) > self._insertion_age:
            return False
        q = self._orientation
        position = self._position
        position.x = insertion * 2.0 * (q.x * q.z + q.w * q.y)
        position.y = insertion * 2.0 * (q.y * q.z - q.w * q.x)
        position.z = insertion * (1.0 - 2.0 * (q.x * q.x + q.y * q.y))
        return True

    def _take_gripper(self, joy: Joy) -> None:
        """
        Take the value of the axis; a message without a usable one changes nothing.

        Parameters
        ----------
        joy : Joy
            Its axis goes from -1, closed, to 1, open; beyond these it is cut.

        """
        if self._axis >= len(joy.axes):
            return
        deflection = joy.axes[self._axis]
        if not isfinite(deflection):
            return
        bounded = max(-1.0, min(1.0, deflection))
        share = 0.5 * (bounded + 1.0)
        angle = self._closed + share * (self._open - self._closed)
        self._gripper.position = [angle]
