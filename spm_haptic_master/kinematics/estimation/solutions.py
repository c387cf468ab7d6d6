# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Every orientation that the readings of some sensors allow.

Three readings, one of each leg, allow up to 8 orientations, as the active joints do (eqs. 1 to
7). Where a leg has both its sensors in use, its chain lacks only th2k, and each further reading
is a turn equation with two solutions. Gauss-Newton then fits all readings from each of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
import math

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
    CONVERGED_STEP,
    fit,
    MODE_MARGIN,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.joints import LEG_NAMES, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    into_second_link,
    linkage,
    residual,
    squared_sine,
    turn_equation,
)
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Vector
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion
from spm_haptic_master.kinematics.vectors import about_x, transposed_times

# Largest angle between two results of Gauss-Newton that are one solution (rad): the noise of the
# readings alone turns solutions that nearly meet further apart. And between such a result and one
# that stopped earlier, of the 1 kHz path, in total standard deviations.
SAME_SOLUTION = 1e-4
SAME_DEVIATIONS = 6.0
# Largest residual of a turn equation (unit 1) at a start that may lead to a solution: noise and
# bias of the readings leave a hundredth, most starts of no solution more than this.
START_RESIDUAL = 0.1
# The readings of th1A, th1B, th1C, th3A, th3B, th3C, rad; None of a sensor that is not in use.
Readings = tuple[float | None, ...]


def known_readings(readings: tuple[float, ...], sensors: UsedSensors) -> Readings:
    """Return the six readings, rad, None of a sensor that is not in use."""
    return tuple(readings[place] if place in sensors.used else None for place in range(6))


def fit_from(
    start: State[float],
    known: Readings,
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode | None,
    last_step: float = CONVERGED_STEP,
) -> SampleEstimate:
    """Fit the known readings by Gauss-Newton from a start; arguments and errors as of `fit`."""
    th1a, _, th3a, th1b, th1c = start
    readings = tuple([0.0 if angle is None else angle for angle in known[: len(sensors.sigma)]])
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    return fit(start, view, readings, sensors, geometry, working_mode, last_step)


def fits(
    starts: Iterable[State[float]],
    known: Readings,
    sensors: UsedSensors,
    geometry: Geometry,
    working_mode: WorkingMode | None,
) -> Iterator[SampleEstimate]:
    """Yield the solutions that starts lead to: some lead to none, others to the same one."""
    for start in starts:
        with suppress(SpmError):
            yield fit_from(start, known, sensors, geometry, working_mode)


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
    solution = fit_from(start, known, sensors, geometry, working_mode)
    unreached = _unreached_leg(solution, known, geometry)
    if unreached:
        raise UnreachableError(f'leg {unreached} does not reach the orientation')
    return solution


def other_solutions(
    found: SampleEstimate,
    readings: tuple[float, ...],
    geometry: Geometry,
    working_mode: WorkingMode | None = None,
) -> list[SampleEstimate]:
    """
    Return all solutions of a sample of four or more sensors in use but one; duplicates possible.

    Unlike `all_solutions` it does not ask whether a leg without a sensor reaches them. It takes as
    long as tens of estimates.

    Parameters
    ----------
    found : SampleEstimate
        The solution that is left out, to `SAME_DEVIATIONS`; has the sensors in use.
    readings, geometry, working_mode
        As of `estimate_sample`.

    Returns
    -------
    list of SampleEstimate
        In any order.

    """
    known = known_readings(readings, found.sensors)
    starts = possible_starts(known, geometry)
    near = SAME_DEVIATIONS * found.total_deviation
    return [
        solution
        for solution in fits(starts, known, found.sensors, geometry, working_mode)
        if rotation_distance(solution.quaternion, found.quaternion) > near
    ]


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
    for solution in fits(starts, known, sensors, geometry, working_mode):
        is_new = all(
            rotation_distance(solution.quaternion, other.quaternion) > SAME_SOLUTION
            for other in found
        )
        if is_new and not _unreached_leg(solution, known, geometry):
            found.append(solution)
    return found


def _unreached_leg(solution: SampleEstimate, known: Readings, geometry: Geometry) -> str:
    """Return the leg without a sensor in use that does not reach a solution; empty if none."""
    rotation = rotation_from_quaternion(*solution.quaternion)
    for place, leg in enumerate(geometry.legs):
        is_free = known[place] is None and known[3 + place] is None
        # With p the root, B_kk is p sin alpha: noise may take it so far beyond 0.
        least = -MODE_MARGIN * MODE_MARGIN
        if is_free and squared_sine(rotation, leg) * leg.sin_alpha**2 < least:
            return LEG_NAMES[place]
    return ''


def _one_reading_a_leg(known: Readings, g: Geometry) -> Iterator[State[float]]:
    """
    Yield starts from three readings, one of each leg: leg A carries the platform.

    Leg A has a reading of th1A or of th3A, so that th3A is one where th1A is None.
    """
    leg = g.legs[0]
    th1 = known[0]
    th3 = known[3]
    (closure_b,) = closures(known, 1, g)
    (closure_c,) = closures(known, 2, g)

    def equations(cosine: float, sine: float) -> tuple[Vector[float], Vector[float]]:
        """Return the turn equations, in the passive angle without a reading, at a th2A."""
        if th1 is not None:
            return (
                _equation_of_third(leg, th1, closure_b, cosine, sine),
                _equation_of_third(leg, th1, closure_c, cosine, sine),
            )
        return (
            _equation_of_first(leg, th3 or 0.0, closure_b, cosine, sine),
            _equation_of_first(leg, th3 or 0.0, closure_c, cosine, sine),
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


def _equation_of_third(
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


def _equation_of_first(
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
