# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `teleop` publishes beside its commands: their angular velocity, the slave's torque."""

from __future__ import annotations

from geometry_msgs.msg import TwistStamped, WrenchStamped
from rclpy.node import Node
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.kinematics.vectors import times
from spm_haptic_master.nodes.factories import registration_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.qos import COMMANDS, WRENCHES
from spm_haptic_master.teleoperation.command_limits import FadingTwist
from spm_haptic_master.timing import SECOND

# Twists of zero at the end: MoveIt Servo stops at the first one that arrives.
ZEROS = 4
# Topics: of the slave, and of the master.
SLAVE_TOPIC, MASTER_TOPIC = 'slave/measured_cf', 'spatial/servo_cf'


class TwistOutput:
    """
    Publishes `delta_twist_cmds` while it has a subscriber.

    `acceleration` is that of the fading, rad/s^2, `period` that of the commands, s; all times are
    monotonic, s.
    """

    def __init__(self, node: Node, acceleration: float, period: float, now: float) -> None:
        self._out = node.create_publisher(TwistStamped, 'delta_twist_cmds', COMMANDS)
        self._message = TwistStamped()
        self._fading = FadingTwist(acceleration, ZEROS)
        self._period, self._passed = period, now

    def set_frame(self, frame: str) -> None:
        """Have the frame_id of the messages."""
        self._message.header.frame_id = frame

    def follow(self, stamp: int, velocity: Vector[float], now: float) -> None:
        """Publish the velocity of a command (rad/s) with its stamp (ns)."""
        self._publish(stamp, self._fading.follow(velocity, max(now - self._passed, self._period)))
        self._passed = now

    def fade(self, stamp: int, now: float) -> None:
        """Publish the velocity that is left, as long as it is not zero."""
        self._publish(stamp, self._fading.fade(now - self._passed))
        self._passed = now

    def _publish(self, stamp: int, velocity: Vector[float] | None) -> None:
        if velocity is None or not self._out.get_subscription_count():
            return
        header, angular = self._message.header, self._message.twist.angular
        header.stamp.sec, header.stamp.nanosec = divmod(stamp, SECOND)
        angular.x, angular.y, angular.z = velocity
        self._out.publish(self._message)


class SlaveTorque:
    """Publishes a share of the slave's torque: m_master = scale R_slave_master^T m_slave."""

    def __init__(self, node: Node, values: Values) -> None:
        self._node, self._scale = node, values['teleop.force_scale']
        self._rotation = rotation_from_quaternion(*conjugate(registration_from(values)))
        self._out = node.create_publisher(WrenchStamped, MASTER_TOPIC, WRENCHES)
        self._message = WrenchStamped()
        self.count = self.refused = 0

    def forward(self, message: WrenchStamped, frame: str | None) -> None:
        """Forward a torque of the slave, whose pose is in a frame, with its stamp."""
        given = message.header.frame_id
        if given and given != frame:
            if not self.refused:
                node_log.error(
                    self._node,
                    f'{SLAVE_TOPIC} is in frame {given!r}; expected '
                    f'{frame!r} as slave/measured_cp, or none',
                )
            self.refused += 1
            return
        torque, found = message.wrench.torque, self._message.wrench.torque
        x, y, z = times(self._rotation, (torque.x, torque.y, torque.z))
        found.x, found.y, found.z = self._scale * x, self._scale * y, self._scale * z
        self._message.header.stamp = message.header.stamp
        self._out.publish(self._message)
        self.count += 1
