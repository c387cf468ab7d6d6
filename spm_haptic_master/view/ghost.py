# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What three encoders alone would report, beside the device: in violet, where it differs."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description import solids
from spm_haptic_master.description.colours import THREE_ENCODERS
from spm_haptic_master.description.solids import Solid
from spm_haptic_master.description.three_encoders import angle_of
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.view import surfaces
from spm_haptic_master.view.surfaces import rgb
from viser import SceneApi

# Error below which nothing is drawn (rad): noise of three encoders clear of the singularity.
LEAST_ERROR = radians(1.0)
# Opacities of the platform and of the sector; size that keeps it in front of the platform.
OPACITY = 0.55
SECTOR_OPACITY = 0.6
LARGER = 1.012
# Flag above the handle and the dome, along the platform's x, the hand of the self-rotation: plates
# from a corner to the opposite one (unit SIZE).
POLE = (-0.02, -0.02, 1.6), (0.02, 0.02, 2.06)
CLOTH = (0.0, -0.014, 1.9), (0.86, 0.014, 2.06)
# The flag of three encoders is above that of the device: neither hides the other one.
GHOST_POLE = (-0.02, -0.02, 2.06), (0.02, 0.02, 2.22)
GHOST_CLOTH = (0.0, -0.014, 2.08), (0.86, 0.014, 2.22)
# Sector between the two flags: radius, height on the handle, number of triangles; where its words
# are (units of the scene).
SECTOR_RADIUS = 0.86
SECTOR_HEIGHT = 2.07
SECTOR_PARTS = 24
WORDS_AT = 1.15


def flag() -> Solid:
    """Return the flag above the handle, which is seen from far (m)."""
    return solids.together(_box(*POLE), _box(*CLOTH))


def ghost_flag() -> Solid:
    """Return the flag of three encoders alone (m)."""
    return solids.together(_box(*GHOST_POLE), _box(*GHOST_CLOTH))


def _box(
    low: Sequence[float],
    high: Sequence[float],
) -> Solid:
    """Return a box between two opposite corners, unit SIZE."""
    corners = list(product(*zip(low, high, strict=True)))
    # Corner numbers: 4 for the far x, 2 for the larger y, 1 for the larger z.
    faces = (
        (0, 1, 3, 2),
        (4, 6, 7, 5),
        (0, 4, 5, 1),
        (2, 3, 7, 6),
        (0, 2, 6, 4),
        (1, 5, 7, 3),
    )
    triangles = [part for a, b, c, d in faces for part in ((a, b, c), (a, c, d))]
    return Solid(solids.SIZE * np.array(corners), np.array(triangles))


class Ghost:
    """
    The platform of three encoders, and the sector between its flag and the device's.

    Parameters
    ----------
    scene : SceneApi
        The scene of the page.
    root : str
        Name of a frame of the scene with the axes of the device's platform.
    platform : Solid
        The platform without a flag, m.

    Attributes
    ----------
    platform, sector : BatchedMeshHandle
        The platform as three encoders report it, and the sector.
    words : LabelHandle
        The error in words.

    """

    def __init__(
        self,
        scene: SceneApi,
        root: str,
        platform: Solid,
    ) -> None:
        self.platform = surfaces.add(
            scene,
            f'{root}/ghost',
            solids.together(platform, ghost_flag()),
            rgb([THREE_ENCODERS.light]),
            scale=LARGER / solids.SIZE,
            opacity=OPACITY,
            visible=False,
        )
        self.sector = surfaces.add(
            scene,
            f'{root}/sector',
            sector(np.eye(3)),
            rgb([THREE_ENCODERS.light]),
            opacity=SECTOR_OPACITY,
            visible=False,
        )
        self.words = scene.add_label(
            f'{root}/sector_words',
            '',
            anchor='center-center',
            font_screen_scale=1.2,
            visible=False,
        )

    def show(self, turn: Quaternion[float] | None) -> None:
        """
        Show the platform turned from the device's; None, or a small turn: nothing.

        Parameters
        ----------
        turn : tuple of 4 float, or None
            Quaternion x, y, z, w of the orientation by three encoders, in the frame of the
            device's platform.

        """
        error = 0.0 if turn is None else angle_of(turn)
        is_shown = turn is not None and error >= LEAST_ERROR
        for part in (self.platform, self.sector, self.words):
            part.visible = is_shown
        if turn is None or not is_shown:
            return
        rotation = matrix_from_quaternion(np.array(turn))
        x, y, z, w = turn
        self.platform.wxyz = w, x, y, z
        self.sector.vertices = sector(rotation).vertices.astype(np.float32)
        middle = _directions(rotation, 2)[1]
        self.words.position = WORDS_AT * middle + (0.0, 0.0, SECTOR_HEIGHT)
        self.words.text = f'three encoders: {degrees(error):.0f}\u00b0 off'


def sector(rotation: NDArray[np.float64]) -> Solid:
    """
    Return the sector between the flags of the device and of a platform turned from it.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        Orientation by three encoders, in the frame of the device's platform.

    Returns
    -------
    Solid
        The sector in that frame, seen from both sides (units of the scene).

    """
    rim = SECTOR_RADIUS * _directions(rotation, SECTOR_PARTS)
    corners = np.concatenate([np.zeros((1, 3)), rim]) + (0.0, 0.0, SECTOR_HEIGHT)
    here = np.arange(1, SECTOR_PARTS + 1)
    return surfaces.two_sided(Solid(corners, np.stack([np.zeros_like(here), here, here + 1], 1)))


def _directions(
    rotation: NDArray[np.float64],
    parts: int,
) -> NDArray[np.float64]:
    """Return unit vectors from x to the turned x, in equal steps, shape (parts + 1, 3)."""
    begin = np.array([1.0, 0.0, 0.0])
    end = rotation[:, 0]
    side = end - (begin @ end) * begin
    length = float(np.linalg.norm(side))
    # Opposite or equal: any side will do.
    if length > 1e-9:
        side = side / length
    else:
        side = np.array([0.0, 1.0, 0.0])
    angles = np.linspace(0.0, np.arctan2(length, begin @ end), parts + 1)[:, None]
    directions: NDArray[np.float64] = np.cos(angles) * begin + np.sin(angles) * side
    return directions
