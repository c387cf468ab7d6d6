# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Statics of motors in one pose, in plain floats: what `three_motors` builds on, and four motors.

The rates of the motors' joints over the handle's angular velocity are the rows of
`kinematics.jacobian`, here without any joint angle. With u = Z1k . Z3k the closure of a leg,
Z2k . Z1k = cos alpha and Z2k . Z3k = cos beta, gives

    B_kk = +- sqrt(1 - u^2 - cos^2 alpha - cos^2 beta + 2 u cos alpha cos beta)
    th1k:  (Z1k - u Z3k + (cos alpha - u cos beta) / B_kk  Z1k x Z3k) / (1 - u^2)
    th3k:  (Z3k - u Z1k + (cos beta - u cos alpha) / B_kk  Z1k x Z3k) / (1 - u^2)

By virtual work the torques tau of the motors turn the handle with the torque G^T tau.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from math import inf, isfinite, radians, sqrt
from typing import TypeAlias

from spm_haptic_master.exceptions import InputError, quoted
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.vectors import cross, dot

# Torques of the motors th1A, th1B, th1C, and th3A of a fourth one, N m.
Torques: TypeAlias = tuple[float, ...]
# Least B_kk^2 of a leg (unit 1).
LEAST_SQUARE = MODE_BOUNDARY**2
# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE, FOUR = 3, 4


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """
    Limits of the force feedback.

    InputError: a value is not a finite number above 0 (`damping`: 0 or more), or `sigma_full` is
    not above `sigma_off`.
    """

    torque: float = 0.3  # largest asked of the handle, N m
    motor_torque: float = 0.5  # largest of a motor, N m
    slew: float = 10.0  # largest slope of the torque asked of the handle, N m/s
    ramp: float = 0.5  # time over which torque comes up after engaging, s
    damping: float = 0.005  # viscous damping added at the handle, N m s/rad
    # Smallest singular values of G (unit 1) between which the share of the weak direction of three
    # motors rises from 0 to 1.
    sigma_off: float = 0.05
    sigma_full: float = 0.15
    speed: float = 10.0  # fastest handle, rad/s: beyond, torque fades out
    # Largest protection level of an orientation that force relies on, rad. An orientation wrong by
    # 0.5 deg makes a torque wrong by up to 11 % where sigma is above 0.15.
    protection_level: float = radians(1.0)
    wrench_age: float = 0.03  # oldest wrench that is rendered, s
    small_torque: float = 0.05  # largest torque of a wrench with which force may begin, N m
    noise: float = 5.0  # largest noise of an encoder over its figure (unit 1)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if (
                isinstance(value, bool)
                or not isinstance(value, (int, float))
                or not (isfinite(value))
                or value < 0.0
                or (value == 0.0 and each.name != 'damping')
            ):
                raise InputError(f'{each.name} = {quoted(value)}: expected a number above 0')
        if self.sigma_full <= self.sigma_off:
            raise InputError(
                f'sigma_full = {self.sigma_full:g}: expected a number above '
                f'sigma_off = {self.sigma_off:g}'
            )


def smoothstep(x: float) -> float:
    """Return 0 below 0, 1 above 1, and 3 x^2 - 2 x^3 between them: continuous in its slope."""
    if x <= 0.0:
        return 0.0
    return 1.0 if x >= 1.0 else x * x * (3.0 - 2.0 * x)


def clipped(value: float, limit: float) -> float:
    """Return a value within -limit and limit; of a product with a ratio, only rounding is cut."""
    return -limit if value < -limit else limit if value > limit else value


def rotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    x, y, z = vector
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def unrotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by the inverse of a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    return rotated((a, d, g, b, e, h, c, f, i), vector)


class MotorRates:
    """
    Rows of G in the pose that `place` took last, and the torque of motors on the handle.

    `legs` has for A, B, C: Z3k in the platform frame, Z1k in the base frame, cos alpha and
    cos beta, both with the sign of B_kk, the sum of their squares, and twice their product.
    `scaled` has for each motor 1 - u^2, B_kk^2, and 1 - u^2 times its row of G (unit 1).
    """

    __slots__ = ('legs', 'limits', 'motors', 'rotation', 'scaled', 'signs')

    def __init__(
        self, geometry: Geometry, working_mode: WorkingMode, motors: int, limits: ForceLimits
    ) -> None:
        self.limits, self.motors, self.signs = limits, motors, working_mode
        self.legs = tuple(
            [
                (
                    *leg.third,
                    *leg.first,
                    sign * leg.cos_alpha,
                    sign * leg.cos_beta,
                    leg.cos_alpha**2 + leg.cos_beta**2,
                    2.0 * leg.cos_alpha * leg.cos_beta,
                )
                for leg, sign in zip(geometry.legs, self.signs, strict=True)
            ]
        )
        self.rotation: Rotation[float] = (0.0,) * 9
        self.scaled: tuple[float, ...] = ()

    def place(self, rotation: Rotation[float]) -> None:
        """
        Take a pose, R_base_platform row by row; nothing is validated.

        UnreachableError and SingularityError: a leg does not reach the pose, or is on the boundary
        of its working mode.
        """
        # Leg by leg, without a loop: this takes a third of the time of a sample.
        self.rotation = r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
        leg_a, leg_b, leg_c = self.legs
        px, py, pz, fx, fy, fz, ca, cb, squares, twice = leg_c
        x = r00 * px + r01 * py + r02 * pz
        y = r10 * px + r11 * py + r12 * pz
        z = r20 * px + r21 * py + r22 * pz
        u = fx * x + fy * y + fz * z
        wc = 1.0 - u * u
        sc = wc - squares + twice * u
        if not sc >= LEAST_SQUARE:
            self._refuse(2, sc)
        factor = (ca - u * cb) / sqrt(sc)
        cx = fx - u * x + factor * (fy * z - fz * y)
        cy = fy - u * y + factor * (fz * x - fx * z)
        cz = fz - u * z + factor * (fx * y - fy * x)
        px, py, pz, fx, fy, fz, ca, cb, squares, twice = leg_b
        x = r00 * px + r01 * py + r02 * pz
        y = r10 * px + r11 * py + r12 * pz
        z = r20 * px + r21 * py + r22 * pz
        u = fx * x + fy * y + fz * z
        wb = 1.0 - u * u
        sb = wb - squares + twice * u
        if not sb >= LEAST_SQUARE:
            self._refuse(1, sb)
        factor = (ca - u * cb) / sqrt(sb)
        bx = fx - u * x + factor * (fy * z - fz * y)
        by = fy - u * y + factor * (fz * x - fx * z)
        bz = fz - u * z + factor * (fx * y - fy * x)
        px, py, pz, fx, fy, fz, ca, cb, squares, twice = leg_a
        x = r00 * px + r01 * py + r02 * pz
        y = r10 * px + r11 * py + r12 * pz
        z = r20 * px + r21 * py + r22 * pz
        u = fx * x + fy * y + fz * z
        wa = 1.0 - u * u
        sa = wa - squares + twice * u
        if not sa >= LEAST_SQUARE:
            self._refuse(0, sa)
        root = sqrt(sa)
        nx, ny, nz = fy * z - fz * y, fz * x - fx * z, fx * y - fy * x
        factor = (ca - u * cb) / root
        ax, ay, az = fx - u * x + factor * nx, fy - u * y + factor * ny, fz - u * z + factor * nz
        if self.motors == FOUR:
            factor = (cb - u * ca) / root
            self.scaled = (
                wa,
                sa,
                ax,
                ay,
                az,
                wb,
                sb,
                bx,
                by,
                bz,
                wc,
                sc,
                cx,
                cy,
                cz,
                wa,
                sa,
                x - u * fx + factor * nx,
                y - u * fy + factor * ny,
                z - u * fz + factor * nz,
            )
        else:
            self.scaled = wa, sa, ax, ay, az, wb, sb, bx, by, bz, wc, sc, cx, cy, cz

    def _refuse(self, k: int, square: float) -> None:
        """Raise the error of a leg with too small a square of B_kk."""
        FLOATS.mode_reciprocal(self.signs[k] * FLOATS.reach_root(square))

    def rows(self) -> list[Vector[float]]:
        """Return the rows of G, one for each motor: thetadot = G omega, in the base frame."""
        wa, _, ax, ay, az, wb, _, bx, by, bz, wc, _, cx, cy, cz = self.scaled[:15]
        rows = [
            (ax / wa, ay / wa, az / wa),
            (bx / wb, by / wb, bz / wb),
            (cx / wc, cy / wc, cz / wc),
        ]
        if self.motors == FOUR:
            dx, dy, dz = self.scaled[17:]
            rows.append((dx / wa, dy / wa, dz / wa))
        return rows

    def rendered(self, tau: Sequence[float]) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame: G^T tau."""
        x = y = z = 0.0
        for torque, (gx, gy, gz) in zip(tau, self.rows(), strict=True):
            x, y, z = x + torque * gx, y + torque * gy, z + torque * gz
        return x, y, z


class FourMotors(MotorRates):
    """
    Statics of four motors in the pose that `place` took last.

    For a torque m on the handle tau = p + a n: p = G (G^T G)^-1 m has the least heat, and n, with
    G^T n = 0, is the parity vector of the four sensors: torque along it turns nothing. The
    smallest |a| with which each motor is within its limit is the least heat within it. If there is
    none, m as a whole is scaled down until the least peak of a motor is the limit:

        min_a max_i |p_i + a n_i|  =  max over i < j of |n_j p_i - n_i p_j| / (|n_i| + |n_j|)

    by linear duality: a torque balance that one pair of motors makes alone.
    """

    __slots__ = ()

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, limits: ForceLimits) -> None:
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
        z = (z - l31 * x - l32 * y) / (az * az + bz * bz + cz * cz + dz * dz - l31 * zx - l32 * zy)
        y = y / yy - l32 * z
        x = x / xx - l21 * y - l31 * z
        p = a, b, c, d = (
            ax * x + ay * y + az * z,
            bx * x + by * y + bz * z,
            cx * x + cy * y + cz * z,
            dx * x + dy * y + dz * z,
        )
        limit = self.limits.motor_torque
        least = -limit
        if (
            least <= a <= limit
            and least <= b <= limit
            and (least <= c <= limit and least <= d <= limit)
        ):
            return p, m
        # The parity vector, of any length: the volumes of the other three rows, in turn of sign.
        row_a, row_b, row_c, row_d = self.rows()
        first, last = cross(row_a, row_b), cross(row_c, row_d)
        tau = _within(
            p, (dot(row_b, last), -dot(row_a, last), dot(row_d, first), -dot(row_c, first)), limit
        )
        return tau, self.rendered(tau)


def _within(p: Torques, n: Torques, limit: float) -> Torques:
    """Return p + a n with the smallest |a| within the limit, p scaled down as far as needed."""
    sizes = [abs(each) for each in n]
    peak = max(
        abs(n[j] * p[i] - n[i] * p[j]) / (sizes[i] + sizes[j])
        for i, j in combinations(range(4), 2)
        if sizes[i] + sizes[j] > 0.0
    )
    scale = limit / peak if peak > limit else 1.0
    low, high = -inf, inf
    for torque, part, size in zip(p, n, sizes, strict=True):
        if size > 0.0:
            middle, half = -scale * torque / part, limit / size
            low, high = max(low, middle - half), min(high, middle + half)
    # With the least peak at the limit both bounds are one number, but for rounding.
    a = 0.5 * (low + high) if low > high else min(max(0.0, low), high)
    return tuple(
        [clipped(scale * torque + a * part, limit) for torque, part in zip(p, n, strict=True)]
    )
