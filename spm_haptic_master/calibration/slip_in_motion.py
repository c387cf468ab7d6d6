# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether an encoder slipped on its shaft while the motion was recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from spm_haptic_master.calibration.mechanism_parameters import Array
from spm_haptic_master.calibration.motion_coverage import inverse
from spm_haptic_master.calibration.motion_fit import normal_equations
from spm_haptic_master.calibration.motion_model import MotionModel

# Number of pieces of the motion; a slip is sought at the end of each.
PIECES = 20
# Least improvement of the squared parities by a slip (unit 1), and least part of what they have
# beyond noise that it explains: play and unknown harmonics are explained by no slip.
LEAST_IMPROVEMENT, LEAST_PART = 100.0, 0.3
# Parity beyond which a sample does not count (unit 1): a spike that passed.
LIMIT = 300.0


@dataclass(frozen=True, slots=True)
class SlipInMotion:
    """
    A slip during the recording.

    Attributes
    ----------
    sensor : int
        Number of the sensor, from 0 on.
    slip : float
        Change of its zero, rad.
    seconds : float
        Time of it, s since the first set, to a piece of the motion.

    """

    sensor: int
    slip: float
    seconds: float


def slip_in_motion(model: MotionModel, turned: Array, rotation: Array, seconds: Array,
                   vector: Array, columns: tuple[int, ...],
                   deviations: Array) -> SlipInMotion | None:
    """
    Return the slip that explains what a fit leaves, None if none does.

    For each sensor and each time, a change of its zero from then on is one more parameter. What
    it improves, and its value, follow from the normal equations of the pieces.

    Parameters
    ----------
    model : MotionModel
        Mechanism with encoders, with white noise.
    turned, rotation : ndarray, shape (n, N), (n, 3, 3)
        Readings by their directions, rad, and orientations.
    seconds : ndarray, shape (n,)
        Times, s.
    vector : ndarray, shape (P,)
        Result of the fit.
    columns : tuple of int
        Parameters that were estimated, the zeros first.
    deviations : ndarray, shape (P,)
        Standard deviations before the fit, rad; inf: none.

    """
    pieces = [normal_equations(model, turned[rows], rotation[rows], vector, columns, LIMIT)
              for rows in np.array_split(np.arange(len(turned)), PIECES)]
    matrices = np.stack([piece.matrix for piece in pieces])
    rights = np.stack([piece.right for piece in pieces])
    matrix = matrices.sum(axis=0)
    places = np.array(columns)
    right = rights.sum(axis=0) + vector[places] * deviations[places] ** -2.0
    covariance = inverse(matrix + np.diag(deviations[places] ** -2.0))
    beyond = sum(float(np.nansum(piece.parity[piece.kept] ** 2)) - piece.parity[piece.kept].size
                 for piece in pieces)
    best, found = max(LEAST_IMPROVEMENT, LEAST_PART * beyond), None
    starts = np.array_split(seconds, PIECES)
    for number in range(1, PIECES):
        after, change = matrices[number:].sum(axis=0), rights[number:].sum(axis=0)
        for sensor in range(model.layout.sensors):
            along = after[:, sensor]
            size = float(after[sensor, sensor] - along @ covariance @ along)
            slope = float(change[sensor] - along @ covariance @ right)
            if size > 0.0 and slope ** 2 / size > best:
                best = slope ** 2 / size
                found = SlipInMotion(sensor, -slope / size, float(starts[number][0]))
    return found
