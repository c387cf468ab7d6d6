# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What a fit leaves that is no white noise: play, higher harmonics, a mechanism of another kind.

Such errors change with the pose and not from sample to sample, so that the mean parity of a piece
of the motion keeps them, while its white noise averages out.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.fit import Fit, Normal, normal_equations
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.kinematics import zxz_from_matrix

# Length of the pieces of the motion (s).
SLOW_SECONDS = 0.5
# Part of the pieces whose mean parity is covered (percent), and as many of a normal distribution
# (standard deviations).
PERCENT, NORMAL_DEVIATIONS = 99.0, 2.58
# Samples from which the sensors' parts of the parity are taken.
SAMPLES = 500


def slow_factor(seconds: Array, normal: Normal) -> float:
    """Return the variance of pieces' mean parities over that of white noise; 1 at least."""
    means, counts = _piece_means(seconds, normal)
    return max(1.0, float(np.mean(counts[:, None] * means ** 2)))


def unexplained_errors(model: MotionModel, turned: Array, seconds: Array, vector: Array,
                       normal: Normal) -> Array:
    """
    Return the error of each sensor if it alone causes what is slow in the parity, rad, (N,).

    As large as 99 % of the pieces have it; the model has white noise, `normal` is of the result.
    """
    means, counts = _piece_means(seconds, normal)
    enough = counts > 0.5 * np.median(counts)
    size = np.linalg.norm(means[enough], axis=1)
    white = NORMAL_DEVIATIONS ** 2 / float(np.median(counts))
    slow = np.sqrt(max(0.0, float(np.percentile(size, PERCENT)) ** 2 - white))
    rows = np.flatnonzero(normal.kept)
    rows = rows[::max(1, len(rows) // SAMPLES)]
    zeros = tuple(range(model.layout.sensors))
    parts = model.linearised(turned[rows], normal.rotation[rows], vector, zeros).derivative
    found: Array = slow / np.sqrt(np.mean(np.sum(parts ** 2, axis=1), axis=0))
    return found


def contradiction(model: MotionModel, turned: Array, found: Fit) -> float:
    """
    Return by how much halves of the motion contradict each other: variance over noise's (unit 1).

    The halves are those of the tilt in two directions and of the self-rotation. A mechanism that
    is not that of the model has other parameters in each; about 1 or less is noise.
    """
    rotation, columns = found.normal.rotation, np.array(found.columns)
    turn = np.exp(1j * zxz_from_matrix(np.nan_to_num(rotation))[2])
    places = np.column_stack([rotation[:, 0, 2], rotation[:, 1, 2],
                              np.angle(turn * np.conj(turn.sum()))])
    above = places > np.nanmedian(places, axis=0)
    octant = above @ [1, 2, 4]
    parts = {each: normal_equations(model, turned[octant == each], rotation[octant == each],
                                    found.vector, found.columns, found.normal.limit)
             for each in np.unique(octant).tolist()}
    # Each half has half of what was known before.
    weights = 0.5 * model.layout.deviations[columns] ** -2.0
    largest = 0.0
    for axis in range(3):
        changes, covariances = [], []
        for side in (0, 1):
            half = [part for each, part in parts.items() if each >> axis & 1 == side]
            covariance = inverse(sum(part.matrix for part in half) + np.diag(weights))
            right = sum(part.right for part in half) + weights * found.vector[columns]
            changes.append(covariance @ right)
            covariances.append(covariance)
        difference = changes[0] - changes[1]
        size = difference @ np.linalg.solve(sum(covariances), difference)
        largest = max(largest, float(size) / len(columns))
    return largest


def _piece_means(seconds: Array, normal: Normal) -> tuple[Array, NDArray[np.intp]]:
    """Return the mean parities of the pieces, shape (m, N - 3), and their numbers of samples."""
    kept = normal.kept
    piece = np.unique(np.floor(seconds[kept] / SLOW_SECONDS), return_inverse=True)[1]
    counts = np.bincount(piece)
    sums = np.column_stack([np.bincount(piece, column) for column in normal.parity[kept].T])
    return sums / counts[:, None], counts
