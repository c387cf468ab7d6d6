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

from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import FEWEST_USED, UsedSensors
from spm_haptic_master.kinematics.leg_kernels import (
    common_turn,
    Linkage,
    linkage,
    passive_axes,
    Turn,
    turn_equation,
    turn_through_link,
    View,
)
from spm_haptic_master.kinematics.number_backends import Backend, FLOATS, N, Rotation, Vector

TURN = 2.0 * math.pi
State: TypeAlias = tuple[N, N, N, N, N]
# Correction of a leg's active angle (rad), its rates along th1A, th2A, th3A (unit 1), and B_kk.
Closure: TypeAlias = tuple[N, N, N, N, N]
Legs: TypeAlias = tuple[Closure[N], Closure[N]]
# Residual (rad), rates along th1A, th2A, th3A (unit 1) and weight (1 / rad^2) of a sensor.
Row: TypeAlias = tuple[N, N, N, N, float]
# Cosines and sines of th1A, th2A and th3A (unit 1).
Turns: TypeAlias = tuple[Turn[N], Turn[N], Turn[N]]
# The row of a sensor that is left out; closure of a leg without a sensor, and that row.
NO_ROW = 0.0, 0.0, 0.0, 0.0, 0.0
NO_LEG = NO_ROW, NO_ROW
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
    closure_b, row_b = (
        closed_leg(
            turns,
            leg_b,
            g,
            1,
            readings[4] if weight_3b else None,
            weight_3b,
            m,
        )
        if weight_b or weight_3b
        else NO_LEG
    )
    closure_c, row_c = (
        closed_leg(
            turns,
            leg_c,
            g,
            2,
            readings[5] if weight_3c else None,
            weight_3c,
            m,
        )
        if weight_c or weight_3c
        else NO_LEG
    )
    left_b, b1, b2, b3, _ = closure_b
    left_c, d1, d2, d3, _ = closure_c
    rows = (
        (readings[0] - th1a, 1.0, 0.0, 0.0, weight_a),
        (readings[1] - th1b + left_b, b1, b2, b3, weight_b),
        (readings[2] - th1c + left_c, d1, d2, d3, weight_c),
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
) -> tuple[Closure[N], Row[N]]:
    """
    Linearise leg B (`place` 1) or C (2): its closure, and the row of a sensor on its third joint.

    `reading` is the sensor's, rad; None for a sensor that is left out.
    """
    (c1, s1), (c2, s2), (c3, s3) = turns
    (dx, dy, dz), (vx, vy, vz), cos_beta = view
    carrier, carried = g.legs[0], g.carried[place - 1]
    ux, uy, uz = turn_through_link(c1, -s1, carried.first)
    # Z1A, and Z1k and Z2k from before leg A's second joint to after it.
    ax, ay, az = carrier.sin_alpha * s2, carrier.sin_alpha * c2, carrier.cos_alpha
    dx, dy, ux, uy = c2 * dx + s2 * dy, c2 * dy - s2 * dx, c2 * ux + s2 * uy, c2 * uy - s2 * ux
    # A turn of the platform about a unit axis changes Z2k . Z3k at the rate axis . (Z3k x Z2k).
    x, y, z = vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx
    # Along the leg's own active angle it changes at the rate B_kk = -Z1k . (Z3k x Z2k).
    along = ux * x + uy * y + uz * z
    reciprocal = m.mode_reciprocal(along)
    left = -(dx * vx + dy * vy + dz * vz - cos_beta) * reciprocal
    closure = (
        left,
        (ax * x + ay * y + az * z) * reciprocal,
        z * reciprocal,
        (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal,
        -along,
    )
    if reading is None:
        return closure, NO_ROW
    # Z2k is (sin beta sin th3k, sin beta cos th3k, cos beta) in the frame Q_k of the platform.
    # As turn_through_link(c3, s3, carried.zero) does, without its call.
    zx, zy, cx, cy, sz, sx, sy, cz = carried.zero
    ex, ey, ez = c3 * zx - s3 * zy, s3 * cx + c3 * cy - sz, s3 * sx + c3 * sy + cz
    sine, cosine = ex * dx + ey * dy + ez * dz, -(ex * x + ey * y + ez * z)
    angle = m.remainder(reading - m.atan2(sine, cosine), TURN)
    # A turn of Z2k about Z1k alone changes th3k at the rate (Z2k x Z3k).(Z1k x Z2k) / sin^2 beta.
    leg = g.legs[place]
    rate = (leg.cos_alpha * leg.cos_beta - vx * ux - vy * uy - vz * uz) / (
        leg.sin_beta * leg.sin_beta
    )
    # A turn of the platform changes it at the rate axis . (Z1k x Z2k) / B_kk.
    x, y, z = dy * uz - dz * uy, dz * ux - dx * uz, dx * uy - dy * ux
    return closure, (
        angle + rate * left,
        (ax * x + ay * y + az * z) * reciprocal,
        z * reciprocal,
        (carrier.cos_beta * z - carrier.sin_beta * y) * reciprocal,
        weight,
    )


def normal_equations(rows: tuple[Row[N], ...]) -> tuple[Vector[N], Symmetric[N], N, N]:
    """
    Return right side (1 / rad), inverse times determinant (1 / rad^4), determinant, and a bound.

    That is the product of the diagonal (1 / rad^6): where the determinant is far smaller, the
    sensors do not measure every direction.
    """
    (left_a, _, _, _, weight_a), row_b, row_c, (left_3, _, _, _, weight_3), *further = rows
    # th1A and th3A are coordinates themselves.
    zero: N = 0.0
    n11, n12, n13 = zero + weight_a, zero, zero
    n22, n23, n33 = zero, zero, zero + weight_3
    y1, y2, y3 = weight_a * left_a, zero, zero
    for residual, x, y, z, weight in (row_b, row_c, *further):
        wx, wy, wz = weight * x, weight * y, weight * z
        n11, n12, n13 = n11 + wx * x, n12 + wy * x, n13 + wz * x
        n22, n23, n33 = n22 + wy * y, n23 + wz * y, n33 + wz * z
        y1, y2, y3 = y1 + wx * residual, y2 + wy * residual, y3 + wz * residual
    y3 = y3 + weight_3 * left_3
    e11, e12, e13 = n22 * n33 - n23 * n23, n13 * n23 - n12 * n33, n12 * n23 - n13 * n22
    e22, e23, e33 = n11 * n33 - n13 * n13, n12 * n13 - n11 * n23, n11 * n22 - n12 * n12
    return (
        (y1, y2, y3),
        (e11, e12, e13, e22, e23, e33),
        n11 * e11 + n12 * e12 + n13 * e13,
        n11 * n22 * n33,
    )


def gauss_newton_step(
    right: Vector[N], legs: Legs[N], entries: Symmetric[N], determinant: N
) -> tuple[State[N], Symmetric[N]]:
    """
    Return the step of the state, rad, and the covariance of th1A, th2A, th3A, rad^2.

    In the step th1B and th1C follow so that their legs close.
    """
    (fb, b1, b2, b3, _), (fc, c1, c2, c3, _) = legs
    e11, e12, e13, e22, e23, e33 = entries
    y1, y2, y3 = right
    p11, p12, p13 = e11 / determinant, e12 / determinant, e13 / determinant
    p22, p23, p33 = e22 / determinant, e23 / determinant, e33 / determinant
    d1 = p11 * y1 + p12 * y2 + p13 * y3
    d2 = p12 * y1 + p22 * y2 + p23 * y3
    d3 = p13 * y1 + p23 * y2 + p33 * y3
    return (
        (d1, d2, d3, b1 * d1 + b2 * d2 + b3 * d3 - fb, c1 * d1 + c2 * d2 + c3 * d3 - fc),
        (p11, p12, p13, p22, p23, p33),
    )


def in_base_frame(
    th1a: N,
    th2a: N,
    covariance: Symmetric[N],
    g: Geometry,
    m: Backend[N],
) -> tuple[Rotation[N], Motions[N]]:
    """Covariance of the rotation error in the base frame, and with errors of th1A, th2A, th3A."""
    # The platform turns about Z1A, Z2A and Z3A.
    x1, y1, z1 = g.legs[0].first
    (x2, y2, z2), (x3, y3, z3) = passive_axes(
        m.cos(th1a), m.sin(th1a), m.cos(th2a), m.sin(th2a), g
    )
    p11, p12, p13, p22, p23, p33 = covariance
    ax, ay, az = (
        x1 * p11 + x2 * p12 + x3 * p13,
        y1 * p11 + y2 * p12 + y3 * p13,
        z1 * p11 + z2 * p12 + z3 * p13,
    )
    bx, by, bz = (
        x1 * p12 + x2 * p22 + x3 * p23,
        y1 * p12 + y2 * p22 + y3 * p23,
        z1 * p12 + z2 * p22 + z3 * p23,
    )
    cx, cy, cz = (
        x1 * p13 + x2 * p23 + x3 * p33,
        y1 * p13 + y2 * p23 + y3 * p33,
        z1 * p13 + z2 * p23 + z3 * p33,
    )
    xy, xz = y1 * ax + y2 * bx + y3 * cx, z1 * ax + z2 * bx + z3 * cx
    yz = z1 * ay + z2 * by + z3 * cy
    return (
        x1 * ax + x2 * bx + x3 * cx,
        xy,
        xz,
        xy,
        y1 * ay + y2 * by + y3 * cy,
        yz,
        xz,
        yz,
        z1 * az + z2 * bz + z3 * cz,
    ), ((ax, ay, az), (bx, by, bz), (cx, cy, cz))


def parities(
    rows: tuple[Row[N], ...], sensors: UsedSensors, covariance: Symmetric[N], m: Backend[N]
) -> tuple[tuple[N, ...], tuple[ParityRow[N], ...]]:
    """Parity vector, and its changes with the readings; 0 where only rounding makes them."""
    if sensors.count == FEWEST_USED:
        return (), ()
    places = sensors.used
    p11, p12, p13, p22, p23, p33 = covariance
    lines: list[list[N]] = []
    # Backwards: the covariance is of all sensors, then without the last, and so on.
    for index in range(sensors.count - 1, 3, -1):
        place = places[index]
        _, x, y, z, weight = rows[place]
        g1, g2, g3 = (
            p11 * x + p12 * y + p13 * z,
            p12 * x + p22 * y + p23 * z,
            p13 * x + p23 * y + p33 * z,
        )
        # The variance of the sensor's residual in the fit, which it has drawn, over its own.
        share = 1.0 - weight * (x * g1 + y * g2 + z * g3)
        size = m.reciprocal_root(share, NO_SHARE) / sensors.sigma[place]
        line: list[N] = [0.0] * len(rows)
        for before in places[:index]:
            _, x, y, z, weight = rows[before]
            line[before] = -size * weight * (x * g1 + y * g2 + z * g3)
        line[place] = size * share
        lines.append(line)
        size = size * size
        h1, h2, h3 = size * g1, size * g2, size * g3
        p11, p12, p13 = p11 + h1 * g1, p12 + h1 * g2, p13 + h1 * g3
        p22, p23, p33 = p22 + h2 * g2, p23 + h2 * g3, p33 + h3 * g3
    # The one combination of the first four residuals that no motion of the platform changes.
    p, q, r, s = (rows[place][1:4] for place in places[:4])
    parts = -_volume(q, r, s), _volume(p, r, s), -_volume(p, q, s), _volume(p, q, r)
    variance: N = 0.0
    for part, place in zip(parts, places[:4], strict=True):
        variance = variance + part * part / sensors.weights[place]
    scale = m.reciprocal_root(variance, 0.0)
    line = [0.0] * len(rows)
    for part, place in zip(parts, places[:4], strict=True):
        line[place] = scale * part
    lines.append(line)
    vector: list[N] = []
    for line in reversed(lines):
        parity: N = 0.0
        for part, row in zip(line, rows, strict=True):
            parity = parity + part * row[0]
        vector.append(parity)
    return tuple(vector), tuple(map(tuple, reversed(lines)))


def _volume(p: Vector[N], q: Vector[N], r: Vector[N]) -> N:
    """Return the determinant of three rows."""
    p1, p2, p3 = p
    q1, q2, q3 = q
    r1, r2, r3 = r
    return p1 * (q2 * r3 - q3 * r2) + p2 * (q3 * r1 - q1 * r3) + p3 * (q1 * r2 - q2 * r1)


def theta3a_gains(
    th1a: float, th1b: float, th1c: float, th3a: float, geometry: Geometry
) -> tuple[Vector[float], ...]:
    """
    Gains of Case 2: rotation vectors in the base frame, rad per rad of th1A, th1B, th1C, th3A.

    The closed form weighs the closures of legs B and C by their terms N1 and N2, not by the noise
    of their sensors, so that its gains are not those of the estimate. SingularityError if the
    closures do not determine th2A, or a leg is on the boundary of its working mode.
    """
    turn_1, turn_3, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, geometry, FLOATS)
    first, second = turn_equation(*leg_b), turn_equation(*leg_c)
    cosine, sine, determinant = common_turn(first, second)
    th2a = math.atan2(sine * determinant, cosine * determinant)
    c2, s2 = math.cos(th2a), math.sin(th2a)
    (_, b1, b2, b3, _), (_, d1, d2, d3, _) = (
        closed_leg((turn_1, (c2, s2), turn_3), view, geometry, place, None, 0.0, FLOATS)[0]
        for place, view in ((1, leg_b), (2, leg_c))
    )
    if b2 == 0.0 or d2 == 0.0 or determinant == 0.0:
        raise SingularityError('the closures of legs B and C do not determine th2A')
    # Share of leg B's closure in th2A, of the linear system's solution at consistent readings.
    (l1, m1, n1), (l2, m2, n2) = first, second
    share_b = n2 * (l1 * s2 - m1 * c2)
    share_c = n1 * (m2 * c2 - l2 * s2)
    share_b, share_c = share_b / (share_b + share_c), share_c / (share_b + share_c)
    along = (
        -share_b * b1 / b2 - share_c * d1 / d2,
        share_b / b2,
        share_c / d2,
        -share_b * b3 / b2 - share_c * d3 / d2,
    )
    (x2, y2, z2), (x3, y3, z3) = passive_axes(*turn_1, c2, s2, geometry)
    x1, y1, z1 = geometry.legs[0].first
    gains = [(each * x2, each * y2, each * z2) for each in along]
    (xa, ya, za), (xe, ye, ze) = gains[0], gains[3]
    return (xa + x1, ya + y1, za + z1), gains[1], gains[2], (xe + x3, ye + y3, ze + z3)
