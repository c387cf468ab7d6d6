# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motions of the hand: pushes, loops, and their directions."""

from __future__ import annotations

import math

import numpy as np
from spm_haptic_master.kinematics import quaternion_from_matrix, workspace_pose
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import multiply_quaternions, quaternion_from_vector
from study.force.loop import Environment, Motion, spring

# Tilt and azimuth of the poses (rad), which no symmetry makes special.
TILT, AZIMUTH = 0.05, 0.3
# Radius of a loop (rad); stiffness of its spring (N m/rad), which is centred that far beside it.
RADIUS, LOOP_STIFFNESS = 0.1, 2.0


def pose(phi_deg: float) -> np.ndarray:
    """Return R_base_platform near the centre at a self-rotation, deg."""
    R: np.ndarray = workspace_pose(TILT, AZIMUTH, math.radians(phi_deg))
    return R


def axis(R: np.ndarray, name: str) -> np.ndarray:
    """Return the handle's axis of 'roll' or of 'tilt', a unit vector in the base frame."""
    return R[:, {'roll': 2, 'tilt': 0}[name]]


def quaternion(R: np.ndarray) -> Quaternion[float]:
    """Return the quaternion x, y, z, w of a matrix in plain floats."""
    x, y, z, w = quaternion_from_matrix(R).tolist()
    return x, y, z, w


def push(direction: np.ndarray, depth: float, rise: float = 0.3, hold: float = math.inf) -> Motion:
    """Return a push to a depth, rad, and after `hold`, s, the way back; each in `rise`, s."""

    def motion(time: float) -> Vector[float]:
        share = min(1.0, time / rise, max(0.0, (2.0 * rise + hold - time) / rise))
        x, y, z = (depth * share * share * (3.0 - 2.0 * share) * direction).tolist()
        return x, y, z

    return motion


def loops(
    R: np.ndarray, speed: float, count: int, sense: int
) -> tuple[Motion, Environment, float]:
    """
    Loops of roll and tilt at a speed, rad/s, in one sense, 1 or -1, against a spring.

    Returns
    -------
    motion, environment
        Of hand and slave.
    seconds : float
        Their time, s.

    """
    turn = 2.0 * math.pi * RADIUS / speed
    roll, tilt = axis(R, 'roll'), axis(R, 'tilt')

    def motion(time: float) -> Vector[float]:
        angle = sense * 2.0 * math.pi * min(time / turn, count)
        x, y, z = (RADIUS * (math.sin(angle) * roll + (1.0 - math.cos(angle)) * tilt)).tolist()
        return x, y, z

    x, y, z = (-RADIUS * roll).tolist()
    centre = multiply_quaternions(quaternion_from_vector(x, y, z), quaternion(R))
    return motion, spring(centre, LOOP_STIFFNESS), count * turn
