# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Motor torques of three motors, on th1A, th1B, th1C.

The motor torques tau = G^-T m for a torque m on the handle are exact, and infinite at the parallel
singularity, where s_3, the smallest singular value of G, is 0. The handle's direction v of that
value is the weak one; the other two are strong everywhere in the workspace (s_2 is at least 1.2).
So tau is the sum of two parts, with the limits off and full of s_3:

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

from math import copysign, hypot, sqrt

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.statics import (
    clipped,
    divided,
    smoothstep,
    Statics,
    THREE_MOTORS,
    Torques,
)
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import Rotation, Vector
from spm_haptic_master.kinematics.vectors import cross, dot, scaled, times, transposed_times

# Longest vector of motor torques along the weak direction, far from the surface, over the limit of
# one motor (unit 1); and the s_3 at which it would be 0, over `off` (unit 1). By the table of
# docs/force: three poses of four stay exact, and a relaxed hand is thrown little.
BOUND = 1.4
BEGIN = 0.2
# Steps of the inverse iteration. Wherever s_3 is below 0.3 in the workspace the handle's axis Z_E
# is within 15 deg of the weak direction; two steps from there leave 1.2e-3 rad at s_3 = 0.45, 4e-5
# rad where the fade begins (0.15).
INVERSE_STEPS = 2


class ThreeMotors(Statics):
    """Statics of three motors in the pose that `place` took last."""

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, limits: ForceLimits) -> None:
        super().__init__(geometry, working_mode, THREE_MOTORS, limits)
        # Least |det G| over the sum of the 1 / B_kk^2 with which s_3 is above sigma_full: s_3 is
        # 2 |det G| over the sum of the squares of G or more, and a row of G is as long as
        # sin beta / |B_kk|. The weak part is whole there: its bound is above the limit of one
        # motor from s_3 = 0.7 sigma_off on.
        longest = max(1.0 - leg.cos_beta**2 for leg in geometry.legs)
        self._least = 0.5 * limits.sigma_full * longest
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
        # Cramer's rule, with the rows of G times their divisors 1 - u^2.
        px = by * cz - bz * cy
        py = bz * cx - bx * cz
        pz = bx * cy - by * cx
        determinant = ax * px + ay * py + az * pz
        # See `_least`; here with the divisors of the rows.
        inverse_reach = 1.0 / leg_a.reach + 1.0 / leg_b.reach + 1.0 / leg_c.reach
        least = self._least * wa * wb * wc * inverse_reach
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
        limit = limits.motor_torque
        row_a, row_b, row_c = self.rows()
        cofactors = *cross(row_b, row_c), *cross(row_c, row_a), *cross(row_a, row_b)
        determinant = dot(row_a, cofactors[:3])
        v, u, product = self._weak_direction(cofactors)
        sigma = abs(determinant) / product
        whole = times(cofactors, m)
        # Strong part: G + u v^T has the same rates across v, and is regular. Its cofactors are
        # those of G, here times m less its part along v, and (G (v x m)) x u.
        along = product * dot(v, m)
        across = cross(v, m)
        rates = dot(row_a, across), dot(row_b, across), dot(row_c, across)
        sign = copysign(1.0, determinant)
        regular = determinant + sign * product
        exact = [
            (torque - along * direction + sign * turned) / regular
            for torque, direction, turned in zip(whole, u, cross(rates, u), strict=True)
        ]
        peak = max(map(abs, exact))
        strong = exact
        if peak > limit:
            strong = [limit / peak * torque for torque in exact]
        share = self._share(sigma)
        if share == 0.0:
            return tuple([clipped(torque, limit) for torque in strong])
        weak = [torque / determinant - part for torque, part in zip(whole, exact, strict=True)]
        length = sqrt(weak[0] * weak[0] + weak[1] * weak[1] + weak[2] * weak[2])
        most = BOUND * limit * (1.0 - BEGIN * limits.sigma_off / sigma)
        if share * length > most:
            share = most / length
        return _together(strong, weak, share, limit)

    def _weak_direction(
        self,
        cofactors: Rotation[float],
    ) -> tuple[Vector[float], Vector[float], float]:
        """
        Return the weak direction v, the motors' direction u that belongs to it, and s_1 s_2.

        With the cofactors C of G, row by row, C v = s_1 s_2 u; that holds on the surface of the
        singularity, too. The inverse of G^T G, which is C^T C but for a factor, stretches the weak
        direction most: the iteration begins at the handle's axis.
        """
        v = self.rotation[2], self.rotation[5], self.rotation[8]
        for _ in range(INVERSE_STEPS):
            v = transposed_times(cofactors, times(cofactors, v))
        v = scaled(1.0 / sqrt(dot(v, v)), v)
        turned = times(cofactors, v)
        product = sqrt(dot(turned, turned))
        return v, divided(turned, product), product


def _together(
    strong: list[float],
    weak: list[float],
    share: float,
    limit: float,
) -> Torques:
    """Return strong part and a share of the weak part, as much as each motor has room for; N m."""
    for torque, part in zip(strong, weak, strict=True):
        if torque + share * part > limit:
            share = max(0.0, limit - torque) / part
        elif torque + share * part < -limit:
            share = max(0.0, limit + torque) / -part
    return tuple(
        [clipped(torque + share * part, limit) for torque, part in zip(strong, weak, strict=True)]
    )
