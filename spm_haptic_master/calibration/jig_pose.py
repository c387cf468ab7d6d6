# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts from a known pose: what the encoders say while a static jig holds the device.

A static pose fixes the zero counts for given directions. It cannot tell a direction: with the
wrong one a zero count exists as well, and the angle is right at that pose and wrong everywhere
else. A second pose tells, for every joint that it moves far enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np

from spm_haptic_master.encoders.encoder_layout import angle_from_counts, TURN
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import JOINT_NAMES

# Fewer sets tell neither noise nor motion.
SETS_MINIMUM = 100
# The recording is cut into so many pieces, and the device moved where their means differ.
PIECES = 10
# Of the pieces' means, in their own standard deviations: what noise alone does not reach in years.
MEANS_SIGMAS = 8.0
# rad; how far a joint has to move between two poses to tell its direction.
TRAVEL_MINIMUM = radians(1.0)


@dataclass(frozen=True, slots=True)
class Reading:
    """
    What one encoder said at rest.

    Attributes
    ----------
    counts : float
        Mean.
    sigma : float
        Noise, rad, 1 standard deviation.
    drift : float
        rad; largest difference between the means of the recording's pieces.

    """

    counts: float
    sigma: float
    drift: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """
    Zero counts, and what they rest on.

    Attributes
    ----------
    date : str
        ISO 8601, with the offset to UTC.
    pose : tuple of 3 float
        psi, theta, phi (ZXZ) of the jig, rad.
    counts, sigma : tuple of 4 float
        Mean counts, and noise in rad, of each sensor at that pose.
    direction, zero_count, counts_per_turn : tuple of 4 int
        As the driver takes them.
    direction_checked : tuple of 4 bool
        A second pose confirmed the direction.
    sets : int
        Sets averaged.

    """

    date: str
    pose: tuple[float, ...]
    counts: tuple[float, ...]
    sigma: tuple[float, ...]
    direction: tuple[int, ...]
    zero_count: tuple[int, ...]
    counts_per_turn: tuple[int, ...]
    direction_checked: tuple[bool, ...]
    sets: int


def read_still(counts: Sequence[Sequence[int]], counts_per_turn: Sequence[int],
               noise_limit: float, drift_limit: float) -> tuple[Reading, ...]:
    """
    Return what each encoder said, if the device stood still.

    Parameters
    ----------
    counts : sequence of sets of 4 int
        In the order of JOINT_NAMES, each in [0, counts_per_turn).
    counts_per_turn : sequence of 4 int
        Scale.
    noise_limit : float
        rad; more noise (1 sigma) than this is refused.
    drift_limit : float
        rad; a device whose joints moved further is refused.

    Raises
    ------
    CalibrationError
        Too few sets, a sensor that is noisy, dead or wraps, a device that moved.

    """
    table = np.asarray(counts)
    if len(table) < SETS_MINIMUM:
        raise CalibrationError(f'{len(table)} sets of four encoders; at least {SETS_MINIMUM} '
                               'are needed')
    readings = tuple(_read_one(joint, table[:, index], counts_per_turn[index])
                     for index, joint in enumerate(JOINT_NAMES))
    piece = len(table) // PIECES
    for joint, reading in zip(JOINT_NAMES, readings, strict=True):
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


def _read_one(joint: str, counts: np.ndarray, per_turn: int) -> Reading:
    if counts.max() - counts.min() > per_turn // 2:
        raise CalibrationError(
            f'{joint} wraps: its counts pass from {per_turn - 1} to 0 at this pose; turn the '
            'encoder on its shaft, or set its preset (CiA 406, object 0x6003)')
    # From one set to the next: slow motion does not count as noise.
    steps = np.diff(counts)
    noise = float(np.sqrt(np.mean(steps * steps) / 2.0))
    means = [float(piece.mean()) for piece in np.array_split(counts, PIECES)]
    scale = TURN / per_turn
    return Reading(float(counts.mean()), noise * scale, (max(means) - min(means)) * scale)


def calibrate(readings: Sequence[Reading], angles: Sequence[float], direction: Sequence[int],
              counts_per_turn: Sequence[int], date: str, pose: Sequence[float], sets: int,
              before: Calibration | None = None) -> Calibration:
    """
    Return the zero counts that make the readings the jig's joint angles.

    Parameters
    ----------
    readings : sequence of 4 Reading
        From `read_still`.
    angles : sequence of 4 float
        The joint angles of the jig's pose, rad.
    direction, counts_per_turn : sequences of 4 int
        As configured; where an earlier calibration at another pose tells a direction, that counts.
    date, pose, sets
        For the record.
    before : Calibration, optional
        An earlier one.

    """
    found = list(direction)
    known = [False] * len(found)
    if before is not None:
        for index, told in enumerate(directions_told(before, readings, angles)):
            if told:
                found[index], known[index] = told, True
            elif before.direction_checked[index]:
                found[index], known[index] = before.direction[index], True
    zero = tuple(
        round(reading.counts - sign * angle * per_turn / TURN) % per_turn
        for reading, angle, sign, per_turn
        in zip(readings, angles, found, counts_per_turn, strict=True))
    return Calibration(
        date, tuple(pose), tuple(reading.counts for reading in readings),
        tuple(reading.sigma for reading in readings), tuple(found), zero, tuple(counts_per_turn),
        tuple(known), sets)


def directions_told(before: Calibration, readings: Sequence[Reading],
                    angles: Sequence[float]) -> tuple[int, ...]:
    """
    Return the direction (+1, -1) of each joint that the step between two poses tells, else 0.

    A joint tells when the jig moved it by TRAVEL_MINIMUM or more; then its counts moved by as
    much, one way or the other.

    Parameters
    ----------
    before : Calibration
        The first pose.
    readings : sequence of 4 Reading
        At the second pose.
    angles : sequence of 4 float
        Joint angles of the second pose, rad.

    """
    told = []
    for index, per_turn in enumerate(before.counts_per_turn):
        old_angle = angle_from_counts(round(before.counts[index]), before.zero_count[index],
                                      before.direction[index], per_turn)
        expected = _wrapped(angles[index] - old_angle)
        # With direction +1 and no zero count: how far the shaft turned by its counts.
        turned = angle_from_counts(
            round(readings[index].counts), round(before.counts[index]), 1, per_turn)
        if abs(expected) < TRAVEL_MINIMUM or abs(abs(turned) - abs(expected)) > 0.5 * abs(expected):
            told.append(0)
        else:
            told.append(1 if turned * expected > 0.0 else -1)
    return tuple(told)


def deviations(calibration: Calibration, readings: Sequence[Reading],
               angles: Sequence[float]) -> tuple[float, ...]:
    """Return how far each joint's angle by an earlier calibration is from the jig's, rad."""
    return tuple(
        _wrapped(angle_from_counts(round(reading.counts), zero, sign, per_turn) - angle)
        for reading, angle, zero, sign, per_turn
        in zip(readings, angles, calibration.zero_count, calibration.direction,
               calibration.counts_per_turn, strict=True))


def _wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return (angle + TURN / 2.0) % TURN - TURN / 2.0
