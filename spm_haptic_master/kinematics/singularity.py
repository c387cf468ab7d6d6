# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How near one pose is to a parallel singularity, cheap enough for use while the device moves."""

from typing import NamedTuple

import numpy as np

from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.inverse_model import joint_angles
from spm_haptic_master.kinematics.jacobians import cross, dot, velocity_rows
from spm_haptic_master.kinematics.leg_kernels import (
    second_axis_a,
    second_axis_b,
    second_axis_c,
    third_axes,
)
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)

APPROACH_STEPS = 8
"""Newton steps at most towards the singular surface; four are the rule."""

APPROACH_TOLERANCE = 1e-6
"""Last step of a search that has arrived, rad."""


class Nearness(NamedTuple):
    """
    Dexterity of a pose with three and with four sensors.

    Attributes
    ----------
    three, four : float
        sigma_min / sigma_max of the Jacobian (eq. 12, 2-norm), in [0, 1].

    """

    three: float
    four: float


class Approach(NamedTuple):
    """
    The way to the singular surface.

    Attributes
    ----------
    distance : float
        Angle of the turn that leads there, rad.
    axis : tuple of three float
        Axis of that turn, a unit vector in the base frame.

    """

    distance: float
    axis: tuple


def determinant_gradient(rotation, g, working_mode, m):
    """
    Kernel: det A of a pose of nine numbers, and its gradient along turns in the base frame.

    Returns
    -------
    determinant : number
        Unit 1.
    gradient : tuple of three numbers
        1 / rad.

    """
    th1 = joint_angles(rotation, g, working_mode, m)[:3]
    rows, diagonal = velocity_rows(rotation, th1, g, m)
    th1a, th1b, th1c = th1
    thirds = third_axes(rotation, g)
    seconds = (second_axis_a(m.cos(th1a), m.sin(th1a), g),
               second_axis_b(m.cos(th1b), m.sin(th1b), g),
               second_axis_c(m.cos(th1c), m.sin(th1c), g))
    gradient = 0.0, 0.0, 0.0
    for k, first in enumerate(((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))):
        cofactor = cross(rows[(k + 1) % 3], rows[(k + 2) % 3])
        # A turn omega moves Z3k by omega x Z3k and Z2k by th1k' Z1k x Z2k, th1k' = row . omega / B.
        rate = dot(cross(cross(first, seconds[k]), thirds[k]), cofactor) / diagonal[k]
        along_second = dot(thirds[k], cofactor)
        gradient = tuple(
            so_far + rate * row + g.cos_beta * y - along_second * z
            for so_far, row, y, z in zip(gradient, rows[k], cofactor, seconds[k], strict=True))
    return dot(rows[0], cross(rows[1], rows[2])), gradient


def nearness(quaternion, geometry, working_mode):
    """
    Dexterities of one pose; nothing is validated.

    Parameters
    ----------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform, a unit quaternion.
    geometry : Geometry
        Link angles.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    Nearness

    Raises
    ------
    UnreachableError, SingularityError
        The pose is out of the working mode's reach, or on its boundary.

    """
    rotation = rotation_from_quaternion(*quaternion)
    th1 = joint_angles(rotation, geometry, working_mode, FLOATS)[:3]
    rows, diagonal = velocity_rows(rotation, th1, geometry, FLOATS)
    jacobian = np.array([
        [FLOATS.mode_reciprocal(b) * component for component in row]
        for row, b in zip(rows, diagonal, strict=True)])
    largest, _, smallest = np.linalg.svd(jacobian[:3], compute_uv=False).tolist()
    largest_of_four, _, smallest_of_four = np.linalg.svd(jacobian, compute_uv=False).tolist()
    return Nearness(smallest / largest, smallest_of_four / largest_of_four)


def approach(quaternion, geometry, working_mode):
    """
    Find the turn to the parallel singularity that lies next along the determinant's gradient.

    Newton's method from the pose itself: near the singular surface the foot of the perpendicular;
    one that lies behind a hill of the determinant is not found.

    Parameters
    ----------
    quaternion, geometry, working_mode
        As of `nearness`.

    Returns
    -------
    Approach or None
        None where the search leaves the working mode's reach or does not arrive.

    """
    x = y = z = 0.0
    try:
        for _ in range(APPROACH_STEPS):
            turned = multiply_quaternions(quaternion_from_vector(x, y, z, FLOATS), quaternion)
            value, gradient = determinant_gradient(
                rotation_from_quaternion(*turned), geometry, working_mode, FLOATS)
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
