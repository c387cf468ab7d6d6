"""Improved forward models: the orientation from the active and one passive joint of leg A."""

import numpy as np

from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.checks import check_array, check_broadcast, check_geometry
from spm_haptic_master.kinematics.elementary import ARRAYS, FLOATS
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.legs import (
    chain_quaternion,
    common_turn,
    from_third_joint,
    into_second_joint,
    into_third_joint,
    second_axis_b,
    second_axis_c,
    turn_equation,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

DETERMINANT_TOLERANCE = 1e-9
"""
Below this |L1 M2 - L2 M1| (unit 1) the closed form has no answer.

Rounding of 1e-16 then turns the platform by about 1e-7 rad, still far under the sensors' noise of
7e-4 rad; the noise itself makes the closed form useless long before (see `estimate`).
"""


def second_axes_in_second_joint(c, s, th1b, th1c, g, m):
    """Z2B and Z2C seen after leg A's active joint, from cosine and sine of th1A."""
    return (into_second_joint(c, s, second_axis_b(m.cos(th1b), m.sin(th1b), g), g),
            into_second_joint(c, s, second_axis_c(m.cos(th1c), m.sin(th1c), g), g))


def linkage(th1a, th1b, th1c, th3a, g, m):
    """
    Legs B and C as leg A's second joint sees them, before its turn by th2A.

    Returns
    -------
    c1, s1 : numbers
        Cosine and sine of th1A.
    leg_b, leg_c : pairs of 3-tuples of numbers
        Z2k, on the base's side of the joint, and Z3k, on the platform's.

    """
    c1, s1 = m.cos(th1a), m.sin(th1a)
    c3, s3 = m.cos(th3a), m.sin(th3a)
    second_b, second_c = second_axes_in_second_joint(c1, s1, th1b, th1c, g, m)
    third_b, third_c = g.third_joint_axes
    return (c1, s1, (second_b, from_third_joint(c3, s3, third_b, g)),
            (second_c, from_third_joint(c3, s3, third_c, g)))


def turn_of_second_joint(leg_b, leg_c, g):
    """
    Case 2: cosine and sine of th2A, each times the determinant, and the determinant; eqs. 15, 16.

    th2A is measured from the arc A1A2 produced: th2A = xi + xi', eq. 13.
    """
    return common_turn(turn_equation(*leg_b, g), turn_equation(*leg_c, g))


def turn_of_third_joint(th1a, th1b, th1c, th2a, g, m):
    """Case 1: cosine and sine of th3A, each times the determinant, and that; eqs. 13, 14."""
    axes = second_axes_in_second_joint(m.cos(th1a), m.sin(th1a), th1b, th1c, g, m)
    c, s = m.cos(th2a), m.sin(th2a)
    third_b, third_c = g.third_joint_axes
    second_b, second_c = (into_third_joint(c, s, axis, g) for axis in axes)
    return common_turn(turn_equation(second_b, third_b, g), turn_equation(second_c, third_c, g))


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
