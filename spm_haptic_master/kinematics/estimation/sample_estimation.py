# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Maximum-likelihood orientation of one sample, in plain floats, for the 1 kHz path.

The start of Gauss-Newton is the closed form of a leg that carries the platform, leg A's Case 2 if
it can be. Where no closed form is to be trusted, the solutions are several, and prior, working
mode and readings select among them.
"""

from __future__ import annotations

from math import atan2, cos, hypot, sin, sqrt

from spm_haptic_master.exceptions import (
    AmbiguousError,
    InputError,
    SingularityError,
    UnreachableError,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.closed_form import (
    CLOSED_FORM_TRUST,
    possible_starts,
    start_at,
    trusted_start,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    CONVERGED_STEP,
    DETERMINED_VARIANCE,
    fit,
    MODE_MARGIN,
    RANK_TOLERANCE,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import (
    closed_leg,
    in_base_frame,
    NO_SHARE,
    Row,
    State,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import FEWEST_MOUNTED, FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    Linkage,
    linkage,
    turn_of_second_joint,
)
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
            th2a = atan2(sine * determinant, cosine * determinant)
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


def one_step(state: State[float], view: Linkage[float], readings: tuple[float, ...],
             sensors: UsedSensors, g: Geometry, working_mode: WorkingMode | None,
             last_step: float) -> SampleEstimate | None:
    """
    Estimate a sample by one step from Case 2 of its readings; None if that is not enough.

    Arguments as of `fit`, which gives the same numbers. This is `linearise`, `normal_equations`,
    `gauss_newton_step` and `parities`, written out for th1A, th1B, th1C and th3A in use: the
    readings are the start, so that th1A and th3A have no residual.
    """
    th1a, th2a, th3a, _, _ = state
    turn_1, turn_3, leg_b, leg_c = view
    turns = turn_1, (cos(th2a), sin(th2a)), turn_3
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = sensors.weights
    (left_b, b1, b2, b3, volume_b), row_3b = closed_leg(
        turns, leg_b, g, 1, readings[4] if weight_3b else None, weight_3b, FLOATS)
    (left_c, d1, d2, d3, volume_c), row_3c = closed_leg(
        turns, leg_c, g, 2, readings[5] if weight_3c else None, weight_3c, FLOATS)
    wb1, wb2, wb3 = weight_b * b1, weight_b * b2, weight_b * b3
    wc1, wc2, wc3 = weight_c * d1, weight_c * d2, weight_c * d3
    n11, n12, n13 = weight_a + wb1 * b1 + wc1 * d1, wb2 * b1 + wc2 * d1, wb3 * b1 + wc3 * d1
    n22, n23, n33 = wb2 * b2 + wc2 * d2, wb3 * b2 + wc3 * d2, weight_3 + wb3 * b3 + wc3 * d3
    y1, y2, y3 = (wb1 * left_b + wc1 * left_c, wb2 * left_b + wc2 * left_c,
                  wb3 * left_b + wc3 * left_c)
    further = (row_3b, row_3c)[:sensors.further]
    for residual, x, y, z, weight in further:
        wx, wy, wz = weight * x, weight * y, weight * z
        n11, n12, n13 = n11 + wx * x, n12 + wy * x, n13 + wz * x
        n22, n23, n33 = n22 + wy * y, n23 + wz * y, n33 + wz * z
        y1, y2, y3 = y1 + wx * residual, y2 + wy * residual, y3 + wz * residual
    e11, e12, e13 = n22 * n33 - n23 * n23, n13 * n23 - n12 * n33, n12 * n23 - n13 * n22
    e22, e23, e33 = n11 * n33 - n13 * n13, n12 * n13 - n11 * n23, n11 * n22 - n12 * n12
    determinant = n11 * e11 + n12 * e12 + n13 * e13
    if not determinant > RANK_TOLERANCE * (n11 * n22 * n33):
        return None
    p11, p12, p13 = e11 / determinant, e12 / determinant, e13 / determinant
    p22, p23, p33 = e22 / determinant, e23 / determinant, e33 / determinant
    x, y, z = (p11 * y1 + p12 * y2 + p13 * y3, p12 * y1 + p22 * y2 + p23 * y3,
               p13 * y1 + p23 * y2 + p33 * y3)
    if not (-last_step < x < last_step and -last_step < y < last_step
            and -last_step < z < last_step
            and -last_step < b1 * x + b2 * y + b3 * z - left_b < last_step
            and -last_step < d1 * x + d2 * y + d3 * z - left_c < last_step):
        return None
    th1a, th2a, th3a = th1a + x, th2a + y, th3a + z
    if working_mode is not None:
        carrier, (sign_a, sign_b, sign_c) = g.legs[0], working_mode
        if not (sign_b * volume_b > -MODE_MARGIN and sign_c * volume_c > -MODE_MARGIN and
                sign_a * carrier.sin_alpha * carrier.sin_beta * sin(th2a) > -MODE_MARGIN):
            return None
    covariance = p11, p12, p13, p22, p23, p33
    spread, motions = in_base_frame(th1a, th2a, covariance, g, FLOATS)
    na, nb, nc, n3 = b2 * d1 - b1 * d2, d2, -b2, b2 * d3 - b3 * d2
    variance = na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c + n3 * n3 / weight_3
    scale = 1.0 / sqrt(variance) if variance > 0.0 else 0.0
    parity = scale * (nb * left_b + nc * left_c)
    vector: tuple[float, ...] = (parity,)
    rows: tuple[Row[float], ...] = (
        (0.0, 1.0, 0.0, 0.0, weight_a), (left_b, b1, b2, b3, weight_b),
        (left_c, d1, d2, d3, weight_c), (0.0, 0.0, 0.0, 1.0, weight_3))
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = motions
    gain_sizes: tuple[float, ...] = (
        weight_a * hypot(ax, ay, az),
        weight_b * hypot(b1 * ax + b2 * bx + b3 * cx, b1 * ay + b2 * by + b3 * cy,
                         b1 * az + b2 * bz + b3 * cz),
        weight_c * hypot(d1 * ax + d2 * bx + d3 * cx, d1 * ay + d2 * by + d3 * cy,
                         d1 * az + d2 * bz + d3 * cz),
        weight_3 * hypot(cx, cy, cz))
    parity_sizes: tuple[float, ...]
    if sensors.count == FEWEST_MOUNTED:
        parity_sizes = abs(scale * na), abs(scale * nb), abs(scale * nc), abs(scale * n3)
    else:
        # P = I - H K is a projector: a size is the root of weight and share, P's diagonal.
        t12, t13, t23 = 2.0 * p12, 2.0 * p13, 2.0 * p23
        share_a, share_3 = 1.0 - weight_a * p11, 1.0 - weight_3 * p33
        share_b = 1.0 - (wb1 * (p11 * b1 + t12 * b2 + t13 * b3) + wb2 * (p22 * b2 + t23 * b3)
                         + wb3 * b3 * p33)
        share_c = 1.0 - (wc1 * (p11 * d1 + t12 * d2 + t13 * d3) + wc2 * (p22 * d2 + t23 * d3)
                         + wc3 * d3 * p33)
        parity_sizes = (sqrt(weight_a * share_a) if share_a > NO_SHARE else 0.0,
                        sqrt(weight_b * share_b) if share_b > NO_SHARE else 0.0,
                        sqrt(weight_c * share_c) if share_c > NO_SHARE else 0.0,
                        sqrt(weight_3 * share_3) if share_3 > NO_SHARE else 0.0)
    if further:
        rows += further
        sizes: tuple[float, ...] = ()
        gains: tuple[float, ...] = ()
        more: tuple[float, ...] = ()
        last = h1 = h2 = h3 = 0.0
        square = parity * parity
        # From the last one: each parity is that of the sensors before it.
        for residual, u, v, w, weight in reversed(further):
            g1, g2, g3 = (p11 * u + p12 * v + p13 * w, p12 * u + p22 * v + p23 * w,
                          p13 * u + p23 * v + p33 * w)
            share = 1.0 - weight * (u * g1 + v * g2 + w * g3)
            size = sqrt(weight * share) if share > NO_SHARE else 0.0
            sizes = (size,) + sizes
            gains = (weight * hypot(u * ax + v * bx + w * cx, u * ay + v * by + w * cy,
                                    u * az + v * bz + w * cz),) + gains
            if not weight:
                continue
            left = residual - u * x - v * y - w * z
            if more:
                cross = u * h1 + v * h2 + w * h3
                left, share = left + cross * last, share - weight * cross * cross
                size = sqrt(weight * share) if share > NO_SHARE else 0.0
            scale = weight / size if size else 0.0
            last = scale * left
            square += last * last
            h1, h2, h3 = scale * g1, scale * g2, scale * g3
            more = (last,) + more
        gain_sizes += gains
        parity_sizes += sizes
        if more:
            vector, parity = vector + more, sqrt(square)
    # As SampleEstimate(...) does, without its call.
    return tuple.__new__(SampleEstimate, (
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), spread, parity, vector,
        spread[0] + spread[4] + spread[8] < DETERMINED_VARIANCE, sensors, parity_sizes,
        gain_sizes, rows, covariance))
