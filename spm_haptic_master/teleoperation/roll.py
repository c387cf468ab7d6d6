# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The roll of the wrist by which a surgeon shows that a hand is on the handle."""

from __future__ import annotations

from math import atan2, pi, tau

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import conjugate, multiply_quaternions


class Roll:
    """How far the handle has rolled about its own z axis, to and fro, since the first rotation."""

    def __init__(self) -> None:
        self._first: Quaternion[float] | None = None
        self._angle = self._least = self._largest = 0.0

    @property
    def extent(self) -> float:
        """Return the difference of the largest and the smallest roll, rad."""
        return self._largest - self._least

    def add(self, rotation: Quaternion[float]) -> None:
        """Add a rotation of the handle, as a unit quaternion x, y, z, w."""
        if self._first is None:
            self._first = rotation
            return
        _, _, z, w = multiply_quaternions(conjugate(self._first), rotation)
        # The twist about z of the rotation since the first, on the branch of the last one.
        turn = (2.0 * atan2(z, w) - self._angle) % tau
        self._angle += turn - tau if turn > pi else turn
        self._least = min(self._least, self._angle)
        self._largest = max(self._largest, self._angle)
