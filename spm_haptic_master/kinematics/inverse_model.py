# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model: joint angles of an orientation, in closed form, for all 8 working modes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics.checks import (
    check_rotations,
    check_working_mode,
    WorkingMode,
)
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_constants import Leg
from spm_haptic_master.kinematics.leg_kernels import (
    active_angle,
    leg_closure,
    passive_angles,
    third_in_leg_frame,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    ARRAYS,
    Backend,
    Batch,
    FLOATS,
    N,
    Rotation,
    Vector,
)
from spm_haptic_master.kinematics.rotations import unstack_matrix

# Working mode of the rig as built: signs of B_AA, B_BB, B_CC.
RIG_WORKING_MODE = (1, 1, 1)


@dataclass(frozen=True, slots=True)
class JointAngles:
    """
    Joint angles of orientations, rad: the active joints th1A, th1B, th1C, and passive ones.

    Shapes are (..., 3) of `theta1` and (...) of the others.
    """

    theta1: Array
    theta2a: Array
    theta3a: Array
    theta3b: Array
    theta3c: Array


def leg_angles(rotation: Rotation[N], leg: Leg, sign: int, m: Backend[N]) -> Vector[N]:
    """Kernel of one leg: th1k, th2k, th3k, rad, of a rotation; `sign` is its working mode."""
    x, y, z = third_in_leg_frame(rotation, leg)
    p, q = leg_closure(x, y, z, sign, leg, m)
    th1 = active_angle(x, y, p, q, m)
    th2, th3 = passive_angles(rotation, z, th1, p, q, leg, m)
    return th1, th2, th3


def mechanism_angles(rotation: Rotation[float], geometry: Geometry,
                     working_mode: WorkingMode = RIG_WORKING_MODE) -> tuple[float, ...]:
    """
    Angles of all nine joints, in plain floats; nothing is validated.

    They are th1A, th2A, th3A, th1B, th2B, th3B, th1C, th2C, th3C, rad, in [-pi, pi], of a rotation
    R_base_platform, nine numbers row by row. UnreachableError if a leg does not reach it.
    """
    return tuple(angle for leg, sign in zip(geometry.legs, working_mode, strict=True)
                 for angle in leg_angles(rotation, leg, sign, FLOATS))


def measured_angles(rotation: Rotation[float], geometry: Geometry, working_mode: WorkingMode,
                    sensors: int) -> tuple[float, ...]:
    """
    Return the first 3 to 6 of th1A, th1B, th1C, th3A, th3B, th3C, rad, which sensors measure.

    Arguments and errors as of `mechanism_angles`.
    """
    th1a, _, th3a, th1b, _, th3b, th1c, _, th3c = mechanism_angles(
        rotation, geometry, working_mode)
    return (th1a, th1b, th1c, th3a, th3b, th3c)[:sensors]


def inverse(R: ArrayLike, geometry: Geometry = PAPER_GEOMETRY,
            working_mode: Sequence[int] = RIG_WORKING_MODE) -> JointAngles:
    """
    Joint angles of orientations, in closed form.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles and axes.
    working_mode : sequence of three int
        Signs of B_kk = Z1k . (Z2k x Z3k), legs A, B, C; the rig has (1, 1, 1).

    Returns
    -------
    JointAngles
        In [-pi, pi]. In a batch all angles of unreachable poses are NaN.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value; a NaN in a batch raises, too.
    UnreachableError
        `R` is a single pose and a leg does not reach it.

    """
    matrices = check_rotations('R', R)
    working_mode = check_working_mode(working_mode)
    rotation = unstack_matrix(matrices)
    (th1a, th2a, th3a), (th1b, _, th3b), (th1c, _, th3c) = (
        leg_angles(rotation, leg, sign, ARRAYS)
        for leg, sign in zip(check_geometry(geometry).legs, working_mode, strict=True))
    angles: tuple[Batch, ...] = th1a, th1b, th1c, th2a, th3a, th3b, th3c
    unreachable = np.isnan(sum(angles))
    if matrices.ndim == 2 and unreachable:
        raise UnreachableError(
            f'no configuration in working mode {working_mode} reaches '
            f'R = {matrices.tolist()} with {geometry}')
    th1a, th1b, th1c, *passive = (np.where(unreachable, np.nan, angle) for angle in angles)
    return JointAngles(np.stack([th1a, th1b, th1c], axis=-1), *passive)
