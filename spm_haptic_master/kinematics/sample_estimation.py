# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

Leg A's chain carries the platform: th1A, th2A, th3A are coordinates of its orientation, and the
sensors on th1A and th3A measure two of them directly. Legs B and C add their closures, which
contain the fitted th1B and th1C. Gauss-Newton on closures and corrections together minimises the
weighted sum of the four squared corrections. Unlike the angles of the inverse model, the closures
exist for all readings, also just outside the reach of a leg, and each leg stays in the working
mode of its reading.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    SingularityError,
    UnreachableError,
)
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.jacobians import velocity_rows
from spm_haptic_master.kinematics.leg_kernels import (
    active_angle,
    both_turns,
    chain_quaternion,
    leg_closure,
    Linkage,
    linkage,
    passive_angles,
    third_in_leg_frame,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.normal_equations import (
    consistency,
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    Legs,
    linearise,
    parity_of,
    Readings,
    residuals_of,
    Weights,
    weights_of,
)
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion

# Smallest |L1 M2 - L2 M1| at which Gauss-Newton starts from the closed form (largest standard
# deviation of the sensors, 1 / rad): the error of the closed form is about the noise over the
# determinant, here a tenth of a radian, from which Gauss-Newton converges. Below, it may converge
# to the wrong one of two solutions.
CLOSED_FORM_TRUST = 10.0

# Largest last Gauss-Newton step (rad): each step is shorter than the one before by a factor of the
# noise (in rad) or less, so that the error after this one is 1e-8 rad at 0.04 deg.
CONVERGED_STEP = 1e-5

# Largest number of Gauss-Newton steps; two are usual.
STEPS = 30

# Longest step along any coordinate (rad); a longer one is shortened to it.
LONGEST_STEP = 0.3

# Largest determinant of the normal equations, relative to the product of their diagonal, that
# counts as zero (unit 1).
RANK_TOLERANCE = 1e-12

# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1

# Largest difference of the squared parities of two solutions that explain the readings equally
# well (unit 1): 3 sigma.
AMBIGUOUS_COST = 9.0

# Largest parity of healthy sensors (unit 1): noise alone exceeds it once in 4e11 samples.
CONSISTENT_PARITY = 7.0

# Largest squared parity of a solution that may be the true one of healthy sensors (unit 1): 10
# sigma, for the noise and a nominal bias of the size of the noise.
CONSISTENT_COST = 100.0

# Largest |B_kk| of the wrong sign that noise may cause near the boundary of a working mode (unit
# 1).
MODE_MARGIN = 0.02

# Largest angle between two results of the same solution (rad).
SAME_SOLUTION = 1e-4


class SampleEstimate(NamedTuple):
    """
    Maximum-likelihood orientation of one sample, in plain floats.

    Attributes
    ----------
    quaternion : tuple of four float
        Unit quaternion x, y, z, w of R_base_platform, of either sign.
    covariance : tuple of nine float
        Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    parity : float or None
        Signed residual of the four sensors over its standard deviation (unit 1); unit variance for
        healthy sensors. None with a sensor missing: three sensors cannot contradict each other.
    determined : bool
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree: see `consistent`.
    slopes : tuple of two tuples of four float
        Legs B and C: rates of th1B and th1C along th1A, th2A, th3A, from the second entry on
        (unit 1).
    weights : tuple of four float
        1 / sigma^2 of the sensors, 0 of a missing one, 1 / rad^2.
    motions : tuple of three vectors
        Covariance of the rotation error with the errors of th1A, th2A, th3A, rad^2.

    """

    quaternion: Quaternion[float]
    covariance: Rotation[float]
    parity: float | None
    determined: bool
    slopes: Legs[float]
    weights: Weights
    motions: tuple[Vector[float], Vector[float], Vector[float]]

    @property
    def consistent(self) -> bool:
        """
        Whether the sensors agree and determine the orientation: parity up to `CONSISTENT_PARITY`.

        False with a sensor missing: nothing checks the other three.
        """
        return self.determined and self.parity is not None and (
            -CONSISTENT_PARITY <= self.parity <= CONSISTENT_PARITY)

    @property
    def sensitivity(self) -> tuple[float, ...] | None:
        """
        Change of the parity for an error of one standard deviation of each sensor.

        A unit vector of four floats. The other sensors cannot check a sensor with an entry near
        zero. None with a sensor missing.
        """
        if self.parity is None:
            return None
        entries = [coefficient / math.sqrt(weight) for coefficient, weight in zip(
            consistency(self.slopes), self.weights, strict=True)]
        norm = math.sqrt(sum(entry * entry for entry in entries))
        return tuple(entry / norm for entry in entries)


def estimate_sample(th1a: float, th1b: float, th1c: float, th3a: float,
                    sigma: tuple[float, float, float, float], geometry: Geometry,
                    prior: Quaternion[float] | None = None,
                    missing: str | None = None,
                    working_mode: tuple[int, int, int] | None = None,
                    last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated: the readings must be finite numbers.

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Readings, rad; that of a missing sensor is ignored.
    sigma : tuple of four float
        Standard deviations of the readings, rad, in the same order.
    geometry : Geometry
        Link angles and axes.
    prior : tuple of four float, optional
        Unit quaternion x, y, z, w of the last known orientation. It selects among solutions that
        the readings do not contradict by more than 10 sigma, and has no weight in the result.
        Without a prior, readings that two solutions explain equally well raise.
    missing : str, optional
        Name of a missing sensor, from `JOINT_NAMES`. Three sensors have several solutions and
        require a prior: Gauss-Newton converges from it to one of them.
    working_mode : tuple of three int, optional
        Signs of B_kk of the legs A, B, C (eq. 10), where they are known: a solution in another
        working mode is none. By default the readings decide.
    last_step : float
        Largest last Gauss-Newton step, rad. What is left after a step is about its square, so that
        a longer one saves the second step; the default leaves 1e-8 rad.

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
    if missing is not None:
        return _estimate_three(readings, sigma, geometry, prior, missing)
    weights = weights_of(sigma)
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3])
    if abs(determinant) > CLOSED_FORM_TRUST * max(sigma):
        th2a = math.atan2(sine * determinant, cosine * determinant)
        return _fit(th2a, view, readings, weights, geometry, last_step)
    return _estimate_without_closed_form(
        view, readings, weights, geometry, prior, working_mode)


def _fit(th2a: float, view: Linkage[float], readings: Readings[float], weights: Weights,
         g: Geometry, last_step: float = CONVERGED_STEP) -> SampleEstimate:
    """Gauss-Newton to convergence from the readings, th2A and the `linkage` of both."""
    th1a, th1b, th1c, th3a = readings
    for _ in range(STEPS):
        state = th1a, th2a, th3a, th1b, th1c
        legs = linearise(th2a, *view, weights, g, FLOATS)
        residuals = residuals_of(state, readings, legs)
        entries, determinant, product = inverse_normal(legs, weights)
        if not determinant > RANK_TOLERANCE * product:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction')
        d1, d2, d3, db, dc = step = gauss_newton_step(
            residuals, legs, weights, entries, determinant)
        # Both tests by comparison: a call for each component costs as much as the step.
        converged = _within(last_step, d1, d2, d3, db, dc)
        if not converged and not _within(LONGEST_STEP, d1, d2, d3, db, dc):
            longest = max(map(abs, step))
            d1, d2, d3, db, dc = (LONGEST_STEP / longest * along for along in step)
        th1a, th2a, th3a, th1b, th1c = th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc
        if converged:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    parity = parity_of(residuals, legs, weights, FLOATS) if all(weights) else None
    covariance, motions = in_base_frame(th1a, th2a, entries, determinant, g, FLOATS)
    determined = (covariance[0] + covariance[4] + covariance[8]
                  < DETERMINED_DEVIATION * DETERMINED_DEVIATION)
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance, parity, determined, legs,
        weights, motions)


def _within(limit: float, d1: float, d2: float, d3: float, db: float, dc: float) -> bool:
    """Return whether each component of a step is smaller than a limit."""
    return -limit < d1 < limit and -limit < d2 < limit and -limit < d3 < limit \
        and -limit < db < limit and -limit < dc < limit


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
                solutions.append(_fit(th2a, view, readings, weights, g))
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


def _estimate_three(readings: Readings[float], sigma: tuple[float, float, float, float],
                    g: Geometry, prior: Quaternion[float] | None, missing: str) -> SampleEstimate:
    """Start from the prior's th2A, and from its th1A or th3A if that sensor is missing."""
    if prior is None:
        raise InputError(f'prior = None: expected an orientation with {missing} missing')
    if missing not in JOINT_NAMES:
        raise InputError(f'missing = {missing!r}: expected one of {JOINT_NAMES} or None')
    index = JOINT_NAMES.index(missing)
    weight_a, weight_b, weight_c, weight_3 = (
        0.0 if sensor == index else weight for sensor, weight in enumerate(weights_of(sigma)))
    present_a, present_b, present_c, present_3 = (
        None if sensor == index else reading for sensor, reading in enumerate(readings))
    prior_1a, th2a, prior_3a = _chain_angles(prior, present_a, present_3, g)
    th1a = prior_1a if present_a is None else present_a
    th1b, th1c = present_b or 0.0, present_c or 0.0
    th3a = prior_3a if present_3 is None else present_3
    view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    return _fit(
        th2a, view, (th1a, th1b, th1c, th3a), (weight_a, weight_b, weight_c, weight_3), g)


def _chain_angles(quaternion: Quaternion[float], th1a: float | None, th3a: float | None,
                  g: Geometry) -> Vector[float]:
    """Return leg A's joint angles, rad, in the working mode that fits the readings best."""
    rotation = rotation_from_quaternion(*quaternion)
    leg = g.legs[0]
    x, y, z = third_in_leg_frame(rotation, leg)
    solutions = []
    for sign in (1, -1):
        p, q = leg_closure(x, y, z, sign, leg, FLOATS)
        active = active_angle(x, y, p, q, FLOATS)
        solutions.append((active, *passive_angles(rotation, z, active, p, q, leg, FLOATS)))

    def misfit(solution: Vector[float]) -> float:
        return sum(
            abs(math.remainder(angle - reading, 2.0 * math.pi))
            for angle, reading in ((solution[0], th1a), (solution[2], th3a))
            if reading is not None)

    return min(solutions, key=misfit)
