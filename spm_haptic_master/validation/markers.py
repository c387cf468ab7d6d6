# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientation of the platform from four markers, by the method of the paper's Fig. 29."""

from __future__ import annotations

import numpy as np
from spm_haptic_master.exceptions import InputError

# Least distance of A from B, and of C and D from the axis, as a part of the largest distance of
# two markers: below it a direction is only noise.
LEAST_DISTANCE = 0.05


def split(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the unit vectors, (n, 3), of the axis Z_E and of the projections of C and D across it.

    `coordinates`, (n, 12), are of the markers A and B on that axis (B farther out), C and D
    beside it, in any unit. InputError where A and B coincide, or C or D is on the axis.
    """
    a, b, c, d = np.moveaxis(coordinates.reshape(-1, 4, 3), 1, 0)
    span = float(np.median(
        np.linalg.norm(coordinates.reshape(-1, 4, 3) - a[:, None], axis=-1).max(-1)))
    axis = _unit(b - a, span, 'A and B coincide')
    toward_c, toward_d = (_unit(_reject(marker - a, axis), span, f'{name} lies on the axis A-B')
                          for name, marker in (('C', c), ('D', d)))
    return axis, toward_c, toward_d


def _reject(vectors: np.ndarray, axis: np.ndarray) -> np.ndarray:
    return vectors - np.sum(vectors * axis, axis=-1, keepdims=True) * axis


def _unit(vectors: np.ndarray, span: float, problem: str) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not (length > LEAST_DISTANCE * span).all():
        raise InputError(f'markers: {problem}')
    return vectors / length


def orientation(coordinates: np.ndarray, azimuths: tuple[float, float]) -> np.ndarray:
    """
    Return the platform's orientation in the frame of the coordinates, shape (n, 3, 3).

    `azimuths` are those of C and D about Z_E, rad from the platform's x axis.
    """
    axis, toward_c, toward_d = split(coordinates)
    from_c, from_d = (
        np.cos(azimuth) * toward - np.sin(azimuth) * np.cross(axis, toward)
        for azimuth, toward in zip(azimuths, (toward_c, toward_d), strict=True))
    x = from_c + from_d
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def self_rotation(coordinates: np.ndarray, azimuths: tuple[float, float],
                  frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the ZXZ angles, rad, (n,): phi is the average of those of C and D (Fig. 29).

    `frame` is the orientation of the base frame in that of the coordinates, (3, 3).
    """
    axis, toward_c, toward_d = (vectors @ frame for vectors in split(coordinates))
    x, y, z = axis.T
    psi, theta = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
    # Line of nodes, from which the self-rotation is measured.
    nodes = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1)
    beside = np.cross(axis, nodes)
    first, second = (
        np.arctan2(np.sum(toward * beside, -1), np.sum(toward * nodes, -1)) - azimuth
        for toward, azimuth in zip((toward_c, toward_d), azimuths, strict=True))
    apart = np.angle(np.exp(1j * (second - first)))
    return psi, theta, np.angle(np.exp(1j * (first + 0.5 * apart)))
