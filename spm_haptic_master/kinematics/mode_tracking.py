# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classic forward model along a motion: the assembly mode that continues it."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, UnreachableError
from spm_haptic_master.kinematics.assembly_modes import (
    assembly_modes,
    check_triple,
    LockedChain,
    polish,
    ROUNDING,
)
from spm_haptic_master.kinematics.checks import check_rotations
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.number_backends import Array, Quaternion
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)

# Smallest difference between the distances of two distinguishable modes from the last orientation
# (rad): the platform turns about this far between samples at 1 kHz (10 rad/s).
AMBIGUITY_MARGIN = 0.01


class TrackedMode(NamedTuple):
    """
    The assembly mode nearest to a last known orientation: R_base_platform, (3, 3).

    It is `ambiguous` if another mode is about as near, so that either may be the platform's.
    """

    rotation: Array
    ambiguous: bool


def continue_mode(th1: Sequence[float], th2a: float, th3a: float,
                  geometry: Geometry) -> tuple[Quaternion[float], float, float]:
    """
    Classic forward model along a motion, by Newton's method from the last passive angles.

    `th1` are the active joints A, B, C, and `th2a`, `th3a` the passive angles of leg A to start
    from, rad; nothing is validated. Returned are the orientation, quaternion x, y, z, w, and the
    new th2A and th3A. Next to a parallel singularity noise takes the active angles beyond the last
    ones that can be assembled: then it is the pose with the least closure error.
    """
    chain = LockedChain.of(np.asarray(th1, dtype=float), geometry)
    th2a, th3a, *_ = polish(chain, th2a, th3a)
    return chain.quaternion(th2a, th3a), th2a, th3a


def track_mode(th1: ArrayLike, last: ArrayLike,
               geometry: Geometry = PAPER_GEOMETRY) -> TrackedMode:
    """
    Classic forward model with branch tracking: the mode nearest to the last orientation (Fig. 10).

    `th1` (3,) are the active joints A, B, C, rad; `last` (3, 3) is the orientation to start from.
    No mode raises UnreachableError; infinitely many, and wrong arguments, as `forward_all`.
    """
    chain = LockedChain.of(check_triple(th1), check_geometry(geometry))
    matrix = check_rotations('last', last)
    if matrix.ndim != 2:
        raise InputError(f'last has shape {matrix.shape}: expected one rotation, (3, 3)')
    x, y, z, w = quaternion_from_matrix(matrix).tolist()
    modes = sorted(
        (rotation_distance(mode[0], (x, y, z, w)), mode[0], mode[3])
        for mode in assembly_modes(chain))
    if not modes:
        raise UnreachableError(f'th1 = {np.asarray(th1).tolist()} rad: no assembly mode closes')
    distance, quaternion, determinant = modes[0]
    # Where two modes merged into one the rates are parallel, to the root of the rounding.
    ambiguous = abs(determinant) < math.sqrt(ROUNDING) or (
        len(modes) > 1 and modes[1][0] - distance < AMBIGUITY_MARGIN)
    rotation = np.array(rotation_from_quaternion(*quaternion)).reshape(3, 3)
    return TrackedMode(rotation, ambiguous)
