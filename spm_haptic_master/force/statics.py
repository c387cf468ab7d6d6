# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Statics of motors in one pose, in plain floats: what `three_motors` and `four_motors` build on.

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
from dataclasses import dataclass
from math import sqrt
from typing import TypeAlias

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.vectors import NOTHING
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry, Leg
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.vectors import cross, times

# Torques of the motors th1A, th1B, th1C, and th3A of a fourth one, N m.
Torques: TypeAlias = tuple[float, ...]
# Least B_kk^2 of a leg (unit 1).
LEAST_SQUARE = MODE_BOUNDARY**2
# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE_MOTORS = 3
FOUR_MOTORS = 4


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
    """
    A leg in a pose.

    Attributes
    ----------
    third : tuple of three float
        Z3k in the base frame.
    u : float
        Z1k . Z3k.
    divisor : float
        1 - u^2.
    reach : float
        B_kk^2: 0 at the end of the leg's reach.
    normal : tuple of three float
        Z1k x Z3k.
    row : tuple of three float
        1 - u^2 times the row of th1k of G.

    """

    third: Vector[float]
    u: float
    divisor: float
    reach: float
    normal: Vector[float]
    row: Vector[float]


class LegConstants:
    """
    The constants of a leg and its working mode.

    Attributes
    ----------
    third, first : tuple of three float
        Z3k in the platform frame, Z1k in the base frame.
    sign : int
        Sign of B_kk.
    cos_alpha, cos_beta : float
        Cosines of the link angles, both times `sign`.
    squares, twice : float
        Sum of the squares of these, and twice their product: the constants of B_kk^2.

    """

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
            # One of these raises, as it does for the inverse model.
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


class Statics:
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
        Move the legs to a pose, R_base_platform row by row; nothing is validated.

        UnreachableError and SingularityError: a leg does not reach the pose, or is on the boundary
        of its working mode.
        """
        leg_a, leg_b, leg_c = self.legs
        pose_a = leg_a.place(rotation)
        self.leg_poses = pose_a, leg_b.place(rotation), leg_c.place(rotation)
        self.rotation = rotation
        if self.motors == FOUR_MOTORS:
            self.fourth_row = leg_a.third_row(pose_a)

    def strength(self, direction: Vector[float]) -> float:
        """
        Return the share (unit 1) of a torque along a unit vector that the motors may make.

        All of it here; `ThreeMotors` makes less near the singularity.
        """
        return 1.0

    def rows(self) -> list[Vector[float]]:
        """Return the rows of G, one for each motor: thetadot = G omega, in the base frame."""
        rows = [divided(pose.row, pose.divisor) for pose in self.leg_poses]
        if self.motors == FOUR_MOTORS:
            rows.append(divided(self.fourth_row, self.leg_poses[0].divisor))
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


def divided(vector: Vector[float], divisor: float) -> Vector[float]:
    """Return a vector over a divisor."""
    x, y, z = vector
    return x / divisor, y / divisor, z / divisor
