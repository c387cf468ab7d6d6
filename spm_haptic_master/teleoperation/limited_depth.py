# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The commanded depth of the tip below the trocar, which follows a target within limits."""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign

from spm_haptic_master.teleoperation.braking import braking_speed, closing_speed, ROUNDING


@dataclass(frozen=True, slots=True)
class DepthLimits:
    """Limits of the commanded depth."""

    shortest: float  # m
    deepest: float  # m
    speed: float  # m/s
    acceleration: float  # m/s^2
    # Whether the depth slews to a target that would break speed or acceleration; else it is
    # withheld. At the ends of the range it always brakes and waits.
    slews: bool
    longest_step: float  # longest time for which the depth catches up in one step, s


class LimitedDepth:
    """A commanded depth, at rest at first."""

    def __init__(self, limits: DepthLimits, depth: float) -> None:
        self._limits = limits
        self._target = depth  # at the last step, m
        self._target_rate = 0.0  # m/s
        self.depth = depth  # m
        self.rate = 0.0  # m/s

    def advance(self, target: float, dt: float) -> str:
        """
        Move towards a target.

        Parameters
        ----------
        target
            Depth to follow, m; one outside the range is followed to its end.
        dt
            Time since the last step, above 0, s.

        Returns
        -------
        str
            Empty if the depth has moved; else the limit that the target would break, where the
            depth does not slew.

        """
        limits = self._limits
        target_rate = (target - self._target) / dt
        if not limits.slews:
            broken = self._broken_by(target_rate, dt)
            if broken:
                return broken
        clamped = _clamped(target, limits.shortest, limits.deepest)
        before = _clamped(self._target, limits.shortest, limits.deepest)
        clamped_rate = (clamped - before) / dt
        wanted = (clamped - self.depth) / dt
        # Also where it has caught up, it must not be faster than the target by too much.
        is_reachable = self._bounded(wanted, dt) == wanted and (
            abs(wanted - clamped_rate) <= (1.0 + ROUNDING) * limits.acceleration * dt
        )
        if is_reachable:
            self.depth = clamped
            self.rate = wanted
        else:
            approach = self._approach(before, clamped_rate, dt)
            self.rate = self._bounded(approach, dt)
            self.depth += self.rate * dt
        self._target = target
        self._target_rate = target_rate
        return ''

    def _broken_by(self, target_rate: float, dt: float) -> str:
        """Return the limit that the target's own motion breaks; empty if none."""
        limits = self._limits
        if abs(target_rate) > (1.0 + ROUNDING) * limits.speed:
            return 'insertion speed'
        change = abs(target_rate - self._target_rate)
        if change > (1.0 + ROUNDING) * limits.acceleration * dt:
            return 'insertion acceleration'
        return ''

    def _approach(
        self,
        target: float,
        target_rate: float,
        dt: float,
    ) -> float:
        """Return the rate to where a target was that moves, able to stay with it, m/s."""
        error = target - self.depth
        speed = closing_speed(abs(error), dt, self._limits.acceleration * dt)
        return target_rate + copysign(speed, error)

    def _bounded(self, wanted: float, dt: float) -> float:
        """Return the rate nearest to a wanted one that the limits allow, m/s."""
        limits = self._limits
        speed = limits.speed * min(dt, limits.longest_step) / dt
        deeper = braking_speed(limits.deepest - self.depth, dt, limits.acceleration)
        higher = braking_speed(self.depth - limits.shortest, dt, limits.acceleration)
        allowed = _clamped(wanted, -min(speed, higher), min(speed, deeper))
        change = (1.0 + ROUNDING) * limits.acceleration * dt
        # It may be faster than `speed` after a pause: then it slows down as fast as it can.
        return _clamped(allowed, self.rate - change, self.rate + change)


def _clamped(
    value: float,
    smallest: float,
    largest: float,
) -> float:
    """Return the nearest value in a range."""
    return min(max(value, smallest), largest)
