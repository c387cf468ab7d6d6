# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of the motors' joints by the raw angles of the encoders: work and velocity."""

from __future__ import annotations

from collections import deque
from math import inf, isfinite, remainder, tau

from spm_haptic_master.force.statics import Torques

# Time over which a joint velocity is averaged (ns), and samples that are kept for it.
VELOCITY_WINDOW = 10_000_000
KEPT = 200
# Fastest joint (rad/s): beyond, an encoder has jumped. Of a handle at 10 rad/s the joints
# are twice as fast, and noise of five times its figure differs by 5 rad/s from sample to sample.
FASTEST = 30.0


class JointMotion:
    """
    Motion of the first joints of a sample, which have motors.

    Parameters
    ----------
    motors : {3, 4}
        Number of motors.

    Attributes
    ----------
    is_missing : bool
        Whether the angle of a motor is missing in the latest sample.

    """

    def __init__(self, motors: int) -> None:
        self._motors = motors
        # Stamps (ns) and raw angles (rad) of the latest samples without a jump between them.
        self._kept: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=KEPT)
        self.is_missing = False

    def restart(self) -> None:
        """Forget the motion."""
        self._kept.clear()

    def follow(
        self,
        stamp: int,
        angles: tuple[float, ...],
        torques: Torques,
        dt: float,
    ) -> float | None:
        """
        Follow a sample; return the work of the motors since the sample before, J.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            All raw angles, rad; NaN of a joint without a reading.
        torques : tuple of float
            Torques of the motors that were in force meanwhile, N m.
        dt : float
            Time since the sample before, s.

        Returns
        -------
        float or None
            None if a motor's angle is missing in one of the two samples, or has jumped.

        """
        work = None
        if self._kept:
            _, before = self._kept[-1]
            work = _work(torques, angles, before, FASTEST * dt)
        if work is None:
            self.restart()
            self.is_missing = not isfinite(sum(angles[: self._motors]))
        if not self.is_missing:
            self._kept.append((stamp, angles))
        return work

    @property
    def velocity(self) -> Torques | None:
        """Velocity of the motors' joints over `VELOCITY_WINDOW`, rad/s; None before half of it."""
        kept = self._kept
        if not kept:
            return None
        stamp, angles = kept[-1]
        while kept[0][0] < stamp - VELOCITY_WINDOW:
            kept.popleft()
        first, begin = kept[0]
        if stamp - first < VELOCITY_WINDOW // 2:
            return None
        rate = 1e9 / (stamp - first)
        return tuple(
            [
                rate * remainder(angle - last, tau)
                for angle, last in zip(angles, begin[: self._motors], strict=False)
            ]
        )


def _work(
    torques: Torques,
    angles: tuple[float, ...],
    before: tuple[float, ...],
    most: float,
) -> float | None:
    """Return the work of torques (N m) between angles, J; None if a joint turns more than most."""
    work = 0.0
    for torque, angle, last in zip(torques, angles, before, strict=False):
        turn = angle - last
        if not -most <= turn <= most:
            # A raw angle may differ by a turn where the joint does not.
            turn = remainder(turn, tau) if isfinite(turn) else inf
            if abs(turn) > most:
                return None
        work += torque * turn
    return work
