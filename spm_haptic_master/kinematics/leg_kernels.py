# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The formulas of one leg and of the closed chain, as kernels on numbers.

The symbols are the paper's: docs/kinematics.md has their table, `geometry` the frames B_k, Q_k.
Angles are in rad. `m` holds the elementary functions (see `number_backends`), `g` is the Geometry,
`leg` one of its legs, and `carried` leg B or C as seen from leg A.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from spm_haptic_master.kinematics.geometry import Carried, Geometry, Leg, LinkTurn
from spm_haptic_master.kinematics.number_backends import Backend, N, Quaternion, Rotation, Vector

# Axes of leg B or C in the frame of leg A's second joint: Z2k before th2A, Z3k after it; and the
# cosine of the leg's beta (unit 1).
View: TypeAlias = tuple[Vector[N], Vector[N], float]
# Cosine and sine of an angle (unit 1).
Turn: TypeAlias = tuple[N, N]
# Turns of th1A and th3A, and the legs B and C.
Linkage: TypeAlias = tuple[Turn[N], Turn[N], View[N], View[N]]


def second_axis(c: N, s: N, leg: Leg) -> Vector[N]:
    """Z2k in the base frame from cosine and sine of th1k: B_k Rz(th1k) Rx(alpha_k) z."""
    (px, py, pz), (qx, qy, qz), (rx, ry, rz) = leg.second
    return px + c * qx + s * rx, py + c * qy + s * ry, pz + c * qz + s * rz


def third_axes(rotation: Rotation[N], g: Geometry) -> list[Vector[N]]:
    """Z3A, Z3B, Z3C in the base frame, for a platform at `rotation`."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    return [
        (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z)
        for x, y, z in g.platform_axes
    ]


def leg_angles(rotation: Rotation[N], leg: Leg, sign: int, m: Backend[N]) -> Vector[N]:
    """
    Kernel of one leg: th1k, th2k, th3k, rad, of a rotation; `sign` is its working mode.

    With Z3k = (x, y, z) in the leg's frame B_k, Z2k . Z3k = cos beta is
    x sin th1 - y cos th1 = q. With x cos th1 + y sin th1 = p, B_kk = p sin alpha: the working
    mode is the sign of p, and p^2 + q^2 = x^2 + y^2.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    px, py, pz = leg.third
    x, y, z = (
        r00 * px + r01 * py + r02 * pz,
        r10 * px + r11 * py + r12 * pz,
        r20 * px + r21 * py + r22 * pz,
    )
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = leg.base_frame
    x, y, z = (
        b00 * x + b10 * y + b20 * z,
        b01 * x + b11 * y + b21 * z,
        b02 * x + b12 * y + b22 * z,
    )
    q = (leg.cos_beta - leg.cos_alpha * z) / leg.sin_alpha
    p = sign * m.reach_root(x * x + y * y - q * q)
    th1 = m.atan2(q * x + p * y, p * x - q * y)
    th2 = m.atan2(p, leg.cos_alpha * q - leg.sin_alpha * z)
    # Z2k in the frame Q_k of the platform is (sin beta sin th3, sin beta cos th3, cos beta).
    x2, y2, z2 = second_axis(m.cos(th1), m.sin(th1), leg)
    x, y, z = (
        x2 * r00 + y2 * r10 + z2 * r20,
        x2 * r01 + y2 * r11 + z2 * r21,
        x2 * r02 + y2 * r12 + z2 * r22,
    )
    q00, q01, _, q10, q11, _, q20, q21, _ = leg.platform_frame
    return th1, th2, m.atan2(q00 * x + q10 * y + q20 * z, q01 * x + q11 * y + q21 * z)


def turn_equation(d: Vector[N], v: Vector[N], cos_beta: float) -> Vector[N]:
    """
    Coefficients L, M, N of  L cos t + M sin t + N = 0,  that is  d . Rz(t) v = cos beta.

    With t = th2A or th3A this is the input-output equation of a spherical four-bar linkage, the
    paper's eqs. 1, 2 and 15.
    """
    dx, dy, dz = d
    vx, vy, vz = v
    return dx * vx + dy * vy, dy * vx - dx * vy, dz * vz - cos_beta


def common_turn(first: Vector[N], second: Vector[N]) -> Vector[N]:
    """
    Solve two turn equations linearly, eq. 3: cosine and sine of t, each times the determinant.

    They are M1 N2 - M2 N1 and -(L1 N2 - L2 N1), the determinant L1 M2 - L2 M1.
    """
    l1, m1, n1 = first
    l2, m2, n2 = second
    return m1 * n2 - m2 * n1, l2 * n1 - l1 * n2, l1 * m2 - l2 * m1


def both_turns(equation: Vector[float]) -> tuple[float, float]:
    """Both solutions t, rad, of one turn equation; without any, twice the t of least error."""
    cosine, sine, constant = equation
    size = math.hypot(cosine, sine)
    middle = math.atan2(sine, cosine)
    half = math.acos(max(-1.0, min(1.0, -constant / size))) if size > 0.0 else 0.5 * math.pi
    return middle - half, middle + half


def turn_through_link(c: N, s: N, axis: LinkTurn) -> Vector[N]:
    """Rx(link) Rz(t) axis, from cosine and sine of t."""
    x, y, cx, cy, sz, sx, sy, cz = axis
    return c * x - s * y, s * cx + c * cy - sz, s * sx + c * sy + cz


def second_in_second_joint(c1: N, s1: N, c: N, s: N, carried: Carried) -> Vector[N]:
    """Z2k after leg A's proximal link, from cosines and sines of th1A and th1k."""
    px, py, pz, qx, qy, qz, rx, ry, rz, cos_alpha, sin_alpha = carried.second
    x, y, z = px + c * qx + s * rx, py + c * qy + s * ry, pz + c * qz + s * rz
    y1 = c1 * y - s1 * x
    return c1 * x + s1 * y, cos_alpha * y1 + sin_alpha * z, cos_alpha * z - sin_alpha * y1


def into_third_joint(c: N, s: N, axis: Vector[N], g: Geometry) -> Vector[N]:
    """Components, after leg A's distal link, of a vector before it: Rx(-beta) Rz(-th2A) axis."""
    leg = g.legs[0]
    x, y, z = into_second_link(c, s, axis)
    return x, leg.cos_beta * y + leg.sin_beta * z, leg.cos_beta * z - leg.sin_beta * y


def into_second_link(c: N, s: N, axis: Vector[N]) -> Vector[N]:
    """Components, after leg A's second joint, of a vector before it: Rz(-th2A) axis."""
    x, y, z = axis
    return c * x + s * y, c * y - s * x, z


def chain_quaternion(th1a: N, th2a: N, th3a: N, g: Geometry, m: Backend[N]) -> Quaternion[N]:
    """Quaternion of leg A's chain, eq. 6, from its three joint angles in rad."""
    return half_chain_quaternion(th1a, m.cos(0.5 * th2a), m.sin(0.5 * th2a), th3a, g, m)


def half_chain_quaternion(
    th1a: N, c: N, s: N, th3a: N, g: Geometry, m: Backend[N]
) -> Quaternion[N]:
    """
    Quaternion of leg A's chain, eq. 6, from th1A, cosine and sine of half of th2A, and th3A.

    The quaternion of Rx(alpha) Rz(th2A) Rx(beta) comes first. A turn about z on either side then
    rotates the pairs (w, z) and (x, y) like complex numbers. The outer frames B_A and Q_A come
    last, as one matrix.
    """
    cos_sum, sin_sum, cos_difference, sin_difference = g.half_angles
    x, y, z, w = c * sin_sum, s * sin_difference, s * cos_difference, c * cos_sum
    # Halves first: the sum of two readings of any size may overflow.
    first, third = 0.5 * th1a, 0.5 * th3a
    angle = first + third
    c, s = m.cos(angle), m.sin(angle)
    w, z = c * w - s * z, s * w + c * z
    angle = first - third
    c, s = m.cos(angle), m.sin(angle)
    x, y = c * x - s * y, s * x + c * y
    xx, xy, xz, xw, yx, yy, yz, yw, zx, zy, zz, zw, wx, wy, wz, ww = g.chain
    return (
        xx * x + xy * y + xz * z + xw * w,
        yx * x + yy * y + yz * z + yw * w,
        zx * x + zy * y + zz * z + zw * w,
        wx * x + wy * y + wz * z + ww * w,
    )


def linkage(th1a: N, th1b: N, th1c: N, th3a: N, g: Geometry, m: Backend[N]) -> Linkage[N]:
    """Legs B and C in the frame of leg A's second joint, without its turn by th2A."""
    c1, s1 = m.cos(th1a), m.sin(th1a)
    c3, s3 = m.cos(th3a), m.sin(th3a)
    b, c = g.carried
    return (
        (c1, s1),
        (c3, s3),
        (
            second_in_second_joint(c1, s1, m.cos(th1b), m.sin(th1b), b),
            turn_through_link(c3, s3, b.before_distal),
            b.cos_beta,
        ),
        (
            second_in_second_joint(c1, s1, m.cos(th1c), m.sin(th1c), c),
            turn_through_link(c3, s3, c.before_distal),
            c.cos_beta,
        ),
    )


def turn_of_second_joint(leg_b: View[N], leg_c: View[N]) -> Vector[N]:
    """Case 2: cosine, sine of th2A = xi + xi', each times the determinant, and it; eqs. 15, 16."""
    return common_turn(turn_equation(*leg_b), turn_equation(*leg_c))


def passive_axes(c1: N, s1: N, c2: N, s2: N, g: Geometry) -> tuple[Vector[N], Vector[N]]:
    """Z2A and Z3A in the base frame, from cosines and sines of th1A and th2A."""
    leg = g.legs[0]
    x, y = leg.sin_beta * s2, -leg.sin_beta * c2
    y, z = (
        leg.cos_alpha * y - leg.sin_alpha * leg.cos_beta,
        leg.sin_alpha * y + leg.cos_alpha * leg.cos_beta,
    )
    x, y = c1 * x - s1 * y, s1 * x + c1 * y
    b00, b01, b02, b10, b11, b12, b20, b21, b22 = leg.base_frame
    return second_axis(c1, s1, leg), (
        b00 * x + b01 * y + b02 * z,
        b10 * x + b11 * y + b12 * z,
        b20 * x + b21 * y + b22 * z,
    )
