# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion of the motors' joints by their raw angles."""

from __future__ import annotations

from collections import deque
from math import isfinite, remainder, tau

# Time over which a joint velocity is averaged (ns).
WINDOW = 10_000_000


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
        Difference to the sample before, rad; None where an angle is missing in one of them.
    velocity : tuple of float or None
        rad/s, over `WINDOW`; None where an angle is missing, or before half of it.

    """

    __slots__ = ('_kept', '_motors', 'turned', 'velocity')

    def __init__(self, motors: int) -> None:
        self._motors = motors
        # Stamps, and angles without turns of 2 pi.
        self._kept: deque[tuple[int, tuple[float, ...]]] = deque()
        self.turned: tuple[float, ...] | None = None
        self.velocity: tuple[float, ...] | None = None

    def restart(self) -> None:
        """Forget the motion."""
        self._kept.clear()
        self.turned = self.velocity = None

    def take(self, stamp: int, angles: tuple[float, ...]) -> None:
        """Take a sample: stamp in ns, angles in rad."""
        angles = angles[:self._motors]
        kept = self._kept
        if not isfinite(sum(angles)):
            self.restart()
            return
        if not kept:
            kept.append((stamp, angles))
            return
        before = kept[-1][1]
        self.turned = turned = tuple([
            remainder(angle - last, tau) for angle, last in zip(angles, before, strict=True)])
        angles = tuple([last + angle for last, angle in zip(before, turned, strict=True)])
        kept.append((stamp, angles))
        while kept[0][0] < stamp - WINDOW:
            kept.popleft()
        first, begin = kept[0]
        if stamp - first >= WINDOW // 2:
            rate = 1e9 / (stamp - first)
            self.velocity = tuple([
                rate * (angle - last) for angle, last in zip(angles, begin, strict=True)])
        else:
            self.velocity = None
