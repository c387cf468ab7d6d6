# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The cone about the shaft's direction at engaging, in which the shaft has to stay."""

from __future__ import annotations

from math import acos, atan2, cos

from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector
from spm_haptic_master.kinematics.vectors import cross, dot, scaled
from spm_haptic_master.teleoperation.vectors import FloatQuaternion, FloatVector, norm, rotate


class TiltCone:
    """
    The rotations whose shaft is tilted by `largest` at most.

    Parameters
    ----------
    shaft
        Unit vector u in the tool's frame, from the trocar to the tip.
    axis
        Direction a = R_s0 u at engaging, unit vector in the slave's base frame.
    largest
        Largest tilt, rad, below pi / 2.

    """

    def __init__(
        self,
        shaft: FloatVector,
        axis: FloatVector,
        largest: float,
    ) -> None:
        self._shaft = shaft
        self._axis = axis
        self.largest = largest
        self._least_cosine = cos(largest)
        # a . u and u x a, of which the cosine is made.
        self._aligned = dot(axis, shaft)
        self._normal = cross(shaft, axis)

    def tilt(self, rotation: FloatQuaternion) -> float:
        """Return the angle between the shaft R u and the axis, rad in [0, pi]."""
        # Below 1e-8 rad it is rounding: far from any cone, and close to one it is exact.
        return acos(max(-1.0, min(self._cosine(rotation), 1.0)))

    def contains(self, rotation: FloatQuaternion) -> bool:
        """Return whether the tilt of a rotation is `largest` at most."""
        return self._cosine(rotation) >= self._least_cosine

    def within(self, rotation: FloatQuaternion, angle: float) -> FloatQuaternion:
        """Return the rotation, turned back towards the axis as far as its tilt exceeds `angle`."""
        direction = rotate(rotation, self._shaft)
        normal = cross(self._axis, direction)
        sine = norm(normal)
        excess = atan2(sine, dot(self._axis, direction)) - angle
        if excess <= 0.0 or sine == 0.0:
            return rotation
        back = quaternion_from_vector(*scaled(-excess / sine, normal))
        return multiply_quaternions(back, rotation)

    def _cosine(self, rotation: FloatQuaternion) -> float:
        """Return a . R u = (2 w^2 - 1) a . u + 2 (q . a) (q . u) + 2 w q . (u x a)."""
        x, y, z, w = rotation
        vector = x, y, z
        along = dot(vector, self._axis) * dot(vector, self._shaft)
        across = dot(vector, self._normal)
        return (2.0 * w * w - 1.0) * self._aligned + 2.0 * (along + w * across)
