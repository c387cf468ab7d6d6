# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What keeps force from beginning or going on."""

from __future__ import annotations

from math import hypot, inf

from spm_haptic_master.force.samples import Drives, ForceSample, NOTHING, Reason, Wrench
from spm_haptic_master.force.statics import ForceLimits

# Deviation of a motor's torque from its command (unit 1) that is a fault if it lasts (s). Below a
# quarter of its limit a motor's friction and its drive's noise are larger than such a share.
TORQUE_SHARE, TORQUE_FLOOR, TORQUE_TIME = 0.2, 0.25, 0.05
# Messages in a row with a small torque, with which force may begin.
SMALL_MESSAGES = 3
# A stamp before every sample (ns), and what stands for no wrench.
LONG_AGO = -1 << 100
NO_WRENCH = Wrench(LONG_AGO, NOTHING)


class Obstacles:
    """Conditions of force, evaluated at each sample."""

    __slots__ = ('_count', '_floor', '_latest', '_limits', 'earliest', 'latest', 'off_time',
                 'quiet')

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        # Range of the age of a wrench, ns.
        self.latest = round(limits.wrench_age * 1e9)
        self.earliest = -self.latest
        self._floor = TORQUE_FLOOR * limits.motor_torque
        self.quiet = TORQUE_SHARE * self._floor  # deviation of all motors that is none, N m
        self.off_time = 0.0  # how long a motor has been off its command, s
        # Time of the latest wrench that was counted, ns, and small wrenches in a row.
        self._latest, self._count = LONG_AGO, 0

    def restart(self) -> None:
        """Count small wrenches from the next message on."""
        self._count = 0

    def take(self, sample: ForceSample, angle_missing: bool, commanded: tuple[float, ...],
             dt: float, energy_generated: bool, clutched: bool) -> Reason | None:
        """
        Return the first obstacle: those that latch precede the others.

        `commanded` are the motor torques in force, N m, and `dt` the time since the sample before,
        s; `energy_generated` is whether the energy has left the wrench without use for too long,
        `clutched` whether no wrench is rendered: it may be old.
        """
        limits, velocity, measured = self._limits, sample.velocity, sample.motor_torque
        wrench = NO_WRENCH if sample.wrench is None else sample.wrench
        if measured is not None and any(
                not abs(torque - command) <= TORQUE_SHARE * max(abs(command), self._floor)
                for torque, command in zip(measured, commanded, strict=True)):
            self.off_time += dt
        else:
            self.off_time = 0.0
        return next((reason for reason, is_found in (
            (Reason.DRIVE, sample.drives is Drives.FAULT),
            (Reason.ANGLE, angle_missing),
            (Reason.NO_ORIENTATION, sample.quaternion is None),
            (Reason.UNPROTECTED, not sample.protection_level <= limits.protection_level),
            (Reason.NOISY, not sample.noise <= limits.noise),
            (Reason.SPEED, velocity is not None and not hypot(*velocity) <= limits.speed),
            (Reason.TORQUE, self.off_time >= TORQUE_TIME),
            (Reason.NOT_FINITE, not hypot(*wrench.torque) < inf),
            (Reason.SOURCES, sample.sources > 1),
            (Reason.ENERGY, energy_generated),
            (Reason.DISABLED, not sample.enabled),
            (Reason.DRIVES_OFF, sample.drives is Drives.OFF),
            (Reason.DISENGAGED, not sample.engaged),
            (Reason.ABSENT, not sample.present),
            (Reason.STALE, not clutched and self._is_old(wrench, sample.stamp)),
        ) if is_found), None)

    def may_begin(self, wrench: Wrench | None, stamp: int) -> bool:
        """Take the latest wrench; return whether enough in a row have been small."""
        if wrench is None or self._is_old(wrench, stamp):
            self._count = 0
            return False
        if wrench.received != self._latest:
            self._latest = wrench.received
            # The length of a torque that is not finite is not below the limit either.
            small = hypot(*wrench.torque) < self._limits.small_torque
            self._count = self._count + 1 if small else 0
        return self._count >= SMALL_MESSAGES

    def _is_old(self, wrench: Wrench, stamp: int) -> bool:
        return not self.earliest <= stamp - wrench.received <= self.latest
