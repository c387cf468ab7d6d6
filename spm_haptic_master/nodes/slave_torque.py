# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The torque on the slave's instrument, on its way to the hand that leads it."""

from __future__ import annotations

from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from spm_haptic_master.force.statics import rotated
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.nodes.teleop_factory import registration_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.qos import WRENCHES

# Topics: of the slave, and of the master.
SLAVE_TOPIC, MASTER_TOPIC = 'slave/measured_cf', 'spatial/servo_cf'


class SlaveTorque:
    """
    Publishes a share of the slave's torque: m_master = scale R_slave_master^T m_slave.

    A turn of the hand turns the instrument about the same axis in space: so does the torque.
    """

    def __init__(self, node: Node, values: Values) -> None:
        self._node, self._scale = node, values['teleop.force_scale']
        self._rotation = rotation_from_quaternion(*conjugate(registration_from(values)))
        self._out = node.create_publisher(WrenchStamped, MASTER_TOPIC, WRENCHES)
        self._message = WrenchStamped()
        self.count = self.refused = 0

    def forward(self, message: WrenchStamped, frame: str | None) -> None:
        """Forward a torque of the slave, whose pose is in a frame; its stamp goes on with it."""
        given = message.header.frame_id
        if given and given != frame:
            if not self.refused:
                node_log.error(self._node, f'{SLAVE_TOPIC} is in frame {given!r}; expected '
                               f'{frame!r} as slave/measured_cp, or none')
            self.refused += 1
            return
        torque, found = message.wrench.torque, self._message.wrench.torque
        x, y, z = rotated(self._rotation, (torque.x, torque.y, torque.z))
        found.x, found.y, found.z = self._scale * x, self._scale * y, self._scale * z
        self._message.header.stamp = message.header.stamp
        self._out.publish(self._message)
        self.count += 1
