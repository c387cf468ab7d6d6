# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Jacobians with three to six sensors, dexterity, and the distance from parallel singularities."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import cast, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, quoted, SingularityError, SpmError
from spm_haptic_master.kinematics.checks import check_count, check_rotations, WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import inverse, measured_angles, RIG_WORKING_MODE
from spm_haptic_master.kinematics.leg_kernels import second_axis, third_axes
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Backend,
    Batch,
    FLOATS,
    MODE_BOUNDARY,
    N,
    Quaternion,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
    unstack_matrix,
)

# Largest number of Newton steps to the singular surface; four are usual.
APPROACH_STEPS = 8
# Largest last step of a converged search (rad): the step after it is far below 1e-9 rad.
APPROACH_TOLERANCE = 1e-6
# Norms of eq. 12: the 2-norm, and the Frobenius norm weighted by 1 / 3.
DEXTERITY_NORMS = ('2', 'frobenius')
# Rows of A_r and diagonal of B_r, eqs. 20, 21 (unit 1).
VelocityRows: TypeAlias = tuple[
    tuple[Vector[N], Vector[N], Vector[N], Vector[N], Vector[N], Vector[N]],
    tuple[N, N, N, N, N, N]]


def dot(u: Vector[N], v: Vector[N]) -> N:
    """Scalar product of two vectors of three numbers."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u: Vector[N], v: Vector[N]) -> Vector[N]:
    """Vector product of two vectors of three numbers."""
    ux, uy, uz = u
    vx, vy, vz = v
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def velocity_rows(rotation: Rotation[N], th1: Vector[N], g: Geometry,
                  m: Backend[N]) -> VelocityRows[N]:
    """
    Kernel of eqs. 9, 10, 20, 21: rows of A_r and diagonal of B_r with B_r thetadot = A_r omega.

    The rows are Z2k x Z3k and Z1k x Z2k for k = A, B, C, in the base frame (unit 1): those of
    th1A, th1B, th1C, th3A, th3B, th3C. The diagonal is B_AA, B_BB, B_CC, twice.
    (The paper prints Z3k x Z2k and Z3A . (Z2A x Z1A), which reverse the sign of the velocity.)
    """
    leg_a, leg_b, leg_c = g.legs
    third_a, third_b, third_c = third_axes(rotation, g)
    second_a, second_b, second_c = [
        second_axis(m.cos(angle), m.sin(angle), leg)
        for angle, leg in zip(th1, g.legs, strict=True)]
    row_a, row_b, row_c = (
        cross(second_a, third_a), cross(second_b, third_b), cross(second_c, third_c))
    b_a, b_b, b_c = dot(row_a, leg_a.first), dot(row_b, leg_b.first), dot(row_c, leg_c.first)
    return ((row_a, row_b, row_c, cross(leg_a.first, second_a), cross(leg_b.first, second_b),
             cross(leg_c.first, second_c)), (b_a, b_b, b_c, b_a, b_b, b_c))


def _velocity_rows_of(matrices: Array, geometry: Geometry,
                      working_mode: Sequence[int]) -> VelocityRows[Batch]:
    """Return the `velocity_rows` of checked poses; NaN out of reach."""
    th1a, th1b, th1c = np.moveaxis(inverse(matrices, geometry, working_mode).theta1, -1, 0)
    return velocity_rows(unstack_matrix(matrices), (th1a, th1b, th1c), geometry, ARRAYS)


def jacobian(R: ArrayLike, geometry: Geometry = PAPER_GEOMETRY,
             working_mode: Sequence[int] = RIG_WORKING_MODE, sensors: int = 3) -> Array:
    """
    Jacobian G of the inverse model: thetadot = G omega.

    Eqs. 8 to 11 and 17 to 21, with the sign corrected.

    Parameters
    ----------
    R, geometry, working_mode
        As of `inverse`.
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
    sensors = check_count('sensors', sensors, 3, 6)
    vectors, volumes = _velocity_rows_of(matrices, geometry, working_mode)
    rows = np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in vectors], axis=-2)
    diagonal = np.stack(np.broadcast_arrays(*volumes), axis=-1)
    boundary = np.any(np.abs(diagonal) < MODE_BOUNDARY, axis=-1)
    if matrices.ndim == 2 and boundary:
        raise SingularityError(
            f'R = {matrices.tolist()} lies on the boundary of its working mode: '
            f'B_kk = {diagonal[:3].tolist()}, expected {MODE_BOUNDARY:g} or more in size')
    diagonal = np.where(boundary[..., None], np.nan, diagonal)
    G: Array = (rows / diagonal[..., None])[..., :sensors, :]
    return G


def parallel_determinant(R: ArrayLike, geometry: Geometry = PAPER_GEOMETRY,
                         working_mode: Sequence[int] = RIG_WORKING_MODE) -> Array:
    """
    Return det A, zero at a parallel singularity (eq. 9, rows Z2k x Z3k; Fig. 7).

    It has shape (...) and unit 1; the paper's rows Z3k x Z2k would give the negative. Arguments as
    of `inverse`, and its errors; unreachable poses of a batch give NaN.
    """
    matrices = check_rotations('R', R)
    (row_a, row_b, row_c, *_), _ = _velocity_rows_of(matrices, geometry, working_mode)
    return cast('Array', dot(row_a, cross(row_b, row_c)))


def dexterity(R: ArrayLike, geometry: Geometry = PAPER_GEOMETRY,
              working_mode: Sequence[int] = RIG_WORKING_MODE, sensors: int = 3,
              norm: str = '2') -> Array:
    """
    Dexterity: the inverse of the Jacobian's condition number (eq. 12).

    Parameters
    ----------
    R, geometry, working_mode, sensors
        As of `jacobian`, and its errors.
    norm : {'2', 'frobenius'}
        Norm of eq. 12, which the paper leaves open. '2': smallest over largest singular value of
        G. 'frobenius': the Frobenius norm weighted by 1 / 3, i.e. 3 / sqrt(sum s^2 sum 1 / s^2).

    Returns
    -------
    ndarray, shape (...)
        In [0, 1]: 0 at a parallel singularity, 1 where all directions are equal. Poses for which
        `jacobian` gives NaN are NaN.

    """
    if not isinstance(norm, str) or norm not in DEXTERITY_NORMS:
        raise InputError(f'norm = {quoted(norm)}: expected one of {DEXTERITY_NORMS}')
    G = jacobian(R, geometry, working_mode, sensors)
    known = np.all(np.isfinite(G), axis=(-1, -2))
    # LAPACK does not accept NaN: such poses get a substitute here, and NaN again at the end.
    values = np.linalg.svd(np.where(known[..., None, None], G, 1.0), compute_uv=False)
    if norm == '2':
        eta = values[..., 2] / values[..., 0]
    else:
        # s3 is taken out of the sum of 1 / s^2, so that s3 = 0 gives 0.
        s1, s2, s3 = np.moveaxis(values, -1, 0)
        eta = 3.0 * s3 / np.sqrt(
            (s1**2 + s2**2 + s3**2)
            * (1.0 + np.divide(s3, s2, out=np.zeros_like(s2), where=s2 > 0.0)**2 + (s3 / s1)**2))
    return np.where(known, eta, np.nan)


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


def determinant_gradient(rotation: Rotation[float], g: Geometry,
                         working_mode: WorkingMode) -> tuple[float, Vector[float]]:
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
            for so_far, row, y, z in zip(gradient, rows[k], cofactor, second, strict=True))
        gradient = gx, gy, gz
    return dot(rows[0], cross(rows[1], rows[2])), gradient


def nearness(quaternion: Quaternion[float], geometry: Geometry, working_mode: WorkingMode,
             sensors: int = 4, left_out: Collection[int] = ()) -> Nearness:
    """
    Dexterities of one pose; nothing is validated.

    `quaternion` is x, y, z, w of R_base_platform, `working_mode` the signs of B_kk, `sensors` the
    number of sensors, 4, 5 or 6, and `left_out` the places of those that are not in use; three are
    left at least. UnreachableError if the pose is out of reach, SingularityError on the boundary
    of the working mode.
    """
    rotation = rotation_from_quaternion(*quaternion)
    th1a, th1b, th1c = measured_angles(rotation, geometry, working_mode, 3)
    rows, diagonal = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    jacobian = np.array([
        [FLOATS.mode_reciprocal(b) * component for component in row]
        for row, b in zip(rows[:sensors], diagonal[:sensors], strict=True)])
    every = _dexterity(jacobian)
    return Nearness(
        _dexterity(jacobian[:3]), every,
        _dexterity(np.delete(jacobian, list(left_out), axis=0)) if left_out else every)


def _dexterity(jacobian: Array) -> float:
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
