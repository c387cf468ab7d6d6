# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint by itself: its range, its speed, jumps, repeated readings, and its noise."""

from __future__ import annotations

from math import pi, remainder, sqrt

# Sample period from which on the filter is the one of slow samples (s): with 0.04 deg and
# 500 rad/s^2 its limit of a jump is the smaller one from 1.1 ms on; samples at 1 kHz that come a
# little late, or some of them not at all, stay with the other one.
SLOW_PERIOD = 1.5e-3
# Time without a change of the reading up to which the joint may have moved on (s): encoders that
# measure at 100 Hz or more on a faster bus repeat themselves so long.
HOLD = 0.01
# Periods without a reading after which the velocity is set anew (unit 1).
FORGET_PERIODS = 5.0
# Share of repeats of a moving joint from which on its encoder is slower than the bus (unit 1), and
# the samples over which it is averaged.
HOLD_SHARE, HOLD_SAMPLES = 0.4, 16.0
# Part of a jump's limit within which a reading after a jump counts as its end (unit 1).
BACK = 0.5
# Samples over which the noise is averaged: 6 % accuracy.
NOISE_SAMPLES = 256.0
# Readings that the configured noise counts for at the start (readings).
LEARNT_SAMPLES = 64.0
# Square of a difference over the mean square, which a larger one counts as (unit 1).
OUTLIER = 16.0
# Samples over which the velocity is averaged that decides whether the joint is slow.
STEADY_SAMPLES = 32.0
# Changes of the reading in slow motion after which the longest run of equal readings is known.
LEARNING_SAMPLES = 500
# Noise over resolution from which on repeats are as rare at every angle (unit 1): a quieter
# encoder rests on one value wherever its angle is not between two.
NOISY = 0.8
# A run of equal readings that withholds a sample, and one that is a fault, over the longest
# healthy one, each plus some samples. A run twice as long is as rare as the square of its rarity.
WITHHELD_RUN, WITHHELD_SAMPLES = 2, 4
FROZEN_RUN, FROZEN_SAMPLES = 4, 8

TURN = 2.0 * pi


class Gains:
    """
    Gains of an alpha-beta filter, and what follows from them for a sensor of unit variance.

    The variances are those of the steady state (Kalata 1984), with the period T.

    Parameters
    ----------
    alpha, beta : float
        Gains (unit 1). A constant acceleration a lags the filter by a T^2 / beta.
    difference : float
        Standard deviation of the difference between two innovations in a row, which motion hardly
        changes.

    Attributes
    ----------
    position, velocity, covariance : float
        Variance of the filtered position, of the velocity times T^2, and their covariance times T.
    innovation : float
        Standard deviation of the innovation after one period.

    """

    __slots__ = ('alpha', 'beta', 'covariance', 'difference', 'innovation', 'position',
                 'velocity')

    def __init__(self, alpha: float, beta: float, difference: float) -> None:
        self.alpha, self.beta, self.difference = alpha, beta, difference
        total = alpha * (4.0 - 2.0 * alpha - beta)
        self.position = (2.0 * alpha * alpha + beta * (2.0 - 3.0 * alpha)) / total
        self.velocity = 2.0 * beta * beta / total
        self.covariance = beta * (2.0 * alpha - beta) / total
        self.innovation = sqrt(1.0 + self.position + self.velocity + 2.0 * self.covariance)


# Filters of fast and of slow samples. Noise counts more among fast ones; what a joint may do
# between two samples counts more among slow ones, and the second filter lags by 0.4 of that of the
# first.
FAST, SLOW = Gains(0.6, 0.2, 2.1243), Gains(0.8, 0.5, 2.7933)


class JointMonitor:
    """
    Position and velocity of one joint by an alpha-beta filter, and what contradicts them.

    Times are s, angles rad. The filter takes a reading in where it changed: a repeated one is news
    only once the joint cannot have moved on (`HOLD`).

    Parameters
    ----------
    sigma : float
        Configured standard deviation of the sensor, rad.
    threshold : float
        Standard deviations that healthy noise never exceeds (unit 1).
    acceleration : float
        Human motion limit, rad/s^2.

    Attributes
    ----------
    velocity : float
        Filtered velocity, rad/s.
    coasting : bool
        Whether the latest reading was not taken in.
    innovation : float
        Latest reading minus its prediction, in standard deviations of healthy noise.
    run : int
        Equal readings in a row before the latest one.
    since : float
        Time since the reading that the filter took in last, s.

    """

    __slots__ = ('_acceleration', '_allowed', '_alpha', '_angle', '_beta', '_fastest', '_gains',
                 '_is_slow', '_known', '_last', '_last_innovation', '_longest_run',
                 '_noise_limit', '_noisy', '_repeated', '_resolution', '_scale', '_sigma', '_slow',
                 '_square', '_steady', '_threshold', 'coasting', 'innovation', 'run', 'since',
                 'velocity')

    def __init__(self, sigma: float, threshold: float, acceleration: float) -> None:
        self._sigma = self._allowed = sigma
        self._threshold = threshold
        self._acceleration = acceleration
        self._use(FAST)
        self._square = (FAST.difference * sigma) ** 2
        self._resolution = pi
        self._longest_run = self._slow = 0
        self._repeated = self._fastest = 0.0
        # As if so many readings had had the configured noise.
        self._noisy = LEARNT_SAMPLES
        self.restart()

    def _use(self, gains: Gains) -> None:
        """Follow the motion with other gains."""
        self._gains = gains
        self._is_slow = gains is SLOW
        self._alpha, self._beta = gains.alpha, gains.beta
        self._scale = gains.innovation * self._sigma
        self.sigma = self._allowed
        self._last_innovation: float | None = None

    def restart(self) -> None:
        """Reset the motion and the run of equal readings; what was learnt of the sensor stays."""
        self.reset_motion()
        self._last: float | None = None
        self.run = 0
        self._steady = 0.0

    def reset_motion(self) -> None:
        """Have the next two readings set position and velocity."""
        self._known = 0
        self._angle = self.velocity = self.since = self.innovation = 0.0
        self._last_innovation = None
        self.coasting = False

    @property
    def sigma(self) -> float:
        """Return the standard deviation that the limits allow for, rad."""
        return self._allowed

    @sigma.setter
    def sigma(self, sigma: float) -> None:
        self._allowed = sigma
        # Least limit of an innovation: noise alone.
        self._noise_limit = self._threshold * self._gains.innovation * sigma

    @property
    def last(self) -> float | None:
        """Return the latest reading, rad; None before the first."""
        return self._last

    @property
    def noise(self) -> float:
        """Return the standard deviation of the sensor as measured, rad."""
        return sqrt(self._square) / self._gains.difference

    @property
    def withheld_run(self) -> int | None:
        """Run of equal readings that withholds a sample; None where repeats mean nothing."""
        if not self._repeats_mean_something():
            return None
        return WITHHELD_RUN * self._longest_run + WITHHELD_SAMPLES

    @property
    def frozen_run(self) -> int | None:
        """Run of equal readings that is a fault; None where repeats mean nothing."""
        if not self._repeats_mean_something():
            return None
        return FROZEN_RUN * self._longest_run + FROZEN_SAMPLES

    def _repeats_mean_something(self) -> bool:
        return self._slow >= LEARNING_SAMPLES and self.noise > NOISY * self._resolution

    def limit(self, dt: float, period: float) -> float:
        """
        Return the largest innovation of a healthy joint, rad, `dt` after the last reading.

        Noise, and the human motion limit: what the filter lags behind, and what the joint may have
        done since.
        """
        if dt <= period:
            return self._noise_limit + self._acceleration * period * period / self._beta
        gains, alpha, beta = self._gains, self._alpha, self._beta
        periods = dt / period
        deviation = sqrt(1.0 + gains.position
                         + periods * (periods * gains.velocity + 2.0 * gains.covariance))
        lag = (1.0 - alpha) / beta + periods * (alpha / beta - 0.5 + 0.5 * periods)
        return (self._threshold * deviation * self._allowed
                + self._acceleration * period * period * lag)

    def jumped(self, reading: float, dt: float, period: float, timing: float) -> bool:
        """
        Follow the motion with a reading; return whether the reading left the motion.

        Parameters
        ----------
        reading : float
            Angle, rad.
        dt : float
            Time since the last sample, s.
        period : float
            Usual time between samples, s.
        timing : float
            Uncertainty of the sample's time, s.

        """
        last = self._last
        repeated = reading == last
        if repeated:
            self.run += 1
        elif self.run or last is None or abs(reading - last) < self._resolution:
            self._end_run(reading, last)
        self._last = reading
        if self._known < 2:
            if not (repeated and self._repeated > HOLD_SHARE):
                self._begin(reading, dt, period)
            return False
        velocity = self.velocity
        elapsed = self.since + dt
        innovation = reading - self._angle - velocity * elapsed
        if not -pi <= innovation <= pi:
            innovation = remainder(innovation, TURN)
        size = abs(innovation)
        if repeated or size > self._noise_limit or self.since or self.coasting \
                or self._repeated > HOLD_SHARE:
            return self._jumped(reading, innovation, elapsed, dt, period, timing, repeated)
        if self._repeated and abs(velocity) * period > 2.0 * (self._resolution + self._sigma):
            self._repeated -= self._repeated / HOLD_SAMPLES
        self.innovation = size / self._scale
        self._follow(reading, velocity, innovation, elapsed, period, repeated)
        return False

    def _jumped(self, reading: float, innovation: float, elapsed: float, dt: float, period: float,
                timing: float, repeated: bool) -> bool:
        """Decide where noise alone does not explain the innovation, or it is no usual sample."""
        velocity = self.velocity
        size = abs(innovation)
        if self._repeated > HOLD_SHARE and elapsed < HOLD:
            period = max(period, elapsed)
        if self.coasting:
            limit = BACK * self.limit(dt, period)
        else:
            if abs(velocity) * period > 2.0 * (self._resolution + self._sigma):
                self._repeated += (repeated - self._repeated) / HOLD_SAMPLES
            if repeated and self._repeated > HOLD_SHARE:
                # A slower encoder than the bus has no new reading, or the joint has stopped.
                if elapsed <= HOLD:
                    self.since = elapsed
                    return False
                self._angle, self.velocity, self.since = reading, 0.0, 0.0
                return False
            limit = self.limit(elapsed, period) + abs(velocity) * timing
            if size > limit and self.since:
                # A joint that stopped meanwhile is still where it was.
                size = min(size, abs(remainder(reading - self._angle, TURN)))
        self.innovation = size / self._scale
        if size > limit:
            self.coasting = True
            self.since = elapsed
            return True
        self.since = 0.0
        self.coasting = False
        self._follow(reading, velocity, innovation, elapsed, period, repeated)
        return False

    def _follow(self, reading: float, velocity: float, innovation: float, elapsed: float,
                period: float, repeated: bool) -> None:
        """Take a reading of the motion into the filter, and learn from it."""
        before = self._last_innovation
        fastest = 0.95 * self._fastest
        if not -fastest <= velocity <= fastest:
            fastest = abs(velocity)
        self._fastest = fastest
        if before is not None and fastest * period < self._resolution + 3.0 * self._allowed:
            difference = innovation - before
            if self._noisy < NOISE_SAMPLES:
                self._noisy += 1.0
            # One step is not noise.
            mean = self._square
            square = difference * difference
            if square > OUTLIER * mean:
                square = OUTLIER * mean
            self._square = mean + (square - mean) / self._noisy
        self._last_innovation = innovation
        self._angle += velocity * elapsed + self._alpha * innovation
        velocity += self._beta * innovation / (elapsed if elapsed > period else period)
        self.velocity = velocity
        if self._slow < LEARNING_SAMPLES:
            steady = self._steady = self._steady + (velocity - self._steady) / STEADY_SAMPLES
            if not repeated and abs(steady) * period < 0.25 * self._resolution:
                self._slow += 1
        if elapsed > FORGET_PERIODS * period:
            # The velocity of so long ago says nothing; the next reading sets it.
            self._angle, self._known = reading, 1
        if (period > SLOW_PERIOD) is not self._is_slow:
            noise = self.noise
            self._use(FAST if self._is_slow else SLOW)
            self._square = (noise * self._gains.difference) ** 2

    def back_after_gap(self, reading: float) -> bool:
        """Whether a joint that jumped before a gap is where it was before its jump."""
        limit = BACK * self._noise_limit
        return self.coasting and abs(remainder(reading - self._angle, TURN)) < limit

    def _begin(self, reading: float, dt: float, period: float) -> None:
        if self._known == 1:
            self.velocity = remainder(reading - self._angle, TURN) / max(dt, period)
        self._angle = reading
        self._known += 1

    def _end_run(self, reading: float, last: float | None) -> None:
        """Learn resolution and longest run from a reading that differs from the last."""
        if last is None:
            return
        step = abs(reading - last)
        if step < self._resolution:
            self._resolution = step
        if self._longest_run < self.run < (self.frozen_run or self.run + 1):
            self._longest_run = self.run
        self.run = 0
