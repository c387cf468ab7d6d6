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
from spm_haptic_master.kinematics.vectors import about_x, about_z, times, transposed_times

# Axes of leg B or C in the frame of leg A's second joint: Z2k before th2A, Z3k after it; and the
# cosine of the leg's beta (unit 1).
View: TypeAlias = tuple[Vector[N], Vector[N], float]
# Cosine and sine of an angle (unit 1).
Turn: TypeAlias = tuple[N, N]
# Turns of th1A and th3A, and the legs B and C.
Linkage: TypeAlias = tuple[Turn[N], Turn[N], View[N], View[N]]


def second_axis(cosine: N, sine: N, leg: Leg) -> Vector[N]:
    """
    Return Z2k in the base frame: B_k Rz(th1k) Rx(alpha_k) z.

    Parameters
    ----------
    cosine, sine : number
        Of th1k (unit 1).
    leg : Leg
        The leg k.

    """
    (px, py, pz), (qx, qy, qz), (rx, ry, rz) = leg.second
    return (
        px + cosine * qx + sine * rx,
        py + cosine * qy + sine * ry,
        pz + cosine * qz + sine * rz,
    )


def third_axes(rotation: Rotation[N], g: Geometry) -> list[Vector[N]]:
    """Return Z3A, Z3B, Z3C in the base frame, for a platform at `rotation`."""
    return [times(rotation, axis) for axis in g.platform_axes]


def leg_angles(
    rotation: Rotation[N],
    leg: Leg,
    sign: int,
    m: Backend[N],
) -> Vector[N]:
    """
    Return th1k, th2k, th3k of one leg, rad, in [-pi, pi]: the inverse model in closed form.

    Parameters
    ----------
    rotation : nine numbers
        R_base_platform, row by row.
    leg : Leg
        The leg k.
    sign : int
        Its working mode: +1 or -1, the sign of B_kk.
    m : Backend
        Elementary functions. Out of reach, floats raise UnreachableError and arrays give NaN.

    Notes
    -----
    With Z3k = (x, y, z) in the leg's frame B_k, the closure Z2k . Z3k = cos beta is
    x sin th1 - y cos th1 = q. With x cos th1 + y sin th1 = p, B_kk = p sin alpha: the working
    mode is the sign of p, and p^2 + q^2 = x^2 + y^2.

    """
    x, y, z = transposed_times(leg.base_frame, times(rotation, leg.third))
    q = (leg.cos_beta - leg.cos_alpha * z) / leg.sin_alpha
    p = sign * m.reach_root(x * x + y * y - q * q)
    th1 = m.atan2(q * x + p * y, p * x - q * y)
    th2 = m.atan2(p, leg.cos_alpha * q - leg.sin_alpha * z)
    # Z2k in the frame Q_k of the platform is (sin beta sin th3, sin beta cos th3, cos beta).
    second = transposed_times(rotation, second_axis(m.cos(th1), m.sin(th1), leg))
    sine, cosine, _ = transposed_times(leg.platform_frame, second)
    return th1, th2, m.atan2(sine, cosine)


def squared_sine(rotation: Rotation[N], leg: Leg) -> N:
    """Return p^2 of `leg_angles`, negative where the leg does not reach the rotation."""
    x, y, z = transposed_times(leg.base_frame, times(rotation, leg.third))
    q = (leg.cos_beta - leg.cos_alpha * z) / leg.sin_alpha
    return x * x + y * y - q * q


def turn_equation(
    d: Vector[N],
    v: Vector[N],
    cos_beta: float,
) -> Vector[N]:
    """
    Return L, M, N of  L cos t + M sin t + N = 0,  that is of  d . Rz(t) v = cos beta.

    With t = th2A or th3A this is the input-output equation of a spherical four-bar linkage, the
    paper's eqs. 1, 2 and 15.
    """
    dx, dy, dz = d
    vx, vy, vz = v
    return (
        dx * vx + dy * vy,
        dy * vx - dx * vy,
        dz * vz - cos_beta,
    )


def common_turn(first: Vector[N], second: Vector[N]) -> Vector[N]:
    """
    Solve two turn equations linearly (eq. 3).

    Returns
    -------
    cosine, sine, determinant : number
        Cosine and sine of t, each times the determinant L1 M2 - L2 M1, and the determinant: they
        are M1 N2 - M2 N1 and -(L1 N2 - L2 N1). The equations need not have a common solution:
        cosine^2 + sine^2 = determinant^2 only if they do.

    """
    l1, m1, n1 = first
    l2, m2, n2 = second
    return (
        m1 * n2 - m2 * n1,
        l2 * n1 - l1 * n2,
        l1 * m2 - l2 * m1,
    )


def residual(equation: Vector[float], angle: float) -> float:
    """Left side of a turn equation at an angle, rad (unit 1)."""
    cosine, sine, constant = equation
    return cosine * math.cos(angle) + sine * math.sin(angle) + constant


def both_turns(equation: Vector[float]) -> tuple[float, float]:
    """Return both solutions t, rad, of a turn equation; without any, twice that of least error."""
    cosine, sine, constant = equation
    size = math.hypot(cosine, sine)
    middle = math.atan2(sine, cosine)
    if size > 0.0:
        half = math.acos(max(-1.0, min(1.0, -constant / size)))
    else:
        half = 0.5 * math.pi
    return middle - half, middle + half


def turn_through_link(cosine: N, sine: N, axis: LinkTurn) -> Vector[N]:
    """Return Rx(link) Rz(t) axis, from cosine and sine of t."""
    x, y, cx, cy, sz, sx, sy, cz = axis
    return (
        cosine * x - sine * y,
        sine * cx + cosine * cy - sz,
        sine * sx + cosine * sy + cz,
    )


def second_in_second_joint(
    cosine_1a: N,
    sine_1a: N,
    cosine: N,
    sine: N,
    carried: Carried,
) -> Vector[N]:
    """
    Return Z2k of leg B or C in the frame of leg A's second joint, before its turn by th2A.

    Parameters
    ----------
    cosine_1a, sine_1a : number
        Of th1A (unit 1).
    cosine, sine : number
        Of th1k (unit 1).
    carried : Carried
        Leg B or C as seen from leg A.

    """
    px, py, pz, qx, qy, qz, rx, ry, rz, cos_alpha, sin_alpha = carried.second
    second = (
        px + cosine * qx + sine * rx,
        py + cosine * qy + sine * ry,
        pz + cosine * qz + sine * rz,
    )
    return about_x(cos_alpha, -sin_alpha, about_z(cosine_1a, -sine_1a, second))


def into_second_link(
    cosine: N,
    sine: N,
    axis: Vector[N],
) -> Vector[N]:
    """Return a vector's components after leg A's second joint: Rz(-th2A) axis."""
    return about_z(cosine, -sine, axis)


def into_third_joint(
    cosine: N,
    sine: N,
    axis: Vector[N],
    g: Geometry,
) -> Vector[N]:
    """Return a vector's components after leg A's distal link: Rx(-beta) Rz(-th2A) axis."""
    leg = g.legs[0]
    return about_x(leg.cos_beta, -leg.sin_beta, into_second_link(cosine, sine, axis))


def chain_quaternion(
    th1a: N,
    th2a: N,
    th3a: N,
    g: Geometry,
    m: Backend[N],
) -> Quaternion[N]:
    """Return the quaternion of leg A's chain (eq. 6) from its three joint angles, rad."""
    return half_chain_quaternion(th1a, m.cos(0.5 * th2a), m.sin(0.5 * th2a), th3a, g, m)


def half_chain_quaternion(
    th1a: N,
    half_cosine: N,
    half_sine: N,
    th3a: N,
    g: Geometry,
    m: Backend[N],
) -> Quaternion[N]:
    """
    Return the quaternion of leg A's chain (eq. 6), th2A given by its half angle.

    Parameters
    ----------
    th1a, th3a : number
        Leg A's first and third joint, rad.
    half_cosine, half_sine : number
        Cosine and sine of half of th2A (unit 1).
    g : Geometry
        The mechanism.
    m : Backend
        Elementary functions.

    Notes
    -----
    The quaternion of Rx(alpha) Rz(th2A) Rx(beta) comes first. A turn about z on either side then
    rotates the pairs (w, z) and (x, y) like complex numbers. The outer frames B_A and Q_A come
    last, as one matrix.

    """
    cos_sum, sin_sum, cos_difference, sin_difference = g.half_angles
    x = half_cosine * sin_sum
    y = half_sine * sin_difference
    z = half_sine * cos_difference
    w = half_cosine * cos_sum
    # Halves first: the sum of two readings of any size may overflow.
    first = 0.5 * th1a
    third = 0.5 * th3a
    cosine = m.cos(first + third)
    sine = m.sin(first + third)
    w, z = cosine * w - sine * z, sine * w + cosine * z
    cosine = m.cos(first - third)
    sine = m.sin(first - third)
    x, y = cosine * x - sine * y, sine * x + cosine * y
    xx, xy, xz, xw, yx, yy, yz, yw, zx, zy, zz, zw, wx, wy, wz, ww = g.chain
    return (
        xx * x + xy * y + xz * z + xw * w,
        yx * x + yy * y + yz * z + yw * w,
        zx * x + zy * y + zz * z + zw * w,
        wx * x + wy * y + wz * z + ww * w,
    )


def linkage(
    th1a: N,
    th1b: N,
    th1c: N,
    th3a: N,
    g: Geometry,
    m: Backend[N],
) -> Linkage[N]:
    """
    Return the legs B and C in the frame of leg A's second joint, without its turn by th2A.

    Parameters
    ----------
    th1a, th1b, th1c, th3a : number
        Measured joint angles, rad.
    g : Geometry
        The mechanism.
    m : Backend
        Elementary functions.

    Returns
    -------
    turn_1a, turn_3a : Turn
        Cosine and sine of th1A, and of th3A (unit 1).
    leg_b, leg_c : View
        The legs, for `turn_of_second_joint`.

    """
    cosine_1a = m.cos(th1a)
    sine_1a = m.sin(th1a)
    cosine_3a = m.cos(th3a)
    sine_3a = m.sin(th3a)
    carried_b, carried_c = g.carried
    leg_b = (
        second_in_second_joint(cosine_1a, sine_1a, m.cos(th1b), m.sin(th1b), carried_b),
        turn_through_link(cosine_3a, sine_3a, carried_b.before_distal),
        carried_b.cos_beta,
    )
    leg_c = (
        second_in_second_joint(cosine_1a, sine_1a, m.cos(th1c), m.sin(th1c), carried_c),
        turn_through_link(cosine_3a, sine_3a, carried_c.before_distal),
        carried_c.cos_beta,
    )
    return (cosine_1a, sine_1a), (cosine_3a, sine_3a), leg_b, leg_c


def turn_of_second_joint(leg_b: View[N], leg_c: View[N]) -> Vector[N]:
    """
    Solve Case 2 for th2A = xi + xi' (eqs. 15, 16).

    Parameters
    ----------
    leg_b, leg_c : View
        The legs B and C of a `linkage`.

    Returns
    -------
    cosine, sine, determinant : number
        As of `common_turn`.

    """
    return common_turn(turn_equation(*leg_b), turn_equation(*leg_c))


def passive_axes(
    cosine_1a: N,
    sine_1a: N,
    cosine_2a: N,
    sine_2a: N,
    g: Geometry,
) -> tuple[Vector[N], Vector[N]]:
    """
    Return Z2A and Z3A in the base frame.

    Parameters
    ----------
    cosine_1a, sine_1a : number
        Of th1A (unit 1).
    cosine_2a, sine_2a : number
        Of th2A (unit 1).
    g : Geometry
        The mechanism.

    """
    leg = g.legs[0]
    # Rz(th2A) Rx(beta) z, then through the proximal link and the first joint.
    distal = leg.sin_beta * sine_2a, -leg.sin_beta * cosine_2a, leg.cos_beta
    third = about_z(cosine_1a, sine_1a, about_x(leg.cos_alpha, leg.sin_alpha, distal))
    return second_axis(cosine_1a, sine_1a, leg), times(leg.base_frame, third)
