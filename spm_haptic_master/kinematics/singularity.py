# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Distance of one pose from the parallel singularities, fast enough for a moving device."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import joint_angles
from spm_haptic_master.kinematics.jacobians import cross, dot, velocity_rows
from spm_haptic_master.kinematics.leg_kernels import second_axis, third_axes
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)

# Largest number of Newton steps to the singular surface; four are usual.
APPROACH_STEPS = 8
# Largest last step of a converged search (rad): the step after it is far below 1e-9 rad.
APPROACH_TOLERANCE = 1e-6


class Nearness(NamedTuple):
    """Dexterity (eq. 12, 2-norm), in [0, 1], with the active joints and with every sensor."""

    three: float
    every: float


class Approach(NamedTuple):
    """Shortest turn to the singular surface: angle, rad, and unit axis in the base frame."""

    distance: float
    axis: Vector[float]


def determinant_gradient(rotation: Rotation[float], g: Geometry,
                         working_mode: WorkingMode) -> tuple[float, Vector[float]]:
    """Return det A of a pose (unit 1) and its gradient along turns in the base frame (1 / rad)."""
    m = FLOATS
    th1a, th1b, th1c, _, _ = joint_angles(rotation, g, working_mode, m)
    th1 = th1a, th1b, th1c
    rows, diagonal = velocity_rows(rotation, th1, g, m)
    thirds = third_axes(rotation, g)
    gradient = 0.0, 0.0, 0.0
    for k, leg in enumerate(g.legs):
        second = second_axis(m.cos(th1[k]), m.sin(th1[k]), leg)
        cofactor = cross(rows[(k + 1) % 3], rows[(k + 2) % 3])
        # A turn omega moves Z3k by omega x Z3k and Z2k by th1k' Z1k x Z2k, where
        # th1k' = row . omega / B_kk.
        rate = dot(cross(cross(leg.first, second), thirds[k]), cofactor) / diagonal[k]
        along_second = dot(thirds[k], cofactor)
        gx, gy, gz = (
            so_far + rate * row + leg.cos_beta * y - along_second * z
            for so_far, row, y, z in zip(gradient, rows[k], cofactor, second, strict=True))
        gradient = gx, gy, gz
    return dot(rows[0], cross(rows[1], rows[2])), gradient


def nearness(quaternion: Quaternion[float], geometry: Geometry,
             working_mode: WorkingMode, sensors: int = 4) -> Nearness:
    """
    Dexterities of one pose; nothing is validated.

    `quaternion` is x, y, z, w of R_base_platform, `working_mode` the signs of B_kk, and `sensors`
    the number of sensors, 4, 5 or 6. UnreachableError if the pose is out of reach,
    SingularityError on the boundary of the working mode.
    """
    jacobian = _jacobian(quaternion, geometry, working_mode, sensors)
    return Nearness(_dexterity(jacobian[:3]), _dexterity(jacobian))


def dexterity_without(quaternion: Quaternion[float], geometry: Geometry,
                      working_mode: WorkingMode, sensors: int,
                      left_out: Collection[int]) -> float:
    """
    Dexterity of one pose without the sensors at some places; three are left at least.

    Other arguments and errors as of `nearness`.
    """
    jacobian = _jacobian(quaternion, geometry, working_mode, sensors)
    return _dexterity(np.delete(jacobian, list(left_out), axis=0))


def _jacobian(quaternion: Quaternion[float], geometry: Geometry, working_mode: WorkingMode,
              sensors: int) -> NDArray[np.float64]:
    """Return the sensors' rates by turns in the base frame, shape (sensors, 3)."""
    rotation = rotation_from_quaternion(*quaternion)
    th1a, th1b, th1c, _, _ = joint_angles(rotation, geometry, working_mode, FLOATS)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    return np.array([
        [FLOATS.mode_reciprocal(b) * component for component in row]
        for row, b in zip(rows[:sensors], diagonal[:sensors], strict=True)])


def _dexterity(jacobian: NDArray[np.float64]) -> float:
    """Return smallest over largest singular value."""
    values: list[float] = np.linalg.svd(jacobian, compute_uv=False).tolist()
    return values[2] / values[0]


def approach(quaternion: Quaternion[float], geometry: Geometry,
             working_mode: WorkingMode) -> Approach | None:
    """
    Find the shortest turn to the next parallel singularity along the determinant's gradient.

    Newton's method starts from the pose itself. Near the singular surface it converges to the foot
    of the perpendicular; a singularity beyond an extremum of the determinant is not found. None
    where the search leaves the reach of the legs or does not converge. Arguments as of `nearness`.
    """
    x = y = z = 0.0
    try:
        for _ in range(APPROACH_STEPS):
            turned = multiply_quaternions(quaternion_from_vector(x, y, z), quaternion)
            value, gradient = determinant_gradient(
                rotation_from_quaternion(*turned), geometry, working_mode)
            gx, gy, gz = gradient
            along = (gx * x + gy * y + gz * z - value) / (gx * gx + gy * gy + gz * gz)
            last = x, y, z
            x, y, z = along * gx, along * gy, along * gz
            if max(abs(x - last[0]), abs(y - last[1]), abs(z - last[2])) < APPROACH_TOLERANCE:
                break
        else:
            return None
    except (SpmError, ZeroDivisionError):
        return None
    size = FLOATS.sqrt(gx * gx + gy * gy + gz * gz)
    sign = 1.0 if along >= 0.0 else -1.0
    return Approach(abs(along) * size, (sign * gx / size, sign * gy / size, sign * gz / size))
