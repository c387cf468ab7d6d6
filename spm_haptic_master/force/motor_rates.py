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

from math import sqrt
from typing import TypeAlias

from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)

# Rows of G, one for each motor (unit 1).
Rows: TypeAlias = tuple[Vector[float], ...]
# Constants of a leg: Z3k in the platform frame, Z1k in the base frame, cos alpha, cos beta, the
# sum of their squares and twice their product, and the sign of B_kk (unit 1).
LegConstants: TypeAlias = tuple[float, ...]
# A leg in a pose: Z3k and Z1k x Z3k in the base frame; u, B_kk and 1 - u^2 (unit 1).
LegPose: TypeAlias = tuple[float, ...]

# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE, FOUR = 3, 4


def rate_constants(geometry: Geometry, working_mode: WorkingMode) -> tuple[LegConstants, ...]:
    """Return the constants of the legs A, B, C: `working_mode` has the signs of their B_kk."""
    return tuple([(
        *leg.third, *leg.first, leg.cos_alpha, leg.cos_beta,
        leg.cos_alpha ** 2 + leg.cos_beta ** 2, 2.0 * leg.cos_alpha * leg.cos_beta, float(sign))
        for leg, sign in zip(geometry.legs, working_mode, strict=True)])


def motor_rates(rotation: Rotation[float], legs: tuple[LegConstants, ...],
                motors: int) -> tuple[Rows, tuple[LegPose, LegPose, LegPose]]:
    """
    Rates of the motors' joints; nothing is validated.

    Parameters
    ----------
    rotation : tuple of nine float
        R_base_platform, row by row.
    legs : tuple of three LegConstants
        Of `rate_constants`.
    motors : {3, 4}
        On th1A, th1B, th1C; 4: on th3A as well.

    Returns
    -------
    rows : tuple of `motors` vectors
        Rows of G, thetadot = G omega, omega in the base frame (unit 1).
    poses : tuple of three LegPose
        The legs A, B, C.

    Raises
    ------
    UnreachableError
        A leg does not reach the pose.
    SingularityError
        A leg is on the boundary of its working mode.

    """
    leg_a, leg_b, leg_c = legs
    row_a, pose = _first_row(rotation, leg_a)
    row_b, pose_b = _first_row(rotation, leg_b)
    row_c, pose_c = _first_row(rotation, leg_c)
    if motors == THREE:
        return (row_a, row_b, row_c), (pose, pose_b, pose_c)
    x, y, z, nx, ny, nz, u, b, square = pose
    _, _, _, fx, fy, fz, ca, cb, _, _, _ = leg_a
    factor = (cb - u * ca) / b
    return (row_a, row_b, row_c, (
        (x - u * fx + factor * nx) / square, (y - u * fy + factor * ny) / square,
        (z - u * fz + factor * nz) / square)), (pose, pose_b, pose_c)


def _first_row(rotation: Rotation[float], leg: LegConstants) -> tuple[Vector[float], LegPose]:
    """Return the rate of th1k, and the leg."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    px, py, pz, fx, fy, fz, ca, cb, squares, twice, sign = leg
    x = r00 * px + r01 * py + r02 * pz
    y = r10 * px + r11 * py + r12 * pz
    z = r20 * px + r21 * py + r22 * pz
    u = fx * x + fy * y + fz * z
    square = 1.0 - u * u
    sine = square - squares + twice * u
    # No call but one in the usual case: B_kk^2 is far from 0.
    b = sign * (sqrt(sine) if sine > 0.0 else FLOATS.reach_root(sine))
    if -MODE_BOUNDARY < b < MODE_BOUNDARY:
        FLOATS.mode_reciprocal(b)
    factor = (ca - u * cb) / b
    nx = fy * z - fz * y
    ny = fz * x - fx * z
    nz = fx * y - fy * x
    return ((fx - u * x + factor * nx) / square, (fy - u * y + factor * ny) / square,
            (fz - u * z + factor * nz) / square), (x, y, z, nx, ny, nz, u, b, square)


def second_of(pose: LegPose, leg: LegConstants) -> Vector[float]:
    """Return Z2k in the base frame."""
    x, y, z, nx, ny, nz, u, b, square = pose
    _, _, _, fx, fy, fz, ca, cb, _, _, _ = leg
    first, third, normal = (ca - cb * u) / square, (cb - ca * u) / square, -b / square
    return (first * fx + third * x + normal * nx, first * fy + third * y + normal * ny,
            first * fz + third * z + normal * nz)
