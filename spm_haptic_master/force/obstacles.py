# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What keeps force from beginning or going on."""

from __future__ import annotations

from math import hypot, inf

from spm_haptic_master.force.samples import Drives, ForceSample, NOTHING, Reason, Wrench
from spm_haptic_master.force.statics import ForceLimits

# Messages in a row with a small torque, with which force may begin.
SMALL_MESSAGES = 3
# A stamp before every sample (ns), and what stands for no wrench.
LONG_AGO = -1 << 100
NO_WRENCH = Wrench(LONG_AGO, NOTHING)


class Obstacles:
    """Conditions of force, evaluated at each sample."""

    __slots__ = ('_count', '_latest', '_limits', 'earliest', 'latest')

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        # Range of the age of a wrench, ns.
        self.latest = round(limits.wrench_age * 1e9)
        self.earliest = -self.latest
        # Time of the latest wrench that was counted, ns, and small wrenches in a row.
        self._latest, self._count = LONG_AGO, 0

    def restart(self) -> None:
        """Count small wrenches from the next message on."""
        self._count = 0

    def take(self, sample: ForceSample, angle_missing: bool, energy_generated: bool,
             clutched: bool) -> Reason | None:
        """
        Return the first obstacle: those that latch precede the others.

        `energy_generated` is whether the energy has left the wrench without use for too long,
        `clutched` whether no wrench is rendered: it may be old.
        """
        limits, velocity = self._limits, sample.velocity
        wrench = NO_WRENCH if sample.wrench is None else sample.wrench
        return next((reason for reason, is_found in (
            (Reason.DRIVE, sample.drives is Drives.FAULT),
            (Reason.ANGLE, angle_missing),
            (Reason.NO_ORIENTATION, sample.quaternion is None),
            (Reason.UNPROTECTED, not sample.protection_level <= limits.protection_level),
            (Reason.NOISY, not sample.noise <= limits.noise),
            (Reason.SPEED, velocity is not None and not hypot(*velocity) <= limits.speed),
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
