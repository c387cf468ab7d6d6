# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

The start of Gauss-Newton is Case 2's closed form; where that is not to be trusted, the solutions
are several, and prior, working mode and readings select among them.
"""

from __future__ import annotations

import math

from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    SingularityError,
    UnreachableError,
)
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics.gauss_newton import CONVERGED_STEP, fit, fit_more
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.jacobians import velocity_rows
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    Linkage,
    linkage,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.normal_equations import Readings, Weights, weights_of
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.passive_sensors import six_weights
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion
from spm_haptic_master.kinematics.sample_estimate import DETERMINED_DEVIATION, SampleEstimate
from spm_haptic_master.kinematics.starting_points import (
    CLOSED_FORM_TRUST,
    start_from_any_leg,
    start_near,
)

__all__ = ['DETERMINED_DEVIATION', 'SampleEstimate', 'estimate_sample', 'in_working_mode']

# Largest difference of the squared parities of two solutions that explain the readings equally
# well (unit 1): 3 sigma.
AMBIGUOUS_COST = 9.0

# Largest squared parity of a solution that may be the true one of healthy sensors (unit 1): 10
# sigma, for the noise and a nominal bias of the size of the noise.
CONSISTENT_COST = 100.0

# Largest |B_kk| of the wrong sign that noise may cause near the boundary of a working mode (unit
# 1).
MODE_MARGIN = 0.02

# Largest angle between two results of the same solution (rad).
SAME_SOLUTION = 1e-4


def estimate_sample(th1a: float, th1b: float, th1c: float, th3a: float,
                    sigma: tuple[float, ...], geometry: Geometry,
                    prior: Quaternion[float] | None = None,
                    missing: str | None = None,
                    working_mode: tuple[int, int, int] | None = None,
                    last_step: float = CONVERGED_STEP, th3b: float | None = None,
                    th3c: float | None = None) -> SampleEstimate:
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated: the readings must be finite numbers.

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Readings, rad; that of a missing sensor is ignored.
    sigma : tuple of N float
        Standard deviations of the N = 4, 5 or 6 readings, rad: th1A, th1B, th1C, th3A, and where
        they are given th3B, th3C.
    geometry : Geometry
        Link angles and axes.
    prior : tuple of four float, optional
        Unit quaternion x, y, z, w of the last known orientation. It selects among solutions that
        the readings do not contradict by more than 10 sigma, and has no weight in the result.
        Without a prior, readings that two solutions explain equally well raise.
    missing : str, optional
        Name of a missing sensor, from `ALL_JOINT_NAMES`. Three sensors have several solutions and
        require a prior: Gauss-Newton converges from it to one of them. Four or five need none
        where a leg with two of them determines the start.
    working_mode : tuple of three int, optional
        Signs of B_kk of the legs A, B, C (eq. 10), where they are known: a solution in another
        working mode is none. By default the readings decide.
    last_step : float
        Largest last Gauss-Newton step, rad. What is left after a step is about its square, so that
        a longer one saves the second step; the default leaves 1e-8 rad.
    th3b, th3c : float, optional
        Readings of the fifth sensor, and of the sixth beside it, rad.

    Returns
    -------
    SampleEstimate

    Raises
    ------
    SingularityError
        The readings do not determine the orientation: two solutions explain them equally well and
        there is no prior, or a direction is not measured, or a leg is on the boundary of its
        working mode.
    UnreachableError
        The mechanism does not close near the readings.
    InputError
        A sensor is missing and there is no prior, or no sensor has its name.

    """
    readings = th1a, th1b, th1c, th3a
    if th3b is not None:
        return _estimate_more(
            (*readings, th3b, th3c), sigma, geometry, prior, missing, last_step)
    weights = weights_of(sigma)
    if missing is not None:
        return _estimate_three(readings, weights, geometry, prior, missing)
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    if abs(determinant) > CLOSED_FORM_TRUST * max(sigma):
        th2a = math.atan2(sine * determinant, cosine * determinant)
        return fit(th2a, view, readings, weights, geometry, last_step)
    return _estimate_without_closed_form(
        view, readings, weights, geometry, prior, working_mode)


def _estimate_without_closed_form(
        view: Linkage[float], readings: Readings[float], weights: Weights, g: Geometry,
        prior: Quaternion[float] | None,
        working_mode: tuple[int, int, int] | None) -> SampleEstimate:
    """Start from both solutions of each leg's turn equation; select among the results."""
    solutions = []
    _, _, leg_b, leg_c = view
    for leg in (leg_b, leg_c):
        for th2a in both_turns(turn_equation(*leg)):
            try:
                solutions.append(fit(th2a, view, readings, weights, g))
            except (SingularityError, UnreachableError):
                continue
    if working_mode is not None:
        solutions = [solution for solution in solutions
                     if in_working_mode(solution.quaternion, readings, g, working_mode)]
    if not solutions:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    solutions.sort(key=_cost)
    best = solutions[0]
    if prior is not None:
        # Noise alone may make either explain the readings better: the last orientation decides.
        limit = max(CONSISTENT_COST, _cost(best) + AMBIGUOUS_COST)
        rivals = [solution for solution in solutions if _cost(solution) < limit]
        return min(rivals, key=lambda rival: rotation_distance(rival.quaternion, prior))
    rivals = [solution for solution in solutions
              if _cost(solution) - _cost(best) < AMBIGUOUS_COST]
    if any(rotation_distance(rival.quaternion, best.quaternion) > SAME_SOLUTION
           for rival in rivals):
        raise AmbiguousError(
            f'readings {readings} rad: two orientations explain them equally well; a prior '
            'selects')
    return best


def in_working_mode(quaternion: Quaternion[float], readings: Readings[float], g: Geometry,
                    working_mode: tuple[int, int, int]) -> bool:
    """
    Whether an orientation is in a working mode, or as near its boundary as the noise may take it.

    Parameters
    ----------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform.
    readings : tuple of four float
        th1A, th1B, th1C, th3A, rad.
    g : Geometry
        Link angles and axes.
    working_mode : tuple of three int
        Signs of B_kk of the legs A, B, C (eq. 10).

    """
    _, diagonal = velocity_rows(rotation_from_quaternion(*quaternion), readings[:3], g, FLOATS)
    return all(sign * b > -MODE_MARGIN
               for sign, b in zip(working_mode, diagonal[:3], strict=True))


def _cost(solution: SampleEstimate) -> float:
    """Squared parity: weighted sum of the squared residuals (unit 1)."""
    return 0.0 if solution.parity is None else solution.parity ** 2


def _estimate_three(readings: Readings[float], weights: Weights, g: Geometry,
                    prior: Quaternion[float] | None, missing: str) -> SampleEstimate:
    """Start from the prior's th2A, and from its th1A or th3A if that sensor is missing."""
    if prior is None:
        raise InputError(f'prior = None: expected an orientation with {missing} missing')
    index = _index_of(missing, JOINT_NAMES)
    present = tuple(
        None if sensor == index else reading for sensor, reading in enumerate(readings))
    th1a, th2a, th3a, th1b, th1c = start_near(prior, (*present, None, None), g)
    weight_a, weight_b, weight_c, weight_3 = (
        0.0 if sensor == index else weight for sensor, weight in enumerate(weights))
    return fit(th2a, linkage(th1a, th1b, th1c, th3a, g, FLOATS), (th1a, th1b, th1c, th3a),
               (weight_a, weight_b, weight_c, weight_3), g)


def _estimate_more(readings: tuple[float | None, ...], sigma: tuple[float, ...], g: Geometry,
                   prior: Quaternion[float] | None, missing: str | None,
                   last_step: float) -> SampleEstimate:
    """Start from Case 2 with all sensors, else from any leg that determines the orientation."""
    sensors = len(sigma)
    weights = [1.0 / (each * each) for each in sigma]
    if missing is not None:
        index = _index_of(missing, ALL_JOINT_NAMES[:sensors])
        weights[index] = 0.0
        readings = (*readings[:index], None, *readings[index + 1:])
    th1a, th1b, th1c, th3a, th3b, th3c = readings
    six = six_weights(weights)
    if th1a is not None and th1b is not None and th1c is not None and th3a is not None:
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
        cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
        if abs(determinant) > CLOSED_FORM_TRUST * max(sigma):
            th2a = math.atan2(sine * determinant, cosine * determinant)
            return fit_more((th1a, th2a, th3a, th1b, th1c), view,
                            (th1a, th1b, th1c, th3a, th3b or 0.0, th3c or 0.0), six, sensors, g,
                            last_step)
    th1a, th2a, th3a, th1b, th1c = state = start_from_any_leg(readings, max(sigma), g, prior)
    return fit_more(state, linkage(th1a, th1b, th1c, th3a, g, FLOATS),
                    (th1a, th1b, th1c, th3a, th3b or 0.0, th3c or 0.0), six, sensors, g,
                    last_step)


def _index_of(missing: str, names: tuple[str, ...]) -> int:
    """Return the place of a missing sensor among those that there are."""
    if missing not in names:
        raise InputError(f'missing = {missing!r}: expected one of {names} or None')
    return names.index(missing)
