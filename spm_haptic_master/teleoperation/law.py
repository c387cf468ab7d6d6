# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The law: how the slave's commanded rotation follows from the master's.

    R_cmd = R_m (R_m0^T R_s0)

R_m is the master's rotation now, R_m0 and R_s0 are master's and slave's when the offset was taken,
all in the slave's base frame. A turn of the master turns the slave by the same angle about the
same axis in space; a rotation is never scaled.
"""

from __future__ import annotations

from math import atan2, pi, sqrt, tau

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)

# Largest deviation of a pose's squared norm from 1 (unit 1): a controller in single precision
# passes, a quaternion of zeros or of other numbers does not.
NORM_TOLERANCE = 1e-3


def unit_quaternion(quaternion: Quaternion[float]) -> Quaternion[float] | None:
    """Return a quaternion of norm 1; None for one that is not finite or too far from it."""
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    # Also false where a component is not a number.
    if not abs(square - 1.0) < NORM_TOLERANCE:
        return None
    scale = 1.0 / sqrt(square)
    return scale * x, scale * y, scale * z, scale * w


class Offset:
    """The rotation R_m0^T R_s0 from the master's handle to the slave's instrument."""

    def __init__(self, master: Quaternion[float], slave: Quaternion[float]) -> None:
        self._quaternion = multiply_quaternions(conjugate(master), slave)

    @property
    def vector(self) -> Vector[float]:
        """Return the offset as a rotation vector in the handle's frame, rad."""
        return vector_from_quaternion(*self._quaternion)

    @property
    def angle(self) -> float:
        """Return the angle of the offset, rad in [0, pi]."""
        x, y, z = self.vector
        return sqrt(x * x + y * y + z * z)

    def command(self, master: Quaternion[float]) -> Quaternion[float]:
        """Return the commanded rotation of the slave for a rotation R_m of the master."""
        return multiply_quaternions(master, self._quaternion)

    def shrink(self, angle: float) -> None:
        """Take up to `angle`, rad, off the offset: at 0 slave and master are aligned."""
        left = self.angle
        if left <= angle:
            self._quaternion = (0.0, 0.0, 0.0, 1.0)
            return
        x, y, z = self.vector
        part = 1.0 - angle / left
        self._quaternion = quaternion_from_vector(part * x, part * y, part * z)


class Roll:
    """How far the handle has rolled about its own z axis, to and fro, since the first rotation."""

    def __init__(self) -> None:
        self._first: Quaternion[float] | None = None
        self._angle = self._least = self._largest = 0.0

    @property
    def extent(self) -> float:
        """Return the difference of the largest and the smallest roll, rad."""
        return self._largest - self._least

    def add(self, rotation: Quaternion[float]) -> None:
        """Add a rotation of the handle, as a unit quaternion x, y, z, w."""
        if self._first is None:
            self._first = rotation
            return
        _, _, z, w = multiply_quaternions(conjugate(self._first), rotation)
        # The twist about z of the rotation since the first, on the branch of the last one.
        turn = (2.0 * atan2(z, w) - self._angle) % tau
        self._angle += turn - tau if turn > pi else turn
        self._least = min(self._least, self._angle)
        self._largest = max(self._largest, self._angle)
