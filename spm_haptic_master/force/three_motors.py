# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Motor torques of three motors, on th1A, th1B, th1C.

For a torque m on the handle tau = G^-T m: exact, and infinite at the parallel singularity, where
s_3, the smallest singular value of G, is 0. The handle's direction v of that value is the weak
one; the other two are strong everywhere in the workspace (s_2 is at least 1.2). So

    strong part  the least-norm tau for m without its part along v, as a whole within the limit
    weak part    smoothstep((s_3 - off) / (full - off)) of what is left of G^-T m, as a vector no
                 longer than BOUND limit (1 - BEGIN off / s_3), and as much of it as keeps each
                 motor within the limit

The smoothstep fades small torques, next to the surface. The bound fades large ones from further
away: about the weak direction the handle gets at most BOUND limit (s_3 - BEGIN off), whose slope
over the angle is less than 1 N m/rad. A hand that pushes against a torque with a grip of that
stiffness follows; by the smoothstep alone it would lose its hold and be thrown across.

Motor torques are continuous over the workspace. What the handle gets is G^T tau.
"""

from __future__ import annotations

from math import sqrt

from spm_haptic_master.force.motor_rates import Rows
from spm_haptic_master.force.shaping import clipped, smoothstep
from spm_haptic_master.kinematics.number_backends import Vector

# Longest vector of motor torques along the weak direction, far from the surface, over the limit of
# one motor; and where it would be none, over `off` (unit 1): by the table of docs/force, so that
# three poses of four stay exact and a relaxed hand is thrown little.
BOUND, BEGIN = 1.4, 0.2
# Steps of the inverse iteration.
STEPS = 2


class ThreeMotors:
    """
    Statics of one pose with three motors.

    Parameters
    ----------
    rows : tuple of three vectors
        Rows of G, of `motor_rates`.
    handle : tuple of three float
        The platform's axis Z_E in the base frame. Wherever s_3 is below 0.3 in the workspace it is
        within 15 deg of the weak direction; two steps of the inverse iteration from there leave
        1.2e-3 rad at s_3 = 0.45, 4e-5 rad where the fade begins (0.15).
    limit : float
        Largest torque of a motor, N m.
    off, full : float
        Values of s_3 (unit 1) between which the share of the weak part rises from 0 to 1.

    """

    __slots__ = ('_columns', '_determinant', '_full', '_handle', '_limit', '_off', '_rows')

    def __init__(self, rows: Rows, handle: Vector[float], limit: float, off: float,
                 full: float) -> None:
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._rows = rows
        x, y, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        # Columns of the adjugate of G.
        self._columns = ((x, y, z), (cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax),
                         (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx))
        self._determinant = ax * x + ay * y + az * z
        self._handle, self._limit, self._off, self._full = handle, limit, off, full

    def render(self, m: Vector[float]) -> tuple[tuple[float, ...], Vector[float]]:
        """Return motor torques, N m, and what the handle gets of m; N m in the base frame."""
        x, y, z = m
        (px, py, pz), (qx, qy, qz), (rx, ry, rz) = self._columns
        determinant, limit = self._determinant, self._limit
        # Sum of the squares of the products of two singular values: s_3 is |det| over its root,
        # or more, and the weak part of tau is no longer than tau.
        least = abs(determinant) / sqrt(px * px + py * py + pz * pz + qx * qx + qy * qy + qz * qz
                                        + rx * rx + ry * ry + rz * rz)
        if least > self._full:
            a, b, c = ((px * x + py * y + pz * z) / determinant,
                       (qx * x + qy * y + qz * z) / determinant,
                       (rx * x + ry * y + rz * z) / determinant)
            most = BOUND * (1.0 - BEGIN * self._off / least)
            if a * a + b * b + c * c <= limit * limit * (most * most if most < 1.0 else 1.0):
                return (a, b, c), m
        tau = self._in_two_parts(m)
        return tau, self.rendered(tau)

    def rendered(self, tau: tuple[float, ...]) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame: G^T tau."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._rows
        a, b, c = tau
        return ax * a + bx * b + cx * c, ay * a + by * b + cy * c, az * a + bz * b + cz * c

    def weakest(self) -> tuple[float, Vector[float]]:
        """Return s_3 (unit 1) and the weak direction v, a unit vector in the base frame."""
        v, _, k = self._weak_direction()
        return abs(self._determinant) / k, v

    def _weak_direction(self) -> tuple[Vector[float], Vector[float], float]:
        """
        Return the weak direction v, the motors' direction u that belongs to it, and s_1 s_2.

        With the cofactors C of G, C v = s_1 s_2 u; the surface itself is no exception.
        """
        (px, py, pz), (qx, qy, qz), (rx, ry, rz) = self._columns
        x, y, z = self._handle
        # The inverse of G^T G, but for a factor, stretches the weak direction most.
        for _ in range(STEPS):
            p, q, r = px * x + py * y + pz * z, qx * x + qy * y + qz * z, rx * x + ry * y + rz * z
            x = p * px + q * qx + r * rx
            y, z = p * py + q * qy + r * ry, p * pz + q * qz + r * rz
        scale = 1.0 / sqrt(x * x + y * y + z * z)
        x, y, z = scale * x, scale * y, scale * z
        p, q, r = px * x + py * y + pz * z, qx * x + qy * y + qz * z, rx * x + ry * y + rz * z
        k = sqrt(p * p + q * q + r * r)
        return (x, y, z), (p / k, q / k, r / k), k

    def _in_two_parts(self, m: Vector[float]) -> tuple[float, ...]:
        """Return the motor torques from strong and weak part."""
        limit, determinant = self._limit, self._determinant
        (vx, vy, vz), (ua, ub, uc), k = self._weak_direction()
        sigma = abs(determinant) / k
        x, y, z = m
        (px, py, pz), (qx, qy, qz), (rx, ry, rz) = self._columns
        fa, fb, fc = (px * x + py * y + pz * z, qx * x + qy * y + qz * z,
                      rx * x + ry * y + rz * z)
        # Strong part: G + u v^T has the same rates across v, and is regular. Its cofactors are
        # those of G, here times m less its part along v, and (G (v x m)) x u.
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self._rows
        along = k * (vx * x + vy * y + vz * z)
        x, y, z = vy * z - vz * y, vz * x - vx * z, vx * y - vy * x
        x, y, z = (ax * x + ay * y + az * z, bx * x + by * y + bz * z, cx * x + cy * y + cz * z)
        sign = 1.0 if determinant >= 0.0 else -1.0
        regular = determinant + sign * k
        sa = a = (fa - along * ua + sign * (y * uc - z * ub)) / regular
        sb = b = (fb - along * ub + sign * (z * ua - x * uc)) / regular
        sc = c = (fc - along * uc + sign * (x * ub - y * ua)) / regular
        peak = max(abs(a), abs(b), abs(c))
        if peak > limit:
            scale = limit / peak
            a, b, c = scale * a, scale * b, scale * c
        share = smoothstep((sigma - self._off) / (self._full - self._off))
        if share == 0.0:
            return clipped(a, limit), clipped(b, limit), clipped(c, limit)
        wa, wb, wc = fa / determinant - sa, fb / determinant - sb, fc / determinant - sc
        length = sqrt(wa * wa + wb * wb + wc * wc)
        most = BOUND * limit * (1.0 - BEGIN * self._off / sigma)
        if share * length > most:
            share = most / length
        for strong, weak in ((a, wa), (b, wb), (c, wc)):
            # As much of the weak part as this motor has room for.
            if strong + share * weak > limit:
                share = max(0.0, limit - strong) / weak
            elif strong + share * weak < -limit:
                share = max(0.0, limit + strong) / -weak
        return (clipped(a + share * wa, limit), clipped(b + share * wb, limit),
                clipped(c + share * wc, limit))
