# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law, and the course of the slave by it: its alignment, within the limits of the command.

    R_cmd = R_m (R_m0^T R_s0)

R_m is the master's rotation now, R_m0 and R_s0 are master's and slave's when the offset was taken,
all in the slave's base frame. A turn of the master turns the slave by the same angle about the
same axis in space; a rotation is never scaled.
"""

from __future__ import annotations

from math import sqrt

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)
from spm_haptic_master.teleoperation.command_limits import CommandLimits, LimitedRotation, norm
from spm_haptic_master.timing import SECOND

# Offset that is none (rad): far below what any encoder resolves.
ALIGNED = 1e-9


class Following:
    """
    One course of the slave, from where master and slave are at a stamp, ns.

    With an `align_speed` above 0, rad/s, the offset between them shrinks to none.
    """

    def __init__(self, limits: CommandLimits, align_speed: float, master: Quaternion[float],
                 slave: Quaternion[float], stamp: int) -> None:
        self._limits = limits
        # The offset R_m0^T R_s0, from the master's handle to the slave's instrument.
        self._offset = multiply_quaternions(conjugate(master), slave)
        self._command = LimitedRotation(limits, slave)
        self._align_speed = align_speed
        # Speed at which the offset shrinks, rad/s; None where it does not.
        self._closing = 0.0 if align_speed else None
        # Stamp of the last command, ns.
        self.stamp = stamp

    @property
    def rotation(self) -> Quaternion[float]:
        """Return the slave's commanded rotation in its base frame."""
        return self._command.rotation

    @property
    def velocity(self) -> Vector[float]:
        """Return the angular velocity of the command in the slave's base frame, rad/s."""
        return self._command.velocity

    def advance(self, master: Quaternion[float], stamp: int) -> str:
        """Command what follows from an orientation of a stamp, ns; return the limit it breaks."""
        dt = (stamp - self.stamp) / SECOND
        left = norm(vector_from_quaternion(*self._offset))
        if self._closing is not None:
            self._shrink_offset(self._closing, left, dt)
        broken = self._command.advance(multiply_quaternions(master, self._offset), dt)
        if broken:
            return broken
        if self._closing is not None:
            # From where the command is: it may not have followed so fast.
            self._offset = multiply_quaternions(conjugate(master), self._command.rotation)
            self._closing = max(0.0, left - norm(vector_from_quaternion(*self._offset))) / dt
        self.stamp = stamp
        return ''

    def _shrink_offset(self, before: float, left: float, dt: float) -> None:
        """Shrink the offset that is left, rad; it shrank at the speed `before`, rad/s."""
        angle = left
        if left <= ALIGNED:
            self._closing = None
        else:
            a = self._limits.acceleration
            # After this step there is enough left to stop in: c dt + c^2 / 2a = left.
            braking = a * (sqrt(dt * dt + 2.0 * left / a) - dt)
            angle = min(self._align_speed, before + a * dt, braking) * dt
            self._command.restart()
        if left <= angle:
            self._offset = (0.0, 0.0, 0.0, 1.0)
            return
        part = 1.0 - angle / left
        x, y, z = vector_from_quaternion(*self._offset)
        self._offset = quaternion_from_vector(part * x, part * y, part * z)
