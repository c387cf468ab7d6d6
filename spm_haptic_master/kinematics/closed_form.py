# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Improved forward models: the orientation from the active joints and a passive one of leg A."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.checks import check_angles, check_broadcast
from spm_haptic_master.kinematics.estimation.normal_equations import linearise
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    common_turn,
    half_chain_quaternion,
    linkage,
    passive_axes,
    turn_equation,
    turn_of_second_joint,
    turn_of_third_joint,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Batch,
    FLOATS,
    Quaternion,
    SLICE,
    Vector,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix

# Smallest |L1 M2 - L2 M1| of a closed form with an answer (unit 1): rounding of 1e-16 then rotates
# the platform by about 1e-7 rad, far less than the sensors' noise of 7e-4 rad. The noise itself
# makes the closed form useless at much larger determinants (see `estimate`).
DETERMINANT_TOLERANCE = 1e-9
# The sensors of Case 2; their weights do not matter to the rates of the legs.
FOUR = UsedSensors((1.0,) * 4)
# th1A, th1B, th1C and a passive angle of leg A, rad.
FourAngles: TypeAlias = tuple[Array, Array, Array, Array]


def theta3a_quaternion(th1a: float, th1b: float, th1c: float, th3a: float,
                       geometry: Geometry) -> Quaternion[float]:
    """
    Case 2 in plain floats, for the 1 kHz path: orientation from four angles (eqs. 15, 16).

    Nothing is validated: the angles, rad, must be finite numbers.

    Returned is the unit quaternion x, y, z, w of R_base_platform, of either sign. Angles that
    contradict each other give a meaningless one: `estimate` detects that. SingularityError if the
    determinant of the closed form vanishes (`DETERMINANT_TOLERANCE`).
    """
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(leg_b, leg_c)
    if not (determinant > DETERMINANT_TOLERANCE or determinant < -DETERMINANT_TOLERANCE):
        raise SingularityError(
            f'th1 = ({th1a}, {th1b}, {th1c}), th3A = {th3a} rad: the determinant '
            f'L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size')
    c, s = FLOATS.half_turn(sine * determinant, cosine * determinant)
    return half_chain_quaternion(th1a, c, s, th3a, geometry, FLOATS)


def theta3a_gains(th1a: float, th1b: float, th1c: float, th3a: float,
                  geometry: Geometry) -> tuple[Vector[float], ...]:
    """
    How the orientation of Case 2 depends on its four readings, in plain floats.

    The closed form weighs the closures of legs B and C by their terms N1 and N2, not by their
    sensors' noise, so that it depends on the readings in another way than the estimate.

    Returned are rotation vectors in the base frame, rad per rad of th1A, th1B, th1C, th3A.
    SingularityError if a leg's closure does not determine th2A, or a leg is on the boundary of its
    working mode.
    """
    readings = th1a, th1b, th1c, th3a
    (c1, s1), _, leg_b, leg_c = view = linkage(*readings, geometry, FLOATS)
    first, second = turn_equation(*leg_b), turn_equation(*leg_c)
    cosine, sine, determinant = common_turn(first, second)
    th2a = math.atan2(sine * determinant, cosine * determinant)
    ((_, b1, b2, b3, _), (_, d1, d2, d3, _)), _ = linearise(
        (th1a, th2a, th3a, th1b, th1c), view, readings, FOUR, geometry, FLOATS)
    if b2 == 0.0 or d2 == 0.0 or determinant == 0.0:
        raise SingularityError('the closures of legs B and C do not determine th2A')
    length = FLOATS.sqrt(cosine * cosine + sine * sine)
    sign = 1.0 if determinant > 0.0 else -1.0
    c2, s2 = sign * cosine / length, sign * sine / length
    # Share of leg B's closure in th2A, of the linear system's solution at consistent readings.
    (l1, m1, n1), (l2, m2, n2) = first, second
    share_b = n2 * (l1 * s2 - m1 * c2)
    share_c = n1 * (m2 * c2 - l2 * s2)
    share_b, share_c = share_b / (share_b + share_c), share_c / (share_b + share_c)
    along = (-share_b * b1 / b2 - share_c * d1 / d2, share_b / b2, share_c / d2,
             -share_b * b3 / b2 - share_c * d3 / d2)
    (x2, y2, z2), (x3, y3, z3) = passive_axes(c1, s1, c2, s2, geometry)
    x1, y1, z1 = geometry.legs[0].first
    gains = [(each * x2, each * y2, each * z2) for each in along]
    (xa, ya, za), (xe, ye, ze) = gains[0], gains[3]
    return (xa + x1, ya + y1, za + z1), gains[1], gains[2], (xe + x3, ye + y3, ze + z3)


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
        Link angles and axes.

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
    return _in_slices(_case_2, th1, 'theta3a', theta3a, geometry)


def forward_theta2a(th1: ArrayLike, theta2a: ArrayLike,
                    geometry: Geometry = PAPER_GEOMETRY) -> Array:
    """
    Case 1: orientations from the active joints and th2A, in closed form (eqs. 13, 14).

    `theta2a` (...) is leg A's first passive joint, rad; all else as of `forward_theta3a`.
    """
    return _in_slices(_case_1, th1, 'theta2a', theta2a, geometry)


def _in_slices(case: Callable[[FourAngles, Geometry], Quaternion[Batch]], th1: ArrayLike,
               name: str, passive: ArrayLike, geometry: Geometry) -> Array:
    """Check th1 and the passive angle; return the matrices, a slice of rows at a time."""
    check_geometry(geometry)
    active, angle = check_angles('th1', th1, (3,)), check_angles(name, passive, ())
    shape = check_broadcast(f'th1, {name}', active.shape[:-1], angle.shape)
    th1a, th1b, th1c = np.moveaxis(active, -1, 0)
    rows = math.prod(shape)
    if rows <= SLICE:
        return _matrix(case((th1a, th1b, th1c, angle), geometry))
    result = np.empty((rows, 3, 3))
    th1a, th1b, th1c, angle = (
        np.broadcast_to(each, shape).ravel() for each in (th1a, th1b, th1c, angle))
    for start in range(0, rows, SLICE):
        part = slice(start, start + SLICE)
        result[part] = _matrix(case((th1a[part], th1b[part], th1c[part], angle[part]), geometry))
    return result.reshape(shape + (3, 3))


def _case_2(angles: FourAngles, geometry: Geometry) -> Quaternion[Batch]:
    """Orientations of th1A, th1B, th1C, th3A."""
    _, _, leg_b, leg_c = linkage(*angles, geometry, ARRAYS)
    y, x = _common_turn_point(turn_of_second_joint(leg_b, leg_c))
    return half_chain_quaternion(angles[0], *ARRAYS.half_turn(y, x), angles[3], geometry, ARRAYS)


def _case_1(angles: FourAngles, geometry: Geometry) -> Quaternion[Batch]:
    """Orientations of th1A, th1B, th1C, th2A."""
    y, x = _common_turn_point(turn_of_third_joint(*angles, geometry, ARRAYS))
    return chain_quaternion(angles[0], angles[3], np.arctan2(y, x), geometry, ARRAYS)


def _common_turn_point(solution: Vector[Batch]) -> tuple[Array, Array]:
    """Sine and cosine of a `common_turn`, each times the same; NaN where undetermined."""
    cosine, sine, determinant = solution
    singular = ~(np.abs(determinant) > DETERMINANT_TOLERANCE)
    if singular.ndim == 0 and singular:
        raise SingularityError(
            f'the determinant L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size')
    determinant = np.where(singular, np.nan, determinant)
    return sine * determinant, cosine * determinant


def _matrix(quaternion: Quaternion[Batch]) -> Array:
    """Matrices (..., 3, 3) of a batch of unit quaternions."""
    return stack_matrix(rotation_from_quaternion(*quaternion))
