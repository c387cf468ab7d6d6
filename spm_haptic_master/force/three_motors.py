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

from collections.abc import Sequence
from math import copysign, hypot, inf, sqrt

from spm_haptic_master.force.statics import (
    clipped,
    ForceLimits,
    MotorRates,
    smoothstep,
    THREE,
    Torques,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import cross, dot

# Longest vector of motor torques along the weak direction, far from the surface, over the limit of
# one motor; and where it would be none, over `off` (unit 1): by the table of docs/force, so that
# three poses of four stay exact and a relaxed hand is thrown little.
BOUND = 1.4
BEGIN = 0.2
# Steps of the inverse iteration. Wherever s_3 is below 0.3 in the workspace the handle's axis Z_E
# is within 15 deg of the weak direction; two steps from there leave 1.2e-3 rad at s_3 = 0.45, 4e-5
# rad where the fade begins (0.15).
STEPS = 2


class ThreeMotors(MotorRates):
    """Statics of three motors in the pose that `place` took last."""

    __slots__ = ('_limit', '_near', '_square')

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, limits: ForceLimits) -> None:
        super().__init__(geometry, working_mode, THREE, limits)
        # The s_3 beyond which all is whole: the bound is above the limit of one motor.
        near = max(
            limits.sigma_full,
            BEGIN * limits.sigma_off * (BOUND / (BOUND - 1.0) if BOUND > 1.0 else inf),
        )
        # A row of G is as long as sin beta / |B_kk|.
        self._near = 0.5 * near * max(1.0 - leg.cos_beta**2 for leg in geometry.legs)
        self._limit = limits.motor_torque
        self._square = limits.motor_torque**2

    def strength(self, direction: Vector[float]) -> float:
        """
        Return the share (unit 1) of a torque along a unit vector that the motors may make.

        It is the smoothstep of the fade, here of the torque that a unit of the motors makes.
        """
        row_a, row_b, row_c = self.rows()
        torque = (
            dot(cross(row_b, row_c), direction),
            dot(cross(row_c, row_a), direction),
            dot(cross(row_a, row_b), direction),
        )
        needed = hypot(*torque)
        volume = abs(dot(row_a, cross(row_b, row_c)))
        return self._share(volume / needed if needed else 0.0)

    def _share(self, sigma: float) -> float:
        """Return the share (unit 1) of the weak direction by its singular value."""
        off = self.limits.sigma_off
        return smoothstep((sigma - off) / (self.limits.sigma_full - off))

    def render(self, m: Vector[float]) -> tuple[Torques, Vector[float]]:
        """Return motor torques, N m, and what the handle gets of m; N m in the base frame."""
        x, y, z = m
        leg_a, leg_b, leg_c = self.leg_poses
        ax, ay, az = leg_a.row
        bx, by, bz = leg_b.row
        cx, cy, cz = leg_c.row
        wa = leg_a.divisor
        wb = leg_b.divisor
        wc = leg_c.divisor
        # Cramer's rule, with the rows of G times 1 - u^2.
        px = by * cz - bz * cy
        py = bz * cx - bx * cz
        pz = bx * cy - by * cx
        determinant = ax * px + ay * py + az * pz
        # s_3 is 2 |det G| over the sum of the squares of G, or more.
        inverse_reach = 1.0 / leg_a.reach + 1.0 / leg_b.reach + 1.0 / leg_c.reach
        least = self._near * wa * wb * wc * inverse_reach
        if determinant * determinant > least * least:
            qx = ay * z - az * y
            qy = az * x - ax * z
            qz = ax * y - ay * x
            a = wa * (px * x + py * y + pz * z) / determinant
            b = wb * (cx * qx + cy * qy + cz * qz) / determinant
            c = -wc * (bx * qx + by * qy + bz * qz) / determinant
            if a * a + b * b + c * c <= self._square:
                return (a, b, c), m
        tau = self._in_two_parts(m)
        return tau, self.rendered(tau)

    def _in_two_parts(self, m: Vector[float]) -> Torques:
        """Return the motor torques from strong and weak part."""
        limits = self.limits
        limit = self._limit
        row_a, row_b, row_c = self.rows()
        columns = cross(row_b, row_c), cross(row_c, row_a), cross(row_a, row_b)
        determinant = dot(row_a, columns[0])
        v, (ua, ub, uc), k = self._weak_direction(columns)
        sigma = abs(determinant) / k
        fa, fb, fc = [dot(column, m) for column in columns]
        # Strong part: G + u v^T has the same rates across v, and is regular. Its cofactors are
        # those of G, here times m less its part along v, and (G (v x m)) x u.
        along = k * dot(v, m)
        across = cross(v, m)
        x = dot(row_a, across)
        y = dot(row_b, across)
        z = dot(row_c, across)
        sign = copysign(1.0, determinant)
        regular = determinant + sign * k
        sa = a = (fa - along * ua + sign * (y * uc - z * ub)) / regular
        sb = b = (fb - along * ub + sign * (z * ua - x * uc)) / regular
        sc = c = (fc - along * uc + sign * (x * ub - y * ua)) / regular
        peak = max(abs(a), abs(b), abs(c))
        if peak > limit:
            scale = limit / peak
            a = scale * a
            b = scale * b
            c = scale * c
        share = self._share(sigma)
        if share == 0.0:
            return clipped(a, limit), clipped(b, limit), clipped(c, limit)
        wa = fa / determinant - sa
        wb = fb / determinant - sb
        wc = fc / determinant - sc
        length = sqrt(wa * wa + wb * wb + wc * wc)
        most = BOUND * limit * (1.0 - BEGIN * limits.sigma_off / sigma)
        if share * length > most:
            share = most / length
        for strong, weak in ((a, wa), (b, wb), (c, wc)):
            # As much of the weak part as this motor has room for.
            if strong + share * weak > limit:
                share = max(0.0, limit - strong) / weak
            elif strong + share * weak < -limit:
                share = max(0.0, limit + strong) / -weak
        return (
            clipped(a + share * wa, limit),
            clipped(b + share * wb, limit),
            clipped(c + share * wc, limit),
        )

    def _weak_direction(
        self,
        columns: Sequence[Vector[float]],
    ) -> tuple[Vector[float], Vector[float], float]:
        """
        Return the weak direction v, the motors' direction u that belongs to it, and s_1 s_2.

        With the cofactors C of G, C v = s_1 s_2 u; the surface itself is no exception. The inverse
        of G^T G, but for a factor, stretches the weak direction most.
        """
        (px, py, pz), (qx, qy, qz), (rx, ry, rz) = columns
        _, _, x, _, _, y, _, _, z = self.rotation
        for _ in range(STEPS):
            p = px * x + py * y + pz * z
            q = qx * x + qy * y + qz * z
            r = rx * x + ry * y + rz * z
            x = p * px + q * qx + r * rx
            y = p * py + q * qy + r * ry
            z = p * pz + q * qz + r * rz
        scale = 1.0 / sqrt(x * x + y * y + z * z)
        x = scale * x
        y = scale * y
        z = scale * z
        p = px * x + py * y + pz * z
        q = qx * x + qy * y + qz * z
        r = rx * x + ry * y + rz * z
        k = sqrt(p * p + q * q + r * r)
        return (x, y, z), (p / k, q / k, r / k), k
