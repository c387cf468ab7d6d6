# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `fkm` publishes beside `orientation`: each output is computed while it has a subscriber."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from math import degrees
from typing import Any

from geometry_msgs.msg import (
    PoseStamped,
    PoseWithCovarianceStamped,
    Quaternion,
    TwistStamped,
)
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity
from spm_haptic_master.kinematics.estimation.sample_estimate import SampleEstimate
from spm_haptic_master.nodes.gripper import Gripper
from spm_haptic_master.parameters.fkm import VELOCITY_PERIODS
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.timing import StampGrid
from std_msgs.msg import Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout


class OrientationOutputs:
    """
    Publishes protection level, covariance and the CRTK topics of an orientation.

    The CRTK topics are `measured_cp`, `setpoint_cp`, `measured_cv`, `crtk/measured_js` and
    `gripper/measured_js`; they share the samples that are due at `crtk_rate`.

    Parameters
    ----------
    node : Node
        Node that publishes the orientation.
    values : mapping
        Checked values of `FKM_SETTINGS`.
    frame_id : str
        Frame of the orientation.
    supervisor : Supervisor
        Which sensors are unchecked, and by what their faults are bounded.

    Attributes
    ----------
    wanted : bool
        Whether any of them has a subscriber.
    effort : callable or None
        Returns the torque of each joint, N m; None on a device without force feedback.

    """

    def __init__(self, node: Node, values: Values, frame_id: str,
                 supervisor: Supervisor) -> None:
        self._node, self._supervisor = node, supervisor
        # A client may need the first message within 20 ms: do not wait for the next poll.
        self._matched = PublisherEventCallbacks(matched=lambda _: self.count_subscribers())
        names = ALL_JOINT_NAMES[:values['sensors']]
        # The messages of a sample share one header and one quaternion.
        self._header = Header(frame_id=frame_id)
        self._orientation = Quaternion()
        self._level = Float64MultiArray(layout=_level_layout(names))
        self._level_out = self._publisher(Float64MultiArray, 'protection_level')
        self._covariance, self._covariance_out = self._output(
            PoseWithCovarianceStamped, 'pose_with_covariance')
        self._covariance.pose.pose.orientation = self._orientation
        # The grid chooses the samples of the CRTK topics.
        self._grid = StampGrid(values['crtk_rate'], values['rate'])
        self._pose, self._pose_out = self._output(PoseStamped, 'measured_cp')
        self._pose.pose.orientation = self._orientation
        # An unpowered device is where it is commanded to be: clients ask for the setpoint, too.
        self._setpoint_out = self._publisher(PoseStamped, 'setpoint_cp')
        self._twist, self._twist_out = self._output(TwistStamped, 'measured_cv')
        window = max(values['velocity_window'], VELOCITY_PERIODS / values['rate'])
        self._velocity = AngularVelocity(round(window * SECOND))
        self._joints, self._joints_out = self._output(JointState, 'crtk/measured_js')
        self._joints.name = list(names)
        self._gripper = Gripper(
            node, values, self._header, self._publisher(JointState, 'gripper/measured_js'))
        self.effort: Callable[[], list[float]] | None = None
        self.wanted = self._level_wanted = self._covariance_wanted = self._crtk_wanted = False
        self._pose_wanted = self._setpoint_wanted = self._twist_wanted = False
        self._joints_wanted = self._gripper_wanted = False

    def _output(self, message_type: type, topic: str) -> tuple[Any, Publisher]:
        return message_type(header=self._header), self._publisher(message_type, topic)

    def _publisher(self, message_type: type, topic: str) -> Publisher:
        return self._node.create_publisher(
            message_type, topic, SAMPLES, event_callbacks=self._matched)

    def count_subscribers(self) -> None:
        """Find what is to be computed: call it at each poll; it is called for each new one."""
        self._level_wanted = self._level_out.get_subscription_count() > 0
        self._covariance_wanted = self._covariance_out.get_subscription_count() > 0
        self._pose_wanted = self._pose_out.get_subscription_count() > 0
        self._setpoint_wanted = self._setpoint_out.get_subscription_count() > 0
        self._twist_wanted = self._twist_out.get_subscription_count() > 0
        self._joints_wanted = self._joints_out.get_subscription_count() > 0
        self._gripper_wanted = self._gripper.is_wanted()
        self._crtk_wanted = self._pose_wanted or self._setpoint_wanted or self._twist_wanted \
            or self._joints_wanted or self._gripper_wanted
        self.wanted = self._level_wanted or self._covariance_wanted or self._crtk_wanted

    def publish(self, stamp: int, angles: Sequence[float], estimate: SampleEstimate,
                level: float) -> None:
        """
        Publish what has a subscriber and is due.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : sequence of N float
            Readings, rad; NaN of a sensor without a reading.
        estimate : SampleEstimate
            The orientation as published, with its covariance.
        level : float
            Its protection level, rad.

        """
        if self._level_wanted:
            self._level.data = array('d', (degrees(level), *self._supervisor.unchecked(),
                                           *map(degrees, self._supervisor.parts)))
            self._level_out.publish(self._level)
        if self._twist_wanted:
            self._velocity.add(stamp, estimate.quaternion)
        is_crtk_due = self._crtk_wanted and self._grid.is_due(stamp)
        if not (self._covariance_wanted or is_crtk_due):
            return
        time_of_sample, orientation = self._header.stamp, self._orientation
        time_of_sample.sec, time_of_sample.nanosec = divmod(stamp, SECOND)
        orientation.x, orientation.y, orientation.z, orientation.w = estimate.quaternion
        if self._covariance_wanted:
            self._publish_covariance(estimate.covariance)
        if is_crtk_due:
            self._publish_crtk(angles)

    def _publish_covariance(self, covariance: tuple[float, ...]) -> None:
        # Of the 6 x 6 matrix (x, y, z, rotations about the fixed x, y, z) the lower right block.
        field = self._covariance.pose.covariance
        field[21:24] = covariance[0:3]
        field[27:30] = covariance[3:6]
        field[33:36] = covariance[6:9]
        self._covariance_out.publish(self._covariance)

    def _publish_crtk(self, angles: Sequence[float]) -> None:
        if self._pose_wanted:
            self._pose_out.publish(self._pose)
        if self._setpoint_wanted:
            self._setpoint_out.publish(self._pose)
        if self._twist_wanted:
            velocity = self._velocity.value()
            if velocity is not None:
                angular = self._twist.twist.angular
                angular.x, angular.y, angular.z = velocity
                self._twist_out.publish(self._twist)
        if self._joints_wanted:
            self._joints.position = angles
            if self.effort is not None:
                self._joints.effort = self.effort()
            self._joints_out.publish(self._joints)
        if self._gripper_wanted:
            self._gripper.publish()


def _level_layout(names: Sequence[str]) -> MultiArrayLayout:
    """Return the labels of `protection_level`."""
    labels = ('protection_level_deg', *(f'unchecked_{name}_s' for name in names),
              *(f'bound_{name}_deg' for name in names))
    return MultiArrayLayout(dim=[MultiArrayDimension(
        label=', '.join(labels), size=len(labels), stride=len(labels))])
