# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A joint's motion so far, against which its next reading is held."""

from __future__ import annotations

from math import pi, remainder

# Gains of the alpha-beta filter. They follow a hand quickly: a constant acceleration a is lagged
# by a dt^2 / BETA only, while a single reading's noise stays visible.
ALPHA = 0.6
BETA = 0.2
# Standard deviation of the innovation over that of the sensor, with these gains (unit 1).
INNOVATION_DEVIATION = 1.343
# Readings over which it is averaged how often a sensor's value changes.
LIVELINESS_SAMPLES = 16.0
# Readings over which the velocity is averaged beside the filter's own, which is so noisy that a
# joint at rest would seem to miss motion.
STEADY_SAMPLES = 16.0

TURN = 2.0 * pi


class JointTracker:
    """
    Position and velocity of one joint by an alpha-beta filter, in plain floats.

    Attributes
    ----------
    angle, velocity : float
        rad, rad/s; filtered.
    repeats : int
        How many readings in a row were exactly the same as the one before.
    missed_motion : float
        rad; how far the joint would have come while its readings repeated.
    coasting : bool
        The latest reading was not taken in.
    liveliness : float
        Part of the latest readings that differed from the one before (0 .. 1).

    """

    __slots__ = ('_known', '_last', '_speed_before', '_steady_velocity', 'angle', 'coasting',
                 'liveliness', 'missed_motion', 'repeats', 'velocity')

    def __init__(self):
        self.angle = self.velocity = 0.0
        self.liveliness = 0.0
        self.forget()

    def forget(self) -> None:
        """Begin anew."""
        self.lose_motion()
        self._last: float | None = None
        self.repeats = 0
        self.missed_motion = self._speed_before = self._steady_velocity = 0.0

    def lose_motion(self) -> None:
        """Have the next two readings set position and velocity; what repeats is still known."""
        self._known = 0
        self.velocity = 0.0
        self.coasting = False

    def offset(self, reading: float) -> float:
        """Return how far a reading is from where the joint was thought to be last, rad."""
        return remainder(reading - self.angle, TURN)

    def innovation(self, reading: float, dt: float) -> float:
        """Return reading minus prediction, rad; 0 until position and velocity are known."""
        if reading == self._last:
            self.repeats += 1
            self.missed_motion += self._speed_before * dt
            self.liveliness -= self.liveliness / LIVELINESS_SAMPLES
        else:
            self.repeats = 0
            self.missed_motion = 0.0
            # The repeats that may follow will slow the filter down themselves. At rest the noisy
            # velocity is too large, where a motion turns back the steady one.
            velocity, steady = self.velocity, self._steady_velocity
            steady = self._steady_velocity = steady + (velocity - steady) / STEADY_SAMPLES
            self._speed_before = min(abs(velocity), abs(steady))
            self.liveliness += (1.0 - self.liveliness) / LIVELINESS_SAMPLES
            self._last = reading
        if self._known < 2:
            return 0.0
        return remainder(reading - self.angle - self.velocity * dt, TURN)

    def follow(self, reading: float, innovation: float, dt: float, period: float) -> None:
        """
        Take the reading in.

        `period`, s, is the readings' usual distance: two that come closer together tell no more of
        the velocity than that, and divided by `dt` their noise would be taken for speed.
        """
        self.coasting = False
        if self._known >= 2:
            self.angle += self.velocity * dt + ALPHA * innovation
            self.velocity += BETA * innovation / max(dt, period)
            return
        if self._known == 1:
            self.velocity = remainder(reading - self.angle, TURN) / max(dt, period)
        self.angle = reading
        self._known += 1

    def coast(self, dt: float) -> None:
        """Go on as before, without the reading."""
        self.coasting = True
        self.angle += self.velocity * dt
