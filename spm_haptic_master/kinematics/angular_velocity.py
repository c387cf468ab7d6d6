# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angular velocity from the newest orientations."""

from __future__ import annotations

from collections import deque

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import multiply_quaternions
from spm_haptic_master.timing import SECOND


class AngularVelocity:
    """
    Least-squares slope of the orientation over a sliding window, in plain floats.

    The difference of two samples would amplify the sensors' noise by the sample rate. The slope of
    a straight line through the n samples of the window amplifies it by about
    sqrt(12 / n) / window, and lags by half the window (ns, 1 or more).
    """

    def __init__(self, window: int):
        self._window = window
        self._kept: deque[tuple[int, Quaternion[float]]] = deque()

    def add(self, stamp: int, quaternion: Quaternion[float]) -> None:
        """Add an orientation: stamp in ns, sign-continuous unit quaternion x, y, z, w."""
        kept = self._kept
        kept.append((stamp, quaternion))
        while kept[0][0] < stamp - self._window:
            kept.popleft()

    def value(self) -> Vector[float] | None:
        """
        Return the angular velocity in the base frame, rad/s; None until half a window is filled.

        It is exact to first order in the rotation within the window: the derivative of a unit
        quaternion q is half the product of the angular velocity, as a quaternion, and q.
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
        # The vector part of 2 qdot q*, where q* is the conjugate of the newest quaternion.
        x, y, z, _ = multiply_quaternions((dx, dy, dz, dw), (-x, -y, -z, w))
        scale = 2.0 * SECOND / spread
        return scale * x, scale * y, scale * z
