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
    Rows of G in the pose that `place` took last, and the torque of motors on the handle.

    `legs` has for A, B, C: Z3k in the platform frame, Z1k in the base frame, cos alpha and
    cos beta, both with the sign of B_kk, the sum of their squares, and twice their product.
    `scaled` has for each motor 1 - u^2, B_kk^2, and 1 - u^2 times its row of G (unit 1).
    """

    __slots__ = ('legs', 'limits', 'motors', 'rotation', 'scaled', 'signs')

    def __init__(self, geometry: Geometry, working_mode: WorkingMode, motors: int,
                 limits: ForceLimits) -> None:
        self.limits, self.motors, self.signs = limits, motors, working_mode
        self.legs = tuple([(
            *leg.third, *leg.first, sign * leg.cos_alpha, sign * leg.cos_beta,
            leg.cos_alpha ** 2 + leg.cos_beta ** 2, 2.0 * leg.cos_alpha * leg.cos_beta)
            for leg, sign in zip(geometry.legs, self.signs, strict=True)])
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
                wa, sa, ax, ay, az, wb, sb, bx, by, bz, wc, sc, cx, cy, cz, wa, sa,
                x - u * fx + factor * nx, y - u * fy + factor * ny, z - u * fz + factor * nz)
        else:
            self.scaled = wa, sa, ax, ay, az, wb, sb, bx, by, bz, wc, sc, cx, cy, cz

    def _refuse(self, k: int, square: float) -> None:
        """Raise the error of a leg with too small a square of B_kk."""
        FLOATS.mode_reciprocal(self.signs[k] * FLOATS.reach_root(square))

    def rows(self) -> list[Vector[float]]:
        """Return the rows of G, one for each motor: thetadot = G omega, in the base frame."""
        wa, _, ax, ay, az, wb, _, bx, by, bz, wc, _, cx, cy, cz = self.scaled[:15]
        rows = [(ax / wa, ay / wa, az / wa), (bx / wb, by / wb, bz / wb),
                (cx / wc, cy / wc, cz / wc)]
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
