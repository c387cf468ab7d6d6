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
from math import inf, radians, sqrt
from typing import TypeAlias

from spm_haptic_master.exceptions import InputError, quoted
from spm_haptic_master.force.vectors import NOTHING
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.vectors import cross, dot, times

# Torques of the motors th1A, th1B, th1C, and th3A of a fourth one, N m.
Torques: TypeAlias = tuple[float, ...]
# Least B_kk^2 of a leg (unit 1).
LEAST_SQUARE = MODE_BOUNDARY**2
# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE = 3
FOUR = 4


# Limits that may be 0; the others are at least this much above it.
MAY_BE_ZERO = frozenset(('damping', 'lock_stiffness', 'end_stop'))
SMALLEST = 1e-300


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """
    Limits of the force feedback.

    InputError: a value is not a finite number above 0 (those of `MAY_BE_ZERO`: 0 or more), or
    `sigma_full` is not above `sigma_off`.
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
    speed: float = 6.0  # fastest handle, rad/s: beyond, torque fades out
    # Largest protection level of an orientation that force relies on, rad. An orientation wrong by
    # 0.5 deg makes a torque wrong by up to 11 % where sigma is above 0.15.
    protection_level: float = radians(1.0)
    wrench_age: float = 0.03  # oldest wrench that is rendered, s
    small_torque: float = 0.05  # largest torque of a wrench with which force may begin, N m
    noise: float = 5.0  # largest noise of an encoder over its figure (unit 1)
    lock_stiffness: float = 1.0  # of a locked orientation, N m/rad; 0: none
    end_stop: float = radians(5.0)  # angle before the end of a leg's reach, rad; 0: no end stop

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            least = 0.0 if field.name in MAY_BE_ZERO else SMALLEST
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not least <= value < inf:
                raise InputError(f'{field.name} = {quoted(value)}: expected a number above 0')
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


@dataclass(slots=True)
class LegPose:
    """A leg in a pose."""

    third: Vector[float]  # Z3k in the base frame
    u: float  # Z1k . Z3k
    divisor: float  # 1 - u^2
    reach: float  # B_kk^2: 0 at the end of the reach
    normal: Vector[float]  # Z1k x Z3k
    row: Vector[float]  # 1 - u^2 times the row of th1k of G


class LegConstants:
    """
    What of a leg does not depend on the pose.

    Attributes
    ----------
    third, first : tuple of three float
        Z3k in the platform frame, Z1k in the base frame.
    cos_alpha, cos_beta : float
        Both with the sign of B_kk.
    squares, twice : float
        Sum of their squares, and twice their product.

    """

    __slots__ = ('cos_alpha', 'cos_beta', 'first', 'sign', 'squares', 'third', 'twice')

    def __init__(self, leg: Leg, sign: int) -> None:
        self.sign = sign
        self.third = leg.third
        self.first = leg.first
        self.cos_alpha = sign * leg.cos_alpha
        self.cos_beta = sign * leg.cos_beta
        self.squares = leg.cos_alpha**2 + leg.cos_beta**2
        self.twice = 2.0 * leg.cos_alpha * leg.cos_beta

    def place(self, rotation: Rotation[float]) -> LegPose:
        """
        Return the leg in a pose, R_base_platform row by row.

        UnreachableError and SingularityError: it does not reach the pose, or is on the boundary of
        its working mode.
        """
        third = x, y, z = times(rotation, self.third)
        fx, fy, fz = self.first
        u = fx * x + fy * y + fz * z
        divisor = 1.0 - u * u
        reach = divisor - self.squares + self.twice * u
        if not reach >= LEAST_SQUARE:
            # Raises.
            FLOATS.mode_reciprocal(self.sign * FLOATS.reach_root(reach))
        factor = (self.cos_alpha - u * self.cos_beta) / sqrt(reach)
        normal = nx, ny, nz = cross(self.first, third)
        row = (
            fx - u * x + factor * nx,
            fy - u * y + factor * ny,
            fz - u * z + factor * nz,
        )
        # By position, in its order: by names, three legs would cost a tenth of the whole sample.
        return LegPose(third, u, divisor, reach, normal, row)

    def third_row(self, pose: LegPose) -> Vector[float]:
        """Return 1 - u^2 times the row of th3k of G, in a pose."""
        x, y, z = pose.third
        fx, fy, fz = self.first
        nx, ny, nz = pose.normal
        u = pose.u
        factor = (self.cos_beta - u * self.cos_alpha) / sqrt(pose.reach)
        return (
            x - u * fx + factor * nx,
            y - u * fy + factor * ny,
            z - u * fz + factor * nz,
        )


class MotorRates:
    """
    Rows of G in the pose that `place` took last, and the torque of motors on the handle.

    Parameters
    ----------
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    motors : {3, 4}
        Number of motors.
    limits : ForceLimits
        Limits of the motors.

    Attributes
    ----------
    legs : tuple of three LegConstants
        Of A, B, C.
    rotation : tuple of nine float
        R_base_platform of the pose, row by row.
    leg_poses : tuple of three LegPose
        Of A, B, C, in the pose.
    fourth_row : tuple of three float
        Of a fourth motor, in the pose: 1 - u^2 of leg A times its row of G.

    """

    __slots__ = ('fourth_row', 'leg_poses', 'legs', 'limits', 'motors', 'rotation')

    def __init__(
        self,
        geometry: Geometry,
        working_mode: WorkingMode,
        motors: int,
        limits: ForceLimits,
    ) -> None:
        self.limits = limits
        self.motors = motors
        self.legs = tuple(
            [
                LegConstants(leg, sign)
                for leg, sign in zip(geometry.legs, working_mode, strict=True)
            ]
        )
        self.rotation: Rotation[float] = (0.0,) * 9
        self.leg_poses: tuple[LegPose, ...] = ()
        self.fourth_row: Vector[float] = NOTHING

    def place(self, rotation: Rotation[float]) -> None:
        """
        Take a pose, R_base_platform row by row; nothing is validated.

        UnreachableError and SingularityError: a leg does not reach the pose, or is on the boundary
        of its working mode.
        """
        leg_a, leg_b, leg_c = self.legs
        pose_a = leg_a.place(rotation)
        self.leg_poses = pose_a, leg_b.place(rotation), leg_c.place(rotation)
        self.rotation = rotation
        if self.motors == FOUR:
            self.fourth_row = leg_a.third_row(pose_a)

    def strength(self, direction: Vector[float]) -> float:
        """Return the share (unit 1) of a torque along a unit vector that the motors may make."""
        return 1.0

    def rows(self) -> list[Vector[float]]:
        """Return the rows of G, one for each motor: thetadot = G omega, in the base frame."""
        rows = [_divided(pose.row, pose.divisor) for pose in self.leg_poses]
        if self.motors == FOUR:
            rows.append(_divided(self.fourth_row, self.leg_poses[0].divisor))
        return rows

    def rendered(self, tau: Sequence[float]) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame: G^T tau."""
        x = 0.0
        y = 0.0
        z = 0.0
        for torque, (gx, gy, gz) in zip(tau, self.rows(), strict=True):
            x = x + torque * gx
            y = y + torque * gy
            z = z + torque * gz
        return x, y, z


def _divided(vector: Vector[float], divisor: float) -> Vector[float]:
    x, y, z = vector
    return x / divisor, y / divisor, z / divisor


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
