# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

The start of Gauss-Newton is the closed form of a leg that carries the platform, leg A's Case 2 if
it can be. Where no closed form is to be trusted, the solutions are several, and prior, working
mode and readings select among them.
"""

from __future__ import annotations

import math

from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    SingularityError,
    UnreachableError,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.gauss_newton import CONVERGED_STEP, fit, one_step
from spm_haptic_master.kinematics.estimation.normal_equations import State
from spm_haptic_master.kinematics.estimation.sample_estimate import SampleEstimate
from spm_haptic_master.kinematics.estimation.starting_points import (
    CLOSED_FORM_TRUST,
    possible_starts,
    start_at,
    trusted_start,
)
from spm_haptic_master.kinematics.estimation.used_sensors import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion

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

    Nothing is validated: the readings must be finite numbers.

    Parameters
    ----------
    readings : tuple of N float
        Of the mounted sensors th1A, th1B, th1C, th3A, th3B, th3C, rad; that of a sensor that is
        left out is ignored and may be NaN.
    sensors : UsedSensors
        The sensors in use.
    geometry : Geometry
        Link angles and axes.
    prior : tuple of four float, optional
        Quaternion x, y, z, w of the last orientation. It selects among solutions that the readings
        do not contradict by more than 10 sigma, and has no weight in the result. Three sensors
        require a prior: Gauss-Newton converges from it to one of their solutions.
    working_mode : tuple of three int, optional
        Signs of B_kk of the legs A, B, C (eq. 10); by default the readings decide. A leg without a
        sensor in use may have any.
    last_step : float
        Largest last Gauss-Newton step, rad: about its square is left after it.

    Raises
    ------
    SingularityError
        Two solutions explain the readings equally well and there is no prior, a direction is not
        measured, or a leg is on the boundary of its working mode or in another one.
    UnreachableError
        The mechanism does not close near the readings.
    InputError
        Three sensors are in use and there is no prior.

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
