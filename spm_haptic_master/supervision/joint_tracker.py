# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of one joint so far, and the prediction of its next reading."""

from __future__ import annotations

from math import pi, remainder

# Gains of the alpha-beta filter on position and velocity (unit 1). They follow a human motion
# quickly: at a constant acceleration a the lag is a dt^2 / BETA only, while the noise of a single
# reading stays visible.
ALPHA = 0.6
BETA = 0.2
# Standard deviation of the innovation over that of the sensor, with these gains (unit 1).
INNOVATION_DEVIATION = 1.343
# Readings over which the liveliness is averaged.
LIVELINESS_SAMPLES = 16.0
# Readings over which a second, steadier velocity is averaged: the filter's own is so noisy that a
# joint at rest would seem to miss motion.
STEADY_SAMPLES = 16.0
# Readings that determine position and velocity.
READINGS_NEEDED = 2
# Full turn (rad).
TURN = 2.0 * pi


class JointTracker:
    """
    Position and velocity of one joint by an alpha-beta filter, in plain floats.

    Attributes
    ----------
    angle, velocity : float
        Filtered position, rad, and velocity, rad/s.
    repeats : int
        Number of readings in a row that equal the one before.
    missed_motion : float
        Motion to be expected since the readings repeat, rad.
    coasting : bool
        Whether the latest reading was left out of the filter.
    liveliness : float
        Fraction of the latest readings that differ from the one before, 0 .. 1.

    """

    __slots__ = ('_known', '_last', '_speed_before', '_steady_velocity', 'angle', 'coasting',
                 'liveliness', 'missed_motion', 'repeats', 'velocity')

    def __init__(self) -> None:
        self.angle = 0.0
        self.liveliness = 0.0
        self.restart()

    def restart(self) -> None:
        """Reset the motion state, the repeats and the steady velocity."""
        self.reset_motion()
        self._last: float | None = None
        self.repeats = 0
        self.missed_motion = self._speed_before = self._steady_velocity = 0.0

    def reset_motion(self) -> None:
        """Reset the motion state: the next two readings determine it; repeats are kept."""
        self._known = 0
        self.velocity = 0.0
        self.coasting = False

    def offset(self, reading: float) -> float:
        """Return a reading minus the last filtered position, rad, -pi .. pi."""
        return remainder(reading - self.angle, TURN)

    def innovation(self, reading: float, dt: float) -> float:
        """
        Return a reading minus its prediction, and update repeats and liveliness.

        Parameters
        ----------
        reading : float
            Joint angle, rad.
        dt : float
            Time since the last reading, s.

        Returns
        -------
        float
            rad, -pi .. pi; 0 until two readings have determined the motion.

        """
        if reading == self._last:
            self.repeats += 1
            self.missed_motion += self._speed_before * dt
            self.liveliness -= self.liveliness / LIVELINESS_SAMPLES
        else:
            self.repeats = 0
            self.missed_motion = 0.0
            # Repeats slow the filter down themselves, so that the speed before them counts. At
            # rest the noisy velocity is too large, where a motion reverses the steady one is.
            velocity, steady = self.velocity, self._steady_velocity
            steady = self._steady_velocity = steady + (velocity - steady) / STEADY_SAMPLES
            self._speed_before = min(abs(velocity), abs(steady))
            self.liveliness += (1.0 - self.liveliness) / LIVELINESS_SAMPLES
            self._last = reading
        if self._known < READINGS_NEEDED:
            return 0.0
        return remainder(reading - self.angle - self.velocity * dt, TURN)

    def update(self, reading: float, innovation: float, dt: float, period: float) -> None:
        """
        Update position and velocity with a reading.

        Parameters
        ----------
        reading : float
            Joint angle, rad.
        innovation : float
            What `innovation` returned for it, rad.
        dt : float
            Time since the last reading, s.
        period : float
            Average sampling period, s. Two readings closer together than this carry no more
            information on the velocity; divided by `dt` their noise would become speed.

        """
        self.coasting = False
        if self._known >= READINGS_NEEDED:
            self.angle += self.velocity * dt + ALPHA * innovation
            self.velocity += BETA * innovation / max(dt, period)
            return
        if self._known == 1:
            self.velocity = remainder(reading - self.angle, TURN) / max(dt, period)
        self.angle = reading
        self._known += 1

    def coast(self, dt: float) -> None:
        """Extrapolate the motion over `dt`, s, without the reading."""
        self.coasting = True
        self.angle += self.velocity * dt
