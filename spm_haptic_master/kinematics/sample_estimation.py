# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

The platform is carried by leg A's chain, so that th1A, th2A, th3A are coordinates of its
orientation and the sensors on th1A and th3A read two of them directly. Legs B and C add their
closures, in which the fitted th1B and th1C stand. The weighted sum of the four squared corrections
is minimised by Gauss-Newton on closures and corrections together: unlike the inverse model's
angles, the closures exist whatever the readings, also just outside the reach of a leg, and each leg
stays in the working mode its reading puts it in.
"""

import math
from typing import NamedTuple

from spm_haptic_master.exceptions import InputError, SingularityError, UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.leg_kernels import (
    active_angle,
    both_turns,
    chain_quaternion,
    leg_closure,
    linkage,
    passive_angles,
    third_axes,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.normal_equations import (
    consistency,
    gauss_newton_step,
    in_base_frame,
    inverse_normal,
    linearise,
    parity_of,
    residuals_of,
    weights_of,
)
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.rotations import rotation_distance, rotation_from_quaternion

CLOSED_FORM_TRUST = 10.0
"""
Smallest |L1 M2 - L2 M1|, in the largest sensor's standard deviations, of a trusted closed form.

Its error is about the noise over the determinant: a tenth of a radian here, from which Gauss-Newton
converges. Below, the closed form may start it towards the wrong one of two solutions.
"""

CONVERGED_STEP = 1e-5
"""
Last Gauss-Newton step, rad.

Each step is smaller than the one before by the noise (in rad) or better, so that what is left after
this one is 1e-8 rad at 0.04 deg.
"""

STEPS = 30
"""Gauss-Newton steps at most; two are the rule."""

LONGEST_STEP = 0.3
"""Longest step, rad, along any one coordinate; a longer one is shortened to it."""

RANK_TOLERANCE = 1e-12
"""Determinant of the normal equations over its diagonal's product that counts as zero (unit 1)."""

VALID_DEVIATION = 0.1
"""
Largest total standard deviation, rad, of a valid orientation.

Beyond some 6 deg the first-order covariance no longer describes the error.
"""

AMBIGUOUS_COST = 9.0
"""Two solutions whose squared parities differ by less (3 sigma) explain the angles equally well."""

SAME_SOLUTION = 1e-4
"""Solutions nearer to each other than this, rad, are one."""


class SampleEstimate(NamedTuple):
    """
    Maximum-likelihood orientation of one sample, in plain floats.

    Attributes
    ----------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform, a unit quaternion of either sign.
    covariance : tuple of nine float
        Of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    parity : float or None
        Signed residual of the four sensors over its standard deviation; unit variance when they are
        healthy. None with a sensor missing: three sensors cannot contradict each other.
    valid : bool
        Whether the sensors determine the orientation: total deviation under `VALID_DEVIATION`.
    slopes : tuple of two 4-tuples of float
        Legs B and C: rates of th1B and th1C along th1A, th2A, th3A (from the second entry on).
    weights : tuple of four float
        1 / sigma^2 of the sensors, 0 of a missing one.

    """

    quaternion: tuple
    covariance: tuple
    parity: float | None
    valid: bool
    slopes: tuple
    weights: tuple

    @property
    def sensitivity(self):
        """
        Change of the parity for an error of one standard deviation of each sensor.

        A tuple of four float, a unit vector: a sensor whose entry is near zero cannot be checked by
        the others here. None with a sensor missing.
        """
        if self.parity is None:
            return None
        entries = [coefficient / math.sqrt(weight) for coefficient, weight in zip(
            consistency(self.slopes), self.weights, strict=True)]
        norm = math.sqrt(sum(entry * entry for entry in entries))
        return tuple(entry / norm for entry in entries)


def estimate_sample(th1a, th1b, th1c, th3a, sigma, geometry, prior=None, missing=None):
    """
    Maximum-likelihood orientation of one sample in plain floats, for the 1 kHz path.

    Nothing is validated: the readings must be finite numbers.

    Parameters
    ----------
    th1a, th1b, th1c, th3a : float
        Readings, rad; that of a missing sensor is not looked at.
    sigma : tuple of four float
        Their standard deviations, rad, in the same order.
    geometry : Geometry
        Link angles.
    prior : tuple of four float, optional
        Unit quaternion x, y, z, w of the last known orientation. It selects among solutions that
        explain the readings equally well, and has no weight in the result. Without it those raise.
    missing : str, optional
        The sensor, of `JOINT_NAMES`, to do without. Three sensors have several solutions, so that a
        prior must be given: the solution is the one Gauss-Newton reaches from it.

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
        The readings close no mechanism.
    InputError
        A missing sensor and no prior.

    """
    readings = th1a, th1b, th1c, th3a
    if missing is not None:
        return _estimate_three(readings, sigma, geometry, prior, missing)
    weights = weights_of(sigma)
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3], geometry)
    if abs(determinant) > CLOSED_FORM_TRUST * max(sigma):
        th2a = math.atan2(sine * determinant, cosine * determinant)
        return _fit(th2a, view, readings, weights, geometry)
    return _estimate_without_closed_form(view, readings, weights, geometry, prior)


def _fit(th2a, view, readings, weights, g):
    """Gauss-Newton to convergence, from the readings, th2A and the `linkage` they make."""
    th1a, th1b, th1c, th3a = readings
    for _ in range(STEPS):
        state = th1a, th2a, th3a, th1b, th1c
        legs = linearise(th2a, *view, weights, g, FLOATS)
        residuals = residuals_of(state, readings, legs)
        entries, determinant, product = inverse_normal(legs, weights)
        if not determinant > RANK_TOLERANCE * product:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction')
        step = gauss_newton_step(residuals, legs, weights, entries, determinant)
        longest = max(map(abs, step))
        if longest > LONGEST_STEP:
            step = [LONGEST_STEP / longest * along for along in step]
        d1, d2, d3, db, dc = step
        th1a, th2a, th3a, th1b, th1c = th1a + d1, th2a + d2, th3a + d3, th1b + db, th1c + dc
        if longest < CONVERGED_STEP:
            break
        view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    else:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    parity = parity_of(residuals, legs, weights, FLOATS) if all(weights) else None
    covariance = in_base_frame(th1a, th2a, entries, determinant, g, FLOATS)
    valid = covariance[0] + covariance[4] + covariance[8] < VALID_DEVIATION * VALID_DEVIATION
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance, parity, valid, legs, weights)


def _estimate_without_closed_form(view, readings, weights, g, prior):
    """Start from both solutions of each leg's turn equation and keep what explains the readings."""
    solutions = []
    for leg in view[2:]:
        for th2a in both_turns(turn_equation(*leg, g)):
            try:
                solutions.append(_fit(th2a, view, readings, weights, g))
            except (SingularityError, UnreachableError):
                continue
    if not solutions:
        raise UnreachableError(f'readings {readings} rad: no mechanism closes near them')
    solutions.sort(key=lambda solution: abs(solution.parity))
    best = solutions[0]
    rivals = [solution for solution in solutions
              if solution.parity ** 2 - best.parity ** 2 < AMBIGUOUS_COST]
    if prior is not None:
        return min(rivals, key=lambda rival: rotation_distance(rival.quaternion, prior))
    if any(rotation_distance(rival.quaternion, best.quaternion) > SAME_SOLUTION
           for rival in rivals):
        raise SingularityError(
            f'readings {readings} rad: two orientations explain them equally well; a prior selects')
    return best


def _estimate_three(readings, sigma, g, prior, missing):
    if prior is None:
        raise InputError(f'prior = None: expected an orientation with {missing} missing')
    index = JOINT_NAMES.index(missing)
    weights = tuple(
        0.0 if sensor == index else weight for sensor, weight in enumerate(weights_of(sigma)))
    present = tuple(
        None if sensor == index else reading for sensor, reading in enumerate(readings))
    prior_1a, th2a, prior_3a = _chain_angles(prior, present[0], present[3], g)
    th1a, th1b, th1c, th3a = (
        reading if reading is not None else substitute
        for reading, substitute in zip(present, (prior_1a, 0.0, 0.0, prior_3a), strict=True))
    view = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
    return _fit(th2a, view, (th1a, th1b, th1c, th3a), weights, g)


def _chain_angles(quaternion, th1a, th3a, g):
    """Leg A's joint angles at an orientation, in the working mode that fits the readings."""
    rotation = rotation_from_quaternion(*quaternion)
    x, y, z = third_axes(rotation, g)[0]
    solutions = []
    for sign in (1, -1):
        p, q = leg_closure(x, y, z, sign, g, FLOATS)
        active = active_angle(x, y, p, q, FLOATS)
        solutions.append((active, *passive_angles(rotation, z, active, p, q, g, FLOATS)))

    def misfit(solution):
        return sum(
            abs(math.remainder(angle - reading, 2.0 * math.pi))
            for angle, reading in ((solution[0], th1a), (solution[2], th3a))
            if reading is not None)

    return min(solutions, key=misfit)
