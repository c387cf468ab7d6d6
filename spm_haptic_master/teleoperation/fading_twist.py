# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The velocity for a slave that is driven by rates: it fades to zero, and stops."""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.kinematics.vectors import scaled
from spm_haptic_master.teleoperation.braking import ROUNDING
from spm_haptic_master.teleoperation.command import Motion
from spm_haptic_master.teleoperation.vectors import moved_toward, norm

# Longest time in which a twist ends, whatever the acceleration (s): nobody leads it by then.
FADE_LONGEST = 0.1


@dataclass(slots=True)
class Fade:
    """A motion that is about to end."""

    first: Motion  # at the beginning of the end
    duration: float  # time in which it ends, s
    passed: float = 0.0  # time since its beginning, s


class FadingTwist:
    """
    The motion of the commands while there are commands, then one that fades to zero.

    It fades along the same screw: turning and sliding shrink by the same share, so that the shaft
    keeps passing through its trocar.

    Parameters
    ----------
    acceleration
        Largest angular acceleration, rad/s^2; at the end more, where `FADE_LONGEST` needs it.
    sliding_acceleration
        The same of the sliding along the shaft, m/s^2.
    zeros
        Number of zero velocities before the end: one may get lost.

    """

    def __init__(
        self,
        acceleration: float,
        sliding_acceleration: float,
        zeros: int,
    ) -> None:
        self._acceleration = acceleration
        self._sliding_acceleration = sliding_acceleration
        self._zeros = zeros
        self._zeros_left = 0
        self._motion = Motion()
        self._fade: Fade | None = None  # None while there is a command

    def follow(self, motion: Motion, dt: float) -> Motion:
        """Return the motion of a command, or the nearest one within reach in `dt`, s."""
        gain = (1.0 + ROUNDING) * dt
        last = self._motion
        self._motion = Motion(
            angular=moved_toward(last.angular, motion.angular, gain * self._acceleration),
            lever=motion.lever,
            sliding=moved_toward(last.sliding, motion.sliding, gain * self._sliding_acceleration),
        )
        self._zeros_left = self._zeros
        self._fade = None
        return self._motion

    def fade(self, dt: float) -> Motion | None:
        """Return the motion after a further time `dt` without a command, s; None at the end."""
        if not self._zeros_left:
            return None
        fade = self._fade
        if fade is None:
            fade = Fade(self._motion, self._duration())
            self._fade = fade
        fade.passed += dt
        first = fade.first
        if fade.passed < fade.duration:
            left = 1.0 - fade.passed / fade.duration
            self._motion = Motion(
                angular=scaled(left, first.angular),
                lever=first.lever,
                sliding=scaled(left, first.sliding),
            )
        else:
            self._motion = Motion(lever=first.lever)
            self._zeros_left -= 1
        return self._motion

    def stop(self) -> None:
        """Forget the motion, which nobody follows any more: the next one begins from rest."""
        self._motion = Motion()
        self._zeros_left = 0

    def _duration(self) -> float:
        """Return the time in which the motion fades, s."""
        return min(
            FADE_LONGEST,
            max(
                norm(self._motion.angular) / self._acceleration,
                norm(self._motion.sliding) / self._sliding_acceleration,
            ),
        )
