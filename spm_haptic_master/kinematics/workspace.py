# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The workspace cone, and the parallel singularities in it and near a pose.

It is the cone of platform axes about (1, 1, 1), psi = 135 deg and theta = acos(1 / sqrt 3).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, quoted, SpmError
from spm_haptic_master.kinematics.checks import check_angles, check_broadcast, WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import (
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
from spm_haptic_master.kinematics.vectors import cross, dot

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
RAYS = 360
CIRCLES = 60
# Number of halvings of a grid step, of 1 rad at most, down to rounding.
BISECTIONS = 50


def workspace_pose(
    tilt: ArrayLike,
    azimuth: ArrayLike,
    phi: ArrayLike,
) -> Array:
    """
    Poses of the workspace cone.

    Parameters
    ----------
    tilt : array_like, shape (...)
        Angle of the platform axis from (1, 1, 1), rad.
    azimuth : array_like, shape (...)
        Direction of the tilt, rad, about (1, 1, 1) from (1, -1, 0).
    phi : array_like, shape (...)
        Self-rotation, the third ZXZ angle, rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform; the three arguments are broadcast together.

    Raises
    ------
    InputError
        An angle is not finite, or the shapes do not broadcast.

    """
    tilts = check_angles('tilt', tilt, ())
    azimuths = check_angles('azimuth', azimuth, ())
    check_broadcast('tilt, azimuth', tilts.shape, azimuths.shape)
    along_0 = np.cos(azimuths)[..., None] * TILT_DIRECTIONS[0]
    along_90 = np.sin(azimuths)[..., None] * TILT_DIRECTIONS[1]
    direction = along_0 + along_90
    upright = np.cos(tilts)[..., None] * CONE_AXIS
    tilted = np.sin(tilts)[..., None] * direction
    x, y, z = np.moveaxis(upright + tilted, -1, 0)
    across = np.hypot(x, y)
    psi = np.arctan2(x, -y)
    theta = np.arctan2(across, z)
    return matrix_from_zxz(psi, theta, phi)


def singularity_locus(
    phi: float,
    half_angle: float,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
) -> tuple[Array, Array]:
    """
    Parallel singularities of the workspace cone at one self-rotation (the lines of Figs. 6, 7).

    det A is followed along rays from the centre and along circles about it; each change of sign
    is bisected.

    Parameters
    ----------
    phi : float
        Self-rotation, rad.
    half_angle : float
        Half angle of the cone, rad, in ]0, pi].
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    tilt, azimuth : ndarray, shape (n,)
        Of the singularities, rad, as in `workspace_pose`, by azimuth; n may be 0.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.

    """
    angle = check_angles('phi', phi, ())
    half = check_angles('half_angle', half_angle, ())
    is_single = not angle.ndim and not half.ndim
    if not is_single or not 0.0 < half <= math.pi:
        raise InputError(
            f'phi = {quoted(phi)}, half_angle = {quoted(half_angle)}: expected one '
            'angle each in rad, and half_angle in ]0, pi]'
        )

    def determinant(points: Array) -> Array:
        tilts, azimuths = points
        poses = workspace_pose(tilts, azimuths, angle)
        return parallel_determinant(poses, geometry, working_mode)

    found = changes_of_sign(
        function=determinant,
        half_angle=float(half),
        rays=RAYS,
        circles=CIRCLES,
    )
    low = found.here
    high = found.there
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        before = determinant(middle) * found.here_value > 0.0
        low = np.where(before, middle, low)
        high = np.where(before, high, middle)
    tilt, azimuth = 0.5 * (low + high)
    order = np.argsort(azimuth, kind='stable')
    return tilt[order], azimuth[order]


@dataclass(frozen=True, slots=True)
class SignChanges:
    """
    Pairs of neighbouring points of the cone between which a function changes its sign.

    Attributes
    ----------
    here, there : ndarray, shape (2, n)
        Tilt and azimuth of both points, rad.
    here_value, there_value : ndarray, shape (n,)
        Values of the function there.

    """

    here: Array
    there: Array
    here_value: Array
    there_value: Array


def changes_of_sign(
    function: Callable[[Array], Array],
    half_angle: float,
    rays: int,
    circles: int,
) -> SignChanges:
    """
    Return neighbouring points of the cone between which a function of them changes its sign.

    Parameters
    ----------
    function : callable
        Takes points, (2, ...), tilt and azimuth in rad, and returns a value for each.
    half_angle : float
        Of the cone, rad.
    rays, circles : int
        Numbers of the lines along which neighbours are compared.

    """
    tilts = np.linspace(0.0, half_angle, circles + 1)
    azimuths = 2.0 * math.pi * np.arange(rays + 1) / rays
    points = np.stack(np.meshgrid(tilts, azimuths))
    values = function(points)
    table = np.concatenate([points, values[None]])
    # Neighbours along each ray: the next one is on the next circle; then on each circle: the next
    # one is on the next ray.
    inner = table[:, :-1, :-1]
    outer = table[:, :-1, 1:]
    on_next_ray = table[:, 1:, 1:]
    one = _joined(inner, outer)
    other = _joined(outer, on_next_ray)
    changed = one[2] * other[2] < 0.0
    one = one[:, changed]
    other = other[:, changed]
    return SignChanges(
        here=one[:2],
        there=other[:2],
        here_value=one[2],
        there_value=other[2],
    )


def _joined(*tables: Array) -> Array:
    """Return the points of several tables, shape (3, rays, circles), as one list, (3, n)."""
    return np.concatenate([table.reshape(3, -1) for table in tables], axis=1)


# One pose in plain floats, fast enough for a moving device ---------------------------------------


class Nearness(NamedTuple):
    """
    Dexterities of a pose: smallest over largest singular value of the Jacobian (eq. 12, 2-norm).

    Attributes
    ----------
    three, every, in_use : float
        With the active joints alone, with every mounted sensor, and with those in use; in [0, 1].

    """

    three: float
    every: float
    in_use: float


class Approach(NamedTuple):
    """
    Shortest turn of a pose to the singular surface.

    Attributes
    ----------
    distance : float
        Angle of the turn, rad.
    axis : tuple of three float
        Axis of the turn, a unit vector in the base frame.

    """

    distance: float
    axis: Vector[float]


def determinant_gradient(
    rotation: Rotation[float],
    g: Geometry,
    working_mode: WorkingMode,
) -> tuple[float, Vector[float]]:
    """
    Compute det A of a pose and its gradient along turns in the base frame, in plain floats.

    Returns
    -------
    determinant : float
        det A, unit 1.
    gradient : tuple of three float
        1 / rad.

    Raises
    ------
    UnreachableError
        A leg does not reach the pose.

    """
    th1 = th1a, th1b, th1c = measured_angles(rotation, g, working_mode, 3)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), g, FLOATS)
    thirds = third_axes(rotation, g)
    gradient = 0.0, 0.0, 0.0
    for k, leg in enumerate(g.legs):
        second = second_axis(FLOATS.cos(th1[k]), FLOATS.sin(th1[k]), leg)
        next_row = rows[(k + 1) % 3]
        last_row = rows[(k + 2) % 3]
        cofactor = cross(next_row, last_row)
        # A turn omega moves Z3k by omega x Z3k and Z2k by th1k' Z1k x Z2k, where
        # th1k' = row . omega / B_kk.
        motion = cross(leg.first, second)
        change = cross(motion, thirds[k])
        rate = dot(change, cofactor) / diagonal[k]
        along_second = dot(thirds[k], cofactor)
        gx, gy, gz = (
            so_far + rate * row + leg.cos_beta * y - along_second * z
            for so_far, row, y, z in zip(gradient, rows[k], cofactor, second, strict=True)
        )
        gradient = gx, gy, gz
    row_a, row_b, row_c = rows[:3]
    return dot(row_a, cross(row_b, row_c)), gradient


def nearness(
    quaternion: Quaternion[float],
    geometry: Geometry,
    working_mode: WorkingMode,
    sensors: int = 4,
    left_out: Collection[int] = (),
) -> Nearness:
    """
    Dexterities of one pose, in plain floats; nothing is validated.

    Parameters
    ----------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform.
    geometry : Geometry
        Link angles and axes.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.
    sensors : {4, 5, 6}
        Number of mounted sensors.
    left_out : collection of int
        Places of mounted sensors that are not in use; three at least are.

    Raises
    ------
    UnreachableError
        A leg does not reach the pose.
    SingularityError
        The pose is on the boundary of the working mode.

    """
    rotation = rotation_from_quaternion(*quaternion)
    th1a, th1b, th1c = measured_angles(rotation, geometry, working_mode, 3)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    rates = []
    for row, b in zip(rows[:sensors], diagonal[:sensors], strict=True):
        reciprocal = FLOATS.mode_reciprocal(b)
        rates.append([reciprocal * component for component in row])
    jacobian = np.array(rates)
    every = _dexterity(jacobian)
    in_use = every
    if left_out:
        of_used = np.delete(jacobian, list(left_out), axis=0)
        in_use = _dexterity(of_used)
    return Nearness(
        three=_dexterity(jacobian[:3]),
        every=every,
        in_use=in_use,
    )


def _dexterity(jacobian: Array) -> float:
    """Return smallest over largest singular value."""
    values: list[float] = np.linalg.svd(jacobian, compute_uv=False).tolist()
    return values[2] / values[0]


def approach(
    quaternion: Quaternion[float],
    geometry: Geometry,
    working_mode: WorkingMode,
) -> Approach | None:
    """
    Find the shortest turn to the next parallel singularity along the determinant's gradient.

    Newton's method starts from the pose itself. Near the singular surface it converges to the foot
    of the perpendicular; a singularity beyond an extremum of the determinant is not found.

    Parameters
    ----------
    quaternion, geometry, working_mode
        As for `nearness`.

    Returns
    -------
    Approach or None
        None where the search leaves the reach of the legs or does not converge.

    """
    x = y = z = 0.0
    try:
        for _ in range(APPROACH_STEPS):
            turned = multiply_quaternions(quaternion_from_vector(x, y, z), quaternion)
            rotation = rotation_from_quaternion(*turned)
            value, (gx, gy, gz) = determinant_gradient(rotation, geometry, working_mode)
            squared = gx * gx + gy * gy + gz * gz
            along = (gx * x + gy * y + gz * z - value) / squared
            last = x, y, z
            x = along * gx
            y = along * gy
            z = along * gz
            change = max(abs(x - last[0]), abs(y - last[1]), abs(z - last[2]))
            if change < APPROACH_TOLERANCE:
                break
        else:
            return None
    except (SpmError, ZeroDivisionError):
        return None
    size = FLOATS.sqrt(squared)
    sign = 1.0 if along >= 0.0 else -1.0
    axis = (sign * gx / size, sign * gy / size, sign * gz / size)
    return Approach(distance=abs(along) * size, axis=axis)
