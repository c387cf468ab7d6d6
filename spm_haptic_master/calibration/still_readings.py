# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of encoders while a static jig holds the device: mean, noise and drift of each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, NUMBER_WORDS

# Least length of a recording (sets): fewer show neither noise nor motion.
SETS_MINIMUM = 100
# Number of pieces of a recording: the device moved if their means differ.
PIECES = 10
# Limit of the difference between the pieces' means, in their own standard deviations: noise alone
# does not reach it in years.
MEANS_SIGMAS = 8.0


@dataclass(frozen=True, slots=True)
class Reading:
    """Readings of one encoder at rest."""

    counts: float  # mean
    sigma: float  # noise, rad, 1 standard deviation
    drift: float  # largest difference between the means of the recording's pieces, rad


def read_still(counts: NDArray[np.int64], counts_per_turn: Sequence[int],
               noise_limit: float, drift_limit: float) -> tuple[Reading, ...]:
    """
    Return the mean, noise and drift of each encoder by counts, (n, N), if the device did not move.

    CalibrationError where the sets are too few, a sensor is noisier than its limit (1 sigma, rad)
    or wraps, or the device moved by more than its limit (rad).
    """
    if len(counts) < SETS_MINIMUM:
        raise CalibrationError(f'{len(counts)} sets of {NUMBER_WORDS[len(counts_per_turn)]} '
                               f'encoders; at least {SETS_MINIMUM} are needed')
    joints = ALL_JOINT_NAMES[:len(counts_per_turn)]
    readings = tuple(_read_one(joint, counts[:, index], counts_per_turn[index])
                     for index, joint in enumerate(joints))
    piece = len(counts) // PIECES
    for joint, reading in zip(joints, readings, strict=True):
        if reading.sigma > noise_limit:
            raise CalibrationError(
                f'{joint} is noisy: {degrees(reading.sigma):.3f} deg (1 sigma), '
                f'limit {degrees(noise_limit):g} deg')
        allowed = max(drift_limit, MEANS_SIGMAS * reading.sigma / piece ** 0.5)
        if reading.drift > allowed:
            raise CalibrationError(
                f'the device moved: {joint} by {degrees(reading.drift):.3f} deg, '
                f'limit {degrees(allowed):.3f} deg')
    return readings


def _read_one(joint: str, counts: NDArray[np.int64], per_turn: int) -> Reading:
    if counts.max() - counts.min() > per_turn // 2:
        raise CalibrationError(
            f'{joint} wraps: its counts pass from {per_turn - 1} to 0 at this pose; turn the '
            'encoder on its shaft, or set its preset (CiA 406, object 0x6003)')
    # Differences from one set to the next: slow motion does not count as noise.
    steps = np.diff(counts)
    noise = float(np.sqrt(np.mean(steps * steps) / 2.0))
    means = [float(piece.mean()) for piece in np.array_split(counts, PIECES)]
    scale = TURN / per_turn
    return Reading(float(counts.mean()), noise * scale, (max(means) - min(means)) * scale)
