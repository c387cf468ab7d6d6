# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether an encoder slipped on its shaft, or drifted, while the motion was recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import degrees

import numpy as np
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.joints import ALL_JOINT_NAMES

# Number of pieces of the motion; a slip is sought at the end of each.
PIECES = 60
# Least improvement of the squared parities by a slip (unit 1), and least part of what they have
# beyond noise that it explains: play and unknown harmonics are explained by no slip.
LEAST_IMPROVEMENT, LEAST_PART = 100.0, 0.3
# Part of what the best hypothesis explains within which another one is as good (unit 1): slips lie
# within a piece, and near an end of the motion few poses distinguish the sensors.
AS_GOOD = 0.1
# Parity beyond which a sample does not count (unit 1): a spike that passed.
LIMIT = 300.0


@dataclass(frozen=True, slots=True)
class SlipInMotion:
    """
    A change of one zero during the recording.

    Attributes
    ----------
    sensor : int or None
        Number of the sensor, from 0 on; None where several explain it as well.
    slip : float
        Change of its zero, rad.
    seconds : float or None
        Time of a slip, s since the first set, to a piece of the motion; None for a drift over the
        whole motion.

    """

    sensor: int | None
    slip: float
    seconds: float | None

    @property
    def text(self) -> str:
        """Return what happened and what to do, in one line."""
        what = 'slipped' if self.seconds is not None else 'drifted'
        who = f'one of the encoders {what}' if self.sensor is None else \
            f'{ALL_JOINT_NAMES[self.sensor]} {what} by {degrees(self.slip):+.2f} deg'
        if self.seconds is None:
            return (f'{who} during the motion; let it warm up, check its coupling and move the '
                    'device again')
        return (f'{who} during the motion, about {self.seconds:.0f} s after its beginning; fasten '
                'the encoder and move the device again')


def slip_in_motion(model: MotionModel, turned: Array, rotation: Array, seconds: Array,
                   vector: Array, columns: tuple[int, ...],
                   deviations: Array) -> SlipInMotion | None:
    """
    Return the slip or drift that explains what a fit leaves, None if none does.

    For each sensor and each time, a change of its zero from then on is one more parameter, and so
    is a drift from the beginning to the end. What it improves, and its value, follow from the
    normal equations of the pieces.

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
    least = max(LEAST_IMPROVEMENT, LEAST_PART * beyond)
    # The part of the change that a piece has: after each piece all of it, or more and more.
    steps = np.tri(PIECES, PIECES - 1, -1).T
    shares = np.vstack([steps, (np.arange(PIECES) + 0.5) / PIECES])
    times = [*(float(piece[0]) for piece in np.array_split(seconds, PIECES)[1:]), None]
    found = []
    for share, time in zip(shares, times, strict=True):
        after, twice = (np.tensordot(weights, matrices, 1) for weights in (share, share ** 2))
        change = share @ rights
        for sensor in range(model.layout.sensors):
            along = after[:, sensor]
            size = float(twice[sensor, sensor] - along @ covariance @ along)
            slope = float(change[sensor] - along @ covariance @ right)
            if size > 0.0 and slope ** 2 / size > least:
                found.append((slope ** 2 / size, SlipInMotion(sensor, -slope / size, time)))
    if not found:
        return None
    explained, best = max(found, key=lambda each: each[0])
    near = {each.sensor for part, each in found if part > (1.0 - AS_GOOD) * explained}
    return best if len(near) == 1 else replace(best, sensor=None)
