# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model in closed form, for all 8 working modes: joint angles, Jacobians, dexterity."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import cast, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.checks import (
    check_count,
    check_rotations,
    check_working_mode,
    WorkingMode,
)
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import leg_angles, second_axis, third_axes
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Backend,
    Batch,
    FLOATS,
    MODE_BOUNDARY,
    N,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.rotations import unstack_matrix
from spm_haptic_master.kinematics.vectors import cross, dot

# Working mode of the rig as built: signs of B_AA, B_BB, B_CC.
RIG_WORKING_MODE = (1, 1, 1)
# Rows of A_r and diagonal of B_r, eqs. 20, 21 (unit 1).
VelocityRows: TypeAlias = tuple[list[Vector[N]], list[N]]


@dataclass(frozen=True, slots=True)
class JointAngles:
    """
    Joint angles of orientations.

    Attributes
    ----------
    theta1 : ndarray, shape (..., 3)
        Active joints of the legs A, B, C, rad.
    theta2a, theta3a : ndarray, shape (...)
        Passive joints of leg A, rad.
    theta3b, theta3c : ndarray, shape (...)
        Second passive joints of the legs B and C, rad.

    """

    theta1: Array
    theta2a: Array
    theta3a: Array
    theta3b: Array
    theta3c: Array


def mechanism_angles(
    rotation: Rotation[float],
    geometry: Geometry,
    working_mode: WorkingMode = RIG_WORKING_MODE,
) -> tuple[float, ...]:
    """
    Angles of all nine joints, in plain floats; nothing is validated.

    Parameters
    ----------
    rotation : tuple of nine float
        R_base_platform, row by row.
    geometry : Geometry
        Link angles and axes.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    tuple of nine float
        th1A, th2A, th3A, th1B, th2B, th3B, th1C, th2C, th3C, rad, in [-pi, pi].

    Raises
    ------
    UnreachableError
        A leg does not reach the pose.

    """
    angles: list[float] = []
    for leg, sign in zip(geometry.legs, working_mode, strict=True):
        angles += leg_angles(rotation, leg, sign, FLOATS)
    return tuple(angles)


def measured_angles(
    rotation: Rotation[float],
    geometry: Geometry,
    working_mode: WorkingMode,
    sensors: int,
) -> tuple[float, ...]:
    """
    Angles that the first 3 to 6 sensors measure, in plain floats; nothing is validated.

    Parameters
    ----------
    rotation, geometry, working_mode
        As of `mechanism_angles`.
    sensors : int
        Number of sensors, 3 to 6.

    Returns
    -------
    tuple of float
        The first of th1A, th1B, th1C, th3A, th3B, th3C, rad, in [-pi, pi].

    Raises
    ------
    UnreachableError
        A leg does not reach the pose.

    """
    angles = mechanism_angles(rotation, geometry, working_mode)
    of_first_joints = angles[::3]
    of_third_joints = angles[2::3]
    return (of_first_joints + of_third_joints)[:sensors]


def inverse(
    R: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
) -> JointAngles:
    """
    Joint angles of orientations, in closed form.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk = Z1k . (Z2k x Z3k), legs A, B, C; the rig has (1, 1, 1).

    Returns
    -------
    JointAngles
        `theta1` (..., 3), `theta2a`, `theta3a`, `theta3b`, `theta3c` (...), rad in [-pi, pi]. In
        a batch all angles of unreachable poses are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    UnreachableError
        `R` is a single pose and a leg does not reach it.

    """
    matrices = check_rotations('R', R)
    working_mode = check_working_mode(working_mode)
    found = batch_angles(matrices, check_geometry(geometry), working_mode)
    if matrices.ndim == 2 and np.isnan(found.theta2a):
        raise UnreachableError(
            f'no configuration in working mode {working_mode} reaches '
            f'R = {matrices.tolist()} with {geometry}'
        )
    return found


def batch_angles(
    matrices: Array,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> JointAngles:
    """Return `inverse` of a batch; nothing is validated."""
    rotation = unstack_matrix(matrices)
    found = []
    for leg, sign in zip(geometry.legs, working_mode, strict=True):
        found.append(leg_angles(rotation, leg, sign, ARRAYS))
    (th1a, th2a, th3a), (th1b, _, th3b), (th1c, _, th3c) = found
    angles: tuple[Batch, ...] = (th1a, th1b, th1c, th2a, th3a, th3b, th3c)
    unreachable = np.isnan(sum(angles))
    th1a, th1b, th1c, *passive = (np.where(unreachable, np.nan, angle) for angle in angles)
    theta1 = np.stack([th1a, th1b, th1c], axis=-1)
    return JointAngles(theta1, *passive)


# Jacobians ---------------------------------------------------------------------------------------


def velocity_rows(
    rotation: Rotation[N],
    th1: Vector[N],
    g: Geometry,
    m: Backend[N],
) -> VelocityRows[N]:
    """
    Kernel of eqs. 9, 10, 20, 21: rows of A_r and diagonal of B_r with B_r thetadot = A_r omega.

    The rows are Z2k x Z3k and Z1k x Z2k for k = A, B, C; the diagonal is B_AA, B_BB, B_CC, twice.
    (The paper prints Z3k x Z2k and Z3A . (Z2A x Z1A), which reverse the sign of the velocity.)

    Returns
    -------
    rows : tuple of six tuples of three numbers
        th1A, th1B, th1C, th3A, th3B, th3C: components in the base frame (unit 1).
    diagonal : tuple of six numbers
        Unit 1.

    """
    seconds = []
    for angle, leg in zip(th1, g.legs, strict=True):
        seconds.append(second_axis(m.cos(angle), m.sin(angle), leg))
    thirds = third_axes(rotation, g)
    active = list(map(cross, seconds, thirds))
    firsts = [leg.first for leg in g.legs]
    passive = list(map(cross, firsts, seconds))
    volumes = list(map(dot, active, firsts))
    return active + passive, 2 * volumes


def _velocity_rows_of(
    matrices: Array,
    geometry: Geometry,
    working_mode: Sequence[int],
) -> VelocityRows[Batch]:
    """Return the `velocity_rows` of checked poses; NaN out of reach."""
    angles = inverse(matrices, geometry, working_mode)
    th1a, th1b, th1c = np.moveaxis(angles.theta1, -1, 0)
    rotation = unstack_matrix(matrices)
    return velocity_rows(rotation, (th1a, th1b, th1c), geometry, ARRAYS)


def jacobian(
    R: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
    sensors: int = 3,
) -> Array:
    """
    Jacobian G of the inverse model: thetadot = G omega.

    Eqs. 8 to 11 and 17 to 21, with the sign corrected.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    sensors : {3, 4, 5, 6}
        3: rows th1A, th1B, th1C; 4: th3A as well; 5: th3B as well; 6: th3C as well.

    Returns
    -------
    ndarray, shape (..., sensors, 3)
        G, unit 1, for the platform's angular velocity omega in the base frame, rad/s. It is the
        inverse of the paper's J. In a batch, all rows of a pose out of reach or on the boundary of
        its working mode (`MODE_BOUNDARY`) are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.
    UnreachableError
        `R` is a single pose out of reach.
    SingularityError
        `R` is a single pose on the boundary of the working mode.

    """
    matrices = check_rotations('R', R)
    sensors = check_count(
        name='sensors',
        value=sensors,
        least=3,
        most=6,
    )
    vectors, volumes = _velocity_rows_of(matrices, geometry, working_mode)
    rows = np.stack([_stacked(row) for row in vectors], axis=-2)
    diagonal = _stacked(volumes)
    is_small = np.abs(diagonal) < MODE_BOUNDARY
    boundary = np.any(is_small, axis=-1)
    if matrices.ndim == 2 and boundary:
        raise SingularityError(
            f'R = {matrices.tolist()} lies on the boundary of its working mode: '
            f'B_kk = {diagonal[:3].tolist()}, expected {MODE_BOUNDARY:g} or more in size'
        )
    diagonal = np.where(boundary[..., None], np.nan, diagonal)
    every: Array = rows / diagonal[..., None]
    return every[..., :sensors, :]


def _stacked(numbers: Iterable[Batch]) -> Array:
    """Return the numbers of batches as one array; they are its last axis."""
    return np.stack(np.broadcast_arrays(*numbers), axis=-1)


def parallel_determinant(
    R: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
) -> Array:
    """
    Return det A, zero at a parallel singularity (eq. 9, rows Z2k x Z3k; Fig. 7).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    ndarray, shape (...)
        det A, unit 1; the paper's rows Z3k x Z2k would give the negative. Unreachable poses of a
        batch give NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.
    UnreachableError
        `R` is a single pose out of reach.

    """
    matrices = check_rotations('R', R)
    vectors, _ = _velocity_rows_of(matrices, geometry, working_mode)
    row_a, row_b, row_c = vectors[:3]
    return cast('Array', dot(row_a, cross(row_b, row_c)))


def dexterity(
    R: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
    working_mode: Sequence[int] = RIG_WORKING_MODE,
    sensors: int = 3,
) -> Array:
    """
    Dexterity: the inverse of the Jacobian's condition number (eq. 12), in [0, 1].

    It is smallest over largest singular value of G (2-norm): 0 at a parallel singularity, and 1
    where all directions are equal.

    Parameters
    ----------
    R, geometry, working_mode, sensors
        As of `jacobian`.

    Returns
    -------
    ndarray, shape (...)
        Dexterity, unit 1; NaN for the poses for which `jacobian` gives NaN.

    Raises
    ------
    InputError, UnreachableError, SingularityError
        As of `jacobian`.

    """
    G = jacobian(R, geometry, working_mode, sensors)
    known = np.all(np.isfinite(G), axis=(-1, -2))
    # LAPACK does not accept NaN: such poses get a substitute here, and NaN again at the end.
    substituted = np.where(known[..., None, None], G, 1.0)
    values = np.linalg.svd(substituted, compute_uv=False)
    ratio = values[..., 2] / values[..., 0]
    return np.where(known, ratio, np.nan)
