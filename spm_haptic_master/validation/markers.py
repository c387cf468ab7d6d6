# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Orientation of the platform from four markers, as the paper's Fig. 29 has it."""

from __future__ import annotations

import numpy as np

from spm_haptic_master.exceptions import InputError

# Least distance of A from B, and of C and D from the axis, in the largest distance of two markers:
# below it a direction is nothing but noise.
LEAST_DISTANCE = 0.05


def split(coordinates: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the axis Z_E and the projections of C and D across it.

    Parameters
    ----------
    coordinates : ndarray, shape (n, 12)
        Of the markers A and B, on the axis of the platform (B farther out), C and D beside it.

    Returns
    -------
    axis, toward_c, toward_d : ndarray, shape (n, 3)
        Unit vectors, in the frame of the coordinates; the last two are at right angles to the axis.

    Raises
    ------
    InputError
        Markers that coincide, or C or D on the axis.

    """
    a, b, c, d = np.moveaxis(coordinates.reshape(-1, 4, 3), 1, 0)
    span = np.median(np.linalg.norm(coordinates.reshape(-1, 4, 3) - a[:, None], axis=-1).max(-1))
    axis = _unit(b - a, span, 'A and B coincide')
    across = [_unit(_reject(marker - a, axis), span, f'{name} lies on the axis A-B')
              for name, marker in (('C', c), ('D', d))]
    return axis, *across


def _reject(vectors, axis):
    return vectors - np.sum(vectors * axis, axis=-1, keepdims=True) * axis


def _unit(vectors, span, complaint):
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    if not (length > LEAST_DISTANCE * span).all():
        raise InputError(f'markers: {complaint}')
    return vectors / length


def orientation(coordinates: np.ndarray, azimuths: tuple[float, float]) -> np.ndarray:
    """
    Return the platform's orientation in the frame of the coordinates, shape (n, 3, 3).

    Parameters
    ----------
    coordinates : ndarray, shape (n, 12)
        As of `split`.
    azimuths : tuple of two float
        Where C and D stand about Z_E, rad from the platform's x axis.

    """
    axis, toward_c, toward_d = split(coordinates)
    x = sum(np.cos(azimuth) * toward - np.sin(azimuth) * np.cross(axis, toward)
            for azimuth, toward in zip(azimuths, (toward_c, toward_d), strict=True))
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def self_rotation(coordinates: np.ndarray, azimuths: tuple[float, float],
                  frame: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Euler angles from the markers: phi of C and of D by projection, and their average (Fig. 29).

    Parameters
    ----------
    coordinates : ndarray, shape (n, 12)
        As of `split`.
    azimuths : tuple of two float
        As of `orientation`.
    frame : ndarray, shape (3, 3)
        Rotation of the base frame in that of the coordinates.

    Returns
    -------
    psi, theta, phi : ndarray, shape (n,)
        ZXZ, rad.

    """
    axis, *across = (vectors @ frame for vectors in split(coordinates))
    x, y, z = axis.T
    psi, theta = np.arctan2(x, -y), np.arctan2(np.hypot(x, y), z)
    # The line of nodes: what self-rotation is counted from.
    nodes = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1)
    beside = np.cross(axis, nodes)
    first, second = (
        np.arctan2(np.sum(toward * beside, -1), np.sum(toward * nodes, -1)) - azimuth
        for toward, azimuth in zip(across, azimuths, strict=True))
    apart = np.angle(np.exp(1j * (second - first)))
    return psi, theta, np.angle(np.exp(1j * (first + 0.5 * apart)))
