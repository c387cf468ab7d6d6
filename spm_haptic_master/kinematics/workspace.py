# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Poses and parallel singularities of the workspace cone.

The workspace is the cone of platform axes about (1, 1, 1), which is psi = 135 deg and theta =
acos(1 / sqrt 3), at a given self-rotation phi. `dexterity` and `parallel_determinant` accept its
poses in batches, as the paper's Figs. 6, 7 and 15 need them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, quoted
from spm_haptic_master.kinematics.checks import check_angles, check_broadcast
from spm_haptic_master.kinematics.geometry import Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.jacobians import parallel_determinant
from spm_haptic_master.kinematics.number_backends import Array
from spm_haptic_master.kinematics.rotations import matrix_from_zxz

# Axis of the workspace cone, a unit vector in the base frame.
CONE_AXIS = np.array([1.0, 1.0, 1.0]) / math.sqrt(3.0)
# Directions of tilt at azimuth 0 and 90 deg, unit vectors; right-handed with `CONE_AXIS`.
TILT_DIRECTIONS = np.array([
    [math.sqrt(0.5), -math.sqrt(0.5), 0.0],
    [math.sqrt(1.0 / 6.0), math.sqrt(1.0 / 6.0), -math.sqrt(2.0 / 3.0)]])
# Rays and circles of the cone along which `singularity_locus` follows det A.
RAYS, CIRCLES = 360, 60
# Number of halvings of a grid step, of 1 rad at most, down to rounding.
BISECTIONS = 50


def workspace_pose(tilt: ArrayLike, azimuth: ArrayLike, phi: ArrayLike) -> Array:
    """
    Poses R_base_platform of the workspace cone, shape (..., 3, 3).

    `tilt` is the angle of the platform axis from (1, 1, 1), `azimuth` the tilt's direction about
    (1, 1, 1) from (1, -1, 0), and `phi` the self-rotation, the third ZXZ angle, all rad and
    broadcast together. InputError if one is not finite, or the shapes do not broadcast.
    """
    tilts, azimuths = check_angles('tilt', tilt, ()), check_angles('azimuth', azimuth, ())
    check_broadcast('tilt, azimuth', tilts.shape, azimuths.shape)
    direction = (np.cos(azimuths)[..., None] * TILT_DIRECTIONS[0]
                 + np.sin(azimuths)[..., None] * TILT_DIRECTIONS[1])
    axis = np.cos(tilts)[..., None] * CONE_AXIS + np.sin(tilts)[..., None] * direction
    x, y, z = np.moveaxis(axis, -1, 0)
    return matrix_from_zxz(np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z), phi)


def singularity_locus(phi: float, half_angle: float, geometry: Geometry = PAPER_GEOMETRY,
                      working_mode: Sequence[int] = RIG_WORKING_MODE) -> tuple[Array, Array]:
    """
    Parallel singularities of the workspace cone at one self-rotation (the lines of Figs. 6, 7).

    `phi` is the self-rotation and `half_angle` that of the cone, at most pi, rad. det A is
    followed along rays from the centre and along circles about it; each change of sign is
    bisected. Returned are tilt and azimuth of the singularities, rad, shape (n,), as in
    `workspace_pose`, by azimuth; n may be 0. Errors as of `inverse`.
    """
    angle, half = check_angles('phi', phi, ()), check_angles('half_angle', half_angle, ())
    if angle.ndim or half.ndim or not 0.0 < half <= math.pi:
        raise InputError(f'phi = {quoted(phi)}, half_angle = {quoted(half_angle)}: expected one '
                         'angle each in rad, and half_angle in ]0, pi]')

    def determinant(points: Array) -> Array:
        return parallel_determinant(
            workspace_pose(points[0], points[1], angle), geometry, working_mode)

    grid = cone_grid(float(half), RAYS, CIRCLES)
    found = []
    for low, high, side, _ in changes_of_sign(grid, determinant(grid)):
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            before = determinant(middle) * side > 0.0
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        found.append(0.5 * (low + high))
    tilt, azimuth = np.concatenate(found, axis=1)
    order = np.argsort(azimuth, kind='stable')
    return tilt[order], azimuth[order]


def cone_grid(half_angle: float, rays: int, circles: int) -> Array:
    """Return tilts and azimuths, rad, on rays and circles, (2, rays + 1, circles + 1)."""
    return np.stack(np.meshgrid(
        np.linspace(0.0, half_angle, circles + 1), 2.0 * math.pi * np.arange(rays + 1) / rays))


def changes_of_sign(points: Array, values: Array) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield neighbouring points, (2, n), and their values, (n,): along the rays, the circles."""
    for here, there in ((np.s_[:-1, :-1], np.s_[:-1, 1:]), (np.s_[:-1, 1:], np.s_[1:, 1:])):
        changed = values[here] * values[there] < 0.0
        one, other = (np.stack([grid[place][changed] for grid in points])
                      for place in (here, there))
        yield one, other, values[here][changed], values[there][changed]
