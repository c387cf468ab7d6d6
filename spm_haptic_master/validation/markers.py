# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientation of the platform from four markers, by the method of the paper's Fig. 29."""

from __future__ import annotations

import numpy as np
from spm_haptic_master.exceptions import InputError

# Least distance of A from B, and of C and D from the axis, as a part of the largest distance of
# two markers: below it a direction is only noise.
LEAST_DISTANCE = 0.05


def orientation(coordinates: np.ndarray, azimuths: tuple[float, float]) -> np.ndarray:
    """
    Return the platform's orientation in the frame of the coordinates, shape (n, 3, 3).

    `coordinates`, (n, 12), are of the markers A and B on the axis Z_E (B farther out), C and D
    beside it, in any unit; `azimuths` are those of C and D about Z_E, rad from the platform's x
    axis. The self-rotation is the average of those of C and D (Fig. 29). InputError where A and B
    coincide, or C or D is on the axis.
    """
    a, b, c, d = np.moveaxis(coordinates.reshape(-1, 4, 3), 1, 0)
    span = float(np.median(
        np.linalg.norm(coordinates.reshape(-1, 4, 3) - a[:, None], axis=-1).max(-1)))
    axis = _unit(b - a, span, 'A and B coincide')
    x = np.zeros_like(axis)
    for name, marker, azimuth in zip('CD', (c, d), azimuths, strict=True):
        toward = marker - a
        toward = _unit(toward - np.sum(toward * axis, axis=-1, keepdims=True) * axis, span,
                       f'{name} lies on the axis A-B')
        x += np.cos(azimuth) * toward - np.sin(azimuth) * np.cross(axis, toward)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def _unit(vectors: np.ndarray, span: float, problem: str) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not (length > LEAST_DISTANCE * span).all():
        raise InputError(f'markers: {problem}')
    return vectors / length
