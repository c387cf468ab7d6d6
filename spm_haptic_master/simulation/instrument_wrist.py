# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated instrument wrist: it follows its commanded rotation with a lag, and holds it."""

from __future__ import annotations

from math import exp

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    quaternion_from_vector,
    vector_from_quaternion,
)


class InstrumentWrist:
    """
    A first-order follower of `commanded`, which it holds, in each time constant by 1 - 1 / e.

    `rotation` is its own; both are unit quaternions x, y, z, w, the time constant is in s.
    """

    def __init__(self, rotation: Quaternion[float], time_constant: float) -> None:
        self._time_constant = time_constant
        self.rotation = self.commanded = rotation

    def advance(self, dt: float) -> None:
        """Follow the command for a time, s."""
        x, y, z = vector_from_quaternion(
            *multiply_quaternions(self.commanded, conjugate(self.rotation)))
        part = 1.0 - exp(-dt / self._time_constant)
        moved = multiply_quaternions(
            quaternion_from_vector(part * x, part * y, part * z), self.rotation)
        norm = sum(component * component for component in moved) ** 0.5
        self.rotation = (moved[0] / norm, moved[1] / norm, moved[2] / norm, moved[3] / norm)
