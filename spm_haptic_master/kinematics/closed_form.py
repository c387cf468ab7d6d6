# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Improved forward models: the orientation from the active joints and a passive one of leg A."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.checks import check_array, check_broadcast, check_geometry
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    linkage,
    turn_of_second_joint,
    turn_of_third_joint,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Batch,
    FLOATS,
    Quaternion,
    Vector,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

# Smallest |L1 M2 - L2 M1| of a closed form with an answer (unit 1): rounding of 1e-16 then rotates
# the platform by about 1e-7 rad, far less than the sensors' noise of 7e-4 rad. The noise itself
# makes the closed form useless at much larger determinants (see `estimate`).
DETERMINANT_TOLERANCE = 1e-9


def theta3a_quaternion(th1a: float, th1b: float, th1c: float, th3a: float,
                       geometry: Geometry) -> Quaternion[float]:
    """
    Case 2 in plain floats, for the 1 kHz path: orientation from four angles (eqs. 15, 16).

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Active joints and leg A's second passive joint, rad.
    geometry : Geometry
        Link angles.

    Returns
    -------
    x, y, z, w : float
        Unit quaternion of R_base_platform, for any four angles; its sign is arbitrary. Angles
        that contradict each other give a meaningless orientation: `estimate` detects that.

    Raises
    ------
    SingularityError
        The determinant of the closed form vanishes (`DETERMINANT_TOLERANCE`).

    """
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(leg_b, leg_c, geometry)
    if not (determinant > DETERMINANT_TOLERANCE or determinant < -DETERMINANT_TOLERANCE):
        raise SingularityError(
            f'th1 = ({th1a}, {th1b}, {th1c}), th3A = {th3a} rad: the determinant '
            f'L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size')
    th2a = FLOATS.atan2(sine * determinant, cosine * determinant)
    return chain_quaternion(th1a, th2a, th3a, geometry, FLOATS)


def forward_theta3a(th1: ArrayLike, theta3a: ArrayLike,
                    geometry: Geometry = PAPER_GEOMETRY) -> Array:
    """
    Case 2: orientations from the active joints and th3A, in closed form (eqs. 15, 16).

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta3a : array_like, shape (...)
        Leg A's second passive joint, rad.
    geometry : Geometry
        Link angles.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform, always rotations. In a batch, rows for which the determinant of the closed
        form vanishes (`DETERMINANT_TOLERANCE`) are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    SingularityError
        The determinant of a single sample vanishes.

    """
    (th1a, th1b, th1c), th3a = _check_angles(th1, 'theta3a', theta3a, geometry)
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, geometry, ARRAYS)
    th2a = _common_turn_angle(turn_of_second_joint(leg_b, leg_c, geometry))
    return _chain_matrix(th1a, th2a, th3a, geometry)


def forward_theta2a(th1: ArrayLike, theta2a: ArrayLike,
                    geometry: Geometry = PAPER_GEOMETRY) -> Array:
    """
    Case 1: orientations from the active joints and th2A, in closed form (eqs. 13, 14).

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta2a : array_like, shape (...)
        Leg A's first passive joint, rad.
    geometry : Geometry
        Link angles.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform, always rotations. In a batch, rows for which the determinant of the closed
        form vanishes (`DETERMINANT_TOLERANCE`) are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    SingularityError
        The determinant of a single sample vanishes.

    """
    (th1a, th1b, th1c), th2a = _check_angles(th1, 'theta2a', theta2a, geometry)
    th3a = _common_turn_angle(turn_of_third_joint(th1a, th1b, th1c, th2a, geometry, ARRAYS))
    return _chain_matrix(th1a, th2a, th3a, geometry)


def _check_angles(th1: ArrayLike, name: str, passive: ArrayLike,
                  geometry: Geometry) -> tuple[Vector[Batch], Array]:
    """Return th1A, th1B, th1C and the passive angle of that name, rad, checked."""
    check_geometry(geometry)
    active, angle = check_array('th1', th1, (3,)), check_array(name, passive, ())
    check_broadcast(f'th1, {name}', active.shape[:-1], angle.shape)
    th1a, th1b, th1c = np.moveaxis(active, -1, 0)
    return (th1a, th1b, th1c), angle


def _common_turn_angle(solution: Vector[Batch]) -> Array:
    """Angle, rad, of a `common_turn`; NaN where its determinant vanishes."""
    cosine, sine, determinant = solution
    singular = ~(np.abs(determinant) > DETERMINANT_TOLERANCE)
    if singular.ndim == 0 and singular:
        raise SingularityError(
            f'the determinant L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size')
    return np.where(singular, np.nan, np.arctan2(sine * determinant, cosine * determinant))


def _chain_matrix(th1a: Batch, th2a: Batch, th3a: Batch, geometry: Geometry) -> Array:
    """Matrices (..., 3, 3) of leg A's chain from its joint angles in rad."""
    quaternion = chain_quaternion(th1a, th2a, th3a, geometry, ARRAYS)
    return stack_matrix(rotation_from_quaternion(*quaternion))
