# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of the motors' joints by the raw angles of the encoders: work and velocity."""

from __future__ import annotations

from collections import deque
from math import isfinite, remainder, tau
from operator import mul

from spm_haptic_master.force.statics import FOUR, Torques

# Time over which a joint velocity is averaged (ns), and samples that are kept for it.
WINDOW = 10_000_000
KEPT = 200
# Fastest joint (rad/s): beyond, an encoder has jumped. Of a handle at 10 rad/s the joints
# are twice as fast, and noise of five times its figure differs by 5 rad/s from sample to sample.
FASTEST = 30.0


class JointMotion:
    """Differences and velocities of the raw angles of some motors: the first of a sample."""

    __slots__ = ('_has_four', '_kept', '_last', '_motors', 'is_missing')

    def __init__(self, motors: int) -> None:
        self._motors = motors
        self._has_four = motors == FOUR
        # Stamps and raw angles, and the latest of these.
        self._kept: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=KEPT)
        self._last: tuple[float, ...] | None = None
        self.is_missing = False  # whether an angle is missing in the latest sample

    def restart(self) -> None:
        """Forget the motion."""
        self._kept.clear()
        self._last = None

    def work(
        self,
        stamp: int,
        angles: Torques,
        torques: Torques,
        dt: float,
    ) -> float | None:
        """
        Take a sample; return the work of motor torques since the sample before, J.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            All raw angles, rad.
        torques : tuple of float
            Torques of the motors that were in force meanwhile, N m.
        dt : float
            Time since the sample before, s.

        Returns
        -------
        float or None
            None where an angle is missing at one of its ends, or has jumped.

        """
        most = FASTEST * dt
        last = self._last
        work = None
        if last is not None:
            x = angles[0] - last[0]
            y = angles[1] - last[1]
            z = angles[2] - last[2]
            square = x * x + y * y + z * z
            usual = torques[0] * x + torques[1] * y + torques[2] * z
            if self._has_four:
                w = angles[3] - last[3]
                square += w * w
                usual += torques[3] * w
            if square <= most * most:
                # The usual case.
                self._kept.append((stamp, angles))
                self._last = angles
                return usual
        own = angles[: self._motors]
        self.is_missing = not isfinite(sum(own))
        if last is not None and not self.is_missing:
            # A raw angle differs by a turn where the joint does not.
            turned = [remainder(new - old, tau) for new, old in zip(own, last, strict=False)]
            if max(map(abs, turned)) <= most:
                work = sum(map(mul, torques, turned))
        if work is None:
            self.restart()
        if not self.is_missing:
            self._kept.append((stamp, angles))
            self._last = angles
        return work

    @property
    def velocity(self) -> Torques | None:
        """Velocity of the joints, rad/s, over `WINDOW`; None before half of it."""
        kept = self._kept
        if not kept:
            return None
        stamp, angles = kept[-1]
        while kept[0][0] < stamp - WINDOW:
            kept.popleft()
        first, begin = kept[0]
        if stamp - first < WINDOW // 2:
            return None
        rate = 1e9 / (stamp - first)
        return tuple(
            [
                rate * remainder(angle - last, tau)
                for angle, last in zip(angles, begin[: self._motors], strict=False)
            ]
        )
