# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback without parts of it, to show what they are for."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from spm_haptic_master.force import (
    ForceController,
    ForceLimits,
    ForceOutput,
    ForceSample,
    three_motors,
)
from spm_haptic_master.force.energy import EnergyBudget
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.force.samples import ENGAGED
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion

# No limit of what a motor may do (N m), of the handle's speed (rad/s), nor of the motors along the
# weak direction (unit 1).
UNLIMITED, UNBOUNDED = 1e3, 1e9


class _NoBudget(EnergyBudget):
    """A budget that counts, and nothing follows from it."""

    __slots__ = ()

    def count(self, given: float, asked: Vector[float], dt: float) -> bool:
        super().count(given, asked, dt)
        self.damping, self.share = 0.0, 1.0
        return False


def without_energy_law(motors: int = 3) -> ForceController:
    """Return force feedback that generates what the delays make of it."""
    controller = ForceController(motors=motors, limits=ForceLimits(ramp=0.05, speed=UNLIMITED))
    controller._energy = _NoBudget()
    return controller


@contextmanager
def weak_bound(bound: float, begin: float) -> Iterator[None]:
    """Set what bounds the weak part of three motors: see `three_motors`."""
    usual = three_motors.BOUND, three_motors.BEGIN
    three_motors.BOUND, three_motors.BEGIN = bound, begin
    try:
        yield
    finally:
        three_motors.BOUND, three_motors.BEGIN = usual


class Bare:
    """Wrench and viscous damping, N m s/rad, by the statics alone: no limit, ramp or energy."""

    def __init__(self, damping: float) -> None:
        self._damping = damping
        self._statics = make_statics(Geometry(), (1, 1, 1), 3, ForceLimits(motor_torque=UNLIMITED))

    def take(self, sample: ForceSample) -> ForceOutput:
        """Return the motor torques for a sample that has an orientation and a wrench."""
        x, y, z = sample.wrench.torque
        wx, wy, wz = sample.velocity or (0.0, 0.0, 0.0)
        b = self._damping
        asked = x - b * wx, y - b * wy, z - b * wz
        self._statics.place(rotation_from_quaternion(*sample.quaternion))
        tau, rendered = self._statics.render(asked)
        return ForceOutput(ENGAGED, tau, asked, rendered, None, 0.0, 1.0)
