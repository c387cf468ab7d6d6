"""
Maximum-likelihood orientation from four joint sensors, or from any three of them.

The platform is carried by leg A's chain, so that th1A, th2A, th3A are coordinates of its
orientation and the sensors on th1A and th3A read two of them directly. Legs B and C add their
closures, in which the fitted th1B and th1C stand. The weighted sum of the four squared corrections
is minimised by Gauss-Newton on closures and corrections together: unlike the inverse model's
angles, the closures exist whatever the readings, also just outside the reach of a leg, and each leg
stays in the working mode its reading puts it in.
"""

from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from spm_haptic_master.exceptions import (
    InputError,
    SingularityError,
    SpmError,
    UnreachableError,
)
from spm_haptic_master.kinematics.checks import (
    check_array,
    check_broadcast,
    check_geometry,
    check_rotations,
)
from spm_haptic_master.kinematics.elementary import ARRAYS, FLOATS
from spm_haptic_master.kinematics.forward import linkage, turn_of_second_joint
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.legs import (
    active_angle,
    both_turns,
    chain_closure,
    chain_quaternion,
    into_second_link,
    leg_closure,
    passive_angles,
    second_axis_a,
    third_axes,
    turn_equation,
)
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
    stack_matrix,
)

SENSORS = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')
"""The four sensors, in the order of every array of four: th1A, th1B, th1C, th3A."""

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

BATCH_STEPS = 6
"""Steps of a batch as a whole; rows that need more are done one by one."""

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
    motions : tuple of three 3-tuples of float
        Covariance of the rotation error with the errors of th1A, th2A, th3A, rad^2.

    """

    quaternion: tuple
    covariance: tuple
    parity: float | None
    valid: bool
    slopes: tuple
    weights: tuple
    motions: tuple

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
            _consistency(self.slopes), self.weights, strict=True)]
        norm = math.sqrt(sum(entry * entry for entry in entries))
        return tuple(entry / norm for entry in entries)

    def angular_velocity(self, rate_1a, rate_1b, rate_1c, rate_3a):
        """
        Angular velocity from joint velocities, by weighted least squares, in plain floats.

        Parameters
        ----------
        rate_1a, rate_1b, rate_1c, rate_3a : float
            Joint velocities, rad/s; that of a missing sensor must still be a finite number.

        Returns
        -------
        x, y, z : float
            rad/s, base frame.

        """
        y1, y2, y3 = _right_side(
            (rate_1a, rate_1b, rate_1c, rate_3a), self.slopes, self.weights)
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.motions
        return (ax * y1 + bx * y2 + cx * y3, ay * y1 + by * y2 + cy * y3,
                az * y1 + bz * y2 + cz * y3)


@dataclass(frozen=True, slots=True)
class Estimate:
    """
    Maximum-likelihood orientations.

    Attributes
    ----------
    rotation : ndarray, shape (..., 3, 3)
        R_base_platform.
    covariance : ndarray, shape (..., 3, 3)
        Of the rotation error, a rotation vector in the base frame, rad^2; first order.
    parity : ndarray, shape (...)
        Signed residual of the four sensors over its standard deviation; unit variance when they are
        healthy. NaN with a sensor missing: three sensors cannot contradict each other.
    valid : ndarray of bool, shape (...)
        Whether the sensors determine the orientation: total deviation under `VALID_DEVIATION`.

    """

    rotation: np.ndarray
    covariance: np.ndarray
    parity: np.ndarray
    valid: np.ndarray


# Kernels --------------------------------------------------------------------------------------
#
# State: th1A, th2A, th3A, th1B, th1C as fitted. Readings: th1A, th1B, th1C, th3A. Weights:
# 1 / sigma^2 in the readings' order, 0 for a missing sensor.

def _leg_sensitivity(c2, s2, first_a, first, leg, g, m):
    """
    How the active angle of leg B or C that closes the leg depends on leg A's joints.

    Returns
    -------
    correction : number
        rad; the active angle that closes the leg is the fitted one minus this.
    along_1, along_2, along_3 : numbers
        Its rates along th1A, th2A, th3A.

    """
    second, third = leg
    f, (x, y, z), about_third = chain_closure(into_second_link(c2, s2, second), third, g)
    ux, uy, uz = into_second_link(c2, s2, first)
    ax, ay, az = first_a
    # Along the leg's own active angle f changes at the rate B_kk = -Z1k . moment.
    reciprocal = m.mode_reciprocal(ux * x + uy * y + uz * z)
    return (-f * reciprocal, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
            about_third * reciprocal)


NO_SENSITIVITY = (0.0, 0.0, 0.0, 0.0)


def _linearise(th2a, c1, s1, leg_b, leg_c, weights, g, m):
    """Sensitivities of legs B and C of a `linkage`; zeros for a leg whose sensor is missing."""
    c2, s2 = m.cos(th2a), m.sin(th2a)
    # The active axes, z, x, y of the base: Z1A after leg A's second joint, the others before it.
    first_a = g.sin_alpha * s2, g.sin_alpha * c2, g.cos_alpha
    first_b = c1, -g.cos_alpha * s1, g.sin_alpha * s1
    first_c = s1, g.cos_alpha * c1, -g.sin_alpha * c1
    _, weight_b, weight_c, _ = weights
    return (
        _leg_sensitivity(c2, s2, first_a, first_b, leg_b, g, m) if weight_b else NO_SENSITIVITY,
        _leg_sensitivity(c2, s2, first_a, first_c, leg_c, g, m) if weight_c else NO_SENSITIVITY)


def _residuals(state, readings, legs):
    """Return readings minus what the state predicts, rad, to first order for legs B and C."""
    th1a, _, th3a, th1b, th1c = state
    reading_a, reading_b, reading_c, reading_3 = readings
    return (reading_a - th1a, reading_b - th1b + legs[0][0], reading_c - th1c + legs[1][0],
            reading_3 - th3a)


def _inverse_normal(legs, weights):
    """
    Inverse of the normal equations' matrix, the covariance of th1A, th2A, th3A.

    Returns
    -------
    entries : tuple of six numbers
        11, 12, 13, 22, 23, 33, each times the determinant.
    determinant : number
    product : number
        Of the matrix's diagonal; a determinant far below it means a direction nobody measures.

    """
    (_, b1, b2, b3), (_, c1, c2, c3) = legs
    weight_a, weight_b, weight_c, weight_3 = weights
    wb2, wb3, wc2, wc3 = weight_b * b2, weight_b * b3, weight_c * c2, weight_c * c3
    n11 = weight_a + weight_b * b1 * b1 + weight_c * c1 * c1
    n12 = wb2 * b1 + wc2 * c1
    n13 = wb3 * b1 + wc3 * c1
    n22 = wb2 * b2 + wc2 * c2
    n23 = wb3 * b2 + wc3 * c2
    n33 = weight_3 + wb3 * b3 + wc3 * c3
    e11, e12, e13 = n22 * n33 - n23 * n23, n13 * n23 - n12 * n33, n12 * n23 - n13 * n22
    e22, e23, e33 = n11 * n33 - n13 * n13, n12 * n13 - n11 * n23, n11 * n22 - n12 * n12
    return ((e11, e12, e13, e22, e23, e33), n11 * e11 + n12 * e12 + n13 * e13, n11 * n22 * n33)


def _right_side(values, legs, weights):
    """Right side of the normal equations, of residuals (rad) or of joint velocities (rad/s)."""
    (_, b1, b2, b3), (_, c1, c2, c3) = legs
    weight_a, weight_b, weight_c, weight_3 = weights
    a, b, c, third = values
    b, c = weight_b * b, weight_c * c
    return (weight_a * a + b1 * b + c1 * c, b2 * b + c2 * c, b3 * b + c3 * c + weight_3 * third)


def _step(residuals, legs, weights, entries, determinant):
    """Gauss-Newton step of the state, rad; th1B and th1C follow to close their legs."""
    (fb, b1, b2, b3), (fc, c1, c2, c3) = legs
    e11, e12, e13, e22, e23, e33 = entries
    y1, y2, y3 = _right_side(residuals, legs, weights)
    d1 = (e11 * y1 + e12 * y2 + e13 * y3) / determinant
    d2 = (e12 * y1 + e22 * y2 + e23 * y3) / determinant
    d3 = (e13 * y1 + e23 * y2 + e33 * y3) / determinant
    return d1, d2, d3, b1 * d1 + b2 * d2 + b3 * d3 - fb, c1 * d1 + c2 * d2 + c3 * d3 - fc


def _consistency(legs):
    """Coefficients of the one combination of readings that no motion of the platform changes."""
    (_, b1, b2, b3), (_, c1, c2, c3) = legs
    return b2 * c1 - b1 * c2, c2, -b2, b2 * c3 - b3 * c2


def _parity(residuals, legs, weights, m):
    """Signed residual of that combination over its standard deviation."""
    na, nb, nc, n3 = _consistency(legs)
    ra, rb, rc, r3 = residuals
    weight_a, weight_b, weight_c, weight_3 = weights
    return (na * ra + nb * rb + nc * rc + n3 * r3) / m.sqrt(
        na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c + n3 * n3 / weight_3)


def _base_frame(th1a, th2a, entries, determinant, g, m):
    """
    Turn the covariance of leg A's joints into the base frame.

    Returns
    -------
    covariance : tuple of nine numbers
        Of the rotation error, rad^2, row by row.
    motions : tuple of three 3-tuples of numbers
        Covariance of the rotation error with each joint's, rad^2.

    """
    c1, s1, c2, s2 = m.cos(th1a), m.sin(th1a), m.cos(th2a), m.sin(th2a)
    # Z2A and Z3A in the base frame; Z1A is z.
    x2, y2, z2 = second_axis_a(c1, s1, g)
    x, y = g.sin_beta * s2, -g.sin_beta * c2
    y, z3 = g.cos_alpha * y - g.sin_alpha * g.cos_beta, g.sin_alpha * y + g.cos_alpha * g.cos_beta
    x3, y3 = c1 * x - s1 * y, s1 * x + c1 * y
    e11, e12, e13, e22, e23, e33 = entries
    e11, e12, e13 = e11 / determinant, e12 / determinant, e13 / determinant
    e22, e23, e33 = e22 / determinant, e23 / determinant, e33 / determinant
    ax, ay, az = x2 * e12 + x3 * e13, y2 * e12 + y3 * e13, e11 + z2 * e12 + z3 * e13
    bx, by, bz = x2 * e22 + x3 * e23, y2 * e22 + y3 * e23, e12 + z2 * e22 + z3 * e23
    cx, cy, cz = x2 * e23 + x3 * e33, y2 * e23 + y3 * e33, e13 + z2 * e23 + z3 * e33
    xy, xz = y2 * bx + y3 * cx, ax + z2 * bx + z3 * cx
    yz = ay + z2 * by + z3 * cy
    covariance = (x2 * bx + x3 * cx, xy, xz, xy, y2 * by + y3 * cy, yz,
                  xz, yz, az + z2 * bz + z3 * cz)
    return covariance, ((ax, ay, az), (bx, by, bz), (cx, cy, cz))


# Floats ---------------------------------------------------------------------------------------

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
        The sensor, of `SENSORS`, to do without. Three sensors have several solutions, so that a
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
    weights = _weights(sigma)
    view = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3], geometry)
    if abs(determinant) > CLOSED_FORM_TRUST * max(sigma):
        th2a = math.atan2(sine * determinant, cosine * determinant)
        return _fit(th2a, view, readings, weights, geometry)
    return _estimate_without_closed_form(view, readings, weights, geometry, prior)


def _weights(sigma):
    sigma_a, sigma_b, sigma_c, sigma_3 = sigma
    return (1.0 / (sigma_a * sigma_a), 1.0 / (sigma_b * sigma_b), 1.0 / (sigma_c * sigma_c),
            1.0 / (sigma_3 * sigma_3))


def _fit(th2a, view, readings, weights, g):
    """Gauss-Newton to convergence, from the readings, th2A and the `linkage` they make."""
    th1a, th1b, th1c, th3a = readings
    for _ in range(STEPS):
        state = th1a, th2a, th3a, th1b, th1c
        legs = _linearise(th2a, *view, weights, g, FLOATS)
        residuals = _residuals(state, readings, legs)
        entries, determinant, product = _inverse_normal(legs, weights)
        if not determinant > RANK_TOLERANCE * product:
            raise SingularityError(
                f'readings {readings} rad: the sensors do not measure every direction')
        step = _step(residuals, legs, weights, entries, determinant)
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
    parity = _parity(residuals, legs, weights, FLOATS) if all(weights) else None
    covariance, motions = _base_frame(th1a, th2a, entries, determinant, g, FLOATS)
    valid = covariance[0] + covariance[4] + covariance[8] < VALID_DEVIATION * VALID_DEVIATION
    return SampleEstimate(
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), covariance, parity, valid, legs, weights,
        motions)


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
    index = SENSORS.index(missing)
    weights = tuple(
        0.0 if sensor == index else weight for sensor, weight in enumerate(_weights(sigma)))
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


# Arrays ---------------------------------------------------------------------------------------

def estimate(th1, theta3a, sigma, geometry=PAPER_GEOMETRY, prior=None, missing=None):
    """
    Maximum-likelihood orientations from four joint sensors, or from three of them.

    The closed form of Case 2 is the start, Gauss-Newton the rest; the result is at the Cramer-Rao
    bound wherever the noise is small beside the mechanism's curvature. It works in all eight
    working modes: the readings themselves say in which one each leg is.

    One sample detects a faulty sensor by its parity but cannot tell which one it is; near a
    parallel singularity the three active sensors cannot check th3A.

    Parameters
    ----------
    th1 : array_like, shape (..., 3)
        Active joints A, B, C, rad.
    theta3a : array_like, shape (...)
        Leg A's second passive joint, rad.
    sigma : float or array_like of four
        Standard deviation of the readings, rad: one for all, or th1A, th1B, th1C, th3A.
    geometry : Geometry
        Link angles.
    prior : array_like, shape (..., 3, 3), optional
        Last known orientation. It selects among solutions that explain the readings equally well,
        and has no weight in the result.
    missing : {'joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'}, optional
        One sensor to do without; its readings are not looked at and may be NaN. Three sensors have
        several solutions: a prior must be given and the one reached from it is returned.

    Returns
    -------
    Estimate
        In a batch, the rows of samples that would raise alone are NaN, and not valid.

    Raises
    ------
    InputError
        An argument is not what is expected; a NaN anywhere in a batch, too.
    SingularityError
        A single sample that does not determine the orientation: two solutions explain it equally
        well (the closed form is degenerate) and there is no prior, or a direction is not measured,
        or a leg is on the boundary of its working mode.
    UnreachableError
        A single sample whose angles close no mechanism.

    """
    check_geometry(geometry)
    sigma = _check_sigma(sigma)
    th1, theta3a = _check_readings(th1, theta3a, missing)
    shapes = [th1.shape[:-1], theta3a.shape]
    if prior is not None:
        prior = quaternion_from_matrix(check_rotations('prior', prior))
        shapes.append(prior.shape[:-1])
    elif missing is not None:
        raise InputError(f'prior = None: expected an orientation, since {missing} is missing')
    batch = check_broadcast('th1, theta3a, prior', *shapes)
    if not batch:
        return _single(estimate_sample(
            *th1.tolist(), theta3a.item(), sigma, geometry,
            None if prior is None else tuple(prior.tolist()), missing))
    readings = np.empty(batch + (4,))
    readings[..., :3] = th1
    readings[..., 3] = theta3a
    readings = readings.reshape(-1, 4)
    priors = None if prior is None else np.broadcast_to(prior, batch + (4,)).reshape(-1, 4)
    if missing is None:
        result, settled = _estimate_batch(readings, sigma, geometry)
    else:
        result, settled = _unknown(len(readings)), np.zeros(len(readings), bool)
    for row in np.flatnonzero(~settled):
        try:
            single = _single(estimate_sample(
                *readings[row].tolist(), sigma, geometry,
                None if priors is None else tuple(priors[row].tolist()), missing))
        except SpmError:
            continue
        for name in Estimate.__slots__:
            getattr(result, name)[row] = getattr(single, name)
    return Estimate(*(
        getattr(result, name).reshape(batch + getattr(result, name).shape[1:])
        for name in Estimate.__slots__))


def _estimate_batch(readings, sigma, g):
    """Estimate rows by arrays; return what came out and which rows may be believed."""
    result = _unknown(len(readings))
    columns = tuple(readings.T)
    weights = _weights(sigma)
    th1a, th1b, th1c, th3a = columns
    view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
    cosine, sine, determinant = turn_of_second_joint(view[2], view[3], g)
    th2a = np.arctan2(sine * determinant, cosine * determinant)
    trusted = np.abs(determinant) > CLOSED_FORM_TRUST * max(sigma)
    with np.errstate(all='ignore'):  # untrusted rows may go anywhere; they are done one by one
        for _ in range(BATCH_STEPS):
            state = th1a, th2a, th3a, th1b, th1c
            legs = _linearise(th2a, *view, weights, g, ARRAYS)
            residuals = _residuals(state, columns, legs)
            entries, determinant, product = _inverse_normal(legs, weights)
            step = _step(residuals, legs, weights, entries, determinant)
            th1a, th2a, th3a, th1b, th1c = (
                angle + along for angle, along in zip(state, step, strict=True))
            longest = np.max(np.abs(step), axis=0)
            trusted &= (longest < LONGEST_STEP) & (determinant > RANK_TOLERANCE * product)
            settled = trusted & (longest < CONVERGED_STEP)
            if np.array_equal(settled, trusted):
                break
            view = linkage(th1a, th1b, th1c, th3a, g, ARRAYS)
        parity = _parity(residuals, legs, weights, ARRAYS)
        covariance, _ = _base_frame(th1a, th2a, entries, determinant, g, ARRAYS)
        quaternion = chain_quaternion(th1a, th2a, th3a, g, ARRAYS)
    result.rotation[settled] = stack_matrix(rotation_from_quaternion(*quaternion))[settled]
    result.covariance[settled] = stack_matrix(covariance)[settled]
    result.parity[settled] = parity[settled]
    result.valid[settled] = _valid(result.covariance[settled])
    return result, settled


def _valid(covariance):
    return np.trace(covariance, axis1=-2, axis2=-1) < VALID_DEVIATION ** 2


def _unknown(rows):
    return Estimate(
        np.full((rows, 3, 3), np.nan), np.full((rows, 3, 3), np.nan), np.full(rows, np.nan),
        np.zeros(rows, bool))


def _single(sample):
    """Put a sample's numbers into arrays: one for all of them, and views of it."""
    numbers = np.array(
        rotation_from_quaternion(*sample.quaternion) + sample.covariance).reshape(2, 3, 3)
    return Estimate(
        numbers[0], numbers[1], np.float64(math.nan if sample.parity is None else sample.parity),
        np.bool_(sample.valid))


def _check_sigma(sigma):
    deviations = check_array('sigma', sigma, ())
    four = deviations.tolist() if deviations.ndim else [deviations.item()] * 4
    if deviations.ndim > 1 or len(four) != 4 or not min(four) > 0.0:
        raise InputError(
            f'sigma = {sigma!r}: expected one positive standard deviation in rad, or four')
    return tuple(four)


def _check_readings(th1, theta3a, missing):
    if missing not in (None, *SENSORS):
        raise InputError(f'missing = {missing!r}: expected one of {SENSORS} or None')
    if missing == 'joint_3a':
        theta3a = np.zeros(np.shape(theta3a))
    elif missing is not None:
        th1 = np.array(th1, dtype=float)
        th1[..., SENSORS.index(missing)] = 0.0
    th1 = check_array('th1', th1, (3,))
    return th1, check_array('theta3a', theta3a, ())
