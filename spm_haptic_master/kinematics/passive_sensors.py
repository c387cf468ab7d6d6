# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Sensors on th3B and th3C: kernels that add them to the normal equations of four sensors.

All tuples of six are in the order th1A, th1B, th1C, th3A, th3B, th3C; a sensor that is not there
has the weight 0. State, units and legs are those of `normal_equations`.

The parity vector is U^T r of the whitened residuals r, with an orthonormal U whose columns no
motion of the platform reaches: U^T H = 0 with the whitened Jacobian H, and U U^T = P = I - H K.
Its first entry is the parity of the first four sensors that are there. Each further one is what
the next sensor differs by from the estimate of those before it, over its standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.leg_kernels import Linkage, turn_through_link
from spm_haptic_master.kinematics.normal_equations import (
    Legs,
    LegVectors,
    linearise,
    normal_equations,
    parity_of,
    Readings,
    residuals_of,
    Sensitivity,
    State,
    Symmetric,
)
from spm_haptic_master.kinematics.number_backends import Backend, N, Vector

SixReadings: TypeAlias = tuple[N, N, N, N, N, N]
SixWeights: TypeAlias = tuple[float, float, float, float, float, float]
# Cosine and sine of a reading (unit 1).
Turn: TypeAlias = tuple[N, N]
# Residuals (rad) and rates of the sensors on th3B and th3C along th1A, th2A, th3A (unit 1).
Thirds: TypeAlias = tuple[Sensitivity[N], Sensitivity[N]]

# Residual and rates of a sensor that is not there, and of both.
NO_SENSOR = (0.0, 0.0, 0.0, 0.0)
NO_THIRDS = NO_SENSOR, NO_SENSOR


def six_weights(weights: Sequence[float]) -> SixWeights:
    """Weights of six sensors from those of four, five or six."""
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = (*weights, 0.0, 0.0)[:6]
    return weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c


def third_joint(first_a: Vector[N], vectors: LegVectors[N], third: Vector[N], zero: Vector[N],
                correction: N, reading: Turn[N], leg: Leg, carrier: Leg,
                m: Backend[N]) -> Sensitivity[N]:
    """
    Sensor on the third joint of leg B or C, to first order, with its leg closed.

    All vectors are components after leg A's second joint.

    Parameters
    ----------
    first_a : tuple of three numbers
        Z1A.
    vectors : LegVectors
        Axes of the leg, of `linearise`.
    third, zero : tuple of three numbers
        Z3k, and the direction in the platform from which th3k is measured.
    correction : number
        Fitted active angle less the one that closes the leg, rad.
    reading : tuple of two numbers
        Cosine and sine of the sensor's reading.
    leg, carrier : Leg
        The leg itself, and leg A.
    m : Backend
        Elementary functions.

    Returns
    -------
    residual : number
        Reading less the angle that closes the leg, rad, in [-pi, pi] before the correction.
    along_1, along_2, along_3 : number
        Rates of th3k along th1A, th2A, th3A: (Z1k x Z2k) . axis / B_kk (unit 1).

    """
    (ux, uy, uz), (dx, dy, dz), reciprocal = vectors
    vx, vy, vz = third
    ex, ey, ez = zero
    # Z2k is (sin beta sin th3k, sin beta cos th3k, cos beta) in the frame Q_k of the platform.
    sine = ex * dx + ey * dy + ez * dz
    cosine = (dx * (vy * ez - vz * ey) + dy * (vz * ex - vx * ez) + dz * (vx * ey - vy * ex))
    c, s = reading
    angle = m.atan2(s * cosine - c * sine, c * cosine + s * sine)
    # A turn of Z2k about Z1k alone changes th3k at the rate (Z2k x Z3k).(Z1k x Z2k) / sin^2 beta.
    rate = ((leg.cos_alpha * leg.cos_beta - vx * ux - vy * uy - vz * uz)
            / (leg.sin_beta * leg.sin_beta))
    x, y, z = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    ax, ay, az = first_a
    return (angle + rate * correction, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
            (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal)


def linearise_more(state: State[N], view: Linkage[N], readings: Readings[N],
                   turns: tuple[Turn[N], Turn[N]], weights: SixWeights, g: Geometry,
                   m: Backend[N]) -> tuple[Legs[N], Readings[N], Thirds[N]]:
    """
    Linearise the legs B and C and all sensors.

    Returns
    -------
    legs : tuple of two 4-tuples of numbers
        As of `linearise`.
    residuals : tuple of four numbers
        Of th1A, th1B, th1C, th3A, rad.
    thirds : tuple of two 4-tuples of numbers
        Sensors on th3B and th3C, as of `third_joint`.

    """
    _, weight_b, weight_c, _, weight_3b, weight_3c = weights
    _, th2a, th3a, _, _ = state
    c1, s1, leg_b, leg_c = view
    legs, first_a, vectors_b, vectors_c = linearise(
        th2a, c1, s1, leg_b, leg_c, (1.0, weight_b or weight_3b, weight_c or weight_3c, 1.0), g, m)
    c3, s3 = m.cos(th3a), m.sin(th3a)
    carrier, b, c = g.legs
    turn_b, turn_c = turns
    third_b: Sensitivity[N] = NO_SENSOR
    third_c: Sensitivity[N] = NO_SENSOR
    if weight_3b:
        third_b = third_joint(
            first_a, vectors_b, leg_b[1], turn_through_link(c3, s3, g.carried[0].zero),
            legs[0][0], turn_b, b, carrier, m)
    if weight_3c:
        third_c = third_joint(
            first_a, vectors_c, leg_c[1], turn_through_link(c3, s3, g.carried[1].zero),
            legs[1][0], turn_c, c, carrier, m)
    return legs, residuals_of(state, readings, legs), (third_b, third_c)


def normal_equations_of_more(residuals: Readings[N], legs: Legs[N], thirds: Thirds[N],
                             weights: SixWeights) -> tuple[Symmetric[N], Vector[N]]:
    """Matrix (1 / rad^2) and right side (1 / rad) of all sensors' normal equations."""
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = weights
    (n11, n12, n13, n22, n23, n33), (y1, y2, y3) = normal_equations(
        residuals, legs, (weight_a, weight_b, weight_c, weight_3))
    (rb, b1, b2, b3), (rc, c1, c2, c3) = thirds
    wb1, wb2, wb3 = weight_3b * b1, weight_3b * b2, weight_3b * b3
    wc1, wc2, wc3 = weight_3c * c1, weight_3c * c2, weight_3c * c3
    return ((n11 + wb1 * b1 + wc1 * c1, n12 + wb1 * b2 + wc1 * c2, n13 + wb1 * b3 + wc1 * c3,
             n22 + wb2 * b2 + wc2 * c2, n23 + wb2 * b3 + wc2 * c3, n33 + wb3 * b3 + wc3 * c3),
            (y1 + wb1 * rb + wc1 * rc, y2 + wb2 * rb + wc2 * rc, y3 + wb3 * rb + wc3 * rc))


def parity_of_more(residuals: Readings[N], legs: Legs[N], thirds: Thirds[N],
                   weights: SixWeights, entries: Symmetric[N], determinant: N, step: State[N],
                   m: Backend[N]) -> tuple[N, ...]:
    """
    Parity vector (unit 1), one entry for each sensor beyond three.

    Parameters
    ----------
    residuals, legs, thirds
        Of `linearise_more`.
    weights : tuple of six float
        1 / sigma^2 of the sensors, 1 / rad^2.
    entries, determinant
        Of `inverse_normal`, all sensors.
    step : tuple of five numbers
        Gauss-Newton step of these residuals, rad.
    m : Backend
        Elementary functions.

    """
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = weights
    if weight_a and weight_b and weight_c and weight_3:
        first = parity_of(residuals, legs, (weight_a, weight_b, weight_c, weight_3), m)
    else:
        first = _parity_with_third(residuals, legs, thirds, weights, m)
        weight_3b = 0.0
    if not weight_3b and not weight_3c:
        return (first,)
    d1, d2, d3, _, _ = step
    (rb, b1, b2, b3), (rc, c1, c2, c3) = thirds
    e11, e12, e13, e22, e23, e33 = entries
    if not weight_3c:
        # Variances relative to the sensor's own: of its residual in the fit, which it has drawn.
        return first, m.sqrt(weight_3b) * (rb - b1 * d1 - b2 * d2 - b3 * d3) / m.sqrt(
            1.0 - weight_3b / determinant * (
                b1 * (e11 * b1 + e12 * b2 + e13 * b3) + b2 * (e12 * b1 + e22 * b2 + e23 * b3)
                + b3 * (e13 * b1 + e23 * b2 + e33 * b3)))
    g1, g2, g3 = (e11 * c1 + e12 * c2 + e13 * c3, e12 * c1 + e22 * c2 + e23 * c3,
                  e13 * c1 + e23 * c2 + e33 * c3)
    left_c = rc - c1 * d1 - c2 * d2 - c3 * d3
    p_cc = 1.0 - weight_3c * (c1 * g1 + c2 * g2 + c3 * g3) / determinant
    last = m.sqrt(weight_3c / p_cc) * left_c
    if not weight_3b:
        return first, last
    # Without th3C the residual of th3B, and its variance, would be these.
    p_bc = -(b1 * g1 + b2 * g2 + b3 * g3) / determinant
    share = weight_3c * p_bc / p_cc
    p_bb = 1.0 - weight_3b * (
        (b1 * (e11 * b1 + e12 * b2 + e13 * b3) + b2 * (e12 * b1 + e22 * b2 + e23 * b3)
         + b3 * (e13 * b1 + e23 * b2 + e33 * b3)) / determinant + share * p_bc)
    left_b = rb - b1 * d1 - b2 * d2 - b3 * d3 - share * left_c
    return first, m.sqrt(weight_3b / p_bb) * left_b, last


def _parity_with_third(residuals: Readings[N], legs: Legs[N], thirds: Thirds[N],
                       weights: SixWeights, m: Backend[N]) -> N:
    """Return the parity of th3B and three of the four sensors before it."""
    ra, rb, rc, r3 = residuals
    readings = ra, rb, rc, r3, thirds[0][0]
    rows: tuple[Vector[N], ...] = (
        (1.0, 0.0, 0.0), legs[0][1:], legs[1][1:], (0.0, 0.0, 1.0), thirds[0][1:])
    there = [sensor for sensor in range(5) if weights[sensor]]
    p, q, r, s = (rows[sensor] for sensor in there)
    parts = _volume(q, r, s), -_volume(p, r, s), _volume(p, q, s), -_volume(p, q, r)
    t, u, v, w = ((part * readings[sensor], part * part / weights[sensor])
                  for part, sensor in zip(parts, there, strict=True))
    return (t[0] + u[0] + v[0] + w[0]) / m.sqrt(t[1] + u[1] + v[1] + w[1])


def _volume(p: Vector[N], q: Vector[N], r: Vector[N]) -> N:
    """Return the determinant of three rows."""
    p1, p2, p3 = p
    q1, q2, q3 = q
    r1, r2, r3 = r
    return p1 * (q2 * r3 - q3 * r2) + p2 * (q3 * r1 - q1 * r3) + p3 * (q1 * r2 - q2 * r1)
