# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

The start of Gauss-Newton is the closed form of a leg that carries the platform, leg A's Case 2 if
it can be. Where no closed form is to be trusted, the solutions are several, and prior, working
mode and readings select among them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import combinations
import math

from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    SingularityError,
    UnreachableError,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    CONVERGED_STEP,
    fit,
    one_step,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.joints import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    common_turn,
    leg_angles,
    linkage,
    second_axis,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion

# Smallest |L1 M2 - L2 M1| at which Gauss-Newton starts from the closed form (largest standard
# deviation of the sensors, 1 / rad): the error of the closed form is about the noise over the
# determinant, here a tenth of a radian, from which Gauss-Newton converges. Below, it may converge
# to the wrong one of two solutions.
CLOSED_FORM_TRUST = 10.0
# Largest difference of the squared parities of two solutions that explain the readings equally
# well (unit 1): 3 sigma.
AMBIGUOUS_COST = 9.0
# Largest squared parity of a solution that may be the true one of healthy sensors (unit 1): 10
# sigma, for the noise and a nominal bias of the size of the noise.
CONSISTENT_COST = 100.0
# Largest angle between two results of the same solution (rad).
SAME_SOLUTION = 1e-4


def estimate_sample(readings: tuple[float, ...], sensors: UsedSensors, geometry: Geometry,
                    prior: Quaternion[float] | None = None,
                    working_mode: WorkingMode | None = None,
                    last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated. `readings` are finite numbers of the N mounted sensors th1A, th1B, th1C,
    th3A, th3B, th3C, rad; that of a sensor that is left out is ignored and may be NaN.

    `prior`, the quaternion x, y, z, w of the last orientation, selects among solutions that the
    readings do not contradict by more than 10 sigma, and has no weight in the result. Three
    sensors require one (InputError): Gauss-Newton converges from it to one of their solutions.
    Without th3A do not use them nearer than 4 deg to the parallel singularity: samples have no
    answer there (half of them at 0.3 deg), and the others are biased.
    `working_mode` are the signs of B_kk of the legs A, B, C (eq. 10); by default the readings
    decide. A leg without a sensor in use may have any. After a last step of `last_step`, rad, or
    less, about its square is left.

    SingularityError if two solutions explain the readings equally well and there is no prior, a
    direction is not measured, or a leg is on the boundary of its working mode or in another one.
    UnreachableError if the mechanism does not close near the readings.
    """
    if sensors.usual:
        th1a, th1b, th1c, th3a = readings[:4]
        view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
        cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
        if abs(determinant) > CLOSED_FORM_TRUST * sensors.largest:
            th2a = math.atan2(sine * determinant, cosine * determinant)
            start = th1a, th2a, th3a, th1b, th1c
            # One step converges only where the last one may be large.
            return last_step > CONVERGED_STEP and one_step(
                start, view, readings, sensors, geometry, working_mode, last_step) or fit(
                    start, view, readings, sensors, geometry, working_mode, last_step)
    return _estimate_others(readings, sensors, geometry, prior, working_mode, last_step)


def _estimate_others(readings: tuple[float, ...], sensors: UsedSensors, g: Geometry,
                     prior: Quaternion[float] | None, working_mode: WorkingMode | None,
                     last_step: float) -> SampleEstimate:
    """Estimate from sensors of which Case 2 gives no start."""
    mounted = range(len(readings))
    known = tuple(readings[place] if place in sensors.used else None for place in range(6))
    readings = tuple(readings[place] if place in sensors.used else 0.0 for place in mounted)

    def fit_from(start: State[float], largest_last: float) -> SampleEstimate:
        th1a, _, th3a, th1b, th1c = start
        return fit(start, linkage(th1a, th1b, th1c, th3a, g, FLOATS), readings, sensors, g,
                   working_mode, largest_last)

    if sensors.count == FEWEST_USED:
        if prior is None:
            raise InputError('prior = None: expected an orientation with three sensors in use')
        return fit_from(start_at(rotation_from_quaternion(*prior), known, g), CONVERGED_STEP)
    start = trusted_start(known, sensors.largest, g)
    if start is not None:
        return fit_from(start, last_step)
    solutions = []
    for start in possible_starts(known, g):
        try:
            solutions.append(fit_from(start, CONVERGED_STEP))
        except (SingularityError, UnreachableError):
            continue
    if not solutions:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    return _selected(solutions, readings, prior)


def _selected(solutions: list[SampleEstimate], readings: tuple[float, ...],
              prior: Quaternion[float] | None) -> SampleEstimate:
    """Return the solution that explains the readings best, or that the prior selects."""
    solutions.sort(key=_cost)
    best = solutions[0]
    if prior is not None:
        # Noise alone may make either explain the readings better: the last orientation decides.
        limit = max(CONSISTENT_COST, _cost(best) + AMBIGUOUS_COST)
        rivals = [solution for solution in solutions if _cost(solution) < limit]
        return min(rivals, key=lambda rival: rotation_distance(rival.quaternion, prior))
    rivals = [each for each in solutions if _cost(each) - _cost(best) < AMBIGUOUS_COST]
    if any(rotation_distance(rival.quaternion, best.quaternion) > SAME_SOLUTION
           for rival in rivals):
        raise AmbiguousError(
            f'readings {readings} rad: two orientations explain them equally well; a prior '
            'selects')
    return best


def _cost(solution: SampleEstimate) -> float:
    """Squared parity: weighted sum of the squared residuals (unit 1)."""
    return 0.0 if solution.parity is None else solution.parity ** 2


# Starts without Case 2 ---------------------------------------------------------------------------

def trusted_start(readings: tuple[float | None, ...], largest: float,
                  g: Geometry) -> State[float] | None:
    """
    Return the start that the first leg gives which determines it; None without such a leg.

    `largest` is the largest standard deviation of the readings, rad; the others are those of
    `start_at`.
    """
    for leg, first, third, equations in _carriers(readings, g):
        cosine, sine, determinant = max(
            (common_turn(*pair) for pair in combinations(equations, 2)),
            key=lambda turn: abs(turn[2]))
        if abs(determinant) > CLOSED_FORM_TRUST * largest:
            th2 = math.atan2(sine * determinant, cosine * determinant)
            return start_at(_carried_by(leg, first, th2, third), readings, g)
    return None


def possible_starts(readings: tuple[float | None, ...], g: Geometry) -> Iterator[State[float]]:
    """
    Yield both solutions of each turn equation of each leg that can carry the platform.

    Every solution that the readings have is near one of them.
    """
    for leg, first, third, equations in _carriers(readings, g):
        for equation in equations:
            for th2 in both_turns(equation):
                with suppress(UnreachableError):
                    yield start_at(_carried_by(leg, first, th2, third), readings, g)


def _carriers(readings: tuple[float | None, ...],
              g: Geometry) -> Iterator[tuple[Leg, float, float, list[Vector[float]]]]:
    """Yield each leg with readings of both its sensors, these, and its turn equations."""
    for carrier, leg in enumerate(g.legs):
        first, third = readings[carrier], readings[3 + carrier]
        if first is not None and third is not None:
            yield leg, first, third, _turn_equations(carrier, first, third, readings, g)


def _turn_equations(carrier: int, first: float, third: float,
                    readings: tuple[float | None, ...], g: Geometry) -> list[Vector[float]]:
    """Return the equations of th2k of a carrying leg that the other legs' sensors give."""
    leg = g.legs[carrier]
    equations = []
    for other, (each, th1, th3) in enumerate(zip(g.legs, readings[:3], readings[3:], strict=True)):
        if other == carrier:
            continue
        if th1 is not None:
            second = second_axis(math.cos(th1), math.sin(th1), each)
            equations.append(turn_equation(
                _before_second(leg, first, second), _after_second(leg, third, each.third),
                each.cos_beta))
        if th3 is not None:
            second = _times(each.platform_frame, (
                each.sin_beta * math.sin(th3), each.sin_beta * math.cos(th3), each.cos_beta))
            equations.append(turn_equation(
                _before_second(leg, first, each.first), _after_second(leg, third, second),
                each.cos_alpha))
    return equations


def _before_second(leg: Leg, th1: float, axis: Vector[float]) -> Vector[float]:
    """Components after a leg's proximal link of a vector in the base: Rx(-alpha) Rz(-th1) B^T."""
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = leg.base_frame
    vector = _about_z(-th1, _times((b00, b10, b20, b01, b11, b21, b02, b12, b22), axis))
    return _about_x(leg.cos_alpha, -leg.sin_alpha, vector)


def _after_second(leg: Leg, th3: float, axis: Vector[float]) -> Vector[float]:
    """Components before a leg's distal link of a vector in the platform: Rx(beta) Rz(th3) Q^T."""
    q00, q01, q02, q10, q11, q12, q20, q21, q22 = leg.platform_frame
    vector = _about_z(th3, _times((q00, q10, q20, q01, q11, q21, q02, q12, q22), axis))
    return _about_x(leg.cos_beta, leg.sin_beta, vector)


def _carried_by(leg: Leg, th1: float, th2: float, th3: float) -> Rotation[float]:
    """R_base_platform of a leg's chain, eq. 6."""
    (r00, r10, r20), (r01, r11, r21), (r02, r12, r22) = (
        _times(leg.base_frame, _about_z(th1, _about_x(
            leg.cos_alpha, leg.sin_alpha, _about_z(th2, _after_second(leg, th3, unit)))))
        for unit in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
    return r00, r01, r02, r10, r11, r12, r20, r21, r22


def _times(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = matrix
    x, y, z = vector
    return (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z,
            r20 * x + r21 * y + r22 * z)


def _about_z(angle: float, vector: Vector[float]) -> Vector[float]:
    c, s = math.cos(angle), math.sin(angle)
    x, y, z = vector
    return c * x - s * y, s * x + c * y, z


def _about_x(c: float, s: float, vector: Vector[float]) -> Vector[float]:
    x, y, z = vector
    return x, c * y - s * z, s * y + c * z


def start_at(rotation: Rotation[float], readings: tuple[float | None, ...],
             g: Geometry) -> State[float]:
    """
    Return th1A, th2A, th3A, th1B, th1C, rad: readings, and where there is none of an orientation.

    `readings` are th1A, th1B, th1C, th3A, th3B, th3C, rad; None for one that is not used. They
    select the working mode of a leg. An active angle of leg B or C without any reading is 0.
    UnreachableError where a leg without all its sensors does not reach the orientation.
    """
    th1a, th1b, th1c, th3a, th3b, th3c = readings
    found_1a, th2a, found_3a = _fitting_angles(rotation, g.legs[0], th1a, th3a)
    if th1b is None:
        th1b = 0.0 if th3b is None else _fitting_angles(rotation, g.legs[1], None, th3b)[0]
    if th1c is None:
        th1c = 0.0 if th3c is None else _fitting_angles(rotation, g.legs[2], None, th3c)[0]
    return (found_1a if th1a is None else th1a, th2a, found_3a if th3a is None else th3a,
            th1b, th1c)


def _fitting_angles(rotation: Rotation[float], leg: Leg, th1: float | None,
                    th3: float | None) -> Vector[float]:
    """Return a leg's joint angles, rad, in the working mode that fits the readings best."""
    def misfit(solution: Vector[float]) -> float:
        return sum(
            abs(math.remainder(angle - reading, 2.0 * math.pi))
            for angle, reading in ((solution[0], th1), (solution[2], th3))
            if reading is not None)

    return min((leg_angles(rotation, leg, sign, FLOATS) for sign in (1, -1)), key=misfit)
