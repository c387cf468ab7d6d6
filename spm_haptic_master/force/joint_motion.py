# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of the motors' joints by their raw angles."""

from __future__ import annotations

from collections import deque
from math import isfinite, remainder, tau
from operator import sub

# Time over which a joint velocity is averaged (ns).
WINDOW = 10_000_000
# Fastest joint (rad/ns): beyond, an encoder has jumped. The fastest handle is 10 rad/s, its joints
# are twice as fast, and noise of five times its figure differs by 5 rad/s from sample to sample.
FASTEST = 30e-9


class JointMotion:
    """
    Differences and velocities of the motors' raw angles.

    Parameters
    ----------
    motors : {3, 4}
        Number of motors: the first angles of a sample are theirs.

    Attributes
    ----------
    turned : tuple of float or None
        Difference to the sample before, rad; None where an angle is missing in one of them, or
        has jumped.
    is_missing : bool
        Whether an angle is missing in the latest sample.

    """

    __slots__ = ('_kept', '_last', '_motors', 'is_missing', 'turned')

    def __init__(self, motors: int) -> None:
        self._motors = motors
        # Stamps and raw angles.
        self._kept: deque[tuple[int, tuple[float, ...]]] = deque()
        self._last: tuple[float, ...] | None = None
        self.turned: tuple[float, ...] | None = None
        self.is_missing = False

    def restart(self) -> None:
        """Forget the motion."""
        self._kept.clear()
        self._last = self.turned = None

    def take(self, stamp: int, angles: tuple[float, ...]) -> None:
        """Take a sample: stamp in ns, angles in rad."""
        last, kept, angles = self._last, self._kept, angles[:self._motors]
        if last is None:
            self.turned = None
            if not isfinite(sum(angles)):
                self.is_missing = True
                return
        else:
            self.turned = turned = tuple(map(sub, angles, last))
            most = FASTEST * (stamp - kept[-1][0])
            for angle in turned:
                if not -most <= angle <= most:
                    if not isfinite(sum(angles)):
                        self.restart()
                        self.is_missing = True
                        return
                    # A raw angle differs by a turn where the joint does not.
                    self.turned = turned = tuple([remainder(each, tau) for each in turned])
                    if max(map(abs, turned)) > most:
                        self.restart()
                    break
        self._last, self.is_missing = angles, False
        kept.append((stamp, angles))
        while kept[0][0] < stamp - WINDOW:
            kept.popleft()

    @property
    def velocity(self) -> tuple[float, ...] | None:
        """Velocity of the joints, rad/s, over `WINDOW`; None before half of it."""
        if not self._kept:
            return None
        (first, begin), (stamp, angles) = self._kept[0], self._kept[-1]
        if stamp - first < WINDOW // 2:
            return None
        rate = 1e9 / (stamp - first)
        return tuple([rate * remainder(angle - last, tau)
                      for angle, last in zip(angles, begin, strict=True)])
