# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What keeps force from beginning or going on."""

from __future__ import annotations

from math import isfinite

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
    motors : {3, 4}
        Number of motors.
    limits : ForceLimits
        Limits.

    """

    __slots__ = ('_limits', '_motors', '_off_command')

    def __init__(self, motors: int, limits: ForceLimits) -> None:
        self._motors, self._limits = motors, limits
        self._off_command = Lasting(TORQUE_TIME)

    def take(self, sample: ForceSample, commanded: tuple[float, ...], dt: float,
             energy_generated: bool, clutched: bool) -> Reason | None:
        """
        Return the first obstacle: those that latch precede the others.

        Parameters
        ----------
        sample : ForceSample
            The sample.
        commanded : tuple of float
            Motor torques in force, N m.
        dt : float
            Time since the sample before, s.
        energy_generated : bool
            Whether the energy has left the wrench without use for too long.
        clutched : bool
            Whether no wrench is rendered: it may be old.

        """
        limits = self._limits
        off_command = self._off_command.take(self._deviates(sample, commanded), dt)
        if sample.drives is Drives.FAULT:
            return Reason.DRIVE
        if not isfinite(sum(sample.angles[:self._motors])):
            return Reason.ANGLE
        if sample.quaternion is None:
            return Reason.NO_ORIENTATION
        if not sample.protection_level <= limits.protection_level:
            return Reason.UNPROTECTED
        if not sample.noise <= limits.noise:
            return Reason.NOISY
        if sample.velocity is not None and not size(sample.velocity) <= limits.speed:
            return Reason.SPEED
        if off_command:
            return Reason.TORQUE
        wrench = sample.wrench
        if wrench is not None and not isfinite(sum(wrench.torque)):
            return Reason.NOT_FINITE
        if sample.sources > 1:
            return Reason.SOURCES
        if energy_generated:
            return Reason.ENERGY
        if not sample.enabled:
            return Reason.DISABLED
        if sample.drives is not Drives.OPERATING:
            return Reason.DRIVES_OFF
        if not sample.engaged:
            return Reason.DISENGAGED
        if not sample.present:
            return Reason.ABSENT
        if not clutched and not is_fresh(wrench, sample.stamp, limits.wrench_age):
            return Reason.STALE
        return None

    def _deviates(self, sample: ForceSample, commanded: tuple[float, ...]) -> bool:
        if sample.motor_torque is None:
            return False
        floor = TORQUE_FLOOR * self._limits.motor_torque
        return any(not abs(torque - command) <= TORQUE_SHARE * max(abs(command), floor)
                   for torque, command in zip(sample.motor_torque, commanded, strict=True))


def is_fresh(wrench: Wrench | None, stamp: int, age: float) -> bool:
    """Return whether a wrench is at most `age`, s, older than a stamp, ns, nor later than that."""
    return wrench is not None and abs(stamp - wrench.received) <= age * 1e9


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
        """Begin to count."""
        self._count = 0

    def take(self, wrench: Wrench | None, stamp: int) -> bool:
        """Take the latest wrench; return whether force may begin."""
        if wrench is None or not is_fresh(wrench, stamp, self._limits.wrench_age):
            self._count = 0
            return False
        if wrench.received != self._latest:
            self._latest = wrench.received
            # The length of a torque that is not finite is not below the limit either.
            small = size(wrench.torque) < self._limits.small_torque
            self._count = self._count + 1 if small else 0
        return self._count >= SMALL_MESSAGES
