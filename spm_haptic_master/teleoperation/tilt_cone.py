# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The cone about the shaft's direction at engaging, in which the shaft has to stay."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos

from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector
from spm_haptic_master.kinematics.vectors import cross, dot
from spm_haptic_master.teleoperation.vectors import (
    FloatQuaternion,
    FloatVector,
    norm,
    rotate,
    scaled,
)


@dataclass(frozen=True, slots=True)
class TiltCone:
    """The rotations whose shaft is tilted by `largest` at most."""

    shaft: FloatVector  # unit vector u in the tool's frame, from the trocar to the tip
    axis: FloatVector  # direction R_s0 u at engaging, unit vector in the slave's base frame
    largest: float  # rad, below pi / 2

    def tilt(self, rotation: FloatQuaternion) -> float:
        """Return the angle between the shaft R u and the axis, rad in [0, pi]."""
        direction = rotate(rotation, self.shaft)
        return atan2(norm(cross(self.axis, direction)), dot(self.axis, direction))

    def within(self, rotation: FloatQuaternion, angle: float) -> FloatQuaternion:
        """Return the rotation, turned back towards the axis as far as its tilt exceeds `angle`."""
        direction = rotate(rotation, self.shaft)
        cosine = dot(self.axis, direction)
        if cosine >= cos(angle):
            return rotation
        normal = cross(self.axis, direction)
        sine = norm(normal)
        excess = atan2(sine, cosine) - angle
        if excess <= 0.0 or sine == 0.0:
            return rotation
        back = quaternion_from_vector(*scaled(normal, -excess / sine))
        return multiply_quaternions(back, rotation)
