# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What keeps force from beginning or going on."""

from __future__ import annotations

from math import dist, hypot, inf

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.samples import Drives, ForceSample, Reason, Wrench

# Deviation of a motor's torque from its command (unit 1) that is a fault if it lasts (s). Below a
# quarter of its limit a motor's friction and its drive's noise are larger than such a share.
TORQUE_SHARE, TORQUE_FLOOR, TORQUE_TIME = 0.2, 0.25, 0.05
# Messages in a row with a small torque, with which force may begin.
SMALL_MESSAGES = 3
# Without a look-up at each sample.
FAULT, OPERATING = Drives.FAULT, Drives.OPERATING


class Obstacles:
    """Conditions of force, evaluated at each sample."""

    __slots__ = ('_floor', '_limits', 'earliest', 'latest', 'off_time', 'quiet')

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        # Range of the age of a wrench, ns.
        self.latest = round(limits.wrench_age * 1e9)
        self.earliest = -self.latest
        self._floor = TORQUE_FLOOR * limits.motor_torque
        self.quiet = TORQUE_SHARE * self._floor  # deviation of all motors that is none, N m
        self.off_time = 0.0  # how long a motor has been off its command, s

    def take(self, sample: ForceSample, angle_missing: bool, commanded: tuple[float, ...],
             dt: float, energy_generated: bool, clutched: bool) -> Reason | None:
        """
        Return the first obstacle: those that latch precede the others.

        `commanded` are the motor torques in force, N m, and `dt` the time since the sample before,
        s; `energy_generated` is whether the energy has left the wrench without use for too long,
        `clutched` whether no wrench is rendered: it may be old.
        """
        (stamp, _, quaternion, velocity, level, noise, wrench, sources, drives, measured, enabled,
         engaged, present, _, _, _) = sample
        limits = self._limits
        if measured is None or dist(measured, commanded) <= self.quiet:
            self.off_time = 0.0
        else:
            self.off_time = self.off_time + dt if self._deviates(measured, commanded) else 0.0
        if drives is FAULT:
            return Reason.DRIVE
        if angle_missing:
            return Reason.ANGLE
        if quaternion is None:
            return Reason.NO_ORIENTATION
        if not level <= limits.protection_level:
            return Reason.UNPROTECTED
        if not noise <= limits.noise:
            return Reason.NOISY
        if velocity is not None and not hypot(*velocity) <= limits.speed:
            return Reason.SPEED
        if self.off_time >= TORQUE_TIME:
            return Reason.TORQUE
        if wrench is not None:
            received, torque, _ = wrench
            if not hypot(*torque) < inf:
                return Reason.NOT_FINITE
        if sources > 1:
            return Reason.SOURCES
        if energy_generated:
            return Reason.ENERGY
        if not enabled:
            return Reason.DISABLED
        if drives is not OPERATING:
            return Reason.DRIVES_OFF
        if not engaged:
            return Reason.DISENGAGED
        if not present:
            return Reason.ABSENT
        if not clutched and (
                wrench is None or not self.earliest <= stamp - received <= self.latest):
            return Reason.STALE
        return None

    def _deviates(self, measured: tuple[float, ...], commanded: tuple[float, ...]) -> bool:
        return any(not abs(torque - command) <= TORQUE_SHARE * max(abs(command), self._floor)
                   for torque, command in zip(measured, commanded, strict=True))


class SmallForce:
    """Whether the wrench is small enough for force to begin: some messages in a row."""

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
            small = hypot(*wrench.torque) < self._limits.small_torque
            self._count = self._count + 1 if small else 0
        return self._count >= SMALL_MESSAGES
