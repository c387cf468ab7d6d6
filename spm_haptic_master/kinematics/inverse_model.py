# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse model: joint angles of an orientation, in closed form, for any of the 8 working modes."""

from dataclasses import dataclass

import numpy as np

from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics.checks import check_geometry, check_rotations, check_working_mode
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    active_angle,
    leg_closure,
    passive_angles,
    third_axes,
)
from spm_haptic_master.kinematics.number_backends import ARRAYS, FLOATS
from spm_haptic_master.kinematics.rotations import unstack_matrix

RIG_WORKING_MODE = (1, 1, 1)
"""Working mode the rig is built in: signs of B_AA, B_BB, B_CC."""


@dataclass(frozen=True, slots=True)
class JointAngles:
    """
    Joint angles of an orientation, rad.

    Attributes
    ----------
    theta1 : ndarray, shape (..., 3)
        Active joints, legs A, B, C.
    theta2a, theta3a : ndarray, shape (...)
        Leg A's passive joints.

    """

    theta1: np.ndarray
    theta2a: np.ndarray
    theta3a: np.ndarray


def joint_angles(rotation, g, working_mode, m):
    """Kernel of the inverse model: th1A, th1B, th1C, th2A, th3A of nine numbers."""
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = third_axes(rotation, g)
    sign_a, sign_b, sign_c = working_mode
    p, q = leg_closure(ax, ay, az, sign_a, g, m)
    th1a = active_angle(ax, ay, p, q, m)
    th2a, th3a = passive_angles(rotation, az, th1a, p, q, g, m)
    # Legs B and C in their own base frames: (y, z, x) and (z, x, y).
    p, q = leg_closure(by, bz, bx, sign_b, g, m)
    th1b = active_angle(by, bz, p, q, m)
    p, q = leg_closure(cz, cx, cy, sign_c, g, m)
    th1c = active_angle(cz, cx, p, q, m)
    return th1a, th1b, th1c, th2a, th3a


def inverse_angles(rotation, geometry, working_mode=RIG_WORKING_MODE):
    """
    Inverse model in plain floats, for the 1 kHz path; nothing is validated.

    Parameters
    ----------
    rotation : tuple of nine float
        R_base_platform, row by row.
    geometry : Geometry
        Link angles.
    working_mode : tuple of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    th1a, th1b, th1c, th2a, th3a : float
        rad, in [-pi, pi].

    Raises
    ------
    UnreachableError
        A leg cannot reach the pose.

    """
    return joint_angles(rotation, geometry, working_mode, FLOATS)


def inverse(R, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE):
    """
    Joint angles of orientations, in closed form.

    Parameters
    ----------
    R : array_like, shape (..., 3, 3)
        R_base_platform.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk = Z1k . (Z2k x Z3k), legs A, B, C; all + is the rig's.

    Returns
    -------
    JointAngles
        `theta1` (..., 3), `theta2a` (...), `theta3a` (...), rad in [-pi, pi]. In a batch the rows
        of unreachable poses are NaN, all of them.

    Raises
    ------
    InputError
        An argument is not what is expected; a NaN anywhere in a batch, too.
    UnreachableError
        `R` is a single pose and a leg cannot reach it.

    """
    matrices = check_rotations('R', R)
    rotation = unstack_matrix(matrices)
    angles = joint_angles(
        rotation, check_geometry(geometry), check_working_mode(working_mode), ARRAYS)
    unreachable = np.isnan(sum(angles))
    if matrices.ndim == 2 and unreachable:
        raise UnreachableError(
            f'no configuration in working mode {tuple(working_mode)} reaches '
            f'R = {matrices.tolist()} with {geometry}')
    th1a, th1b, th1c, th2a, th3a = (np.where(unreachable, np.nan, angle) for angle in angles)
    return JointAngles(np.stack([th1a, th1b, th1c], axis=-1), th2a, th3a)
