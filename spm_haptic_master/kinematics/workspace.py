# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The workspace cone, and the parallel singularities in it and near a pose.

It is the cone of platform axes about (1, 1, 1), psi = 135 deg and theta = acos(1 / sqrt 3).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, quoted, SpmError
from spm_haptic_master.kinematics.checks import check_angles, check_broadcast, WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import (
    cross,
    dot,
    measured_angles,
    parallel_determinant,
    RIG_WORKING_MODE,
    velocity_rows,
)
from spm_haptic_master.kinematics.leg_kernels import second_axis, third_axes
from spm_haptic_master.kinematics.number_backends import (
    Array,
    FLOATS,
    Quaternion,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.rotations import (
    matrix_from_zxz,
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)

# Largest number of Newton steps to the singular surface; four are usual.
APPROACH_STEPS = 8
# Largest last step of a converged search (rad): the step after it is far below 1e-9 rad.
APPROACH_TOLERANCE = 1e-6
# Axis of the workspace cone, a unit vector in the base frame.
CONE_AXIS = np.array([1.0, 1.0, 1.0]) / math.sqrt(3.0)
# Directions of tilt at azimuth 0 and 90 deg, unit vectors; right-handed with `CONE_AXIS`.
TILT_DIRECTIONS = np.array(
    [
        [math.sqrt(0.5), -math.sqrt(0.5), 0.0],
        [math.sqrt(1.0 / 6.0), math.sqrt(1.0 / 6.0), -math.sqrt(2.0 / 3.0)],
    ]
)
# Rays and circles of the cone along which `singularity_locus` follows det A.
RAYS, CIRCLES = 360, 60
# Number of halvings of a grid step, of 1 rad at most, down to rounding.
BISECTIONS = 50


def workspace_pose(tilt: ArrayLike, azimuth: ArrayLike, phi: ArrayLike) -> Array:
    """
    Poses R_base_platform of the workspace cone, shape (..., 3, 3).

    `tilt` is the angle of the platform axis from (1, 1, 1), `azimuth` the tilt's direction about
    (1, 1, 1) from (1, -1, 0), and `phi` the self-rotation, the third ZXZ angle, all rad and
    broadcast together. InputError if one is not finite, or the shapes do not broadcast.
    """
    tilts, azimuths = check_angles('tilt', tilt, ()), check_angles('azimuth', azimuth, ())
    check_broadcast('tilt, azimuth', tilts.shape, azimuths.shape)
    direction = (
        np.cos(azimuths)[..., None] * TILT_DIRECTIONS[0]
        + np.sin(azimuths)[..., None] * TILT_DIRECTIONS[1]
    )
    axis = np.cos(tilts)[..., None] * CONE_AXIS + np.sin(tilts)[..., None] * direction
    x, y, z = np.moveaxis(axis, -1, 0)
    return matrix_from_zxz(np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z), phi)


def singularity_locus(
    phi: float,
    half_angle: float,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
) -> tuple[Array, Array]:
    """
    Parallel singularities of the workspace cone at one self-rotation (the lines of Figs. 6, 7).

    `phi` is the self-rotation and `half_angle` that of the cone, at most pi, rad. det A is
    followed along rays from the centre and along circles about it; each change of sign is
    bisected. Returned are tilt and azimuth of the singularities, rad, shape (n,), as in
    `workspace_pose`, by azimuth; n may be 0. Errors as of `inverse`.
    """
    angle, half = check_angles('phi', phi, ()), check_angles('half_angle', half_angle, ())
    if angle.ndim or half.ndim or not 0.0 < half <= math.pi:
        raise InputError(
            f'phi = {quoted(phi)}, half_angle = {quoted(half_angle)}: expected one '
            'angle each in rad, and half_angle in ]0, pi]'
        )

    def determinant(points: Array) -> Array:
        return parallel_determinant(
            workspace_pose(points[0], points[1], angle), geometry, working_mode
        )

    low, high, side, _ = changes_of_sign(determinant, float(half), RAYS, CIRCLES)
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        before = determinant(middle) * side > 0.0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    tilt, azimuth = 0.5 * (low + high)
    order = np.argsort(azimuth, kind='stable')
    return tilt[order], azimuth[order]


def changes_of_sign(
    function: Callable[[Array], Array], half_angle: float, rays: int, circles: int
) -> tuple[Array, Array, Array, Array]:
    """
    Return neighbouring points of the cone between which a function of them changes its sign.

    A point is tilt and azimuth, rad. Of n pairs, found along rays and circles, both points,
    (2, n), and both values, (n,), are returned.
    """
    points = np.stack(
        np.meshgrid(
            np.linspace(0.0, half_angle, circles + 1), 2.0 * math.pi * np.arange(rays + 1) / rays
        )
    )
    table = np.concatenate([points, function(points)[None]])
    one, other = (
        np.concatenate([part.reshape(3, -1) for part in parts], axis=1)
        for parts in (
            (table[:, :-1, :-1], table[:, :-1, 1:]),
            (table[:, :-1, 1:], table[:, 1:, 1:]),
        )
    )
    changed = one[2] * other[2] < 0.0
    one, other = one[:, changed], other[:, changed]
    return one[:2], other[:2], one[2], other[2]


# One pose in plain floats, fast enough for a moving device ---------------------------------------


class Nearness(NamedTuple):
    """Dexterity (eq. 12, 2-norm), in [0, 1], of the active joints, of every sensor, in use."""

    three: float
    every: float
    in_use: float


class Approach(NamedTuple):
    """Shortest turn to the singular surface: angle, rad, and unit axis in the base frame."""

    distance: float
    axis: Vector[float]


def determinant_gradient(
    rotation: Rotation[float], g: Geometry, working_mode: WorkingMode
) -> tuple[float, Vector[float]]:
    """Return det A of a pose (unit 1) and its gradient along turns in the base frame (1 / rad)."""
    th1 = th1a, th1b, th1c = measured_angles(rotation, g, working_mode, 3)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), g, FLOATS)
    thirds = third_axes(rotation, g)
    gradient = 0.0, 0.0, 0.0
    for k, leg in enumerate(g.legs):
        second = second_axis(FLOATS.cos(th1[k]), FLOATS.sin(th1[k]), leg)
        cofactor = cross(rows[(k + 1) % 3], rows[(k + 2) % 3])
        # A turn omega moves Z3k by omega x Z3k and Z2k by th1k' Z1k x Z2k, where
        # th1k' = row . omega / B_kk.
        rate = dot(cross(cross(leg.first, second), thirds[k]), cofactor) / diagonal[k]
        along_second = dot(thirds[k], cofactor)
        gx, gy, gz = (
            so_far + rate * row + leg.cos_beta * y - along_second * z
            for so_far, row, y, z in zip(gradient, rows[k], cofactor, second, strict=True)
        )
        gradient = gx, gy, gz
    return dot(rows[0], cross(rows[1], rows[2])), gradient


def nearness(
    quaternion: Quaternion[float],
    geometry: Geometry,
    working_mode: WorkingMode,
    sensors: int = 4,
    left_out: Collection[int] = (),
) -> Nearness:
    """
    Dexterities of one pose, quaternion x, y, z, w; nothing is validated.

    `sensors`, 4, 5 or 6, are mounted, and those at the places `left_out` not in use, three at
    least. UnreachableError, or SingularityError on the boundary of the working mode.
    """
    rotation = rotation_from_quaternion(*quaternion)
    th1a, th1b, th1c = measured_angles(rotation, geometry, working_mode, 3)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    jacobian = np.array(
        [
            [FLOATS.mode_reciprocal(b) * component for component in row]
            for row, b in zip(rows[:sensors], diagonal[:sensors], strict=True)
        ]
    )
    every = _dexterity(jacobian)
    return Nearness(
        _dexterity(jacobian[:3]),
        every,
        _dexterity(np.delete(jacobian, list(left_out), axis=0)) if left_out else every,
    )


def _dexterity(jacobian: Array) -> float:
    """Return smallest over largest singular value."""
    values: list[float] = np.linalg.svd(jacobian, compute_uv=False).tolist()
    return values[2] / values[0]


def approach(
    quaternion: Quaternion[float], geometry: Geometry, working_mode: WorkingMode
) -> Approach | None:
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
                rotation_from_quaternion(*turned), geometry, working_mode
            )
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
