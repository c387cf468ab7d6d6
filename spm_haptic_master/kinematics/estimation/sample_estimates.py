# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

Gauss-Newton starts from the closed form of a leg that carries the platform, leg A's Case 2 if it
can be. Where no closed form is to be trusted, the solutions are several, and prior, working mode
and readings select among them.
"""

from __future__ import annotations

from math import atan2

from spm_haptic_master.exceptions import AmbiguousError, InputError, UnreachableError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import (
    CLOSED_FORM_TRUST,
    possible_starts,
    start_at,
    trusted_start,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    CONVERGED_STEP,
    fit,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.solutions import (
    fit_from,
    fits,
    known_readings,
    SAME_SOLUTION,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion

# Largest difference of the squared parities of two solutions that explain the readings equally
# well (unit 1): 3 sigma.
AMBIGUOUS_COST = 9.0
# Largest parity of a solution that a prior may select (unit 1): that of the true one of healthy
# sensors, by noise and a nominal bias of the size of the noise, is smaller.
SELECTABLE_PARITY = 10.0


def estimate_sample(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    geometry: Geometry,
    prior: Quaternion[float] | None = None,
    working_mode: WorkingMode | None = None,
    last_step: float = CONVERGED_STEP,
    selectable_parity: float = SELECTABLE_PARITY,
) -> SampleEstimate:
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated.

    Parameters
    ----------
    readings : tuple of float
        Finite numbers of the N mounted sensors th1A, th1B, th1C, th3A, th3B, th3C, rad; a sensor
        that is left out may have NaN.
    sensors : UsedSensors
        Standard deviations, and which sensors are in use.
    geometry : Geometry
        Link angles and axes.
    prior : tuple of four float, optional
        Quaternion x, y, z, w of the last orientation. It selects among solutions with a parity up
        to `selectable_parity`, and has no weight in the result. Three sensors require one; three
        without th3A require one that is 4 deg or more off the parallel singularity.
    working_mode : tuple of three int, optional
        Signs of B_kk of the legs A, B, C (eq. 10); by default the readings decide. A leg without a
        sensor in use may have any.
    last_step : float
        A Gauss-Newton step that is shorter along each coordinate is the last one, rad.
    selectable_parity : float
        Largest parity of a solution that the prior may select (unit 1).

    Returns
    -------
    SampleEstimate

    Raises
    ------
    InputError
        Three sensors are in use and there is no prior.
    SingularityError
        Two solutions explain the readings equally well and there is no prior, a direction is not
        measured, or a leg is on the boundary of its working mode or in another one.
    UnreachableError
        The mechanism does not close near the readings.

    """
    if sensors.usual:
        th1a, th1b, th1c, th3a = readings[:4]
        view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
        cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
        if abs(determinant) > CLOSED_FORM_TRUST * sensors.largest:
            th2a = atan2(sine * determinant, cosine * determinant)
            start = th1a, th2a, th3a, th1b, th1c
            return fit(start, view, readings, sensors, geometry, working_mode, last_step)
    return _estimate_others(
        readings, sensors, geometry, prior, working_mode, last_step, selectable_parity
    )


def _estimate_others(
    readings: tuple[float, ...],
    sensors: UsedSensors,
    g: Geometry,
    prior: Quaternion[float] | None,
    working_mode: WorkingMode | None,
    last_step: float,
    selectable_parity: float,
) -> SampleEstimate:
    """Estimate from sensors of which Case 2 gives no start."""
    known = known_readings(readings, sensors)
    if sensors.count == FEWEST_USED:
        if prior is None:
            raise InputError('prior = None: expected an orientation with three sensors in use')
        start = start_at(rotation_from_quaternion(*prior), known, g)
        return fit_from(start, known, sensors, g, working_mode)
    trusted = trusted_start(known, sensors.largest, g)
    if trusted is not None:
        return fit_from(trusted, known, sensors, g, working_mode, last_step)
    solutions = list(fits(possible_starts(known, g), known, sensors, g, working_mode))
    if not solutions:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    return _selected(solutions, readings, prior, selectable_parity)


def _selected(
    solutions: list[SampleEstimate],
    readings: tuple[float, ...],
    prior: Quaternion[float] | None,
    selectable_parity: float,
) -> SampleEstimate:
    """Return the solution that explains the readings best, or that the prior selects."""
    solutions.sort(key=_cost)
    best = solutions[0]
    if prior is not None:
        # Noise alone may make either explain the readings better: the last orientation decides.
        limit = max(selectable_parity * selectable_parity, _cost(best) + AMBIGUOUS_COST)
        likely = [solution for solution in solutions if _cost(solution) < limit]
        return min(likely, key=lambda other: rotation_distance(other.quaternion, prior))
    for other in solutions:
        is_as_good = _cost(other) - _cost(best) < AMBIGUOUS_COST
        if is_as_good and rotation_distance(other.quaternion, best.quaternion) > SAME_SOLUTION:
            raise AmbiguousError(
                f'readings {readings} rad: two orientations explain them equally well; '
                'a prior selects'
            )
    return best


def _cost(solution: SampleEstimate) -> float:
    """Return the weighted sum of the squared residuals (unit 1)."""
    return sum([entry * entry for entry in solution.parity_vector])
