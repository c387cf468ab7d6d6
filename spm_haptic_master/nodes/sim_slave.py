# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node of a simulated slave, which follows `servo_cp` and nothing else."""

from __future__ import annotations

from math import degrees, exp, radians
import time

from geometry_msgs.msg import PointStamped, PoseStamped
from sensor_msgs.msg import JointState
from spm_haptic_master.kinematics import rotations
from spm_haptic_master.kinematics.vectors import added, scaled
from spm_haptic_master.nodes.latest_angle import LatestAngle
from spm_haptic_master.nodes.slave_torque import components
from spm_haptic_master.nodes.teleop_factory import trocar_from
from spm_haptic_master.parameters.nodes import SLAVE_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros import node_log, runner
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher, STEADY, WARN
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES, STATE
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.remote_centre import (
    depth_of,
    distance_from_shaft,
    MILLIMETRES,
)
from spm_haptic_master.teleoperation.vectors import FloatVector, rotate, unit_quaternion, ZERO

# Longest time that the slave moves in one step (s): a process that was stopped does not jump.
LONGEST_STEP = 0.05
# Shaft of the laparoscopic slave in its tool's frame: z, from the trocar to the tip.
SHAFT: FloatVector = (0.0, 0.0, 1.0)
# Largest distance (m) of a commanded shaft from the trocar that the mechanism can follow.
REACH = 1e-6
# Age at which a commanded angle of the jaw is none any more (s).
JAW_TIMEOUT = 1e9


class SimSlave(ParameterNode):
    """
    Publishes `slave/measured_cp` of a slave that follows the last `servo_cp` with a lag.

    It is an instrument's wrist whose tip stays, or with `slave.trocar` a laparoscopic arm of four
    degrees of freedom: three rotations about the trocar, which it publishes on `slave/trocar`,
    and the depth. Like most slaves it obeys any command that it can reach: a step of the command
    is a step of the slave. A command whose shaft passes the trocar is refused.

    Parameters
    ----------
    parameters : Parameters
        Values from files and arguments; SettingError if one is invalid.

    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('sim_slave', parameters)
        values = self.declare(SLAVE_SETTINGS)
        self._rotation = self._commanded = rotations.zxz_quaternion(
            *map(radians, values['slave.pose_zxz_deg'])
        )
        self._frame = values['slave.frame_id']
        self._trocar = trocar_from(values, 'slave.trocar')
        # Depth of the tip below the trocar, m.
        self._depth = self._commanded_depth = float(values['slave.depth'])
        self._jaw = 0.0  # rad
        self._commanded_jaw = LatestAngle(JAW_TIMEOUT)
        self._time_constant = values['slave.time_constant']
        self._advanced = time.monotonic()
        self._commands = self._refused = 0
        self._pose = PoseStamped()
        self._pose.header.frame_id = self._frame
        self._out = self.create_publisher(PoseStamped, 'slave/measured_cp', SAMPLES)
        self._status = StatusPublisher(
            node=self,
            aspect='tracking',
            hardware_id='simulated slave',
            logs=False,
        )
        self.create_subscription(PoseStamped, 'servo_cp', self._on_command, SAMPLES)
        if self._trocar is not None:
            self._begin_laparoscopy(self._trocar)
        self.create_timer(1.0 / values['slave.rate'], self._advance, clock=STEADY)

    def _begin_laparoscopy(self, trocar: FloatVector) -> None:
        """
        Publish the trocar, and have an instrument with a jaw.

        Parameters
        ----------
        trocar : tuple of 3 float
            Position in the frame of the slave, m.

        """
        self._jaw_out = self.create_publisher(JointState, 'slave/jaw/measured_js', SAMPLES)
        self.create_subscription(
            JointState, 'slave/jaw/servo_jp', self._commanded_jaw.take, SAMPLES
        )
        message = PointStamped()
        message.header.frame_id = self._frame
        message.point.x, message.point.y, message.point.z = trocar
        self.create_publisher(PointStamped, 'slave/trocar', STATE).publish(message)

    def _on_command(self, message: PoseStamped) -> None:
        """Take a commanded pose, if it has a rotation and can be reached."""
        q = message.pose.orientation
        rotation = unit_quaternion((q.x, q.y, q.z, q.w))
        if rotation is None:
            return
        pose = Pose(rotation, components(message.pose.position))
        if self._trocar is not None and not self._is_reachable(self._trocar, pose):
            return
        self._commanded = rotation
        self._commands += 1

    def _is_reachable(self, trocar: FloatVector, pose: Pose) -> bool:
        """
        Take the depth of a commanded pose; return False if its shaft passes the trocar.

        Parameters
        ----------
        trocar : tuple of 3 float
            Position in the frame of the slave, m.
        pose : Pose
            Commanded pose of the tip in the same frame.

        Returns
        -------
        bool
            Whether the line of the shaft is at most REACH from the trocar.

        """
        distance = distance_from_shaft(trocar, pose, SHAFT)
        if not distance <= REACH:
            if not self._refused:
                node_log.warning(
                    self,
                    f'servo_cp refused: its shaft passes the trocar by '
                    f'{MILLIMETRES * distance:.1f} mm',
                )
            self._refused += 1
            return False
        self._commanded_depth = depth_of(trocar, pose)
        return True

    def _advance(self) -> None:
        """
        Move by what the time since the last call allows, and publish.

        The slave is a lag of first order with `slave.time_constant`.
        """
        now = time.monotonic()
        # A lag of first order.
        elapsed = min(now - self._advanced, LONGEST_STEP)
        share = 1.0 - exp(-elapsed / self._time_constant)
        self._advanced = now
        self._turn(share)
        self._depth += share * (self._commanded_depth - self._depth)
        commanded_jaw = self._commanded_jaw.at(now)
        if commanded_jaw is not None:
            self._jaw += share * (commanded_jaw - self._jaw)
        self._publish()

    def _turn(self, share: float) -> None:
        """
        Turn by a share of what the command is ahead.

        Parameters
        ----------
        share : float
            Share 0 .. 1 of the turn from the slave's rotation to the commanded one.

        """
        back = rotations.conjugate(self._rotation)
        turn = rotations.multiply_quaternions(self._commanded, back)
        ahead = rotations.vector_from_quaternion(*turn)
        step = rotations.quaternion_from_vector(*scaled(share, ahead))
        moved = rotations.multiply_quaternions(step, self._rotation)
        # Without the rounding of the product.
        self._rotation = unit_quaternion(moved) or self._rotation

    def _publish(self) -> None:
        """Publish the pose of the tip, and the angle of the jaw."""
        position = ZERO
        if self._trocar is not None:
            direction = rotate(self._rotation, SHAFT)
            position = added(self._trocar, scaled(self._depth, direction))
        stamp = self.get_clock().now().to_msg()
        pose = self._pose.pose
        pose.position.x, pose.position.y, pose.position.z = position
        q = pose.orientation
        q.x, q.y, q.z, q.w = self._rotation
        self._pose.header.stamp = stamp
        self._out.publish(self._pose)
        if self._trocar is not None:
            jaw = JointState(name=['jaw'], position=[self._jaw])
            jaw.header.stamp = stamp
            self._jaw_out.publish(jaw)
        self._report()

    def _report(self) -> None:
        """Publish the entry on /diagnostics."""
        level = OK
        text = 'following'
        if self._refused:
            level = WARN
            text = 'has refused commands whose shaft passes the trocar'
        if not self._status.is_due(level, text):
            return
        behind = rotations.rotation_distance(self._rotation, self._commanded)
        figures = {
            'commands': self._commands,
            'tracking error (deg)': degrees(behind),
        }
        if self._trocar is not None:
            figures['depth of the tip (mm)'] = MILLIMETRES * self._depth
            figures['commands refused'] = self._refused
        self._status.publish(level, text, figures)


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('sim_slave', lambda _, add: add(SimSlave), args)
