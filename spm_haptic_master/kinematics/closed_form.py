# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Improved forward models: the orientation from the active and one passive joint of leg A."""

import numpy as np

from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.checks import check_array, check_broadcast, check_geometry
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    linkage,
    turn_of_second_joint,
    turn_of_third_joint,
)
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

DETERMINANT_TOLERANCE = 1e-9
"""
Below this |L1 M2 - L2 M1| (unit 1) the closed form has no answer.

Rounding of 1e-16 then turns the platform by about 1e-7 rad, still far under the sensors' noise of
7e-4 rad; the noise itself makes the closed form useless long before (see `estimate`).
"""


def theta3a_quaternion(th1a, th1b, th1c, th3a, geometry):
    """
    Case 2 in plain floats, for the 1 kHz path: orientation from four measured angles (eqs. 15, 16).

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Active joints and leg A's second passive joint, rad.
    geometry : Geometry
        Link angles.

    Returns
    -------
    x, y, z, w : float
        Unit quaternion of R_base_platform, whatever the four angles; its sign is arbitrary. Angles
        that do not fit together give some orientation: `estimate` tells.

    Raises
    ------
    SingularityError
        The closed form's determinant vanishes (`DETERMINANT_TOLERANCE`).

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


def forward_theta3a(th1, theta3a, geometry=PAPER_GEOMETRY):
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
        R_base_platform, always rotations. In a batch, rows where the closed form's determinant
        vanishes (`DETERMINANT_TOLERANCE`) are NaN.

    Raises
    ------
    InputError
        An argument is not what is expected; a NaN anywhere in a batch, too.
    SingularityError
        A single sample, and the determinant vanishes.

    """
    active, (theta3a,) = _check_angles(th1, geometry, theta3a=theta3a)
    _, _, leg_b, leg_c = linkage(*active, theta3a, geometry, ARRAYS)
    theta2a = _common_turn_angle(turn_of_second_joint(leg_b, leg_c, geometry))
    return _chain_matrix(active[0], theta2a, theta3a, geometry)


def forward_theta2a(th1, theta2a, geometry=PAPER_GEOMETRY):
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
        R_base_platform, always rotations. In a batch, rows where the closed form's determinant
        vanishes (`DETERMINANT_TOLERANCE`) are NaN.

    Raises
    ------
    InputError
        An argument is not what is expected; a NaN anywhere in a batch, too.
    SingularityError
        A single sample, and the determinant vanishes.

    """
    active, (theta2a,) = _check_angles(th1, geometry, theta2a=theta2a)
    theta3a = _common_turn_angle(turn_of_third_joint(*active, theta2a, geometry, ARRAYS))
    return _chain_matrix(active[0], theta2a, theta3a, geometry)


def _check_angles(th1, geometry, **passive):
    check_geometry(geometry)
    th1 = check_array('th1', th1, (3,))
    passive = {name: check_array(name, value, ()) for name, value in passive.items()}
    check_broadcast(
        'th1, ' + ', '.join(passive), th1.shape[:-1], *(angle.shape for angle in passive.values()))
    return tuple(np.moveaxis(th1, -1, 0)), tuple(passive.values())


def _common_turn_angle(solution):
    cosine, sine, determinant = solution
    singular = ~(np.abs(determinant) > DETERMINANT_TOLERANCE)
    if singular.ndim == 0 and singular:
        raise SingularityError(
            f'the determinant L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size')
    return np.where(singular, np.nan, np.arctan2(sine * determinant, cosine * determinant))


def _chain_matrix(th1a, th2a, th3a, geometry):
    quaternion = chain_quaternion(th1a, th2a, th3a, geometry, ARRAYS)
    return stack_matrix(rotation_from_quaternion(*quaternion))
