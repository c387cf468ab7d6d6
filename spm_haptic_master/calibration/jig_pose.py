# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts from a known pose: the readings of the encoders while a static jig holds the device.

A static pose determines the zero counts for given directions. It does not determine a direction:
with the wrong one there is a zero count as well, and the angle is right at that pose and wrong
everywhere else. A second pose determines the direction of every joint that it moves far enough.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from spm_haptic_master.encoders.encoder_layout import angle_from_counts, TURN
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, inverse_angles, zxz_rotation

# Least length of a recording (sets): fewer show neither noise nor motion.
SETS_MINIMUM = 100
# Number of pieces of a recording: the device moved if their means differ.
PIECES = 10
# Limit of the difference between the pieces' means, in their own standard deviations: noise alone
# does not reach it in years.
MEANS_SIGMAS = 8.0
# Least motion of a joint between two poses (rad) that determines its direction.
TRAVEL_MINIMUM = radians(1.0)
# Largest difference between the motion by the counts and the motion by the poses, as a part of
# the latter: beyond it the encoder slipped on its shaft.
TRAVEL_MISMATCH = 0.5


@dataclass(frozen=True, slots=True)
class Reading:
    """
    Readings of one encoder at rest.

    Attributes
    ----------
    counts : float
        Mean of the counts.
    sigma : float
        Noise, rad, 1 standard deviation.
    drift : float
        Largest difference between the means of the recording's pieces, rad.

    """

    counts: float
    sigma: float
    drift: float


@dataclass(frozen=True, slots=True)
class Calibration:
    """
    Zero counts, and the readings that they were computed from.

    Attributes
    ----------
    date : str
        Time of the calibration, ISO 8601 with the offset to UTC.
    pose : tuple of 3 float
        Pose of the jig: psi, theta, phi (ZXZ), rad.
    counts, sigma : tuple of 4 float
        Mean counts, and noise in rad, of each sensor at that pose.
    direction, zero_count, counts_per_turn : tuple of 4 int
        Settings of the driver, by sensor.
    direction_checked : tuple of 4 bool
        True where a second pose confirmed the direction.
    sets : int
        Number of sets averaged.

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
    Return the mean, noise and drift of each encoder, if the device did not move.

    Parameters
    ----------
    counts : sequence of sets of 4 int
        In the order of JOINT_NAMES, each in [0, counts_per_turn).
    counts_per_turn : sequence of 4 int
        Scale of each encoder.
    noise_limit : float
        Largest noise (1 sigma) that is accepted, rad.
    drift_limit : float
        Largest motion of a joint that is accepted, rad.

    Raises
    ------
    CalibrationError
        The sets are too few, a sensor is noisy or wraps, or the device moved.

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
    # Differences from one set to the next: slow motion does not count as noise.
    steps = np.diff(counts)
    noise = float(np.sqrt(np.mean(steps * steps) / 2.0))
    means = [float(piece.mean()) for piece in np.array_split(counts, PIECES)]
    scale = TURN / per_turn
    return Reading(float(counts.mean()), noise * scale, (max(means) - min(means)) * scale)


def jig_angles(pose: Sequence[float], geometry: Geometry,
               working_mode: tuple[int, int, int]) -> tuple[float, float, float, float]:
    """
    Return the joint angles th1A, th1B, th1C, th3A, rad, of a jig's pose.

    Parameters
    ----------
    pose : sequence of 3 float
        psi, theta, phi (ZXZ), rad.
    geometry : Geometry
        Link angles.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.

    Raises
    ------
    UnreachableError
        The manipulator does not reach the pose.

    """
    psi, theta, phi = pose
    th1a, th1b, th1c, _, th3a = inverse_angles(
        zxz_rotation(psi, theta, phi), geometry, working_mode)
    return th1a, th1b, th1c, th3a


def calibrate(readings: Sequence[Reading], angles: Sequence[float], direction: Sequence[int],
              counts_per_turn: Sequence[int], date: str, pose: Sequence[float], sets: int,
              before: Calibration | None = None) -> Calibration:
    """
    Return the zero counts with which the readings yield the jig's joint angles.

    Parameters
    ----------
    readings : sequence of 4 Reading
        From `read_still`.
    angles : sequence of 4 float
        Joint angles of the jig's pose, rad.
    direction, counts_per_turn : sequences of 4 int
        Settings of the encoders. A direction determined by an earlier calibration at another pose
        overrides the given one.
    date : str
        Time of the calibration, for the record.
    pose : sequence of 3 float
        psi, theta, phi (ZXZ) of the jig, rad, for the record.
    sets : int
        Number of sets in the readings, for the record.
    before : Calibration, optional
        An earlier calibration.

    """
    found = list(direction)
    known = [False] * len(found)
    if before is not None:
        for index, observed in enumerate(observed_directions(before, readings, angles)):
            if observed:
                found[index], known[index] = observed, True
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


def observed_directions(before: Calibration, readings: Sequence[Reading],
                        angles: Sequence[float]) -> tuple[int, ...]:
    """
    Return the direction (+1, -1) of each joint from the step between two poses, 0 if unknown.

    The step determines the direction of a joint that it moves by TRAVEL_MINIMUM or more, if the
    counts moved by as much, one way or the other.

    Parameters
    ----------
    before : Calibration
        Calibration at the first pose.
    readings : sequence of 4 Reading
        Readings at the second pose.
    angles : sequence of 4 float
        Joint angles of the second pose, rad.

    """
    observed = []
    for index, per_turn in enumerate(before.counts_per_turn):
        old_angle = angle_from_counts(round(before.counts[index]), before.zero_count[index],
                                      before.direction[index], per_turn)
        expected = wrapped(angles[index] - old_angle)
        # Rotation of the shaft by its counts, with direction +1.
        turned = angle_from_counts(
            round(readings[index].counts), round(before.counts[index]), 1, per_turn)
        mismatch = abs(abs(turned) - abs(expected))
        if abs(expected) < TRAVEL_MINIMUM or mismatch > TRAVEL_MISMATCH * abs(expected):
            observed.append(0)
        else:
            observed.append(1 if turned * expected > 0.0 else -1)
    return tuple(observed)


def wrapped(angle: float) -> float:
    """Return an angle, rad, in [-pi, pi)."""
    return (angle + TURN / 2.0) % TURN - TURN / 2.0
