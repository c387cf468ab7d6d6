# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The node of a simulated slave: an instrument wrist that follows `servo_cp` and nothing else."""

from __future__ import annotations

from math import degrees, exp, radians
import time

from geometry_msgs.msg import PoseStamped
from spm_haptic_master.kinematics import rotations
from spm_haptic_master.parameters.nodes import SLAVE_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.ros import runner
from spm_haptic_master.ros.diagnostic_status import OK, StatusPublisher, STEADY
from spm_haptic_master.ros.parameters import ParameterNode
from spm_haptic_master.ros.qos import SAMPLES
from spm_haptic_master.teleoperation.command_limits import unit_quaternion

# Longest time that the wrist moves in one step (s): a process that was stopped does not jump.
LONGEST_STEP = 0.05


class SimSlave(ParameterNode):
    """
    Publishes `slave/measured_cp` of a wrist that follows the last `servo_cp` with a lag.

    Like most slaves it obeys any rotation: a step of the command is a step of the slave.
    """

    def __init__(self, parameters: Parameters) -> None:
        super().__init__('sim_slave', parameters)
        values = self.declare(SLAVE_SETTINGS)
        self._rotation = self._commanded = rotations.zxz_quaternion(
            *map(radians, values['slave.pose_zxz_deg'])
        )
        self._time_constant = values['slave.time_constant']
        self._advanced = time.monotonic()
        self._commands = 0
        self._pose = PoseStamped()
        self._pose.header.frame_id = values['slave.frame_id']
        self._out = self.create_publisher(PoseStamped, 'slave/measured_cp', SAMPLES)
        self._status = StatusPublisher(self, 'tracking', 'simulated slave', logs=False)
        self.create_subscription(PoseStamped, 'servo_cp', self._on_command, SAMPLES)
        self.create_timer(1.0 / values['slave.rate'], self._advance, clock=STEADY)

    def _on_command(self, message: PoseStamped) -> None:
        q = message.pose.orientation
        if commanded := unit_quaternion((q.x, q.y, q.z, q.w)):
            self._commanded = commanded
            self._commands += 1

    def _advance(self) -> None:
        now = time.monotonic()
        x, y, z = rotations.vector_from_quaternion(
            *rotations.multiply_quaternions(self._commanded, rotations.conjugate(self._rotation))
        )
        # A lag of first order.
        part = 1.0 - exp(-min(now - self._advanced, LONGEST_STEP) / self._time_constant)
        moved = rotations.multiply_quaternions(
            rotations.quaternion_from_vector(part * x, part * y, part * z), self._rotation
        )
        # Without the rounding of the product.
        self._rotation = unit_quaternion(moved) or self._rotation
        self._advanced = now
        q = self._pose.pose.orientation
        q.x, q.y, q.z, q.w = self._rotation
        self._pose.header.stamp = self.get_clock().now().to_msg()
        self._out.publish(self._pose)
        if self._status.is_due(OK, 'following'):
            self._status.publish(
                OK,
                'following',
                {
                    'commands': self._commands,
                    'tracking error (deg)': degrees(
                        rotations.rotation_distance(self._rotation, self._commanded)
                    ),
                },
            )


def main(args: list[str] | None = None) -> int:
    """Run the node as a process."""
    return runner.run('sim_slave', lambda _, add: add(SimSlave), args)
