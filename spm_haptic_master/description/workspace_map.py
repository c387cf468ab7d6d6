# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Dexterity and parallel singularities over the workspace's cone, at one self-rotation."""

from __future__ import annotations

from math import cos, pi, radians, sqrt

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.workspace import changes_of_sign

# Half angle of the cone (rad).
HALF_ANGLE = radians(26.0)
# Tiles of the map.
TILES = 480
# Rays and circles of the search for singularities, with det A linear between two points: it looks
# like `singularity_locus` at a tenth of its cost.
RAYS = 72
CIRCLES = 12
# Turn from one tile to the next about the cone's axis (rad): the golden angle fills a disc evenly.
GOLDEN_ANGLE = pi * (3.0 - sqrt(5.0))
# Dexterity above which the colour does not change (unit 1).
FULL = 0.2
# Colours, red, green, blue, of dexterity 0, FULL / 2, FULL, and of poses out of reach.
COLOURS = np.array(
    [
        (150, 0, 20),
        (225, 160, 30),
        (20, 95, 160),
    ],
    dtype=float,
)
UNREACHABLE = np.array([200, 200, 200], dtype=np.uint8)


class WorkspaceMap:
    """
    The map of a mechanism: the cone of the workspace in tiles of equal area.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    Attributes
    ----------
    axes : ndarray, shape (TILES, 3)
        Platform axes of the tiles, unit vectors in the base frame.

    """

    def __init__(self, geometry: kinematics.Geometry, working_mode: WorkingMode) -> None:
        self._geometry = geometry
        self._working_mode = working_mode
        number = np.arange(TILES) + 0.5
        # Equal areas of the sphere.
        height = (1.0 - cos(HALF_ANGLE)) * number / TILES
        self._tilts = np.arccos(1.0 - height)
        self._azimuths = np.mod(GOLDEN_ANGLE * number, 2.0 * pi)
        poses = kinematics.workspace_pose(self._tilts, self._azimuths, 0.0)
        self.axes: NDArray[np.float64] = poses[..., 2]

    def colours(self, phi: float) -> NDArray[np.uint8]:
        """
        Return the tiles' colours, shape (TILES, 3), by the dexterity of three sensors.

        Parameters
        ----------
        phi : float
            Self-rotation of the platform, rad.

        Returns
        -------
        ndarray of uint8, shape (TILES, 3)
            Red, green, blue, 0 .. 255; UNREACHABLE where a leg does not reach the pose.

        """
        poses = kinematics.workspace_pose(self._tilts, self._azimuths, phi)
        eta = kinematics.dexterity(poses, self._geometry, self._working_mode)
        reached = np.isfinite(eta)
        steps = np.linspace(0.0, FULL, len(COLOURS))
        channels = []
        for channel in COLOURS.T:
            channels.append(np.interp(eta[reached], steps, channel))
        colours = np.tile(UNREACHABLE, (TILES, 1))
        colours[reached] = np.stack(channels, axis=1)
        return colours

    def singular_axes(self, phi: float) -> NDArray[np.float64]:
        """
        Return the platform axes at a parallel singularity, unit vectors, shape (n, 3).

        Parameters
        ----------
        phi : float
            Self-rotation of the platform, rad.

        Returns
        -------
        ndarray, shape (n, 3)
            z of the platform in the base frame, where det A changes its sign; n may be 0.

        """

        def determinant(points: NDArray[np.float64]) -> NDArray[np.float64]:
            tilts, azimuths = points
            poses = kinematics.workspace_pose(tilts, azimuths, phi)
            return kinematics.parallel_determinant(poses, self._geometry, self._working_mode)

        found = changes_of_sign(
            function=determinant,
            half_angle=HALF_ANGLE,
            rays=RAYS,
            circles=CIRCLES,
        )
        difference = found.here_value - found.there_value
        share = found.here_value / difference
        tilts, azimuths = (1.0 - share) * found.here + share * found.there
        poses = kinematics.workspace_pose(tilts, azimuths, phi)
        axes: NDArray[np.float64] = poses[..., 2]
        return axes


def colour_bar() -> dict[str, list[str]]:
    """
    Return the colours of the map in CSS, and their labels.

    Returns
    -------
    dict
        `colours` and `words`: of dexterity 0, FULL / 2, and FULL.

    """
    colours = []
    for red, green, blue in COLOURS:
        colours.append(f'rgb({red:.0f},{green:.0f},{blue:.0f})')
    return {
        'colours': colours,
        'words': [
            '0: singular',
            f'{FULL / 2:g}',
            f'{FULL:g} and more',
        ],
    }
