# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Velocities: Jacobians with three and four sensors, dexterity and the parallel determinant."""

import numpy as np

from spm_haptic_master.exceptions import InputError, SingularityError
from spm_haptic_master.kinematics.checks import (
    check_geometry,
    check_rotations,
    check_sensors,
    check_working_mode,
)
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import inverse, RIG_WORKING_MODE
from spm_haptic_master.kinematics.leg_kernels import (
    second_axis_a,
    second_axis_b,
    second_axis_c,
    third_axes,
)
from spm_haptic_master.kinematics.number_backends import ARRAYS, MODE_BOUNDARY
from spm_haptic_master.kinematics.rotations import unstack_matrix

DEXTERITY_NORMS = ('2', 'frobenius')
"""Norms of eq. 12: the 2-norm, and the Frobenius norm weighted by 1 / 3."""


def dot(u, v):
    """Scalar product of two vectors of three numbers."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


def cross(u, v):
    """Vector product of two vectors of three numbers."""
    ux, uy, uz = u
    vx, vy, vz = v
    return uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


def velocity_rows(rotation, th1, g, m):
    """
    Kernel of eqs. 9, 10, 20, 21: rows of A_r and diagonal of B_r with B_r thetadot = A_r omega.

    Rows Z2k x Z3k for k = A, B, C, then Z1A x Z2A; the diagonal is B_AA, B_BB, B_CC, B_AA. (The
    print has Z3k x Z2k and Z3A . (Z2A x Z1A), which turn the sign of the velocity.)

    Returns
    -------
    rows : tuple of four 3-tuples of numbers
        Components in the base frame.
    diagonal : tuple of four numbers

    """
    th1a, th1b, th1c = th1
    second_a = second_axis_a(m.cos(th1a), m.sin(th1a), g)
    second_b = second_axis_b(m.cos(th1b), m.sin(th1b), g)
    second_c = second_axis_c(m.cos(th1c), m.sin(th1c), g)
    third_a, third_b, third_c = third_axes(rotation, g)
    row_a = cross(second_a, third_a)
    row_b = cross(second_b, third_b)
    row_c = cross(second_c, third_c)
    x, y, _ = second_a
    # Z1A, Z1B, Z1C are z, x, y: B_kk is one component of the row.
    return (row_a, row_b, row_c, (-y, x, 0.0 * x)), (row_a[2], row_b[0], row_c[1], row_a[2])


def _velocity_arrays(matrices, geometry, working_mode):
    """Return A_r (..., 4, 3) and diagonal of B_r (..., 4) of checked poses; NaN out of reach."""
    th1 = inverse(matrices, geometry, working_mode).theta1
    rows, diagonal = velocity_rows(
        unstack_matrix(matrices), tuple(np.moveaxis(th1, -1, 0)), geometry, ARRAYS)
    rows = np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
    return rows, np.stack(diagonal, axis=-1)


def jacobian(R, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE, sensors=3):
    """
    Jacobian G of the inverse model: thetadot = G omega (eqs. 8 to 11 and 17 to 21, sign corrected).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    sensors : {3, 4}
        Rows th1A, th1B, th1C, and with 4 also th3A.

    Returns
    -------
    ndarray, shape (..., sensors, 3)
        G, unit 1, for the platform's angular velocity omega in the BASE frame, rad/s. It is the
        inverse of the paper's J. In a batch, poses out of reach or on the boundary of their working
        mode (`MODE_BOUNDARY`) give NaN, all rows of that pose.

    Raises
    ------
    InputError
        An argument is not what is expected.
    UnreachableError
        A single pose, out of reach.
    SingularityError
        A single pose, on the boundary of the working mode.

    """
    matrices = check_rotations('R', R)
    check_geometry(geometry)
    sensors = check_sensors(sensors)
    rows, diagonal = _velocity_arrays(matrices, geometry, check_working_mode(working_mode))
    boundary = (np.abs(diagonal) < MODE_BOUNDARY).any(axis=-1)
    if matrices.ndim == 2 and boundary:
        raise SingularityError(
            f'R = {matrices.tolist()} lies on the boundary of working mode {tuple(working_mode)}: '
            f'B_kk = {diagonal[:3].tolist()}, expected {MODE_BOUNDARY:g} or more in size')
    diagonal = np.where(boundary[..., None], np.nan, diagonal)
    return (rows / diagonal[..., None])[..., :sensors, :]


def parallel_determinant(R, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE):
    """
    Return det A, zero at a parallel singularity (eq. 9, rows Z2k x Z3k; Fig. 7).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    ndarray, shape (...)
        det A, unit 1. With the print's rows Z3k x Z2k it would be the negative. Unreachable poses
        of a batch give NaN.

    Raises
    ------
    InputError
        An argument is not what is expected.
    UnreachableError
        A single pose, out of reach.

    """
    matrices = check_rotations('R', R)
    th1 = inverse(matrices, geometry, working_mode).theta1
    (row_a, row_b, row_c, _), _ = velocity_rows(
        unstack_matrix(matrices), tuple(np.moveaxis(th1, -1, 0)), geometry, ARRAYS)
    return dot(row_a, cross(row_b, row_c))


def dexterity(R, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE, sensors=3,
              norm='2'):
    """
    Dexterity: the inverse of the Jacobian's condition number (eq. 12).

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    sensors : {3, 4}
        Active joints only, or with th3A.
    norm : {'2', 'frobenius'}
        The paper does not say which norm eq. 12 means. '2': smallest over largest singular value of
        G. 'frobenius': the Frobenius norm weighted by 1 / 3, i.e. 3 / sqrt(sum s^2 sum 1 / s^2).

    Returns
    -------
    ndarray, shape (...)
        In [0, 1]: 0 at a parallel singularity, 1 where all directions are alike. Rows for which
        `jacobian` gives NaN are NaN.

    Raises
    ------
    InputError
        An argument is not what is expected.
    UnreachableError, SingularityError
        A single pose, as `jacobian` says.

    """
    if norm not in DEXTERITY_NORMS:
        raise InputError(f'norm = {norm!r}: expected one of {DEXTERITY_NORMS}')
    G = jacobian(R, geometry, working_mode, sensors)
    known = np.isfinite(G).all(axis=(-1, -2))
    # LAPACK does not take NaN: such poses get a stand-in, and NaN again at the end.
    values = np.linalg.svd(np.where(known[..., None, None], G, 1.0), compute_uv=False)
    if norm == '2':
        eta = values[..., 2] / values[..., 0]
    else:
        # s3 is pulled out of the sum of 1 / s^2, so that s3 = 0 gives 0.
        s1, s2, s3 = np.moveaxis(values, -1, 0)
        eta = 3.0 * s3 / np.sqrt(
            (s1**2 + s2**2 + s3**2)
            * (1.0 + np.divide(s3, s2, out=np.zeros_like(s2), where=s2 > 0.0)**2 + (s3 / s1)**2))
    return np.where(known, eta, np.nan)
