# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The slave's torque for the hand, turned into the master's frame.

    m_hand = scale R_slave_master^T m_tip

m_tip is the torque about the tip in the slave's base frame. Slaves publish it as it is ('base'),
in the tool's frame ('tool', m_tip = R_s m), or about the origin of the base ('spatial', m_tip =
m - p_s x f, with the position p_s of the tip and the force f).
"""

from __future__ import annotations

from geometry_msgs.msg import Vector3, WrenchStamped
from rclpy.node import Node
from spm_haptic_master.kinematics.rotations import conjugate
from spm_haptic_master.kinematics.vectors import cross, scaled, subtracted
from spm_haptic_master.nodes.teleop_factory import registration_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import node_log
from spm_haptic_master.ros.qos import WRENCHES
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.vectors import FloatVector, rotate

# Topics: of the slave, and of the master.
SLAVE_TOPIC = 'slave/measured_cf'
MASTER_TOPIC = 'spatial/servo_cf'
TOOL = 'tool'
SPATIAL = 'spatial'


class SlaveTorque:
    """
    Publishes a share of the slave's torque; the caller decides when.

    Parameters
    ----------
    node
        Node that publishes `spatial/servo_cf`.
    values
        Checked settings of `teleop`: scale, frame of the torque, registration.

    Attributes
    ----------
    count, refused, invalid : int
        Torques that went on, that were in another frame, and that have no stamp.

    """

    def __init__(self, node: Node, values: Values) -> None:
        self._node = node
        self._scale: float = values['teleop.force_scale']
        self._frame: str = values['teleop.force_frame']
        self._accepts_unstamped: bool = values['teleop.slave_without_stamps']
        self._to_master = conjugate(registration_from(values))
        self._out = node.create_publisher(WrenchStamped, MASTER_TOPIC, WRENCHES)
        self._message = WrenchStamped()
        # Torques that went on, that were in another frame, and that the slave marked as invalid.
        self.count = 0
        self.refused = 0
        self.invalid = 0

    def forward(
        self,
        message: WrenchStamped,
        slave_frame: str | None,
        slave: Pose,
    ) -> None:
        """
        Forward a torque of the slave with its stamp, or count why not.

        Parameters
        ----------
        message
            Force, N, and torque, N m, that the slave measures.
        slave_frame
            frame_id of the slave's pose; None before the first pose.
        slave
            Measured pose of the slave.

        """
        stamp = message.header.stamp
        if not (stamp.sec or stamp.nanosec or self._accepts_unstamped):
            self.invalid += 1
            return
        if not self._is_in_frame(message.header.frame_id, slave_frame):
            return
        about_tip = self._torque_about_tip(message, slave)
        torque = rotate(self._to_master, about_tip)
        found = self._message.wrench.torque
        found.x, found.y, found.z = scaled(self._scale, torque)
        self._message.header.stamp = stamp
        self._out.publish(self._message)
        self.count += 1

    def _is_in_frame(self, given: str, expected: str | None) -> bool:
        """Return whether a frame_id is that of the slave's pose; a tool's frame has any name."""
        if self._frame == TOOL or given in ('', expected):
            return True
        if not self.refused:
            node_log.error(
                self._node,
                f'{SLAVE_TOPIC} is in frame {given!r}; expected '
                f'{expected!r} as slave/measured_cp, or none',
            )
        self.refused += 1
        return False

    def _torque_about_tip(self, message: WrenchStamped, slave: Pose) -> FloatVector:
        """
        Return m_tip in the slave's base frame, N m.

        Parameters
        ----------
        message : WrenchStamped
            Force, N, and torque, N m: in the frame of the tool, about the origin of the slave's
            base (`spatial`), or about the tip.
        slave : Pose
            Measured pose of the slave; position in m.

        """
        torque = components(message.wrench.torque)
        if self._frame == TOOL:
            return rotate(slave.rotation, torque)
        if self._frame == SPATIAL:
            force = components(message.wrench.force)
            return subtracted(torque, cross(slave.position, force))
        return torque


def components(vector: Vector3) -> FloatVector:
    """Return x, y, z of a vector or a point."""
    return vector.x, vector.y, vector.z
