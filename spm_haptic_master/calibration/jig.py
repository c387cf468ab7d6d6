# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Zero counts and directions from known poses of a static jig.

One pose determines the zero counts for given directions. It does not determine a direction: with
the wrong one there is a zero count as well, and the angle is right at that pose and wrong
everywhere else. A second pose determines the direction of every joint that it moves far enough,
and every further one checks the poses against each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from math import degrees, hypot, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.encoder_layout import TURN
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics import Geometry, jacobian, matrix_from_zxz
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, NUMBER_WORDS
from spm_haptic_master.kinematics.rotations import wrapped

# Least motion of a joint between two poses (rad) that determines its direction.
TRAVEL_MINIMUM = radians(1.0)
# Largest difference between the motion by the counts and the motion by the poses, as a part of
# the latter: beyond it the encoder slipped on its shaft.
TRAVEL_MISMATCH = 0.25
# Least length of a recording (sets): fewer show neither noise nor motion.
SETS_MINIMUM = 100
# Number of pieces of a recording: the device moved if their means differ.
PIECES = 10
# Limit of the difference between the pieces' means, in their own standard deviations: noise alone
# does not reach it in years.
MEANS_SIGMAS = 8.0


@dataclass(frozen=True, slots=True)
class Station:
    """
    Readings at one pose of the jig.

    Attributes
    ----------
    pose : tuple of float
        Pose of the jig: psi, theta, phi (ZXZ), rad.
    angles : tuple of float
        Angles of the N joints at that pose, rad, as encoders with harmonics read them.
    counts : tuple of float
        Mean counts of each sensor.
    sigma : tuple of float
        Noise of each sensor, rad, 1 standard deviation.
    sets : int
        Number of sets averaged.

    """

    pose: tuple[float, ...]
    angles: tuple[float, ...]
    counts: tuple[float, ...]
    sigma: tuple[float, ...]
    sets: int


@dataclass(frozen=True, slots=True)
class Calibration:
    """
    Zero counts, directions, noise and bias of N sensors, and the readings behind them.

    Attributes
    ----------
    date : str
        Time of the calibration, ISO 8601 with the offset to UTC.
    stations : tuple of Station
        Readings, one for each pose of the jig.
    direction : tuple of int
        Direction of each encoder, 1 or -1.
    zero_count : tuple of int
        Count of each encoder at joint angle 0.
    counts_per_turn : tuple of int
        Counts of each encoder in a turn.
    direction_verified : tuple of bool
        Whether two poses determined the direction.
    bias : tuple of float
        Bound of each sensor's systematic error, rad.

    """

    date: str
    stations: tuple[Station, ...]
    direction: tuple[int, ...]
    zero_count: tuple[int, ...]
    counts_per_turn: tuple[int, ...]
    direction_verified: tuple[bool, ...]
    bias: tuple[float, ...]

    @property
    def sigma(self) -> tuple[float, ...]:
        """
        Return each sensor's white noise, rad, 1 standard deviation.

        That is the root mean square over the stations, and at least the standard deviation of
        quantisation, one count over sqrt(12): a quiet encoder at rest repeats its count.
        """
        return tuple(
            max(
                hypot(*(station.sigma[index] for station in self.stations))
                / len(self.stations) ** 0.5,
                TURN / per_turn / 12.0**0.5,
            )
            for index, per_turn in enumerate(self.counts_per_turn)
        )


def read_still(
    counts: NDArray[np.int64],
    counts_per_turn: Sequence[int],
    noise_limit: float,
    drift_limit: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Return the mean counts of encoders at rest, and their noise, if the device did not move.

    The noise is taken from differences of consecutive sets, s^2 = mean(d^2) / 2, so that slow
    motion does not count as noise. Motion is the span of the means of `PIECES` pieces.

    Parameters
    ----------
    counts : ndarray of int, shape (n, N)
        Counts of n sets.
    counts_per_turn : sequence of int
        Counts of each encoder in a turn.
    noise_limit : float
        Largest noise of a sensor that is accepted, rad, 1 standard deviation.
    drift_limit : float
        Largest motion of a joint that is accepted, rad; more where the noise of the pieces' means
        is larger.

    Returns
    -------
    mean : ndarray, shape (N,)
        Mean counts.
    noise : ndarray, shape (N,)
        White noise, rad, 1 standard deviation.

    Raises
    ------
    CalibrationError
        There are too few sets, a sensor is noisy or its counts wrap at this pose, or the device
        moved.

    """
    if len(counts) < SETS_MINIMUM:
        raise CalibrationError(
            f'{len(counts)} sets of {NUMBER_WORDS[len(counts_per_turn)]} '
            f'encoders; at least {SETS_MINIMUM} are needed'
        )
    scale = TURN / np.array(counts_per_turn)
    # Differences from one set to the next: slow motion does not count as noise.
    squares = np.diff(counts, axis=0) ** 2
    noise = np.sqrt(np.mean(squares, axis=0) / 2.0) * scale
    means = [piece.mean(axis=0) for piece in np.array_split(counts, PIECES)]
    drift = np.ptp(means, axis=0) * scale
    allowed = np.maximum(drift_limit, MEANS_SIGMAS * noise / (len(counts) // PIECES) ** 0.5)
    for index, joint in enumerate(ALL_JOINT_NAMES[: len(scale)]):
        if np.ptp(counts[:, index]) > counts_per_turn[index] // 2:
            raise CalibrationError(
                f'{joint} wraps: its counts pass from {counts_per_turn[index] - 1} to 0 at this '
                'pose; turn the encoder on its shaft, or set its preset (CiA 406, object 0x6003)'
            )
        if noise[index] > noise_limit:
            raise CalibrationError(
                f'{joint} is noisy: {degrees(noise[index]):.3f} deg (1 sigma), '
                f'limit {degrees(noise_limit):g} deg'
            )
        if drift[index] > allowed[index]:
            raise CalibrationError(
                f'the device moved: {joint} by {degrees(drift[index]):.3f} deg, '
                f'limit {degrees(allowed[index]):.3f} deg'
            )
    return counts.mean(axis=0), noise


def jig_bias(
    pose: Sequence[float],
    geometry: Geometry,
    working_mode: tuple[int, int, int],
    error: float,
    sensors: int,
) -> tuple[float, ...]:
    """
    Return the largest error of each joint angle at a pose, if the jig is off.

    To first order a small rotation of size e moves joint i by at most e times the length of row i
    of the Jacobian.

    Parameters
    ----------
    pose : sequence of float
        psi, theta, phi (ZXZ) of the jig, rad.
    geometry : Geometry
        Link angles and axes of the mechanism.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C.
    error : float
        Largest angle between the jig's pose and the stated one, about any axis, rad.
    sensors : int
        Number N of sensors.

    Returns
    -------
    tuple of float
        Bound for each of the N sensors, rad.

    """
    rotation = matrix_from_zxz(*pose)
    gains = jacobian(rotation, geometry, working_mode, sensors)
    largest = np.linalg.norm(gains, axis=1)
    return tuple(float(gain) * error for gain in largest)


def calibrate(
    stations: Sequence[Station],
    direction: Sequence[int],
    counts_per_turn: Sequence[int],
    date: str,
    bias: Sequence[float],
    tolerance: float,
    before: Calibration | None = None,
) -> Calibration:
    """
    Return the zero counts and directions with which the readings yield the jig's angles.

    For each pose, zero count = count - direction * angle * counts per turn / 2 pi; the result is
    the mean over the poses. A direction that two poses determine, of these or of an earlier
    calibration, overrides the given one.

    Parameters
    ----------
    stations : sequence of Station
        Readings, one for each pose.
    direction : sequence of int
        Configured direction of each encoder, 1 or -1.
    counts_per_turn : sequence of int
        Counts of each encoder in a turn, N values.
    date : str
        Time of the calibration, ISO 8601 with the offset to UTC.
    bias : sequence of float
        Bound of each sensor's systematic error, rad, for the result.
    tolerance : float
        Largest difference between the zeros of two poses that is accepted, rad.
    before : Calibration or None, optional
        An earlier calibration: its poses and verified directions help to determine the directions.

    Returns
    -------
    Calibration
        Zeros, directions and the readings behind them.

    Raises
    ------
    CalibrationError
        The poses contradict each other: a shaft slipped, or a pose is not the stated one.

    """
    observed = observed_directions(combinations(stations, 2), counts_per_turn)
    if before is not None:
        since = observed_directions(product(before.stations, stations), counts_per_turn)
        verified = np.multiply(before.direction, before.direction_verified).tolist()
        observed = tuple(
            here or there or earlier
            for here, there, earlier in zip(
                observed,
                since,
                verified,
                strict=True,
            )
        )
    known = np.array(observed) != 0
    found = np.where(known, observed, direction)
    per_turn = np.array(counts_per_turn)
    angles = np.array([station.angles for station in stations])
    # angle = direction * (count - zero count) * 2 pi / counts per turn, solved for the zero count.
    zeros = np.array([station.counts for station in stations]) - found * angles * per_turn / TURN
    # Differences from the first, so that the mean is right where the counts wrap.
    off = wrapped((zeros - zeros[0]) * TURN / per_turn)
    mean = off.mean(axis=0)
    for index in np.flatnonzero((np.ptp(off, axis=0) > tolerance) & known).tolist():
        apart = off[:, index] - mean[index]
        worst = int(np.abs(apart).argmax())
        raise CalibrationError(
            f'the poses contradict each other: {ALL_JOINT_NAMES[index]} is '
            f'{degrees(apart[worst]):+.3f} deg off at pose {worst + 1} of {len(off)} '
            f'(tolerance {degrees(tolerance):g} deg between two); did its shaft slip, or is a '
            'pose not the stated one?'
        )
    zero = np.rint(zeros[0] + mean * per_turn / TURN).astype(int) % per_turn
    return Calibration(
        date,
        tuple(stations),
        tuple(found.tolist()),
        tuple(zero.tolist()),
        tuple(counts_per_turn),
        tuple(known.tolist()),
        tuple(bias),
    )


def observed_directions(
    pairs: Iterable[tuple[Station, Station]],
    counts_per_turn: Sequence[int],
) -> tuple[int, ...]:
    """
    Return the direction of each joint from the motion between two poses.

    The pair that moves a joint farthest determines its direction, if that is by `TRAVEL_MINIMUM`
    or more, and if the counts moved by as much, one way or the other.

    Parameters
    ----------
    pairs : iterable of tuple of 2 Station
        Readings at two poses each.
    counts_per_turn : sequence of int
        Counts of each encoder in a turn, N values.

    Returns
    -------
    tuple of int
        1 or -1 for each joint; 0 where no pair determines it.

    """
    # Without a pair nothing moves.
    steps = [(np.zeros(len(counts_per_turn)),) * 2]
    steps += [
        (
            np.subtract(second.angles, first.angles),
            np.subtract(second.counts, first.counts) * TURN / np.array(counts_per_turn),
        )
        for first, second in pairs
    ]
    expected, turned = wrapped(np.array(steps)).swapaxes(0, 1)
    farthest = np.abs(expected).argmax(axis=0), np.arange(len(counts_per_turn))
    expected = expected[farthest]
    turned = turned[farthest]
    size = np.abs(expected)
    mismatch = np.abs(np.abs(turned) - size)
    known = (size >= TRAVEL_MINIMUM) & (mismatch <= TRAVEL_MISMATCH * size)
    signs = np.sign(turned * expected)
    return tuple(np.where(known, signs, 0).astype(int).tolist())
