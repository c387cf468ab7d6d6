# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Residuals, rates, normal equations and parity vector of one joint sample: kernels of estimates.

State: the fitted th1A, th2A, th3A, th1B, th1C, rad. Leg A's chain carries the platform: its joints
are coordinates of the orientation. The legs B and C add their closures. A sensor's row has its
residual and its rates along th1A, th2A, th3A, with the closure of its own leg kept. A symmetric
matrix is 11, 12, 13, 22, 23, 33.

The parity vector is U^T r of the whitened residuals r, with an orthonormal U whose columns no
motion of the platform reaches: U^T H = 0 with the whitened Jacobian H, and U U^T = P = I - H K.
Its first entry is the parity of the first four sensors in use. Each further one is the difference
of the next sensor from the estimate of those before it, over its standard deviation.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.joints import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    Linkage,
    passive_axes,
    Turn,
    turn_through_link,
    View,
)
from spm_haptic_master.kinematics.number_backends import Backend, N, Rotation, Vector
from spm_haptic_master.kinematics.vectors import about_z, cross, dot

TURN = 2.0 * math.pi
State: TypeAlias = tuple[N, N, N, N, N]
# Correction of a leg's active angle (rad), its rates along th1A, th2A, th3A (unit 1), and B_kk.
ClosureRow: TypeAlias = tuple[N, N, N, N, N]
Legs: TypeAlias = tuple[ClosureRow[N], ClosureRow[N]]
# Residual (rad), rates along th1A, th2A, th3A (unit 1) and weight (1 / rad^2) of a sensor.
Row: TypeAlias = tuple[N, N, N, N, float]
# Cosines and sines of th1A, th2A and th3A (unit 1).
Turns: TypeAlias = tuple[Turn[N], Turn[N], Turn[N]]
# The row of a sensor that is left out, and that of the closure of a leg without a sensor.
NO_ROW = 0.0, 0.0, 0.0, 0.0, 0.0
Symmetric: TypeAlias = tuple[N, N, N, N, N, N]
# Covariance of the rotation error with the errors of th1A, th2A, th3A, rad^2.
Motions: TypeAlias = tuple[Vector[N], Vector[N], Vector[N]]
# Change of a parity with the readings of the N mounted sensors (1 / rad).
ParityRow: TypeAlias = tuple[N, ...]
# Largest share of a sensor's variance in its residual that counts as zero (unit 1): the difference
# of two numbers of size 1 and of rounding. The others do not check such a sensor.
NO_SHARE = 1e-12


def linearise(
    state: State[N],
    view: Linkage[N],
    readings: tuple[N, ...],
    sensors: UsedSensors,
    g: Geometry,
    m: Backend[N],
) -> tuple[Legs[N], tuple[Row[N], ...]]:
    """
    Linearise the legs B and C and the N mounted sensors at a state with its `linkage`.

    A leg's correction is its fitted active angle less the one that closes it, with the rates of
    that; zeros for a leg without a sensor in use. A residual is reading less prediction, the
    weight 0 for a sensor that is left out.
    """
    th1a, th2a, th3a, th1b, th1c = state
    turn_1, turn_3, leg_b, leg_c = view
    weight_a, weight_b, weight_c, weight_3, weight_3b, weight_3c = sensors.weights
    turns = turn_1, (m.cos(th2a), m.sin(th2a)), turn_3
    closure_b: ClosureRow[N] = NO_ROW
    closure_c: ClosureRow[N] = NO_ROW
    row_b: Row[N] = NO_ROW
    row_c: Row[N] = NO_ROW
    if weight_b or weight_3b:
        reading_b = readings[4] if weight_3b else None
        closure_b, row_b = closed_leg(turns, leg_b, g, 1, reading_b, weight_3b, m)
    if weight_c or weight_3c:
        reading_c = readings[5] if weight_3c else None
        closure_c, row_c = closed_leg(turns, leg_c, g, 2, reading_c, weight_3c, m)
    correction_b, b1, b2, b3, _ = closure_b
    correction_c, c1, c2, c3, _ = closure_c
    rows = (
        (readings[0] - th1a, 1.0, 0.0, 0.0, weight_a),
        (readings[1] - th1b + correction_b, b1, b2, b3, weight_b),
        (readings[2] - th1c + correction_c, c1, c2, c3, weight_c),
        (readings[3] - th3a, 0.0, 0.0, 1.0, weight_3),
        row_b,
        row_c,
    )
    return (closure_b, closure_c), rows[: 4 + sensors.further]


def closed_leg(
    turns: Turns[N],
    view: View[N],
    g: Geometry,
    place: int,
    reading: N | None,
    weight: float,
    m: Backend[N],
) -> tuple[ClosureRow[N], Row[N]]:
    """
    Linearise leg B (`place` 1) or C (2): its closure, and the row of a sensor on its third joint.

    `reading` is the sensor's, rad; None for a sensor that is left out. All axes are in the frame
    behind leg A's second joint.
    """
    (c1, s1), (c2, s2), turn_3 = turns
    second_before, third, cos_beta = view
    carrier = g.legs[0]
    carried = g.carried[place - 1]
    carrier_first = carrier.sin_alpha * s2, carrier.sin_alpha * c2, carrier.cos_alpha
    first = about_z(c2, -s2, turn_through_link(c1, -s1, carried.first))
    second = about_z(c2, -s2, second_before)
    # A turn of the platform about a unit axis changes Z2k . Z3k at the rate axis . (Z3k x Z2k).
    moment: Vector[N] = cross(third, second)
    # Along the leg's own active angle it changes at the rate B_kk = -Z1k . (Z3k x Z2k).
    along = dot(first, moment)
    reciprocal = m.mode_reciprocal(along)
    correction = (cos_beta - dot(second, third)) * reciprocal
    active_1, active_2, active_3 = _rates(moment, reciprocal, carrier_first, carrier)
    closure: ClosureRow[N] = correction, active_1, active_2, active_3, -along
    if reading is None:
        return closure, NO_ROW
    # Z2k is (sin beta sin th3k, sin beta cos th3k, cos beta) in the frame Q_k of the platform.
    c3, s3 = turn_3
    zero = turn_through_link(c3, s3, carried.zero)
    th3 = m.atan2(dot(zero, second), -dot(zero, moment))
    # A turn of the platform changes th3k at the rate axis . (Z2k x Z1k) / Z1k . (Z3k x Z2k).
    third_1, third_2, third_3 = _rates(cross(second, first), reciprocal, carrier_first, carrier)
    # th3k follows th1k, which the closure corrects.
    follows = _rate_of_third(first, third, g.legs[place]) * correction
    residual = m.remainder(reading - th3, TURN) + follows
    return closure, (residual, third_1, third_2, third_3, weight)


def _rates(
    moment: Vector[N],
    reciprocal: N,
    carrier_first: Vector[N],
    carrier: Leg,
) -> Vector[N]:
    """
    Return the rates of an angle along th1A, th2A, th3A (unit 1).

    A turn of the platform about a unit axis changes the angle at the rate
    axis . moment / B_kk; the platform turns about Z1A, Z2A = z and Z3A.
    """
    _, y, z = moment
    return (
        dot(carrier_first, moment) * reciprocal,
        z * reciprocal,
        (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal,
    )


def _rate_of_third(
    first: Vector[N],
    third: Vector[N],
    leg: Leg,
) -> N:
    """Return the rate of th3k along th1k alone: (Z2k x Z3k) . (Z1k x Z2k) / sin^2 beta."""
    product = leg.cos_alpha * leg.cos_beta - dot(third, first)
    return product / (leg.sin_beta * leg.sin_beta)


def normal_equations(rows: tuple[Row[N], ...]) -> tuple[Vector[N], Symmetric[N], N, N]:
    """
    Return right side (1 / rad), adjugate (1 / rad^4), determinant and diagonal (1 / rad^6).

    The inverse of the normal matrix is its adjugate over the determinant. The last number is the
    product of the diagonal: where the determinant is far smaller, the sensors do not measure every
    direction.
    """
    row_a, row_b, row_c, row_3, *further = rows
    # Normal matrix n = H^T W H and right side y = H^T W r of the rows H, weights W, residuals r.
    # th1A and th3A are coordinates themselves.
    residual_a, _, _, _, weight_a = row_a
    residual_3, _, _, _, weight_3 = row_3
    zero: N = 0.0
    n11 = zero + weight_a
    n12 = zero
    n13 = zero
    n22 = zero
    n23 = zero
    n33 = zero + weight_3
    y1 = weight_a * residual_a
    y2 = zero
    y3 = zero
    for residual, x, y, z, weight in (row_b, row_c, *further):
        wx = weight * x
        wy = weight * y
        wz = weight * z
        n11 = n11 + wx * x
        n12 = n12 + wy * x
        n13 = n13 + wz * x
        n22 = n22 + wy * y
        n23 = n23 + wz * y
        n33 = n33 + wz * z
        y1 = y1 + wx * residual
        y2 = y2 + wy * residual
        y3 = y3 + wz * residual
    y3 = y3 + weight_3 * residual_3
    # The adjugate has the cofactors of the symmetric matrix.
    e11 = n22 * n33 - n23 * n23
    e12 = n13 * n23 - n12 * n33
    e13 = n12 * n23 - n13 * n22
    e22 = n11 * n33 - n13 * n13
    e23 = n12 * n13 - n11 * n23
    e33 = n11 * n22 - n12 * n12
    determinant = n11 * e11 + n12 * e12 + n13 * e13
    diagonal = n11 * n22 * n33
    return (y1, y2, y3), (e11, e12, e13, e22, e23, e33), determinant, diagonal


def gauss_newton_step(
    right: Vector[N],
    legs: Legs[N],
    adjugate: Symmetric[N],
    determinant: N,
) -> tuple[State[N], Symmetric[N]]:
    """
    Return the step of the state, rad, and the covariance of th1A, th2A, th3A, rad^2.

    In the step th1B and th1C follow so that their legs close.
    """
    (correction_b, b1, b2, b3, _), (correction_c, c1, c2, c3, _) = legs
    e11, e12, e13, e22, e23, e33 = adjugate
    y1, y2, y3 = right
    p11 = e11 / determinant
    p12 = e12 / determinant
    p13 = e13 / determinant
    p22 = e22 / determinant
    p23 = e23 / determinant
    p33 = e33 / determinant
    d1 = p11 * y1 + p12 * y2 + p13 * y3
    d2 = p12 * y1 + p22 * y2 + p23 * y3
    d3 = p13 * y1 + p23 * y2 + p33 * y3
    db = b1 * d1 + b2 * d2 + b3 * d3 - correction_b
    dc = c1 * d1 + c2 * d2 + c3 * d3 - correction_c
    return (d1, d2, d3, db, dc), (p11, p12, p13, p22, p23, p33)


def in_base_frame(
    th1a: N,
    th2a: N,
    covariance: Symmetric[N],
    g: Geometry,
    m: Backend[N],
) -> tuple[Rotation[N], Motions[N]]:
    """
    Return the covariance of the rotation error in the base frame, rad^2.

    And its covariance with the errors of th1A, th2A, th3A, of which `covariance` is given, rad^2.
    """
    cosine_1 = m.cos(th1a)
    sine_1 = m.sin(th1a)
    # The platform turns about Z1A, Z2A and Z3A: u, v and w.
    ux, uy, uz = g.legs[0].first
    (vx, vy, vz), (wx, wy, wz) = passive_axes(cosine_1, sine_1, m.cos(th2a), m.sin(th2a), g)
    p11, p12, p13, p22, p23, p33 = covariance
    ax = ux * p11 + vx * p12 + wx * p13
    ay = uy * p11 + vy * p12 + wy * p13
    az = uz * p11 + vz * p12 + wz * p13
    bx = ux * p12 + vx * p22 + wx * p23
    by = uy * p12 + vy * p22 + wy * p23
    bz = uz * p12 + vz * p22 + wz * p23
    cx = ux * p13 + vx * p23 + wx * p33
    cy = uy * p13 + vy * p23 + wy * p33
    cz = uz * p13 + vz * p23 + wz * p33
    # The axes times the motions a, b and c; the product is symmetrical.
    xx = ux * ax + vx * bx + wx * cx
    xy = uy * ax + vy * bx + wy * cx
    xz = uz * ax + vz * bx + wz * cx
    yy = uy * ay + vy * by + wy * cy
    yz = uz * ay + vz * by + wz * cy
    zz = uz * az + vz * bz + wz * cz
    motions = (ax, ay, az), (bx, by, bz), (cx, cy, cz)
    return (xx, xy, xz, xy, yy, yz, xz, yz, zz), motions


def parities(
    rows: tuple[Row[N], ...],
    sensors: UsedSensors,
    covariance: Symmetric[N],
    m: Backend[N],
) -> tuple[tuple[N, ...], tuple[ParityRow[N], ...]]:
    """
    Return the parity vector, and its changes with the readings; 0 where only rounding makes them.

    Parameters
    ----------
    rows : tuple of Row
        Of the N mounted sensors, by `linearise`.
    sensors : UsedSensors
        Which are in use; with three there is no parity.
    covariance : Symmetric
        Of th1A, th2A, th3A from all sensors in use, rad^2.
    m : Backend
        Elementary functions.

    Returns
    -------
    vector : tuple of number
        Parities of unit variance: the first of four sensors, each further one of one more.
    changes : tuple of ParityRow
        Change of each parity with the N readings, 1 / rad.

    """
    if sensors.count == FEWEST_USED:
        return (), ()
    changes = []
    # Backwards: the covariance is of all sensors, then without the last, and so on.
    for index in range(sensors.count - 1, FEWEST_USED, -1):
        change, covariance = _comparison(rows, sensors, index, covariance, m)
        changes.append(change)
    changes.append(_parity_of_four(rows, sensors, m))
    changes.reverse()
    return tuple([_parity(change, rows) for change in changes]), tuple(changes)


def _comparison(
    rows: tuple[Row[N], ...],
    sensors: UsedSensors,
    index: int,
    covariance: Symmetric[N],
    m: Backend[N],
) -> tuple[ParityRow[N], Symmetric[N]]:
    """
    Compare one sensor in use with the estimate of those before it.

    Return the change of that parity with the readings, and the covariance without the sensor.
    """
    places = sensors.used
    place = places[index]
    p11, p12, p13, p22, p23, p33 = covariance
    _, x, y, z, weight = rows[place]
    gain = (
        p11 * x + p12 * y + p13 * z,
        p12 * x + p22 * y + p23 * z,
        p13 * x + p23 * y + p33 * z,
    )
    # Variance of the sensor's residual in the fit, which the sensor has drawn to it, over its own.
    share = 1.0 - weight * dot((x, y, z), gain)
    size = m.reciprocal_root(share, NO_SHARE) / sensors.sigma[place]
    changes: list[N] = [0.0] * len(rows)
    for before in places[:index]:
        _, rate_1, rate_2, rate_3, own_weight = rows[before]
        changes[before] = -size * own_weight * dot((rate_1, rate_2, rate_3), gain)
    changes[place] = size * share
    # The covariance without the sensor is P + size^2 gain gain^T.
    g1, g2, g3 = gain
    h1 = size * size * g1
    h2 = size * size * g2
    h3 = size * size * g3
    without = (
        p11 + h1 * g1,
        p12 + h1 * g2,
        p13 + h1 * g3,
        p22 + h2 * g2,
        p23 + h2 * g3,
        p33 + h3 * g3,
    )
    return tuple(changes), without


def _parity_of_four(
    rows: tuple[Row[N], ...],
    sensors: UsedSensors,
    m: Backend[N],
) -> ParityRow[N]:
    """
    Return the change, with the readings, of the parity of the first four sensors in use.

    It is the one combination of their residuals that no motion of the platform changes.
    """
    place_p, place_q, place_r, place_s = sensors.used[:4]
    p = rows[place_p][1:4]
    q = rows[place_q][1:4]
    r = rows[place_r][1:4]
    s = rows[place_s][1:4]
    first = cross(p, q)
    last = cross(r, s)
    part_p = -dot(q, last)
    part_q = dot(p, last)
    part_r = -dot(s, first)
    part_s = dot(r, first)
    weights = sensors.weights
    scale = m.reciprocal_root(
        part_p * part_p / weights[place_p]
        + part_q * part_q / weights[place_q]
        + part_r * part_r / weights[place_r]
        + part_s * part_s / weights[place_s],
        0.0,
    )
    changes: list[N] = [0.0] * len(rows)
    changes[place_p] = scale * part_p
    changes[place_q] = scale * part_q
    changes[place_r] = scale * part_r
    changes[place_s] = scale * part_s
    return tuple(changes)


def _parity(changes: ParityRow[N], rows: tuple[Row[N], ...]) -> N:
    """Return a parity from its changes with the readings, and the residuals."""
    parity: N = 0.0
    for change, row in zip(changes, rows, strict=True):
        parity = parity + change * row[0]
    return parity
