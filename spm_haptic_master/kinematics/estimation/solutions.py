# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every orientation that the readings of some sensors allow, and what they say of one more sensor.

Three readings, one of each leg, allow up to 8 orientations, as the active joints do (eqs. 1 to
7). Where a leg has both its sensors in use, its chain lacks only th2k, and each further reading
is a turn equation with two solutions. Gauss-Newton then fits all readings from each of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
import math
from typing import NamedTuple

from spm_haptic_master.exceptions import SpmError, UnreachableError
from spm_haptic_master.kinematics.assembly_modes import common_turns, eliminant_roots
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import (
    after_second,
    before_second,
    carried_by,
    Closure,
    closures,
    possible_starts,
    start_at,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    fit,
    MODE_MARGIN,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.inverse_model import measured_angles, velocity_rows
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    into_second_link,
    linkage,
    residual,
    squared_sine,
    turn_equation,
)
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    rotation_distance,
    rotation_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import about_x, dot, times, transposed_times

# Largest angle between two results of one solution (rad): where two solutions meet, noise of the
# readings turns each further than this.
SAME_SOLUTION = 1e-4
# Largest residual of a turn equation (unit 1) at a start that may lead to a solution: noise and
# bias of the readings leave a hundredth, most starts of no solution more than this.
START_RESIDUAL = 0.1
# Turn on either side of an orientation over which the curvature of the readings is taken (rad).
CURVATURE_TURN = 0.03
TURN = 2.0 * math.pi
Readings = tuple[float | None, ...]


def known_readings(readings: tuple[float, ...], sensors: UsedSensors) -> Readings:
    """Return the six readings, rad, None of a sensor that is not in use."""
    return tuple(readings[place] if place in sensors.used else None for place in range(6))


def fit_near(
    quaternion: Quaternion[float],
    readings: tuple[float, ...],
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> SampleEstimate:
    """
    Fit the readings in use by Gauss-Newton from an orientation.

    Parameters
    ----------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform to start from.
    readings : tuple of N float
        th1A, th1B, th1C, th3A, th3B, th3C of the N mounted sensors, rad; one that is not in use
        may be NaN.
    sensors : UsedSensors
        The three or more sensors in use.
    geometry : Geometry
        The mechanism.
    working_mode : tuple of three int
        Signs of B_kk of the legs A, B, C (eq. 10).

    Returns
    -------
    SampleEstimate
        The solution that Gauss-Newton converges to.

    Raises
    ------
    UnreachableError
        It converges to none, or a leg without a sensor in use does not reach the solution.
    SingularityError
        The sensors do not measure every direction, or the solution is in another working mode.

    """
    known = known_readings(readings, sensors)
    start = start_at(rotation_from_quaternion(*quaternion), known, geometry)
    return _fitted(start, known, sensors, geometry, working_mode)


def all_solutions(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> list[SampleEstimate]:
    """
    Return every orientation in a working mode that fits the readings of three or more sensors.

    Of four and more sensors it is every best fit near which all readings fit to some degrees.
    Parameters as of `fit_near`. No solution is returned twice; where infinitely many fit, some
    are missing.
    """
    known = known_readings(readings, sensors)
    starts = possible_starts(known, geometry, START_RESIDUAL)
    legs = zip(known[:3], known[3:], strict=True)
    if not any(first is not None and third is not None for first, third in legs):
        starts = _one_reading_a_leg(known, geometry)
    found: list[SampleEstimate] = []
    for start in starts:
        with suppress(SpmError):
            solution = _fitted(start, known, sensors, geometry, working_mode)
            if all(
                rotation_distance(solution.quaternion, other.quaternion) > SAME_SOLUTION
                for other in found
            ):
                found.append(solution)
    return found


def _fitted(
    start: State[float],
    known: Readings,
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> SampleEstimate:
    """Fit from a start; UnreachableError where a leg without a sensor in use cannot follow."""
    th1a, _, th3a, th1b, th1c = start
    readings = tuple(0.0 if angle is None else angle for angle in known[: len(sensors.sigma)])
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    solution = fit(start, view, readings, sensors, geometry, working_mode)
    rotation = rotation_from_quaternion(*solution.quaternion)
    for place, leg in enumerate(geometry.legs):
        if known[place] is None and known[3 + place] is None:
            # With p the root, B_kk is p sin alpha: noise may take it so far beyond 0.
            if squared_sine(rotation, leg) * leg.sin_alpha**2 < -MODE_MARGIN * MODE_MARGIN:
                raise UnreachableError(f'leg {"ABC"[place]} does not reach the orientation')
    return solution


def _one_reading_a_leg(known: Readings, g: Geometry) -> Iterator[State[float]]:
    """Yield starts from three readings, one of each leg: leg A carries the platform."""
    leg = g.legs[0]
    th1 = known[0]
    th3 = known[3]
    (first,) = closures(known, 1, g)
    (second,) = closures(known, 2, g)

    def equations(cosine: float, sine: float) -> tuple[Vector[float], Vector[float]]:
        """Return the turn equations, in the passive angle without a reading, at a th2A."""
        if th1 is not None:
            return (
                _of_third(leg, th1, first, cosine, sine),
                _of_third(leg, th1, second, cosine, sine),
            )
        return (
            _of_first(leg, th3 or 0.0, first, cosine, sine),
            _of_first(leg, th3 or 0.0, second, cosine, sine),
        )

    for th2 in eliminant_roots(equations) or ():
        both = equations(math.cos(th2), math.sin(th2))
        for angle in common_turns(*both):
            if any(abs(residual(equation, angle)) > START_RESIDUAL for equation in both):
                continue
            if th1 is not None:
                rotation = carried_by(leg, th1, th2, angle)
            else:
                rotation = carried_by(leg, angle, th2, th3 or 0.0)
            with suppress(UnreachableError):
                yield start_at(rotation, known, g)


def _of_third(
    leg: Leg,
    th1: float,
    closure: Closure,
    c2: float,
    s2: float,
) -> Vector[float]:
    """Return the turn equation of th3 of a leg with th1, from cosine and sine of th2."""
    base, platform, cosine = closure
    before = into_second_link(c2, s2, before_second(leg, th1, base))
    return turn_equation(
        about_x(leg.cos_beta, -leg.sin_beta, before),
        transposed_times(leg.platform_frame, platform),
        cosine,
    )


def _of_first(
    leg: Leg,
    th3: float,
    closure: Closure,
    c2: float,
    s2: float,
) -> Vector[float]:
    """Return the turn equation of th1 of a leg with th3, from cosine and sine of th2."""
    base, platform, cosine = closure
    after = into_second_link(c2, -s2, after_second(leg, th3, platform))
    return turn_equation(
        transposed_times(leg.base_frame, base),
        about_x(leg.cos_alpha, leg.sin_alpha, after),
        cosine,
    )


# What the others say of one sensor ---------------------------------------------------------------


class ImpliedFault(NamedTuple):
    """The fault of one sensor if the others are right, and how well they know it, rad."""

    fault: float  # reading less the angle that the others imply
    deviation: float  # its standard deviation, with the noise of all sensors
    bias: float  # what the nominal biases of all sensors do to it at most


def implied_fault(
    others: SampleEstimate,
    sensor: int,
    reading: float,
    bias: tuple[float, ...],
    parity_bias: float,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> ImpliedFault:
    """
    Return the fault of a sensor that an orientation implies, which the other sensors determine.

    Parameters
    ----------
    others : SampleEstimate
        The orientation, from other sensors.
    sensor : int
        Place of the sensor in ALL_JOINT_NAMES.
    reading : float
        Its reading, rad.
    bias : tuple of N float
        Nominal biases of the mounted sensors, rad.
    parity_bias : float
        Bound of the length of that part of the biases that no motion explains, rad.
    geometry, working_mode
        As of `fit_near`.

    Returns
    -------
    ImpliedFault
        First order: with the gains K_j = C h_j / sigma_j^2 of the others, C their covariance and
        h the sensors' rows of the Jacobian (eqs. 8 to 11, 17 to 21).

    Raises
    ------
    SpmError
        A leg does not reach the orientation, or is on the boundary of its working mode.

    """
    used = others.sensors
    rotation = rotation_from_quaternion(*others.quaternion)
    angles = measured_angles(rotation, geometry, working_mode, 6)
    rows = _sensor_rows(rotation, angles, geometry)
    along = times(others.covariance, rows[sensor])
    sigma = used.sigma[sensor]
    moved = bias[sensor]
    square = 1.0
    for other in used.used:
        gain = abs(dot(rows[other], along)) * used.weights[other]
        moved += gain * bias[other]
        square += gain * gain
    return ImpliedFault(
        fault=math.remainder(reading - angles[sensor], TURN),
        deviation=math.sqrt(sigma * sigma + dot(rows[sensor], along)),
        bias=min(moved, parity_bias * math.sqrt(square)),
    )


def parity_curvature(
    estimate: SampleEstimate,
    sensor: int,
    geometry: Geometry,
    working_mode: WorkingMode,
) -> float:
    """
    Return how the parity of four sensors bends along the turn that a fault of one makes.

    A turn e (rad) of the orientation along that direction changes the parity by e / slope + c e^2
    with this c (1 / rad^2, of either sign): to first order it is the sensor's slope that bounds
    its fault, but where the others stop determining the direction, c alone remains.

    Parameters
    ----------
    estimate : SampleEstimate
        Orientation by four sensors in use.
    sensor : int
        Place of the faulty sensor in ALL_JOINT_NAMES.
    geometry, working_mode
        As of `fit_near`.

    Raises
    ------
    SpmError
        A leg does not reach an orientation `CURVATURE_TURN` away, or is on the boundary of its
        working mode.

    """
    quaternion = estimate.quaternion
    rotation = rotation_from_quaternion(*quaternion)
    angles = measured_angles(rotation, geometry, working_mode, 6)
    row = _sensor_rows(rotation, angles, geometry)[sensor]
    gx, gy, gz = times(estimate.covariance, row)
    scale = CURVATURE_TURN / math.hypot(gx, gy, gz)
    turn = quaternion_from_vector(scale * gx, scale * gy, scale * gz)
    ahead = multiply_quaternions(turn, quaternion)
    behind = multiply_quaternions(conjugate(turn), quaternion)
    angles_ahead = measured_angles(rotation_from_quaternion(*ahead), geometry, working_mode, 6)
    angles_behind = measured_angles(rotation_from_quaternion(*behind), geometry, working_mode, 6)
    gains = estimate.parity_gains
    bent = 0.0
    for place in estimate.sensors.used:
        change_ahead = math.remainder(angles_ahead[place] - angles[place], TURN)
        change_behind = math.remainder(angles_behind[place] - angles[place], TURN)
        bent += gains[place][0] * (change_ahead + change_behind)
    return 0.5 * bent / (CURVATURE_TURN * CURVATURE_TURN)


def _sensor_rows(
    rotation: Rotation[float],
    angles: tuple[float, ...],
    geometry: Geometry,
) -> list[Vector[float]]:
    """Return the six sensors' rows of the Jacobian in the base frame (unit 1)."""
    th1a, th1b, th1c = angles[:3]
    vectors, volumes = velocity_rows(rotation, (th1a, th1b, th1c), geometry, FLOATS)
    rows = []
    for (x, y, z), volume in zip(vectors, volumes, strict=True):
        scale = FLOATS.mode_reciprocal(volume)
        rows.append((scale * x, scale * y, scale * z))
    return rows
