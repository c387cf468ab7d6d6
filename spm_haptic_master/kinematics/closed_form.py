# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Improved forward models: the orientation from the active joints and a passive one, in closed form.

Cases 1 and 2 have a passive joint of leg A. An estimate starts from Case 2, or where it cannot,
from any leg with readings of both its sensors, which then carries the platform.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import combinations
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.kinematics.assembly_modes import LockedChain
from spm_haptic_master.kinematics.checks import check_angles, check_broadcast
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, Leg, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    chain_quaternion,
    common_turn,
    half_chain_quaternion,
    leg_angles,
    linkage,
    residual,
    second_axis,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Batch,
    FLOATS,
    Quaternion,
    Rotation,
    SLICE,
    Vector,
)
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion, stack_matrix
from spm_haptic_master.kinematics.vectors import about_x, about_z, times, transposed_times

# Smallest |L1 M2 - L2 M1| of a closed form with an answer (unit 1): rounding of 1e-16 then rotates
# the platform by about 1e-7 rad, far less than the sensors' noise of 7e-4 rad. The noise itself
# makes the closed form useless at much larger determinants (see `estimate`).
DETERMINANT_TOLERANCE = 1e-9
# Smallest |L1 M2 - L2 M1| at which Gauss-Newton starts from the closed form (largest standard
# deviation of the sensors, 1 / rad): the error of the closed form is about the noise over the
# determinant, here a tenth of a radian: Gauss-Newton converges. Below, it may converge to the
# wrong one of two solutions.
CLOSED_FORM_TRUST = 10.0
# What one reading says of R: base . R platform = cosine, with unit vectors in these frames.
Closure: TypeAlias = tuple[Vector[float], Vector[float], float]


def theta3a_quaternion(
    th1a: float,
    th1b: float,
    th1c: float,
    th3a: float,
    geometry: Geometry,
) -> Quaternion[float]:
    """
    Case 2 in plain floats, for the 1 kHz path: orientation from four angles (eqs. 15, 16).

    Nothing is validated: the angles must be finite numbers.

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Active joints and leg A's second passive joint, rad.
    geometry : Geometry
        Link angles and axes.

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
    cosine, sine, determinant = turn_of_second_joint(leg_b, leg_c)
    if not (determinant > DETERMINANT_TOLERANCE or determinant < -DETERMINANT_TOLERANCE):
        raise SingularityError(
            f'th1 = ({th1a}, {th1b}, {th1c}), th3A = {th3a} rad: the determinant '
            f'L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size'
        )
    c, s = FLOATS.half_turn(sine * determinant, cosine * determinant)
    return half_chain_quaternion(th1a, c, s, th3a, geometry, FLOATS)


def forward_theta3a(
    th1: ArrayLike,
    theta3a: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
) -> Array:
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
    return _in_slices(
        case=_case_2,
        th1=th1,
        name='theta3a',
        passive=theta3a,
        geometry=geometry,
    )


def forward_theta2a(
    th1: ArrayLike,
    theta2a: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
) -> Array:
    """
    Case 1: orientations from the active joints and th2A, in closed form (eqs. 13, 14).

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta2a : array_like, shape (...)
        Leg A's first passive joint, rad.
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
    return _in_slices(
        case=_case_1,
        th1=th1,
        name='theta2a',
        passive=theta2a,
        geometry=geometry,
    )


def _in_slices(
    case: Callable[..., Array],
    th1: ArrayLike,
    name: str,
    passive: ArrayLike,
    geometry: Geometry,
) -> Array:
    """Check th1 and the passive angle; return the matrices, a slice of rows at a time."""
    check_geometry(geometry)
    active = check_angles('th1', th1, (3,))
    angle = check_angles(name, passive, ())
    shape = check_broadcast(f'th1, {name}', active.shape[:-1], angle.shape)
    columns = *np.moveaxis(active, -1, 0), angle
    rows = math.prod(shape)
    if rows <= SLICE:
        return case(*columns, geometry)
    result = np.empty((rows, 3, 3))
    flat = [np.broadcast_to(column, shape).ravel() for column in columns]
    for start in range(0, rows, SLICE):
        part = slice(start, start + SLICE)
        of_part = [column[part] for column in flat]
        result[part] = case(*of_part, geometry)
    return result.reshape(shape + (3, 3))


def _case_2(
    th1a: Array,
    th1b: Array,
    th1c: Array,
    th3a: Array,
    geometry: Geometry,
) -> Array:
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, geometry, ARRAYS)
    y, x = _common_turn_point(turn_of_second_joint(leg_b, leg_c))
    c, s = ARRAYS.half_turn(y, x)
    quaternion = half_chain_quaternion(th1a, c, s, th3a, geometry, ARRAYS)
    return stack_matrix(rotation_from_quaternion(*quaternion))


def _case_1(
    th1a: Array,
    th1b: Array,
    th1c: Array,
    th2a: Array,
    geometry: Geometry,
) -> Array:
    chain = LockedChain.of((th1a, th1b, th1c), geometry, ARRAYS)
    first, second = chain.turn_equations(np.cos(th2a), np.sin(th2a))
    y, x = _common_turn_point(common_turn(first, second))
    th3a = np.arctan2(y, x)
    quaternion = chain_quaternion(th1a, th2a, th3a, geometry, ARRAYS)
    return stack_matrix(rotation_from_quaternion(*quaternion))


def _common_turn_point(solution: Vector[Batch]) -> tuple[Array, Array]:
    """Return a point at the angle of a `common_turn`, y and x; NaN where undetermined."""
    cosine, sine, determinant = solution
    singular = ~(np.abs(determinant) > DETERMINANT_TOLERANCE)
    if singular.ndim == 0 and singular:
        raise SingularityError(
            f'the determinant L1 M2 - L2 M1 of the closed form is {determinant:.3g}, expected '
            f'{DETERMINANT_TOLERANCE:g} or more in size'
        )
    determinant = np.where(singular, np.nan, determinant)
    return sine * determinant, cosine * determinant


# Starts of an estimate without Case 2 -----------------------------------------------------------


def trusted_start(
    readings: tuple[float | None, ...],
    largest: float,
    g: Geometry,
) -> State[float] | None:
    """Return the start by the first leg that determines it; `largest` sigma in rad."""
    for leg, first, third, equations in _carriers(readings, g):
        turns = [common_turn(*pair) for pair in combinations(equations, 2)]
        cosine, sine, determinant = max(turns, key=lambda turn: abs(turn[2]))
        if abs(determinant) > CLOSED_FORM_TRUST * largest:
            th2 = math.atan2(sine * determinant, cosine * determinant)
            # The noise may carry another leg beyond its reach.
            with suppress(UnreachableError):
                rotation = carried_by(leg, first, th2, third)
                return start_at(rotation, readings, g)
    return None


def possible_starts(
    readings: tuple[float | None, ...],
    g: Geometry,
    largest: float = math.inf,
) -> Iterator[State[float]]:
    """
    Yield starts by both solutions of each turn equation; each estimate is near one of them.

    Those that leave a `residual` of more than `largest` in an equation of their leg are left out.
    """
    for leg, first, third, equations in _carriers(readings, g):
        for equation in equations:
            for th2 in both_turns(equation):
                misfits = [abs(residual(other, th2)) for other in equations]
                if max(misfits) > largest:
                    continue
                with suppress(UnreachableError):
                    rotation = carried_by(leg, first, th2, third)
                    yield start_at(rotation, readings, g)


def _carriers(
    readings: tuple[float | None, ...],
    g: Geometry,
) -> Iterator[tuple[Leg, float, float, list[Vector[float]]]]:
    """Yield each leg with both its sensors, their readings, and the equations of its th2k."""
    for carrier, leg in enumerate(g.legs):
        first = readings[carrier]
        third = readings[3 + carrier]
        if first is None or third is None:
            continue
        equations = []
        for other in {0, 1, 2} - {carrier}:
            for base, platform, cosine in closures(readings, other, g):
                before = before_second(leg, first, base)
                after = after_second(leg, third, platform)
                equations.append(turn_equation(before, after, cosine))
        yield leg, first, third, equations


def closures(
    readings: tuple[float | None, ...],
    place: int,
    g: Geometry,
) -> Iterator[Closure]:
    """
    Yield what each reading of a leg says of the orientation: base . R platform = cosine.

    th1k fixes Z2k in the base, whose angle to Z3k is beta; th3k fixes Z2k in the platform, whose
    angle to Z1k is alpha. `base` and `platform` are unit vectors in these frames.
    """
    leg = g.legs[place]
    th1 = readings[place]
    th3 = readings[3 + place]
    if th1 is not None:
        yield second_axis(math.cos(th1), math.sin(th1), leg), leg.third, leg.cos_beta
    if th3 is not None:
        in_leg = leg.sin_beta * math.sin(th3), leg.sin_beta * math.cos(th3), leg.cos_beta
        yield leg.first, times(leg.platform_frame, in_leg), leg.cos_alpha


def before_second(
    leg: Leg,
    th1: float,
    axis: Vector[float],
) -> Vector[float]:
    """Components after a leg's proximal link of a vector in the base: Rx(-alpha) Rz(-th1) B^T."""
    in_leg = transposed_times(leg.base_frame, axis)
    turned = about_z(math.cos(th1), -math.sin(th1), in_leg)
    return about_x(leg.cos_alpha, -leg.sin_alpha, turned)


def after_second(
    leg: Leg,
    th3: float,
    axis: Vector[float],
) -> Vector[float]:
    """Components before a leg's distal link of a vector in the platform: Rx(beta) Rz(th3) Q^T."""
    in_leg = transposed_times(leg.platform_frame, axis)
    turned = about_z(math.cos(th3), math.sin(th3), in_leg)
    return about_x(leg.cos_beta, leg.sin_beta, turned)


def carried_by(
    leg: Leg,
    th1: float,
    th2: float,
    th3: float,
) -> Rotation[float]:
    """R_base_platform of a leg's chain, eq. 6."""
    columns = []
    for unit in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        vector = after_second(leg, th3, unit)
        vector = about_z(math.cos(th2), math.sin(th2), vector)
        vector = about_x(leg.cos_alpha, leg.sin_alpha, vector)
        vector = about_z(math.cos(th1), math.sin(th1), vector)
        columns.append(times(leg.base_frame, vector))
    (r00, r10, r20), (r01, r11, r21), (r02, r12, r22) = columns
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def start_at(
    rotation: Rotation[float],
    readings: tuple[float | None, ...],
    g: Geometry,
) -> State[float]:
    """
    Return th1A, th2A, th3A, th1B, th1C, rad: the readings; missing ones from an orientation.

    The six readings, None for one that is not used, select the working mode of a leg. An active
    angle of leg B or C without any reading is 0. UnreachableError if a leg that lacks a reading
    does not reach the orientation.
    """
    th1a = readings[0]
    th3a = readings[3]
    found_1a, th2a, found_3a = _fitting_angles(
        rotation=rotation,
        leg=g.legs[0],
        th1=th1a,
        th3=th3a,
    )
    th1b = _active_angle(
        rotation=rotation,
        leg=g.legs[1],
        th1=readings[1],
        th3=readings[4],
    )
    th1c = _active_angle(
        rotation=rotation,
        leg=g.legs[2],
        th1=readings[2],
        th3=readings[5],
    )
    return (
        found_1a if th1a is None else th1a,
        th2a,
        found_3a if th3a is None else th3a,
        th1b,
        th1c,
    )


def _active_angle(
    rotation: Rotation[float],
    leg: Leg,
    th1: float | None,
    th3: float | None,
) -> float:
    """Return th1k, rad: as read, or in the working mode that fits th3k; 0 without a reading."""
    if th1 is not None:
        return th1
    if th3 is None:
        return 0.0
    found, _, _ = _fitting_angles(rotation, leg, None, th3)
    return found


def _fitting_angles(
    rotation: Rotation[float],
    leg: Leg,
    th1: float | None,
    th3: float | None,
) -> Vector[float]:
    """Return a leg's joint angles, rad, in the working mode that fits the readings best."""

    def misfit(solution: Vector[float]) -> float:
        found_1, _, found_3 = solution
        total = 0.0
        if th1 is not None:
            total += abs(math.remainder(found_1 - th1, 2.0 * math.pi))
        if th3 is not None:
            total += abs(math.remainder(found_3 - th3, 2.0 * math.pi))
        return total

    solutions = [leg_angles(rotation, leg, sign, FLOATS) for sign in (1, -1)]
    return min(solutions, key=misfit)
