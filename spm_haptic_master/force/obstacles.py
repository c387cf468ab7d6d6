# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What keeps force from beginning or going on."""

from __future__ import annotations

from math import isfinite
from operator import sub

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.force_state import Reason
from spm_haptic_master.force.samples import Drives, ForceSample, Wrench
from spm_haptic_master.force.shaping import Lasting, size

# Deviation of a motor's torque from its command (unit 1) that is a fault if it lasts (s). Below a
# quarter of its limit a motor's friction and its drive's noise are larger than such a share.
TORQUE_SHARE, TORQUE_FLOOR, TORQUE_TIME = 0.2, 0.25, 0.05
# Messages in a row with a small torque, with which force may begin.
SMALL_MESSAGES = 3


class Obstacles:
    """
    Conditions of force, evaluated at each sample.

    Parameters
    ----------
    limits : ForceLimits
        Limits.

    """

    __slots__ = ('_age', '_limits', '_off_command', '_speed')

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        # Oldest wrench (ns), and the square of the fastest handle (rad^2/s^2).
        self._age, self._speed = limits.wrench_age * 1e9, limits.speed ** 2
        self._off_command = Lasting(TORQUE_TIME)

    def take(self, sample: ForceSample, angle_missing: bool, commanded: tuple[float, ...],
             dt: float, energy_generated: bool, clutched: bool) -> Reason | None:
        """
        Return the first obstacle: those that latch precede the others.

        Parameters
        ----------
        sample : ForceSample
            The sample.
        angle_missing : bool
            Whether the angle of a motor is missing.
        commanded : tuple of float
            Motor torques in force, N m.
        dt : float
            Time since the sample before, s.
        energy_generated : bool
            Whether the energy has left the wrench without use for too long.
        clutched : bool
            Whether no wrench is rendered: it may be old.

        """
        (stamp, _, quaternion, velocity, level, noise, wrench, sources, drives, measured, enabled,
         engaged, present, _, _, _) = sample
        limits = self._limits
        off_command = self._off_command.take(
            measured is not None and self._deviates(measured, commanded), dt)
        if drives is Drives.FAULT:
            return Reason.DRIVE
        if angle_missing:
            return Reason.ANGLE
        if quaternion is None:
            return Reason.NO_ORIENTATION
        if not level <= limits.protection_level:
            return Reason.UNPROTECTED
        if not noise <= limits.noise:
            return Reason.NOISY
        if velocity is not None:
            x, y, z = velocity
            if not x * x + y * y + z * z <= self._speed:
                return Reason.SPEED
        if off_command:
            return Reason.TORQUE
        if wrench is not None:
            received, (x, y, z), _ = wrench
            if not isfinite(x + y + z):
                return Reason.NOT_FINITE
        if sources > 1:
            return Reason.SOURCES
        if energy_generated:
            return Reason.ENERGY
        if not enabled:
            return Reason.DISABLED
        if drives is not Drives.OPERATING:
            return Reason.DRIVES_OFF
        if not engaged:
            return Reason.DISENGAGED
        if not present:
            return Reason.ABSENT
        if not clutched and (
                wrench is None or not -self._age <= stamp - received <= self._age):
            return Reason.STALE
        return None

    def _deviates(self, measured: tuple[float, ...], commanded: tuple[float, ...]) -> bool:
        floor = TORQUE_FLOOR * self._limits.motor_torque
        if sum(map(abs, map(sub, measured, commanded))) <= TORQUE_SHARE * floor:
            # The usual case, in half the time.
            return False
        return any(not abs(torque - command) <= TORQUE_SHARE * max(abs(command), floor)
                   for torque, command in zip(measured, commanded, strict=True))


class SmallForce:
    """
    Whether the wrench is small enough for force to begin: some messages in a row.

    Parameters
    ----------
    limits : ForceLimits
        Limits.

    """

    __slots__ = ('_count', '_latest', '_limits')

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        self._latest: int | None = None
        self._count = 0

    def restart(self) -> None:
        """Begin to count, with the next message that `take` gets."""
        self._count = 0

    def take(self, wrench: Wrench | None, stamp: int) -> bool:
        """Take the latest wrench; return whether force may begin."""
        if wrench is None or abs(stamp - wrench.received) > self._limits.wrench_age * 1e9:
            self._count = 0
            return False
        if wrench.received != self._latest:
            self._latest = wrench.received
            # The length of a torque that is not finite is not below the limit either.
            small = size(wrench.torque) < self._limits.small_torque
            self._count = self._count + 1 if small else 0
        return self._count >= SMALL_MESSAGES
