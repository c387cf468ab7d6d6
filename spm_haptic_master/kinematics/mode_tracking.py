# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Classic forward model along a motion: the assembly mode that continues it."""

from dataclasses import dataclass
import math

import numpy as np

from spm_haptic_master.exceptions import InputError, UnreachableError
from spm_haptic_master.kinematics.assembly_modes import (
    assembly_modes,
    check_triple,
    LockedChain,
    ROUNDING,
)
from spm_haptic_master.kinematics.checks import check_array, check_geometry, check_rotations
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)

AMBIGUITY_MARGIN = 0.01
"""
Two modes whose distances to the last orientation differ by less, rad, are too close to tell.

A hand turns the platform about this far between samples at 1 kHz (10 rad/s).
"""


@dataclass(frozen=True, slots=True)
class TrackedMode:
    """
    The assembly mode nearest to a last known orientation.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        R_base_platform of the nearest mode.
    distance : float
        Its angle from the last orientation, rad.
    ambiguous : bool
        True where another mode is about as near, so that nothing tells which one is the platform's.

    """

    rotation: np.ndarray
    distance: float
    ambiguous: bool


def track_mode(th1, last, geometry=PAPER_GEOMETRY, margin=AMBIGUITY_MARGIN):
    """
    Classic forward model with branch tracking: the mode nearest to the last orientation (Fig. 10).

    Parameters
    ----------
    th1 : array_like, shape (3,)
        Active joints A, B, C, rad.
    last : array_like, shape (3, 3)
        Orientation to start from, R_base_platform.
    geometry : Geometry
        Link angles.
    margin : float
        rad; two modes whose distances to `last` differ by less are too close to tell.

    Returns
    -------
    TrackedMode

    Raises
    ------
    InputError
        An argument is not what is expected.
    UnreachableError
        The angles close no mechanism: there is no mode.
    SingularityError
        Infinitely many modes.

    """
    chain = LockedChain.of(check_triple(th1), check_geometry(geometry))
    last = check_rotations('last', last)
    if last.ndim != 2:
        raise InputError(f'last has shape {last.shape}: expected one rotation, (3, 3)')
    if not check_array('margin', margin, ()) > 0.0:
        raise InputError(f'margin = {margin!r}: expected a positive angle in rad')
    start = tuple(quaternion_from_matrix(last).tolist())
    modes = sorted(
        (rotation_distance(mode[0], start), mode[0], mode[3]) for mode in assembly_modes(chain))
    if not modes:
        raise UnreachableError(f'th1 = {np.asarray(th1).tolist()} rad: no assembly mode closes')
    distance, quaternion, determinant = modes[0]
    # Two modes merged into one leave the rates parallel, to the root of the rounding.
    ambiguous = abs(determinant) < math.sqrt(ROUNDING) or (
        len(modes) > 1 and modes[1][0] - distance < margin)
    rotation = np.array(rotation_from_quaternion(*quaternion)).reshape(3, 3)
    return TrackedMode(rotation, distance, ambiguous)
