# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angular velocity from the newest orientations."""

from __future__ import annotations

from collections import deque

from spm_haptic_master.kinematics.rotations import multiply_quaternions

# A second in the stamps' unit (ns).
SECOND = 1e9


class AngularVelocity:
    """
    Least-squares slope of the orientation over a sliding window, in plain floats.

    Differences of single samples would carry the sensors' noise times the sample rate; a straight
    line through the window's n samples carries about sqrt(12 / n) / window times it, and lags half
    the window behind.

    Parameters
    ----------
    window : int
        ns of orientations that the slope is taken over.

    """

    def __init__(self, window: int):
        self._window = window
        self._kept: deque[tuple[int, tuple[float, float, float, float]]] = deque()

    def add(self, stamp: int, quaternion: tuple[float, float, float, float]) -> None:
        """Take an orientation: stamp in ns, sign-continuous unit quaternion x, y, z, w."""
        kept = self._kept
        kept.append((stamp, quaternion))
        while kept[0][0] < stamp - self._window:
            kept.popleft()

    def value(self) -> tuple[float, float, float] | None:
        """
        Return the angular velocity in the base frame, rad/s; None until half a window is known.

        To first order in the rotation within the window: the derivative of a unit quaternion is
        half the angular velocity's quaternion times it.
        """
        kept = self._kept
        if not kept:
            return None
        newest, (x, y, z, w) = kept[-1]
        if newest - kept[0][0] < 0.5 * self._window:
            return None
        times = [stamp - newest for stamp, _ in kept]
        mean = sum(times) / len(times)
        spread = dx = dy = dz = dw = 0.0
        for time, (_, (qx, qy, qz, qw)) in zip(times, kept, strict=True):
            offset = time - mean
            spread += offset * offset
            dx += offset * qx
            dy += offset * qy
            dz += offset * qz
            dw += offset * qw
        # omega = 2 qdot q*, its vector part; q* is the conjugate of the newest quaternion.
        x, y, z, _ = multiply_quaternions((dx, dy, dz, dw), (-x, -y, -z, w))
        scale = 2.0 * SECOND / spread
        return scale * x, scale * y, scale * z
