# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Weighted normal equations of one joint sample: kernels of the maximum-likelihood orientation.

State: the fitted th1A, th2A, th3A, th1B, th1C, rad. Readings: th1A, th1B, th1C, th3A, rad.
Weights: 1 / sigma^2 in the order of the readings, 1 / rad^2, 0 for a missing sensor. `legs` holds
the sensitivities of the legs B and C (see `linearise`).
"""

from __future__ import annotations

from typing import TypeAlias

from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.leg_kernels import (
    chain_closure,
    into_second_link,
    passive_axes,
    turn_through_link,
    View,
)
from spm_haptic_master.kinematics.number_backends import Backend, N, Rotation, Vector

Readings: TypeAlias = tuple[N, N, N, N]
State: TypeAlias = tuple[N, N, N, N, N]
Weights: TypeAlias = tuple[float, float, float, float]
# Correction of a leg's active angle (rad) and its rates along th1A, th2A, th3A (unit 1).
Sensitivity: TypeAlias = tuple[N, N, N, N]
Legs: TypeAlias = tuple[Sensitivity[N], Sensitivity[N]]
# Entries 11, 12, 13, 22, 23, 33 of a symmetric matrix.
Symmetric: TypeAlias = tuple[N, N, N, N, N, N]

# Z1k and Z2k of leg B or C after leg A's second joint, and -1 / B_kk (unit 1).
LegVectors: TypeAlias = tuple[Vector[N], Vector[N], N]
# Which sensors, or by which weights, a leg needs: its own is 0 where it does not.
Needed: TypeAlias = tuple[float, float, float, float]

# Sensitivity and axes of a leg without a sensor.
NO_LEG = (0.0, 0.0, 0.0, 0.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.0)


def weights_of(sigma: tuple[float, ...]) -> Weights:
    """1 / sigma^2, 1 / rad^2, of four sensors."""
    sigma_a, sigma_b, sigma_c, sigma_3 = sigma
    return (1.0 / (sigma_a * sigma_a), 1.0 / (sigma_b * sigma_b), 1.0 / (sigma_c * sigma_c),
            1.0 / (sigma_3 * sigma_3))


def _leg_sensitivity(c2: N, s2: N, first_a: Vector[N], first: Vector[N], leg: View[N],
                     g: Geometry, m: Backend[N]) -> tuple[Sensitivity[N], LegVectors[N]]:
    """
    Active angle that closes leg B or C, as a function of leg A's joints, to first order.

    Returns
    -------
    sensitivity : tuple of four numbers
        Fitted active angle less the one that closes the leg, rad; rates of the closing angle
        along th1A, th2A, th3A (unit 1).
    vectors : LegVectors
        Axes of the leg.

    """
    second, third, cos_beta = leg
    second = into_second_link(c2, s2, second)
    f, (x, y, z), about_third = chain_closure(second, third, cos_beta, g)
    ux, uy, uz = first = into_second_link(c2, s2, first)
    ax, ay, az = first_a
    # Along the leg's own active angle f changes at the rate B_kk = -Z1k . moment.
    reciprocal = m.mode_reciprocal(ux * x + uy * y + uz * z)
    return ((-f * reciprocal, (ax * x + ay * y + az * z) * reciprocal, z * reciprocal,
             about_third * reciprocal), (first, second, reciprocal))


def linearise(th2a: N, c1: N, s1: N, leg_b: View[N], leg_c: View[N], needed: Needed, g: Geometry,
              m: Backend[N]) -> tuple[Legs[N], Vector[N], LegVectors[N], LegVectors[N]]:
    """
    Sensitivities of the legs B and C of a `linkage`; zeros of one that is not needed.

    Returns
    -------
    legs : tuple of two 4-tuples of numbers
        Sensitivities of the legs B and C.
    first_a : tuple of three numbers
        Z1A in the frame of `LegVectors`.
    vectors_b, vectors_c : LegVectors
        Axes of the legs B and C.

    """
    c2, s2 = m.cos(th2a), m.sin(th2a)
    # The active axes: Z1A after leg A's second joint, the others before it.
    leg_a, (b, c) = g.legs[0], g.carried
    first_a = leg_a.sin_alpha * s2, leg_a.sin_alpha * c2, leg_a.cos_alpha
    first_b = turn_through_link(c1, -s1, b.first)
    first_c = turn_through_link(c1, -s1, c.first)
    _, need_b, need_c, _ = needed
    rates_b, vectors_b = _leg_sensitivity(
        c2, s2, first_a, first_b, leg_b, g, m) if need_b else NO_LEG
    rates_c, vectors_c = _leg_sensitivity(
        c2, s2, first_a, first_c, leg_c, g, m) if need_c else NO_LEG
    return (rates_b, rates_c), first_a, vectors_b, vectors_c


def residuals_of(state: State[N], readings: Readings[N], legs: Legs[N]) -> Readings[N]:
    """Return readings minus predictions of the state, rad, to first order for legs B and C."""
    th1a, _, th3a, th1b, th1c = state
    reading_a, reading_b, reading_c, reading_3 = readings
    return (reading_a - th1a, reading_b - th1b + legs[0][0], reading_c - th1c + legs[1][0],
            reading_3 - th3a)


def normal_equations(residuals: Readings[N], legs: Legs[N],
                     weights: Weights) -> tuple[Symmetric[N], Vector[N]]:
    """Matrix (1 / rad^2) and right side (1 / rad) of the four sensors' normal equations."""
    (_, b1, b2, b3), (_, c1, c2, c3) = legs
    weight_a, weight_b, weight_c, weight_3 = weights
    a, b, c, third = residuals
    wb2, wb3, wc2, wc3 = weight_b * b2, weight_b * b3, weight_c * c2, weight_c * c3
    wb1, wc1 = weight_b * b1, weight_c * c1
    return ((weight_a + wb1 * b1 + wc1 * c1, wb2 * b1 + wc2 * c1, wb3 * b1 + wc3 * c1,
             wb2 * b2 + wc2 * c2, wb3 * b2 + wc3 * c2, weight_3 + wb3 * b3 + wc3 * c3),
            (weight_a * a + wb1 * b + wc1 * c, wb2 * b + wc2 * c,
             wb3 * b + wc3 * c + weight_3 * third))


def inverse_normal(matrix: Symmetric[N]) -> tuple[Symmetric[N], N, N]:
    """
    Inverse of the normal equations' matrix, which is the covariance of th1A, th2A, th3A.

    Returns
    -------
    entries : tuple of six numbers
        Entries 11, 12, 13, 22, 23, 33 of the inverse, each times the determinant, 1 / rad^4.
    determinant : number
        Determinant of the matrix, 1 / rad^6.
    product : number
        Product of the matrix's diagonal, 1 / rad^6. Where the determinant is far smaller, the
        sensors do not measure every direction.

    """
    n11, n12, n13, n22, n23, n33 = matrix
    e11, e12, e13 = n22 * n33 - n23 * n23, n13 * n23 - n12 * n33, n12 * n23 - n13 * n22
    e22, e23, e33 = n11 * n33 - n13 * n13, n12 * n13 - n11 * n23, n11 * n22 - n12 * n12
    return ((e11, e12, e13, e22, e23, e33), n11 * e11 + n12 * e12 + n13 * e13, n11 * n22 * n33)


def gauss_newton_step(right: Vector[N], legs: Legs[N], entries: Symmetric[N],
                      determinant: N) -> State[N]:
    """Gauss-Newton step of the state, rad; th1B and th1C follow, so that their legs close."""
    (fb, b1, b2, b3), (fc, c1, c2, c3) = legs
    e11, e12, e13, e22, e23, e33 = entries
    y1, y2, y3 = right
    d1 = (e11 * y1 + e12 * y2 + e13 * y3) / determinant
    d2 = (e12 * y1 + e22 * y2 + e23 * y3) / determinant
    d3 = (e13 * y1 + e23 * y2 + e33 * y3) / determinant
    return d1, d2, d3, b1 * d1 + b2 * d2 + b3 * d3 - fb, c1 * d1 + c2 * d2 + c3 * d3 - fc


def consistency(legs: Legs[N]) -> Readings[N]:
    """Coefficients (unit 1) of the one combination of readings that no platform motion changes."""
    (_, b1, b2, b3), (_, c1, c2, c3) = legs
    return b2 * c1 - b1 * c2, c2, -b2, b2 * c3 - b3 * c2


def parity_of(residuals: Readings[N], legs: Legs[N], weights: Weights, m: Backend[N]) -> N:
    """Signed residual of the `consistency` combination over its standard deviation (unit 1)."""
    na, nb, nc, n3 = consistency(legs)
    ra, rb, rc, r3 = residuals
    weight_a, weight_b, weight_c, weight_3 = weights
    return (na * ra + nb * rb + nc * rc + n3 * r3) / m.sqrt(
        na * na / weight_a + nb * nb / weight_b + nc * nc / weight_c + n3 * n3 / weight_3)


def in_base_frame(th1a: N, th2a: N, entries: Symmetric[N], determinant: N, g: Geometry,
                  m: Backend[N]) -> tuple[Rotation[N], tuple[Vector[N], Vector[N], Vector[N]]]:
    """
    Covariance of the rotation error in the base frame from that of leg A's joints.

    Returns
    -------
    covariance : tuple of nine numbers
        Of the rotation error, rad^2, row by row.
    motions : tuple of three vectors
        Covariance of the rotation error with the errors of th1A, th2A, th3A, rad^2.

    """
    # The platform turns about Z1A, Z2A and Z3A.
    x1, y1, z1 = g.legs[0].first
    (x2, y2, z2), (x3, y3, z3) = passive_axes(
        m.cos(th1a), m.sin(th1a), m.cos(th2a), m.sin(th2a), g)
    e11, e12, e13, e22, e23, e33 = entries
    e11, e12, e13 = e11 / determinant, e12 / determinant, e13 / determinant
    e22, e23, e33 = e22 / determinant, e23 / determinant, e33 / determinant
    ax, ay, az = (x1 * e11 + x2 * e12 + x3 * e13, y1 * e11 + y2 * e12 + y3 * e13,
                  z1 * e11 + z2 * e12 + z3 * e13)
    bx, by, bz = (x1 * e12 + x2 * e22 + x3 * e23, y1 * e12 + y2 * e22 + y3 * e23,
                  z1 * e12 + z2 * e22 + z3 * e23)
    cx, cy, cz = (x1 * e13 + x2 * e23 + x3 * e33, y1 * e13 + y2 * e23 + y3 * e33,
                  z1 * e13 + z2 * e23 + z3 * e33)
    xy, xz = y1 * ax + y2 * bx + y3 * cx, z1 * ax + z2 * bx + z3 * cx
    yz = z1 * ay + z2 * by + z3 * cy
    covariance = (x1 * ax + x2 * bx + x3 * cx, xy, xz, xy, y1 * ay + y2 * by + y3 * cy, yz,
                  xz, yz, z1 * az + z2 * bz + z3 * cz)
    return covariance, ((ax, ay, az), (bx, by, bz), (cx, cy, cz))
