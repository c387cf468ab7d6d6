# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the readings of one encoder show by themselves: resolution, repeats and noise.

None of it needs to know where the joint is, so it survives a fault and a pause.
"""

from __future__ import annotations

from math import hypot, nan, pi, sqrt

# Standard deviation of the difference between two innovations in a row over that of the sensor
# (unit 1), by the filter of `joint_monitor` and white noise, to 0.1 %. Motion hardly changes it.
DIFFERENCE = 2.4623
# Share of repeated readings of a moving joint above which its encoder is slower than the bus, and
# the samples over which that share is averaged.
SLOW_SHARE = 0.4
SHARE_SAMPLES = 8.0
# Samples over which the noise is averaged, to 6 %; and how many readings the configured noise
# counts for at the start.
NOISE_SAMPLES = 256.0
LEARNT_SAMPLES = 64.0
# Standard deviations of the noise, or one count if that is more, that a slow joint moves at most
# in a sample: its noise can be measured, and equal readings do not show the rate of its encoder.
SLOW_DEVIATIONS = 2.0
OUTLIER = 16.0  # largest square of a difference, over the mean square, that the noise counts
# Ratio of noise to resolution above which equal readings are rare at every angle: two in a row
# have a probability of 0.26 at most, 20 of 2e-12. And reversals of the reading (up, then down)
# after which it is known that the changes are noise: a motion has few.
NOISY = 1.5
REVERSALS = 500
# Resolution over the standard deviation of rounding to it, whose error is uniform (unit 1).
ROOT_TWELVE = sqrt(12.0)
COARSEST = 2.0 * pi / 4096.0  # rad, resolution before a finer one is seen: of 12 bits


class JointReadings:
    """
    Resolution, repeated readings and noise of one encoder.

    Parameters
    ----------
    sigma : float
        Configured standard deviation of the sensor, rad.

    Attributes
    ----------
    latest : float
        The latest reading, rad; NaN before the first.
    repeats : int
        Number of equal readings before the latest one.
    resolution : float
        Smallest change between two readings, rad.
    expected : float
        Standard deviation of a healthy reading by noise and resolution, rad.
    allowed : float
        Standard deviation that the limits allow for, rad.
    slow_step : float
        Motion in a sample up to which a joint is slow, rad.

    """

    def __init__(self, sigma: float) -> None:
        self._sigma = sigma
        self.latest = nan
        self.repeats = 0
        self.resolution = COARSEST
        self.allow(sigma)
        # Changes of the reading against the one before, `REVERSALS` at most, and the latest change
        # (rad).
        self._reversals = 0
        self._last_change = 0.0
        # Share of readings that repeat the last one while the joint moves (unit 1).
        self._repeat_share = 0.0
        # Mean square of the difference between two innovations in a row, rad^2, and how many
        # differences it averages.
        self._mean_square = (DIFFERENCE * sigma) ** 2
        self._averaged = LEARNT_SAMPLES

    def add(self, reading: float) -> float:
        """
        Add a reading, rad; return its change, rad.

        Notes repeats, reversals and the resolution. The change is NaN at the first reading.
        """
        change = reading - self.latest
        self.latest = reading
        if change == 0.0:
            self.repeats += 1
            return change
        self.repeats = 0
        if self._reversals < REVERSALS:
            self._reversals += change * self._last_change < 0.0
            self._last_change = change
        if abs(change) < self.resolution:
            self.resolution = abs(change)
            self.allow(self.allowed)
        return change

    def allow(self, sigma: float) -> None:
        """Allow for a standard deviation, rad, as configured or measured."""
        self.allowed = sigma
        self.slow_step = max(self.resolution, SLOW_DEVIATIONS * sigma)
        self.expected = hypot(self._sigma, self.resolution / ROOT_TWELVE)

    def note_moving(self, is_repeated: bool) -> None:
        """Note whether the reading of a joint that moves is a repeated one."""
        self._repeat_share += (is_repeated - self._repeat_share) / SHARE_SAMPLES

    @property
    def is_slower_than_bus(self) -> bool:
        """Whether the encoder is slower than the bus: many readings of a moving joint repeat."""
        return self._repeat_share > SLOW_SHARE

    def note_noise(self, difference: float) -> None:
        """
        Average the square of the difference between two innovations of a slow joint, rad.

        NaN where there is no innovation before; it is not averaged.
        """
        square = difference * difference
        mean = self._mean_square
        if square > OUTLIER * mean:
            # One step is not noise.
            square = OUTLIER * mean
        if square == square:
            if self._averaged < NOISE_SAMPLES:
                self._averaged += 1.0
            self._mean_square = mean + (square - mean) / self._averaged

    @property
    def noise(self) -> float:
        """Return the standard deviation of the sensor as measured, rad."""
        return sqrt(self._mean_square) / DIFFERENCE

    @property
    def repeats_are_rare(self) -> bool:
        """Whether neither healthy noise nor a slow encoder explains equal readings in a row."""
        return (
            self._reversals >= REVERSALS
            and not self.is_slower_than_bus
            and self.noise > NOISY * self.resolution
        )
