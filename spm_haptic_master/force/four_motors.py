# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Motor torques of four motors: on th1A, th1B, th1C and th3A.

For a torque m on the handle tau = p + a n: p = G (G^T G)^-1 m has the least heat, and n, with
G^T n = 0, is the parity vector of the four sensors: torque along it turns nothing. The smallest
|a| with which each motor is within its limit is the least heat within it. If there is none, m as
a whole is scaled down until the least peak of a motor is the limit. That peak is

    min over a of max_i |p_i + a n_i|  =  max over i < j of |n_j p_i - n_i p_j| / (|n_i| + |n_j|)

by linear duality: a torque balance that one pair of motors makes alone.
"""

from __future__ import annotations

from itertools import combinations
from math import inf

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.motor_rates import FOUR, MotorRates
from spm_haptic_master.force.torques import clipped, Torques
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.jacobians import cross, dot
from spm_haptic_master.kinematics.number_backends import Vector

# Pairs of the four motors.
PAIRS = tuple(combinations(range(4), 2))


class FourMotors(MotorRates):
    """Statics of four motors in the pose that `place` took last."""

    __slots__ = ()

    def __init__(self, geometry: Geometry, working_mode: WorkingMode,
                 limits: ForceLimits) -> None:
        super().__init__(geometry, working_mode, FOUR, limits)

    def render(self, m: Vector[float]) -> tuple[Torques, Vector[float]]:
        """Return motor torques, N m, and what the handle gets of m; N m in the base frame."""
        u, _, ax, ay, az, v, _, bx, by, bz, w, _, cx, cy, cz, _, _, dx, dy, dz = self.scaled
        ax, ay, az, bx, by, bz = ax / u, ay / u, az / u, bx / v, by / v, bz / v
        cx, cy, cz, dx, dy, dz = cx / w, cy / w, cz / w, dx / u, dy / u, dz / u
        # G^T G = L D L^T, which is regular in the whole workspace; its solution for m.
        xx, yx = ax * ax + bx * bx + cx * cx + dx * dx, ax * ay + bx * by + cx * cy + dx * dy
        zx, zy = ax * az + bx * bz + cx * cz + dx * dz, ay * az + by * bz + cy * cz + dy * dz
        x, y, z = m
        l21, l31 = yx / xx, zx / xx
        yy = ay * ay + by * by + cy * cy + dy * dy - l21 * yx
        zy -= l21 * zx
        l32 = zy / yy
        y -= l21 * x
        z = (z - l31 * x - l32 * y) / (
            az * az + bz * bz + cz * cz + dz * dz - l31 * zx - l32 * zy)
        y = y / yy - l32 * z
        x = x / xx - l21 * y - l31 * z
        p = a, b, c, d = (ax * x + ay * y + az * z, bx * x + by * y + bz * z,
                          cx * x + cy * y + cz * z, dx * x + dy * y + dz * z)
        limit = self.limits.motor_torque
        least = -limit
        if least <= a <= limit and least <= b <= limit and (
                least <= c <= limit and least <= d <= limit):
            return p, m
        # The parity vector, of any length: the volumes of the other three rows, in turn of sign.
        row_a, row_b, row_c, row_d = self.rows()
        first, last = cross(row_a, row_b), cross(row_c, row_d)
        tau = _within(p, (dot(row_b, last), -dot(row_a, last), dot(row_d, first),
                          -dot(row_c, first)), limit)
        return tau, self.rendered(tau)


def _within(p: Torques, n: Torques, limit: float) -> Torques:
    """Return p + a n with the smallest |a| within the limit, p scaled down as far as needed."""
    sizes = [abs(each) for each in n]
    peak = max(abs(n[j] * p[i] - n[i] * p[j]) / (sizes[i] + sizes[j])
               for i, j in PAIRS if sizes[i] + sizes[j] > 0.0)
    scale = limit / peak if peak > limit else 1.0
    low, high = -inf, inf
    for torque, part, size in zip(p, n, sizes, strict=True):
        if size > 0.0:
            middle, half = -scale * torque / part, limit / size
            low, high = max(low, middle - half), min(high, middle + half)
    # With the least peak at the limit both bounds are one number, but for rounding.
    a = 0.5 * (low + high) if low > high else min(max(0.0, low), high)
    return tuple([clipped(scale * torque + a * part, limit)
                  for torque, part in zip(p, n, strict=True)])
