# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The estimate of a healthy sample at 1 kHz: one Gauss-Newton step, unrolled."""

from __future__ import annotations

from math import cos, hypot, sin, sqrt

from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_VARIANCE,
    MODE_MARGIN,
    RANK_TOLERANCE,
)
from spm_haptic_master.kinematics.estimation.linearisation import (
    leg_closure,
    Row,
    State,
    third_joints,
)
from spm_haptic_master.kinematics.estimation.normal_equations import in_base_frame
from spm_haptic_master.kinematics.estimation.parity_vector import further_parities
from spm_haptic_master.kinematics.estimation.sample_estimate import SampleEstimate
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import (
    chain_quaternion,
    Linkage,
    turn_through_link,
)
from spm_haptic_master.kinematics.number_backends import FLOATS


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
    c1, s1, leg_b, leg_c = view
    c2, s2 = cos(th2a), sin(th2a)
    carrier, (b, c) = g.legs[0], g.carried
    first_a = carrier.sin_alpha * s2, carrier.sin_alpha * c2, carrier.cos_alpha
    (left_b, b1, b2, b3, volume_b), vectors_b = leg_closure(
        c2, s2, first_a, turn_through_link(c1, -s1, b.first), leg_b, carrier, FLOATS)
    (left_c, d1, d2, d3, volume_c), vectors_c = leg_closure(
        c2, s2, first_a, turn_through_link(c1, -s1, c.first), leg_c, carrier, FLOATS)
    weight_a, weight_b, weight_c, weight_3, _, _ = sensors.weights
    wb1, wb2, wb3 = weight_b * b1, weight_b * b2, weight_b * b3
    wc1, wc2, wc3 = weight_c * d1, weight_c * d2, weight_c * d3
    n11, n12, n13 = weight_a + wb1 * b1 + wc1 * d1, wb2 * b1 + wc2 * d1, wb3 * b1 + wc3 * d1
    n22, n23, n33 = wb2 * b2 + wc2 * d2, wb3 * b2 + wc3 * d2, weight_3 + wb3 * b3 + wc3 * d3
    y1, y2, y3 = (wb1 * left_b + wc1 * left_c, wb2 * left_b + wc2 * left_c,
                  wb3 * left_b + wc3 * left_c)
    further = third_joints(cos(th3a), sin(th3a), first_a, vectors_b, vectors_c, (left_b, left_c),
                           readings, sensors, g, FLOATS) if sensors.further else ()
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
        sign_a, sign_b, sign_c = working_mode
        if not (sign_b * volume_b > -MODE_MARGIN and sign_c * volume_c > -MODE_MARGIN and
                sign_a * carrier.sin_alpha * carrier.sin_beta * sin(th2a) > -MODE_MARGIN):
            return None
    covariance = p11, p12, p13, p22, p23, p33
    spread, motions = in_base_frame(th1a, th2a, covariance, g, FLOATS)
    na, nb, nc, n3 = b2 * d1 - b1 * d2, d2, -b2, b2 * d3 - b3 * d2
    variance = na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c + n3 * n3 / weight_3
    scale = 1.0 / sqrt(variance) if variance > 0.0 else 0.0
    na, nb, nc, n3 = line = scale * na, scale * nb, scale * nc, scale * n3
    parity = nb * left_b + nc * left_c
    vector: tuple[float, ...] = (parity,)
    changes: tuple[tuple[float, ...], ...] = (line,)
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
    if further:
        rows += further
        gain_sizes += tuple([
            weight * hypot(x * ax + y * bx + z * cx, x * ay + y * by + z * cy,
                           x * az + y * bz + z * cz) for _, x, y, z, weight in further])
        more, lines = further_parities(rows, sensors, covariance, FLOATS)
        vector, changes = vector + more, (line + (0.0,) * len(further),) + lines
        if more:
            parity = hypot(*vector)
    # As SampleEstimate(...) does, without its call.
    return tuple.__new__(SampleEstimate, (
        chain_quaternion(th1a, th2a, th3a, g, FLOATS), spread, parity, vector,
        spread[0] + spread[4] + spread[8] < DETERMINED_VARIANCE, sensors, changes, gain_sizes,
        rows, motions))
