# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The workspace cone, and where its parallel singularities lie.

The workspace is the cone of platform axes about (1, 1, 1), which is psi = 135 deg and theta =
acos(1 / sqrt 3), at a given self-rotation phi. `dexterity` and `parallel_determinant` take its
poses in batches, which draws the paper's Figs. 6, 7 and 15.
"""

from dataclasses import dataclass
import math

import numpy as np

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.checks import (
    check_array,
    check_broadcast,
    check_rotations,
    check_working_mode,
)
from spm_haptic_master.kinematics.geometry import PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.jacobians import parallel_determinant
from spm_haptic_master.kinematics.number_backends import ARRAYS
from spm_haptic_master.kinematics.rotations import (
    matrix_from_zxz,
    quaternion_from_vector,
    rotation_from_quaternion,
    stack_matrix,
    unstack_matrix,
)
from spm_haptic_master.kinematics.singularity import determinant_gradient

CONE_AXIS = np.array([1.0, 1.0, 1.0]) / math.sqrt(3.0)
TILT_DIRECTIONS = np.array([
    [math.sqrt(0.5), -math.sqrt(0.5), 0.0],
    [math.sqrt(1.0 / 6.0), math.sqrt(1.0 / 6.0), -math.sqrt(2.0 / 3.0)]])
"""Where the platform axis goes at azimuth 0 and 90 deg; right-handed with `CONE_AXIS`."""

BISECTIONS = 50
"""Halvings of a grid step of 1 rad at most, down to rounding."""


def _directions(number):
    """Spread unit vectors evenly over the sphere along a golden spiral, shape (number, 3)."""
    place = np.arange(number) + 0.5
    height = 1.0 - 2.0 * place / number
    turn = math.pi * (1.0 + math.sqrt(5.0)) * place
    radius = np.sqrt(1.0 - height * height)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=-1)


SEARCH_DIRECTIONS = _directions(100)
"""Axes along which a search for singularities looks out, some 20 deg between neighbours."""

SEARCH_TURNS = np.radians(np.arange(0.0, 61.0, 4.0))
"""Turns, rad, at which it looks; farther away than this no singularity is of interest."""

SEARCH_STARTS = 10
"""Of what it sees, the nearest ones that are followed to the foot of the perpendicular."""

SEARCH_BISECTIONS = 12
"""Halvings of what it sees between two turns, down to 0.001 deg."""

NEAREST_STEPS = 25
"""Steps at most towards the nearest singularity; some five are the rule."""

NEAREST_TOLERANCE = 1e-9
"""Last step, rad, of a nearest singularity that counts as found."""


def workspace_pose(tilt, azimuth, phi):
    """
    Poses of the workspace cone.

    Parameters
    ----------
    tilt : array_like, shape (...)
        Angle of the platform axis from (1, 1, 1), rad.
    azimuth : array_like, shape (...)
        Direction in which it is tilted, rad, about (1, 1, 1) from (1, -1, 0).
    phi : array_like, shape (...)
        Self-rotation, the third ZXZ angle, rad.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R_base_platform; the three arguments are broadcast together.

    Raises
    ------
    InputError
        Not finite numbers, or shapes that do not broadcast.

    """
    tilt = check_array('tilt', tilt, ())
    azimuth = check_array('azimuth', azimuth, ())
    check_broadcast('tilt, azimuth', tilt.shape, azimuth.shape)
    direction = (np.cos(azimuth)[..., None] * TILT_DIRECTIONS[0]
                 + np.sin(azimuth)[..., None] * TILT_DIRECTIONS[1])
    axis = np.cos(tilt)[..., None] * CONE_AXIS + np.sin(tilt)[..., None] * direction
    x, y, z = np.moveaxis(axis, -1, 0)
    return matrix_from_zxz(np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z), phi)


def singularity_locus(phi, half_angle, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE,
                      rays=360, circles=60):
    """
    Parallel singularities of the workspace cone at one self-rotation (the lines of Figs. 6, 7).

    det A is followed along rays from the centre and along circles about it; each change of sign is
    bisected.

    Parameters
    ----------
    phi : float
        Self-rotation, rad.
    half_angle : float
        Half angle of the cone, rad.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.
    rays, circles : int
        Fineness: azimuths in a turn, and circles from the centre to the rim.

    Returns
    -------
    tilt, azimuth : ndarray, shape (n,)
        The points, rad, as `workspace_pose` takes them, ordered by azimuth; n may be 0.

    Raises
    ------
    InputError
        An argument is not what is expected.

    """
    phi = check_array('phi', phi, ())
    if phi.ndim or not check_array('half_angle', half_angle, ()) > 0.0:
        raise InputError(
            f'phi = {phi.tolist()}, half_angle = {half_angle!r}: expected one self-rotation and a '
            'positive half angle, rad')

    def determinant(tilt, azimuth):
        return parallel_determinant(
            workspace_pose(tilt, azimuth, phi), geometry, working_mode)

    tilts, azimuths = np.meshgrid(
        np.linspace(0.0, half_angle, circles + 1), 2.0 * math.pi * np.arange(rays + 1) / rays)
    values = determinant(tilts, azimuths)
    found = []
    for here, there in ((np.s_[:-1, :-1], np.s_[:-1, 1:]), (np.s_[:-1, 1:], np.s_[1:, 1:])):
        changed = values[here] * values[there] < 0.0
        low = np.stack([tilts[here][changed], azimuths[here][changed]])
        high = np.stack([tilts[there][changed], azimuths[there][changed]])
        side = values[here][changed]
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            before = determinant(*middle) * side > 0.0
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        found.append(0.5 * (low + high))
    tilt, azimuth = np.concatenate(found, axis=1)
    order = np.argsort(azimuth, kind='stable')
    return tilt[order], azimuth[order]


@dataclass(frozen=True, slots=True)
class NearestSingularity:
    """
    The parallel singularity nearest to a pose.

    Attributes
    ----------
    distance : float
        Angle of the turn that leads there, rad.
    axis : ndarray, shape (3,)
        Axis of that turn, a unit vector in the base frame; at a singularity itself it is the normal
        of the singular surface.

    """

    distance: float
    axis: np.ndarray


def nearest_singularity(R, geometry=PAPER_GEOMETRY, working_mode=RIG_WORKING_MODE):
    """
    Find the shortest turn of the platform to a parallel singularity of its working mode.

    The search looks out along `SEARCH_DIRECTIONS` for a change of sign of det A. From the nearest
    of these, and from the pose itself, Newton's method with the gradient in closed form goes to the
    foot of the perpendicular. Where the singular surface ends at the working mode's boundary there
    may be no such foot nearby: what was seen along a direction then stands, up to a quarter too
    long.

    Parameters
    ----------
    R : array_like, shape (3, 3)
        R_base_platform, one pose.
    geometry : Geometry
        Link angles.
    working_mode : sequence of three int
        Signs of B_kk, legs A, B, C.

    Returns
    -------
    NearestSingularity or None
        None if the search sees none within `SEARCH_TURNS` and the working mode's reach.

    Raises
    ------
    InputError
        An argument is not what is expected.
    UnreachableError
        The pose is out of reach.

    """
    matrix = check_rotations('R', R)
    if matrix.ndim != 2:
        raise InputError(f'R has shape {matrix.shape}: expected one pose, (3, 3)')
    working_mode = check_working_mode(working_mode)
    here = parallel_determinant(matrix, geometry, working_mode)
    rays = SEARCH_TURNS[1:, None] * SEARCH_DIRECTIONS[:, None, :]
    there = parallel_determinant(_turned(matrix, rays), geometry, working_mode)
    changed = there * here <= 0.0
    visible = np.flatnonzero(changed.any(axis=-1))
    turns = SEARCH_TURNS[1:][np.argmax(changed[visible], axis=-1)]
    nearest = np.argsort(turns, kind='stable')[:SEARCH_STARTS]
    directions, high = SEARCH_DIRECTIONS[visible[nearest]], turns[nearest]
    low = high - (SEARCH_TURNS[1] - SEARCH_TURNS[0])
    for _ in range(SEARCH_BISECTIONS):
        middle = 0.5 * (low + high)
        value = parallel_determinant(
            _turned(matrix, middle[:, None] * directions), geometry, working_mode)
        before = value * here > 0.0
        low, high = np.where(before, middle, low), np.where(before, high, middle)
    seen = high[:, None] * directions
    feet = _feet(matrix, np.concatenate([np.zeros((1, 3)), seen]), geometry, working_mode)
    vectors = np.concatenate([feet, seen])
    distances = np.linalg.norm(vectors, axis=-1)
    if not np.any(distances <= SEARCH_TURNS[-1]):
        return None
    vector = vectors[np.nanargmin(distances)]
    distance = float(np.linalg.norm(vector))
    if distance > NEAREST_TOLERANCE:
        return NearestSingularity(distance, vector / distance)
    _, normal = _determinant_gradient(matrix, geometry, working_mode)
    return NearestSingularity(distance, normal / np.linalg.norm(normal))


def _feet(matrix, vectors, geometry, working_mode):
    """Rotation vectors (n, 3) of the perpendiculars reached from some; NaN where there is none."""
    with np.errstate(invalid='ignore'):  # a search that leaves the working mode is NaN from then on
        for _ in range(NEAREST_STEPS):
            value, gradient = _determinant_gradient(
                _turned(matrix, vectors), geometry, working_mode)
            along = (np.sum(gradient * vectors, axis=-1) - value) / np.sum(gradient**2, axis=-1)
            before, vectors = vectors, along[:, None] * gradient
            last = np.linalg.norm(vectors - before, axis=-1)
            if not np.any(last > NEAREST_TOLERANCE):
                break
    return np.where(last[:, None] <= NEAREST_TOLERANCE, vectors, np.nan)


def _turned(matrix, vectors):
    """One rotation turned by rotation vectors (..., 3), rad, in the base frame."""
    turn = quaternion_from_vector(*np.moveaxis(vectors, -1, 0), ARRAYS)
    return stack_matrix(rotation_from_quaternion(*turn)) @ matrix


def _determinant_gradient(matrices, g, working_mode):
    """Det A of poses, (...), and its gradient along turns of the platform, (..., 3), base frame."""
    value, gradient = determinant_gradient(unstack_matrix(matrices), g, working_mode, ARRAYS)
    return value, np.stack(gradient, axis=-1)
