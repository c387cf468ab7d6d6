# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The formulas of one leg and of the closed chain, as kernels on numbers.

Symbols, as the paper writes them, with k = A, B, C:

=============  ==================================================================================
Z1k            axis of the active joint, fixed in the base: z, x, y for A, B, C
Z2k            axis between proximal and distal link
Z3k            axis between distal link and platform
th1k, th2k,    joint angles about them; leg A carries the platform by
th3k           R = Rz(th1A) Rx(alpha) Rz(th2A) Rx(beta) Rz(th3A) Rx(gamma)      (eq. 6)
B_kk           Z1k . (Z2k x Z3k), whose sign is leg k's working mode              (eq. 10)
=============  ==================================================================================

Leg B is leg A rotated by +120 deg about (1, 1, 1), which takes z to x to y; leg C is leg B rotated
likewise. Angles are in rad. `m` holds the elementary functions (see `number_backends`), `g` is the
Geometry.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from spm_haptic_master.kinematics.geometry import Axis, Geometry
from spm_haptic_master.kinematics.number_backends import Backend, N, Quaternion, Rotation, Vector

# Axes of leg B or C in the frame of leg A's second joint: Z2k before th2A, Z3k after it.
Leg: TypeAlias = tuple[Vector[N], Vector[N]]
# Cosine and sine of th1A (unit 1), and the legs B and C.
Linkage: TypeAlias = tuple[N, N, Leg[N], Leg[N]]


def second_axis_a(c: N, s: N, g: Geometry) -> Vector[N]:
    """Z2A in the base frame from cosine and sine of th1A: Rz(th1A) Rx(alpha) z."""
    return g.sin_alpha * s, -g.sin_alpha * c, g.cos_alpha


def second_axis_b(c: N, s: N, g: Geometry) -> Vector[N]:
    """Z2B in the base frame from cosine and sine of th1B."""
    return g.cos_alpha, g.sin_alpha * s, -g.sin_alpha * c


def second_axis_c(c: N, s: N, g: Geometry) -> Vector[N]:
    """Z2C in the base frame from cosine and sine of th1C."""
    return -g.sin_alpha * c, g.cos_alpha, g.sin_alpha * s


def third_axes(rotation: Rotation[N],
               g: Geometry) -> tuple[Vector[N], Vector[N], Vector[N]]:
    """Z3A, Z3B, Z3C in the base frame, for a platform at `rotation`."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    third_a, third_b, third_c = [
        (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z, r20 * x + r21 * y + r22 * z)
        for x, y, z in g.platform_axes]
    return third_a, third_b, third_c


def leg_closure(x: N, y: N, z: N, sign: int, g: Geometry, m: Backend[N]) -> tuple[N, N]:
    """
    Close one leg on its third axis (x, y, z), given in the leg's own base frame.

    Z2k . Z3k = cos beta is  x sin th1 - y cos th1 = q.  With  x cos th1 + y sin th1 = p,
    B_kk = p sin alpha: `sign`, the leg's working mode, is the sign of p.

    Returns
    -------
    p, q : number
        Unit 1, p^2 + q^2 = x^2 + y^2.

    """
    q = (g.cos_beta - g.cos_alpha * z) / g.sin_alpha
    return sign * m.reach_root(x * x + y * y - q * q), q


def active_angle(x: N, y: N, p: N, q: N, m: Backend[N]) -> N:
    """Return th1k, rad, of a leg with third axis (x, y, ...) and closure (p, q)."""
    return m.atan2(q * x + p * y, p * x - q * y)


def passive_angles(rotation: Rotation[N], z: N, th1a: N, p: N, q: N, g: Geometry,
                   m: Backend[N]) -> tuple[N, N]:
    """Return th2A and th3A, rad, of a platform with leg A's closure (p, q) and Z3A . Z1A = z."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    th2a = m.atan2(p, g.cos_alpha * q - g.sin_alpha * z)
    # Z2A in the platform frame is Rx(-gamma) (sin beta sin th3A, sin beta cos th3A, cos beta).
    x2, y2, z2 = second_axis_a(m.cos(th1a), m.sin(th1a), g)
    th3a = m.atan2(
        x2 * r00 + y2 * r10 + z2 * r20,
        g.cos_gamma * (x2 * r01 + y2 * r11 + z2 * r21)
        - g.sin_gamma * (x2 * r02 + y2 * r12 + z2 * r22))
    return th2a, th3a


def turn_equation(d: Vector[N], v: Vector[N], g: Geometry) -> Vector[N]:
    """
    Coefficients L, M, N of  L cos t + M sin t + N = 0,  that is  d . Rz(t) v = cos beta.

    With t = th2A or th3A this is the input-output equation of a spherical four-bar linkage, the
    paper's eqs. 1, 2 and 15.
    """
    dx, dy, dz = d
    vx, vy, vz = v
    return dx * vx + dy * vy, dy * vx - dx * vy, dz * vz - g.cos_beta


def common_turn(first: Vector[N], second: Vector[N]) -> Vector[N]:
    """
    Solve two turn equations linearly, eq. 3: cosine and sine of t, each times the determinant.

    Returns
    -------
    cosine, sine, determinant : number
        M1 N2 - M2 N1, -(L1 N2 - L2 N1) and L1 M2 - L2 M1.

    """
    l1, m1, n1 = first
    l2, m2, n2 = second
    return m1 * n2 - m2 * n1, l2 * n1 - l1 * n2, l1 * m2 - l2 * m1


def both_turns(equation: Vector[float]) -> tuple[float, float]:
    """
    Both solutions t, rad, of one turn equation, in plain floats.

    Without a solution, twice the t of the smallest error.
    """
    cosine, sine, constant = equation
    size = math.hypot(cosine, sine)
    middle = math.atan2(sine, cosine)
    half = math.acos(max(-1.0, min(1.0, -constant / size))) if size > 0.0 else 0.5 * math.pi
    return middle - half, middle + half


def into_second_joint(c: N, s: N, axis: Vector[N], g: Geometry) -> Vector[N]:
    """Components of a base vector after leg A's active joint: Rx(-alpha) Rz(-th1A) axis."""
    x, y, z = axis
    y1 = c * y - s * x
    return c * x + s * y, g.cos_alpha * y1 + g.sin_alpha * z, g.cos_alpha * z - g.sin_alpha * y1


def from_third_joint(c: N, s: N, axis: Axis, g: Geometry) -> Vector[N]:
    """Components, before leg A's distal link, of a vector after it: Rx(beta) Rz(th3A) axis."""
    x, y, z = axis
    y1 = s * x + c * y
    return c * x - s * y, g.cos_beta * y1 - g.sin_beta * z, g.sin_beta * y1 + g.cos_beta * z


def into_third_joint(c: N, s: N, axis: Vector[N], g: Geometry) -> Vector[N]:
    """Components, after leg A's distal link, of a vector before it: Rx(-beta) Rz(-th2A) axis."""
    x, y, z = axis
    y1 = c * y - s * x
    return c * x + s * y, g.cos_beta * y1 + g.sin_beta * z, g.cos_beta * z - g.sin_beta * y1


def chain_closure(second: Vector[N], v: Vector[N], g: Geometry) -> tuple[N, Vector[N], N]:
    """
    Closure of leg B or C on a platform carried by leg A, and its rates along leg A's joints.

    All vectors are components after leg A's second joint.

    Parameters
    ----------
    second, v : tuple of three numbers
        Z2k and Z3k.
    g : Geometry
        Link angles.

    Returns
    -------
    f : number
        Z2k . Z3k - cos beta, 0 if the leg closes.
    moment : tuple of three numbers
        Z3k x Z2k: a turn of the platform about a unit axis changes f at the rate axis . moment.
    about_third : number
        That rate about Z3A; about Z2A it is the third component of the moment.

    """
    dx, dy, dz = second
    vx, vy, vz = v
    x, y, z = vy * dz - vz * dy, vz * dx - vx * dz, vx * dy - vy * dx
    return dx * vx + dy * vy + dz * vz - g.cos_beta, (x, y, z), g.cos_beta * z - g.sin_beta * y


def into_second_link(c: N, s: N, axis: Vector[N]) -> Vector[N]:
    """Components, after leg A's second joint, of a vector before it: Rz(-th2A) axis."""
    x, y, z = axis
    return c * x + s * y, c * y - s * x, z


def chain_quaternion(th1a: N, th2a: N, th3a: N, g: Geometry, m: Backend[N]) -> Quaternion[N]:
    """
    Quaternion of leg A's chain, eq. 6, from its three joint angles in rad.

    The quaternion of Rx(alpha) Rz(th2A) Rx(beta) comes first. A turn about z on either side then
    rotates the pairs (w, z) and (x, y) like complex numbers.
    """
    cos_sum, sin_sum, cos_difference, sin_difference, cg, sg = g.half_angles
    c, s = m.cos(0.5 * th2a), m.sin(0.5 * th2a)
    x, y, z, w = c * sin_sum, s * sin_difference, s * cos_difference, c * cos_sum
    angle = 0.5 * (th1a + th3a)
    c, s = m.cos(angle), m.sin(angle)
    w, z = c * w - s * z, s * w + c * z
    angle = 0.5 * (th1a - th3a)
    c, s = m.cos(angle), m.sin(angle)
    x, y = c * x - s * y, s * x + c * y
    return cg * x + sg * w, cg * y + sg * z, cg * z - sg * y, cg * w - sg * x


def second_axes_in_second_joint(c: N, s: N, th1b: N, th1c: N, g: Geometry,
                                m: Backend[N]) -> tuple[Vector[N], Vector[N]]:
    """Components of Z2B and Z2C after leg A's active joint, from cosine and sine of th1A."""
    return (into_second_joint(c, s, second_axis_b(m.cos(th1b), m.sin(th1b), g), g),
            into_second_joint(c, s, second_axis_c(m.cos(th1c), m.sin(th1c), g), g))


def linkage(th1a: N, th1b: N, th1c: N, th3a: N, g: Geometry, m: Backend[N]) -> Linkage[N]:
    """
    Legs B and C in the frame of leg A's second joint, without its turn by th2A.

    Returns
    -------
    c1, s1 : number
        Cosine and sine of th1A.
    leg_b, leg_c : pair of tuples of three numbers
        Z2k on the base's side of the joint and Z3k on the platform's.

    """
    c1, s1 = m.cos(th1a), m.sin(th1a)
    c3, s3 = m.cos(th3a), m.sin(th3a)
    second_b, second_c = second_axes_in_second_joint(c1, s1, th1b, th1c, g, m)
    third_b, third_c = g.third_joint_axes
    return (c1, s1, (second_b, from_third_joint(c3, s3, third_b, g)),
            (second_c, from_third_joint(c3, s3, third_c, g)))


def turn_of_second_joint(leg_b: Leg[N], leg_c: Leg[N], g: Geometry) -> Vector[N]:
    """
    Case 2: cosine and sine of th2A, each times the determinant, and the determinant; eqs. 15, 16.

    th2A is measured from the arc A1A2 produced: th2A = xi + xi', eq. 13.
    """
    return common_turn(turn_equation(*leg_b, g), turn_equation(*leg_c, g))


def turn_of_third_joint(th1a: N, th1b: N, th1c: N, th2a: N, g: Geometry,
                        m: Backend[N]) -> Vector[N]:
    """Case 1: cosine and sine of th3A, each times the determinant, and it; eqs. 13, 14."""
    axes = second_axes_in_second_joint(m.cos(th1a), m.sin(th1a), th1b, th1c, g, m)
    c, s = m.cos(th2a), m.sin(th2a)
    third_b, third_c = g.third_joint_axes
    second_b, second_c = (into_third_joint(c, s, axis, g) for axis in axes)
    return common_turn(turn_equation(second_b, third_b, g), turn_equation(second_c, third_c, g))
