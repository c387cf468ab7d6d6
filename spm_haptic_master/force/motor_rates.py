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
from spm_haptic_master.kinematics.leg_constants import Leg
from spm_haptic_master.kinematics.number_backends import (
    FLOATS,
    MODE_BOUNDARY,
    Rotation,
    Vector,
)

# Rows of G, one for each motor (unit 1).
Rows: TypeAlias = tuple[Vector[float], ...]
# A leg in a pose: Z3k and Z1k x Z3k in the base frame; u, B_kk and 1 - u^2 (unit 1).
LegPose: TypeAlias = tuple[Vector[float], Vector[float], float, float, float]

# Numbers of motors: on th1A, th1B, th1C; and on th3A as well.
THREE, FOUR = 3, 4


def motor_rates(rotation: Rotation[float], geometry: Geometry, working_mode: WorkingMode,
                motors: int) -> tuple[Rows, tuple[LegPose, LegPose, LegPose]]:
    """
    Rates of the motors' joints; nothing is validated.

    Parameters
    ----------
    rotation : tuple of nine float
        R_base_platform, row by row.
    geometry : Geometry
        Link angles and axes.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.
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
    leg_a, leg_b, leg_c = geometry.legs
    sign_a, sign_b, sign_c = working_mode
    row_a, pose = _first_row(rotation, leg_a, sign_a)
    row_b, pose_b = _first_row(rotation, leg_b, sign_b)
    row_c, pose_c = _first_row(rotation, leg_c, sign_c)
    if motors == THREE:
        return (row_a, row_b, row_c), (pose, pose_b, pose_c)
    (tx, ty, tz), (nx, ny, nz), u, b, square = pose
    fx, fy, fz = leg_a.first
    factor = (leg_a.cos_beta - u * leg_a.cos_alpha) / b
    return (row_a, row_b, row_c, (
        (tx - u * fx + factor * nx) / square, (ty - u * fy + factor * ny) / square,
        (tz - u * fz + factor * nz) / square)), (pose, pose_b, pose_c)


def _first_row(rotation: Rotation[float], leg: Leg,
               sign: int) -> tuple[Vector[float], LegPose]:
    """Return the rate of th1k, and the leg."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation
    x, y, z = leg.third
    x, y, z = (r00 * x + r01 * y + r02 * z, r10 * x + r11 * y + r12 * z,
               r20 * x + r21 * y + r22 * z)
    fx, fy, fz = leg.first
    u = fx * x + fy * y + fz * z
    ca, cb, square = leg.cos_alpha, leg.cos_beta, 1.0 - u * u
    sine = square - ca * ca - cb * (cb - 2.0 * u * ca)
    # No call in the usual case: B_kk^2 is far from 0.
    b = sign * (sqrt(sine) if sine > 0.0 else FLOATS.reach_root(sine))
    if -MODE_BOUNDARY < b < MODE_BOUNDARY:
        FLOATS.mode_reciprocal(b)
    factor = (ca - u * cb) / b
    nx, ny, nz = normal = fy * z - fz * y, fz * x - fx * z, fx * y - fy * x
    return ((fx - u * x + factor * nx) / square, (fy - u * y + factor * ny) / square,
            (fz - u * z + factor * nz) / square), ((x, y, z), normal, u, b, square)


def second_of(pose: LegPose, leg: Leg) -> Vector[float]:
    """Return Z2k in the base frame."""
    (tx, ty, tz), (nx, ny, nz), u, b, square = pose
    fx, fy, fz = leg.first
    first = (leg.cos_alpha - leg.cos_beta * u) / square
    third = (leg.cos_beta - leg.cos_alpha * u) / square
    normal = -b / square
    return (first * fx + third * tx + normal * nx, first * fy + third * ty + normal * ny,
            first * fz + third * tz + normal * nz)
