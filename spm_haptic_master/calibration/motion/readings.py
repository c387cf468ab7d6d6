# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Readings of a free motion, made ready for the fit: noise measured, spikes out, means of few."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, NUMBER_WORDS
from spm_haptic_master.kinematics.rotations import wrapped
from spm_haptic_master.validation.parity_map import GAP, white_noise

Array = NDArray[np.float64]

# Largest number of means that are kept: more cost time and determine nothing more.
MEANS_MAXIMUM = 12000
# Longest time that a mean is taken over (s): a joint at 3 rad/s turns by 0.03 rad meanwhile, and
# the mean parity of such a piece is off by less than 0.002 deg.
MEAN_SECONDS = 0.01
# Least length (s) and number of sets.
SECONDS_MINIMUM = 2.0
SETS_MINIMUM = 200
# Distance of a reading from the median of its piece beyond which it is a spike: noise (standard
# deviations), and speed of a joint (rad/s) that no hand reaches. The fit cuts smaller ones.
SPIKE_NOISE = 8.0
SPIKE_SPEED = 10.0
# Largest noise of a sensor (rad, 1 standard deviation).
NOISE_LIMIT = radians(0.5)
# Largest part of the sets with spikes (unit 1).
SPIKES_MAXIMUM = 0.3
# Least travel of every joint (rad): less is rest.
TRAVEL_MINIMUM = radians(2.0)
# Part of the readings on either side that a joint's travel leaves out (percent): spikes.
TRAVEL_PERCENT = 10.0


@dataclass(frozen=True, slots=True)
class MotionReadings:
    """
    Means of readings that follow each other.

    `sets` and `spikes` are numbers of sets received and of those left out.

    Attributes
    ----------
    seconds : ndarray, shape (n,)
        Time since the first set, s.
    readings : ndarray, shape (n, N)
        Means, rad, with direction 1 and zero 0.
    noise : ndarray, shape (N,)
        White noise of one reading, rad, 1 standard deviation.
    together : int
        Number of readings in a mean.
    spiked : ndarray of bool, shape (sets,)
        Which of the sets received are left out because of a spike.

    """

    seconds: Array
    readings: Array
    noise: Array
    together: int
    spiked: NDArray[np.bool_]

    @property
    def sets(self) -> int:
        """Return the number of sets received."""
        return len(self.spiked)

    @property
    def spikes(self) -> int:
        """Return the number of sets left out because of a spike."""
        return int(self.spiked.sum())

    @property
    def rate(self) -> float:
        """Return the number of means in a second, Hz."""
        return 1.0 / float(np.median(np.diff(self.seconds)))

    @property
    def sigma(self) -> Array:
        """White noise of the means, rad, shape (N,)."""
        of_means: Array = self.noise / np.sqrt(self.together)
        return of_means


def motion_readings(
    stamps: NDArray[np.int64],
    readings: Array,
) -> MotionReadings:
    """
    Return the means of readings, without spikes, and their noise.

    A reading is a spike if it is farther from the median of its piece than noise and motion allow.

    Parameters
    ----------
    stamps : ndarray of int, shape (n,)
        Times of the sets, ns.
    readings : ndarray, shape (n, N)
        Angles by the counts alone (direction 1, zero 0), rad, on any turn.

    Returns
    -------
    MotionReadings
        Means of up to `MEAN_SECONDS` each, with the noise of a single reading.

    Raises
    ------
    CalibrationError
        The sets are too few, come at irregular times, are noisy or have too many spikes, or a
        joint does not move.

    """
    _check_stamps(stamps, readings.shape[1])
    noise = _checked_noise(stamps, readings)
    steps = np.diff(stamps)
    period = float(np.median(steps)) * 1e-9
    fewest = -(-len(stamps) // MEANS_MAXIMUM)
    together = max(1, min(int(MEAN_SECONDS / period), fewest))
    rows = _pieces(steps, together)
    limit = SPIKE_NOISE * noise + SPIKE_SPEED * 0.5 * together * period
    means, good = _means_without_spikes(readings[rows], limit)
    spiked = np.zeros(len(stamps), dtype=bool)
    spiked[rows] = ~good
    enough = _has_enough(good)
    _check_spikes(int(spiked.sum()), good.size, bool(enough.any()))
    _check_travel(means[enough])
    middles = stamps[rows[enough]].mean(axis=1)
    return MotionReadings(
        seconds=(middles - stamps[0]) * 1e-9,
        readings=means[enough],
        noise=noise,
        together=together,
        spiked=spiked,
    )


def _check_stamps(
    stamps: NDArray[np.int64],
    sensors: int,
) -> None:
    """Raise CalibrationError for sets that are too few, or whose stamps do not increase."""
    if len(stamps):
        seconds = (int(stamps[-1]) - int(stamps[0])) * 1e-9
    else:
        seconds = 0.0
    if len(stamps) < SETS_MINIMUM or seconds < SECONDS_MINIMUM:
        raise CalibrationError(
            f'{len(stamps)} sets of {NUMBER_WORDS[sensors]} encoders in {seconds:.1f} '
            f's; a motion needs at least {SETS_MINIMUM} sets and {SECONDS_MINIMUM:g} s'
        )
    steps = np.diff(stamps)
    if (steps <= 0).any():
        row = int(np.argmax(steps <= 0))
        raise CalibrationError(
            f'the stamp of set {row + 2} is {-int(steps[row])} ns before that '
            'of the previous set; expected stamps that increase'
        )


def _checked_noise(
    stamps: NDArray[np.int64],
    readings: Array,
) -> Array:
    """
    Return the white noise of a reading of each sensor, rad, 1 standard deviation.

    Raises
    ------
    CalibrationError
        The sets come at irregular times, or a sensor is noisier than `NOISE_LIMIT`.

    """
    noise = white_noise(stamps, np.unwrap(readings, axis=0))
    if not np.isfinite(noise).all():
        raise CalibrationError(
            'the sets do not come at a regular interval; expected a constant period'
        )
    for joint, deviation in zip(ALL_JOINT_NAMES, noise, strict=False):
        if deviation > NOISE_LIMIT:
            raise CalibrationError(
                f'{joint} has a noise of {np.degrees(deviation):.2f} deg (1 sigma), or spikes in '
                f'most of its readings; expected at most {np.degrees(NOISE_LIMIT):g} deg'
            )
    return noise


def _means_without_spikes(
    pieces: Array,
    limit: Array,
) -> tuple[Array, NDArray[np.bool_]]:
    """
    Return the mean of each piece, and which of its sets have no spike.

    Parameters
    ----------
    pieces : ndarray, shape (m, together, N)
        Readings, rad, of each piece.
    limit : ndarray, shape (N,)
        Distance from the median of a piece beyond which a reading is a spike, rad.

    Returns
    -------
    means : ndarray, shape (m, N)
        Means of the good sets, rad; NaN without one.
    good : ndarray of bool, shape (m, together)
        Whether a set has no spike.

    """
    first = pieces[:, :1]
    from_first = wrapped(pieces - first)
    middle = np.median(from_first, axis=1, keepdims=True)
    away = np.abs(wrapped(from_first - middle))
    good = np.all(away < limit, axis=2)
    medians = first[:, 0] + middle[:, 0]
    good[_alone(medians, limit)] = False
    weights = good[:, :, None]
    count = weights.sum(axis=1)
    total = (weights * from_first).sum(axis=1)
    means = np.full_like(total, np.nan)
    np.divide(
        total,
        count,
        out=means,
        where=count > 0,
    )
    return means + first[:, 0], good


def _has_enough(good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which pieces have a mean: more than half of their sets are good."""
    return np.asarray(good.sum(axis=1) > good.shape[1] // 2)


def _check_spikes(
    spikes: int,
    sets: int,
    any_mean: bool,
) -> None:
    """Raise CalibrationError where too many sets have a spike."""
    if not any_mean or spikes > SPIKES_MAXIMUM * sets:
        raise CalibrationError(
            f'{100.0 * spikes / sets:.0f} % of the sets have a spike; expected at most '
            f'{100.0 * SPIKES_MAXIMUM:.0f} %'
        )


def _check_travel(means: Array) -> None:
    """Raise CalibrationError for a joint that does not move."""
    percents = (TRAVEL_PERCENT, 100.0 - TRAVEL_PERCENT)
    turned = np.unwrap(means, axis=0)
    low, high = np.percentile(turned, percents, axis=0)
    for joint, travel in zip(ALL_JOINT_NAMES, high - low, strict=False):
        if travel < TRAVEL_MINIMUM:
            raise CalibrationError(
                f'{joint} moved by {np.degrees(travel):.2f} deg; expected a motion of every '
                'joint: tilt the handle in all directions and turn it both ways'
            )


def spread(
    readings: Array,
    count: int,
) -> NDArray[np.intp]:
    """
    Return the rows of readings that are as far from each other as can be.

    From the one nearest to the median, each further one is that with the largest distance from all
    before (farthest-point sampling).

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Angles, rad.
    count : int
        Number of rows; fewer are returned where there are not so many.

    Returns
    -------
    ndarray of int, shape (count,)
        Rows, in the order of their choice.

    """
    # A row for each sensor: sums over them are of whole rows.
    turned = np.ascontiguousarray(np.unwrap(readings, axis=0).T)
    middle = np.median(turned, axis=1)
    chosen = [int(np.argmin(_squared_distance(turned, middle)))]
    distance = np.full(len(readings), np.inf)
    while len(chosen) < min(count, len(readings)):
        distance = np.minimum(distance, _squared_distance(turned, turned[:, chosen[-1]]))
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def _squared_distance(turned: Array, point: Array) -> Array:
    """Return the squared distances of n readings, (N, n), from a point, (N,), rad^2."""
    return np.asarray(((turned - point[:, None]) ** 2).sum(axis=0))


def _pieces(
    steps: NDArray[np.int64],
    together: int,
) -> NDArray[np.intp]:
    """
    Return the rows of pieces of consecutive sets without a gap.

    Parameters
    ----------
    steps : ndarray of int, shape (n - 1,)
        Differences of the stamps, ns.
    together : int
        Number of sets in a piece.

    Returns
    -------
    ndarray of int, shape (m, together)
        Rows of each piece.

    """
    breaks = np.flatnonzero(steps > GAP * np.median(steps)) + 1
    firsts = np.concatenate(
        [
            np.arange(start, end - together + 1, together)
            for start, end in pairwise((0, *breaks, len(steps) + 1))
        ]
    )
    return firsts.astype(np.intp)[:, None] + np.arange(together)


def _alone(
    readings: Array,
    limit: Array,
) -> NDArray[np.bool_]:
    """
    Return which of consecutive readings are far from both of their neighbours.

    Parameters
    ----------
    readings : ndarray, shape (n, N)
        Angles, rad.
    limit : ndarray, shape (N,)
        Distance within a piece beyond which a reading is a spike, rad.

    Returns
    -------
    ndarray of bool, shape (n,)
        The first and the last one are False.

    """
    far = np.zeros(len(readings), dtype=bool)
    step = np.abs(wrapped(np.diff(readings, axis=0)))
    across = np.abs(wrapped(readings[2:] - readings[:-2]))
    beyond = 3.0 * limit + 2.0 * across
    is_far = (step[1:] > beyond) & (step[:-1] > beyond)
    far[1:-1] = is_far.any(axis=1)
    return far
