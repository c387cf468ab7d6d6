# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether an encoder slipped on its shaft, or drifted, while the motion was recorded."""

from __future__ import annotations

from math import degrees

import numpy as np
from spm_haptic_master.calibration.motion.coverage import inverse
from spm_haptic_master.calibration.motion.fit import Fit, normal_equations
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

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


def check_slip(model: MotionModel, turned: Array, seconds: Array, found: Fit) -> None:
    """
    Raise CalibrationError where a slip or a drift explains what a fit leaves; name the sensor.

    For each sensor and each time, a change of its zero from then on is one more parameter, and so
    is a drift from the beginning to the end. What it improves, and its value, follow from the
    normal equations of the pieces. The zeros are the first parameters that were estimated.
    """
    rotation, vector, places = found.normal.rotation, found.vector, np.array(found.columns)
    weights = model.layout.deviations[places] ** -2.0
    pieces = [normal_equations(model, turned[rows], rotation[rows], vector, found.columns, LIMIT)
              for rows in np.array_split(np.arange(len(turned)), PIECES)]
    matrices = np.stack([piece.matrix for piece in pieces])
    rights = np.stack([piece.right for piece in pieces])
    right = rights.sum(axis=0) + vector[places] * weights
    covariance = inverse(matrices.sum(axis=0) + np.diag(weights))
    beyond = sum(float(np.nansum(piece.parity[piece.kept] ** 2)) - piece.parity[piece.kept].size
                 for piece in pieces)
    least = max(LEAST_IMPROVEMENT, LEAST_PART * beyond)
    # The part of the change that a piece has: after each piece all of it, or more and more.
    steps = np.tri(PIECES, PIECES - 1, -1).T
    shares = np.vstack([steps, (np.arange(PIECES) + 0.5) / PIECES])
    times = [*(float(piece[0]) for piece in np.array_split(seconds, PIECES)[1:]), None]
    slips: list[tuple[float, int, float, float | None]] = []
    for share, time in zip(shares, times, strict=True):
        after, twice = (np.tensordot(part, matrices, 1) for part in (share, share ** 2))
        change = share @ rights
        for sensor in range(model.layout.sensors):
            along = after[:, sensor]
            size = float(twice[sensor, sensor] - along @ covariance @ along)
            slope = float(change[sensor] - along @ covariance @ right)
            if size > 0.0 and slope ** 2 / size > least:
                slips.append((slope ** 2 / size, sensor, -slope / size, time))
    if not slips:
        return
    explained, sensor, slip, time = max(slips, key=lambda each: each[0])
    alone = {each for part, each, _, _ in slips if part > (1.0 - AS_GOOD) * explained} == {sensor}
    what = 'drifted' if time is None else 'slipped'
    who = f'{ALL_JOINT_NAMES[sensor]} {what} by {degrees(slip):+.2f} deg' if alone \
        else f'one of the encoders {what}'
    raise CalibrationError(
        f'{who} during the motion' + (
            '; let it warm up, check its coupling and move the device again' if time is None else
            f', about {time:.0f} s after its beginning; fasten the encoder and move the device '
            'again'))
