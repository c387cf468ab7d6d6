# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
One joint by itself: its motion, and readings that leave it.

A joint is *on its motion* while its readings continue position and velocity as far as human
acceleration and noise allow. A reading that does not *leaves* it; the joint then either *returns*
to the same motion within `RETURN_TIME` (a glitch), or is followed from where it is. All this is
evidence only: `joint_monitors` compares the joints, because an impact moves every one.
"""

from __future__ import annotations

from enum import IntEnum
from math import nan, pi, remainder, sqrt
from typing import NamedTuple

from spm_haptic_master.supervision.joint_readings import JointReadings

# Alpha-beta filter of a joint, for a sensor of unit variance and a period of 1. The variances are
# those of the steady state (Kalata 1984), the gains (unit 1) have the least transient for alpha
# (Benedict and Bordner 1962). 500 rad/s^2 lag it by 0.08 deg at 1 kHz, by 1.2 deg at 250 Hz.
ALPHA = 0.7
BETA = ALPHA * ALPHA / (2.0 - ALPHA)
_DENOMINATOR = ALPHA * (4.0 - 2.0 * ALPHA - BETA)
# Variance of the filtered position, of the velocity, and their covariance.
_POSITION = (2.0 * ALPHA * ALPHA + BETA * (2.0 - 3.0 * ALPHA)) / _DENOMINATOR
_VELOCITY = 2.0 * BETA * BETA / _DENOMINATOR
_COVARIANCE = BETA * (2.0 * ALPHA - BETA) / _DENOMINATOR

# Longest time (s) for which a slow encoder repeats a reading: it has a new one at 100 Hz or more.
REPEAT_TIME = 0.01
LATE_PERIODS = 1.5  # without a reading, after which it comes late
FORGET_PERIODS = 5.0  # without a reading, after which the velocity is set anew
AWAY_SAMPLES = 3  # after which a joint that left its motion is followed from where it is
# Samples for which a step stays evidence: the other joints may seem to move in one of them.
STEP_SAMPLES = 6
RETURN_TIME = 0.05  # s, in which a joint that left its motion can be found back on it
# Part of a jump's limit within which a reading is back on the motion.
RETURN_FRACTION = 0.5
ROOT_TWO = sqrt(2.0)
TURN = 2.0 * pi


def innovation_deviation(periods: float) -> float:
    """
    Return the standard deviation of an innovation some periods after the last reading.

    In standard deviations of the sensor (unit 1): the noise of this reading, and the variance of
    the filtered position and velocity in the steady state (Kalata 1984), extrapolated.
    """
    return sqrt(1.0 + _POSITION + periods * (periods * _VELOCITY + 2.0 * _COVARIANCE))


# The same after one period.
ONE_PERIOD = innovation_deviation(1.0)


def lag(periods: float) -> float:
    """
    Return how far an acceleration of 1 moves the joint off its prediction, in periods^2.

    The prediction is some periods after the last reading.
    """
    return (1.0 - ALPHA) / BETA + periods * (ALPHA / BETA - 0.5 + 0.5 * periods)


def outside(moved: float, predicted: float) -> float:
    """Return how far a motion is outside the range from none to the predicted one, rad."""
    low = min(predicted, 0.0)
    high = max(predicted, 0.0)
    return max(low - moved, moved - high, 0.0)


class Step(IntEnum):
    """Whether a joint left its motion by a step."""

    NONE = 0
    SUSPECTED = 1  # the readings since then do not contradict that
    CERTAIN = 2  # it moved faster than a human, or three readings since do not contradict that


class Departure(NamedTuple):
    """The first reading off a motion."""

    reading: float  # rad
    elapsed: float  # s since the latest reading on the motion
    jump: float  # change of the reading off the motion, rad


class LeftMotion(NamedTuple):
    """The motion that a joint left."""

    angle: float  # rad, of the latest reading on it
    velocity: float  # rad/s
    elapsed: float  # s since that reading
    departure: Departure


class JointMonitor:
    """
    Position and velocity of one joint by an alpha-beta filter, and what contradicts them.

    Times are s, angles rad. A repeated reading of an encoder that is slower than the bus is used
    only once the joint cannot have moved on (`REPEAT_TIME`).

    Parameters
    ----------
    sigma : float
        Configured standard deviation of the sensor, rad.
    threshold : float
        Standard deviations that healthy noise never exceeds (unit 1).
    acceleration, speed : float
        Human motion limits of a joint, rad/s^2 and rad/s.

    Attributes
    ----------
    readings : JointReadings
        What the readings show by themselves.
    velocity : float
        The filtered one, rad/s.
    reading_age : float
        Time from the reading that the filter used last to this sample, s; 0 if it used this one.
    innovation : float
        Size of the latest reading minus its prediction, in standard deviations of a healthy
        innovation.
    distance : float
        Distance of the latest reading from the motion that the joint left, rad, while it is away.
    away : int
        Readings since the joint left its motion, for `RETURN_TIME` at most; 0 while it is on it.
    step : Step
        Whether it left its motion by a step.
    departures : int
        How many motions it has left.
    returned : int
        Number of the departure from which it came back last; 0 before.

    """

    def __init__(
        self,
        sigma: float,
        threshold: float,
        acceleration: float,
        speed: float,
    ) -> None:
        self.readings = JointReadings(sigma)
        self._threshold = threshold
        self._acceleration = acceleration
        self._speed = speed
        self.departures = self.returned = 0
        self.allow(sigma)
        self.reset_motion()

    def reset_motion(self) -> None:
        """Have the next two readings set position and velocity."""
        # Readings that have set the motion: none, one for the position, two for the velocity.
        self._known = 0
        self.away = 0
        self._angle = self.velocity = self.reading_age = self.innovation = 0.0
        self.distance = 0.0
        self._last_innovation = nan
        self._left: LeftMotion | None = None
        self.step = Step.NONE

    def allow(self, sigma: float) -> None:
        """Let the limits allow for a standard deviation, rad, as configured or measured."""
        self.readings.allow(sigma)
        # Limit of an innovation by noise alone, rad.
        self._noise_limit = self._threshold * ONE_PERIOD * sigma

    def limit(self, dt: float, period: float) -> float:
        """
        Return the limit of an innovation, rad, `dt` (s) after a reading, with a `period` (s).

        k_fa sigma sqrt(variance) of the noise, and the lag of the filter at the human acceleration
        limit, so that no human motion leaves the motion of the joint.
        """
        periods = dt / period if dt > period else 1.0
        noise = self._threshold * innovation_deviation(periods) * self.readings.allowed
        human = self._acceleration * period * period * lag(periods)
        return noise + human

    def follow(
        self,
        reading: float,
        dt: float,
        period: float,
        timing_error: float,
    ) -> None:
        """
        Follow the motion with a reading; note what contradicts it.

        Parameters
        ----------
        reading : float
            Angle of the joint, rad; finite.
        dt : float
            Time since the last sample, s.
        period : float
            Usual time between samples, s.
        timing_error : float
            How much earlier or later than its stamp the reading may be sampled, s.

        """
        readings = self.readings
        change = readings.add(reading)
        if self._left is not None and self._follow_away(self._left, reading, change, dt, period):
            return
        is_repeated = change == 0.0
        if self._known < 2:
            if not (is_repeated and readings.is_slower_than_bus):
                self._begin(reading, max(dt, period))
            return
        is_joint_slow = abs(self.velocity * period) < readings.slow_step
        if not is_joint_slow:
            readings.note_moving(is_repeated)
        elapsed = self.reading_age + dt
        if readings.is_slower_than_bus:
            if elapsed < REPEAT_TIME:
                # The filter follows the readings of the encoder, which are so far apart.
                period = max(period, elapsed)
            if is_repeated:
                self._hold(reading, elapsed)
                return
        self._compare(reading, change, elapsed, period, timing_error, is_joint_slow=is_joint_slow)

    def _compare(
        self,
        reading: float,
        change: float,
        elapsed: float,
        period: float,
        timing_error: float,
        *,
        is_joint_slow: bool,
    ) -> None:
        """Compare a new reading with the motion, `elapsed` (s) after the reading used last."""
        was_late = self.reading_age > 0.0
        self.reading_age = 0.0
        innovation = remainder(reading - self._angle - self.velocity * elapsed, TURN)
        if abs(innovation) <= self._noise_limit and elapsed <= LATE_PERIODS * period:
            self.innovation = abs(innovation) / (ONE_PERIOD * self.readings.expected)
            if is_joint_slow:
                self.readings.note_noise(innovation - self._last_innovation)
            self._last_innovation = innovation
        else:
            self._last_innovation = nan
            limit = self.limit(elapsed, period) + abs(self.velocity) * timing_error
            is_late = was_late or elapsed > LATE_PERIODS * period
            if self._note_large(
                reading, innovation, elapsed, period, limit=limit, is_late=is_late
            ):
                # After a late reading only the filter knows where the joint was.
                jump = (
                    innovation if was_late else remainder(change - self.velocity * elapsed, TURN)
                )
                self._leave_motion(reading, jump, elapsed)
                return
            if elapsed > FORGET_PERIODS * period:
                self._angle = reading
                self._known = 1
                return
        self._angle += self.velocity * elapsed + ALPHA * innovation
        self.velocity += BETA * innovation / max(elapsed, period)

    def _hold(self, reading: float, elapsed: float) -> None:
        """Note a repeated reading: a slow encoder has no new one yet, or the joint has stopped."""
        if elapsed <= REPEAT_TIME:
            self.reading_age = elapsed
        else:
            self._angle = reading
            self.velocity = 0.0
            self.reading_age = 0.0

    def _note_large(
        self,
        reading: float,
        innovation: float,
        elapsed: float,
        period: float,
        *,
        limit: float,
        is_late: bool,
    ) -> bool:
        """Note a large innovation, rad; return whether it is beyond the limit (rad)."""
        size = abs(innovation)
        if size > limit and is_late:
            # It may have stopped meanwhile, or the reading be as old as the last sample: any
            # motion from none to the predicted one is healthy.
            moved = remainder(reading - self._angle, TURN)
            size = outside(moved, self.velocity * elapsed)
        periods = max(elapsed / period, 1.0)
        self.distance = size
        scale = ONE_PERIOD * self.readings.expected
        self.innovation = size * ONE_PERIOD / (scale * innovation_deviation(periods))
        return size > limit

    def _leave_motion(self, reading: float, jump: float, elapsed: float) -> None:
        """Leave the motion by a jump, rad."""
        if self._left is None:
            self._depart(reading, jump, elapsed)
        else:
            # It left another one shortly before, which no human motion does.
            self._known = 0
            self.step = Step.CERTAIN

    def _begin(self, reading: float, dt: float) -> None:
        """Let the first two readings set position and velocity."""
        if self._known:
            change = remainder(reading - self._angle, TURN)
            if self._left is None:
                self.away = 0
                self.step = Step.NONE
                if abs(change) > self._speed * dt + self._noise_limit:
                    self.velocity = 0.0
                    self.distance = abs(change)
                    self._depart(reading, change, dt)
                    return
            self.velocity = change / dt
        self._angle = reading
        self._known += 1

    def _depart(self, reading: float, jump: float, elapsed: float) -> None:
        """Remember the motion that the joint leaves, and the jump (rad) by which it does so."""
        self._left = LeftMotion(
            angle=self._angle,
            velocity=self.velocity,
            elapsed=elapsed,
            departure=Departure(reading=reading, elapsed=elapsed, jump=jump),
        )
        self.away = 1
        self.departures += 1
        is_certain = abs(jump) > self._speed * elapsed + self._noise_limit
        self.step = Step.CERTAIN if is_certain else Step.SUSPECTED

    def _follow_away(
        self,
        left: LeftMotion,
        reading: float,
        change: float,
        dt: float,
        period: float,
    ) -> bool:
        """
        Compare a reading with the motion that the joint left.

        Return whether that is all for this reading: else it begins the motion from where it is.
        """
        elapsed = left.elapsed + dt
        self.distance = abs(remainder(reading - left.angle - left.velocity * elapsed, TURN))
        self.innovation = self.distance / (ONE_PERIOD * self.readings.expected)
        is_near = self.distance <= RETURN_FRACTION * self.limit(elapsed, period)
        # It has to jump back: a joint that drifts across its old motion has not returned.
        turned = abs(remainder(change, TURN))
        least_jump = RETURN_FRACTION * self.limit(period, period) + abs(left.velocity) * dt
        if elapsed <= RETURN_TIME and is_near and turned > least_jump:
            self._return_to(reading, left.velocity)
            return True
        self.away += 1
        if self.away <= AWAY_SAMPLES:
            self._judge_step(reading, left, elapsed)
        elif self.away > STEP_SAMPLES:
            self.step = Step.NONE
        # A pause may hide whether it was a step: that is decided with this reading.
        self._left = None if elapsed > RETURN_TIME else left._replace(elapsed=elapsed)
        if self.away == AWAY_SAMPLES or self._left is None:
            # Follow it from where it is.
            self._known = 0
        return self.away < AWAY_SAMPLES and self._left is not None

    def _return_to(self, reading: float, velocity: float) -> None:
        """Continue the motion that the joint left, with a reading on it."""
        self._angle = reading
        self.velocity = velocity
        self._known = 2
        self._left = None
        self.away = 0
        self.step = Step.NONE
        self.returned = self.departures

    def _judge_step(self, reading: float, left: LeftMotion, elapsed: float) -> None:
        """
        Compare the motion after a step with that before it, `elapsed` (s) after the latter.

        After an impact the joint goes on in the direction of the step, faster than a human could
        make it: that is no step. After a jump it goes on as before.
        """
        first = left.departure
        since = elapsed - first.elapsed
        change = remainder(reading - first.reading - left.velocity * since, TURN)
        noise = self._threshold * ROOT_TWO * self.readings.allowed
        human = 0.5 * self._acceleration * since * since
        if change * first.jump > 0.0 and abs(change) > noise + human:
            self.step = Step.NONE
        elif self.away == AWAY_SAMPLES and self.step:
            self.step = Step.CERTAIN
