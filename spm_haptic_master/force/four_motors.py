# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motor torques of four motors, on th1A, th1B, th1C and th3A: of all that fit, the coolest."""

from __future__ import annotations

from itertools import combinations
from math import inf

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.statics import clipped, FOUR_MOTORS, Statics, Torques
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import cross, dot


class FourMotors(Statics):
    """
    Statics of four motors in the pose that `place` took last.

    The torques for a torque m on the handle are tau = p + a n: p = G (G^T G)^-1 m has the least
    heat, and n, with G^T n = 0, is the parity vector of the four sensors: torque along it turns
    nothing. The smallest |a| with which each motor is within its limit has the least heat within
    it. If there is none, m as a whole is scaled down until the least peak of a motor is the limit:

        min_a max_i |p_i + a n_i|  =  max over i < j of |n_j p_i - n_i p_j| / (|n_i| + |n_j|)

    by linear duality: one pair of motors decides it.
    """

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, limits: ForceLimits) -> None:
        super().__init__(geometry, working_mode, FOUR_MOTORS, limits)

    def render(self, m: Vector[float]) -> tuple[Torques, Vector[float]]:
        """Return motor torques, N m, and what the handle gets of m; N m in the base frame."""
        rows = self.rows()
        row_a, row_b, row_c, row_d = rows
        least_heat = _least_heat(rows, m)
        limit = self.limits.motor_torque
        a, b, c, d = least_heat
        are_first_within = -limit <= a <= limit and -limit <= b <= limit
        if are_first_within and -limit <= c <= limit and -limit <= d <= limit:
            return least_heat, m
        # The parity vector, of any length: the volumes of the other three rows, in turn of sign.
        first = cross(row_a, row_b)
        last = cross(row_c, row_d)
        parity = dot(row_b, last), -dot(row_a, last), dot(row_d, first), -dot(row_c, first)
        tau = _within(least_heat, parity, limit)
        return tau, self.rendered(tau)


def _least_heat(rows: list[Vector[float]], m: Vector[float]) -> Torques:
    """
    Return p = G (G^T G)^-1 m for the four rows of G: torques of the least heat for m.

    With G^T G = L D L^T, which is regular in the whole workspace.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz), (dx, dy, dz) = rows
    xx = ax * ax + bx * bx + cx * cx + dx * dx
    yx = ax * ay + bx * by + cx * cy + dx * dy
    zx = ax * az + bx * bz + cx * cz + dx * dz
    yy = ay * ay + by * by + cy * cy + dy * dy
    zy = ay * az + by * bz + cy * cz + dy * dz
    zz = az * az + bz * bz + cz * cz + dz * dz
    l21 = yx / xx
    l31 = zx / xx
    d2 = yy - l21 * yx
    rest = zy - l21 * zx
    l32 = rest / d2
    d3 = zz - l31 * zx - l32 * rest
    # Forwards through L, then backwards through D L^T.
    x, y, z = m
    y -= l21 * x
    z = (z - l31 * x - l32 * y) / d3
    y = y / d2 - l32 * z
    x = x / xx - l21 * y - l31 * z
    return (
        ax * x + ay * y + az * z,
        bx * x + by * y + bz * z,
        cx * x + cy * y + cz * z,
        dx * x + dy * y + dz * z,
    )


def _within(p: Torques, n: Torques, limit: float) -> Torques:
    """Return p + a n with the smallest |a| within the limit, p scaled down as far as needed."""
    sizes = [abs(part) for part in n]
    peak = 0.0
    for i, j in combinations(range(4), 2):
        both = sizes[i] + sizes[j]
        if both > 0.0:
            peak = max(peak, abs(n[j] * p[i] - n[i] * p[j]) / both)
    scale = limit / peak if peak > limit else 1.0
    low = -inf
    high = inf
    for torque, part, size in zip(p, n, sizes, strict=True):
        if size > 0.0:
            middle = -scale * torque / part
            half = limit / size
            low = max(low, middle - half)
            high = min(high, middle + half)
    # With the least peak at the limit both bounds are one number, but for rounding.
    a = min(max(0.0, low), high)
    if low > high:
        a = 0.5 * (low + high)
    return tuple(
        [clipped(scale * torque + a * part, limit) for torque, part in zip(p, n, strict=True)]
    )
