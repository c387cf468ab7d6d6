# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rates of the motors' joints over the handle's angular velocity, for one pose, in plain floats.

They are the rows of `kinematics.jacobian` without any joint angle. With u = Z1k . Z3k the closure
of a leg, Z2k . Z1k = cos alpha and Z2k . Z3k = cos beta, gives

    B_kk = +- sqrt(1 - u^2 - cos^2 alpha - cos^2 beta + 2 u cos alpha cos beta)
    th1k:  (Z1k - u Z3k + (cos alpha - u cos beta) / B_kk  Z1k x Z3k) / (1 - u^2)
    th3k:  (Z3k - u Z1k + (cos beta - u cos alpha) / B_kk  Z1k x Z3k) / (1 - u^2)

Virtual work makes them the statics as well: the torques tau of the motors turn the handle with
the torque G^T tau.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)

# Least B_kk^2 of a leg (unit 1).
LEAST_SQUARE = MODE_BOUNDARY ** 2
# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE, FOUR = 3, 4


class MotorRates:
    """
    Rates of three or four motors in the pose that `place` took last.

    `legs` has a row for C, B and A: Z3k in the platform frame, Z1k in the base frame, cos alpha
    and cos beta, both with the sign of B_kk, the sum of their squares, and twice their product.
    `scaled` has 1 - u^2, B_kk^2, and 1 - u^2 times the rate of th1k; the last one th3A's (unit 1).
    """

    __slots__ = ('legs', 'limits', 'motors', 'rotation', 'scaled', 'signs')

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, motors: int,
                 limits: ForceLimits) -> None:
        self.limits, self.motors, self.signs = limits, motors, working_mode[::-1]
        self.legs = [(
            *leg.third, *leg.first, sign * leg.cos_alpha, sign * leg.cos_beta,
            leg.cos_alpha ** 2 + leg.cos_beta ** 2, 2.0 * leg.cos_alpha * leg.cos_beta)
            for leg, sign in zip(geometry.legs[::-1], self.signs, strict=True)]
        self.rotation: Rotation[float] = (0.0,) * 9
        self.scaled: list[tuple[float, float, float, float, float]] = []

    def place(self, rotation: Rotation[float]) -> None:
        """
        Take a pose, R_base_platform row by row; nothing is validated.

        UnreachableError and SingularityError: a leg does not reach the pose, or is on the boundary
        of its working mode.
        """
        self.rotation = r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
        scaled: list[tuple[float, float, float, float, float]] = []
        self.scaled = scaled
        for px, py, pz, fx, fy, fz, ca, cb, squares, twice in self.legs:
            x = r00 * px + r01 * py + r02 * pz
            y = r10 * px + r11 * py + r12 * pz
            z = r20 * px + r21 * py + r22 * pz
            u = fx * x + fy * y + fz * z
            square = 1.0 - u * u
            sine = square - squares + twice * u
            if not sine >= LEAST_SQUARE:
                FLOATS.mode_reciprocal(self.signs[len(scaled)] * FLOATS.reach_root(sine))
            factor = (ca - u * cb) / sqrt(sine)
            scaled.append((square, sine, fx - u * x + factor * (fy * z - fz * y),
                           fy - u * y + factor * (fz * x - fx * z),
                           fz - u * z + factor * (fx * y - fy * x)))
        if self.motors == FOUR:
            # Leg A is the last one.
            factor = (cb - u * ca) / sqrt(sine)
            scaled.append((square, sine, x - u * fx + factor * (fy * z - fz * y),
                           y - u * fy + factor * (fz * x - fx * z),
                           z - u * fz + factor * (fx * y - fy * x)))

    def rows(self) -> list[Vector[float]]:
        """Return the rows of G, one for each motor: thetadot = G omega, in the base frame."""
        rows = [(x / square, y / square, z / square) for square, _, x, y, z in self.scaled]
        return rows[2::-1] + rows[3:]

    def rendered(self, tau: Sequence[float]) -> Vector[float]:
        """Return the torque on the handle, N m in the base frame: G^T tau."""
        x = y = z = 0.0
        for torque, (gx, gy, gz) in zip(tau, self.rows(), strict=True):
            x, y, z = x + torque * gx, y + torque * gy, z + torque * gz
        return x, y, z
