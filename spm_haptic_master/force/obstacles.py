# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What prevents or ends force: the conditions of each sample, and the wrench that may begin."""

from __future__ import annotations

from math import hypot, inf

from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.samples import (
    DrivesState,
    ForceReason,
    ForceSample,
    LONG_AGO,
    SMALL_MESSAGES,
    Wrench,
)


class Obstacles:
    """The conditions of force, which each sample has to meet, and the count of small wrenches."""

    def __init__(self, limits: ForceLimits) -> None:
        self._limits = limits
        # Largest age of a wrench, and largest time that it may be ahead of its sample, ns.
        self._longest = round(limits.wrench_age * 1e9)
        # Arrival of the latest wrench that was counted, ns, and small wrenches in a row.
        self._latest = LONG_AGO
        self._count = 0

    def restart(self) -> None:
        """Restart the count of small wrenches."""
        self._count = 0

    def first(
        self,
        sample: ForceSample,
        *,
        is_placed: bool,
        angle_missing: bool,
        energy_generated: bool,
    ) -> ForceReason | None:
        """
        Return the first obstacle, those that end all torque before the others; None without any.

        Parameters
        ----------
        sample : ForceSample
            The sample and its circumstances.
        is_placed : bool
            Whether there is an orientation, and all legs reach it.
        angle_missing : bool
            Whether the angle of a motor is missing.
        energy_generated : bool
            Whether the energy budget is spent.

        """
        return (
            self._of_motors(sample, angle_missing)
            or self._of_orientation(sample, is_placed)
            or (ForceReason.DRIVES_OFF if sample.drives is DrivesState.OFF else None)
            or self._of_wrench(sample)
            or (ForceReason.ENERGY if energy_generated else None)
            or self._of_operator(sample)
            or self._of_age(sample)
        )

    def _of_motors(self, sample: ForceSample, angle_missing: bool) -> ForceReason | None:
        """Return what is wrong with drives or encoders of the motors."""
        if sample.drives is DrivesState.FAULT:
            return ForceReason.DRIVE
        return ForceReason.ANGLE if angle_missing else None

    def _of_orientation(self, sample: ForceSample, is_placed: bool) -> ForceReason | None:
        """Return why the orientation is not one to rely on; a comparison with NaN is false."""
        limits = self._limits
        if not is_placed:
            return ForceReason.NO_ORIENTATION
        if not sample.protection_level <= limits.protection_level:
            return ForceReason.UNPROTECTED
        if not sample.noise <= limits.noise:
            return ForceReason.NOISY
        if sample.velocity is not None and not hypot(*sample.velocity) <= limits.speed:
            return ForceReason.SPEED
        return None

    def _of_wrench(self, sample: ForceSample) -> ForceReason | None:
        """Return what is wrong with what is commanded."""
        if sample.wrench is not None and not hypot(*sample.wrench.torque) < inf:
            return ForceReason.NOT_FINITE
        if sample.lock is not None and not hypot(*sample.lock) < inf:
            return ForceReason.NOT_FINITE
        return ForceReason.SOURCES if sample.sources > 1 else None

    def _of_operator(self, sample: ForceSample) -> ForceReason | None:
        """Return why no force is wanted."""
        if not sample.enabled:
            return ForceReason.DISABLED
        if not sample.engaged:
            return ForceReason.DISENGAGED
        return None if sample.present else ForceReason.ABSENT

    def _of_age(self, sample: ForceSample) -> ForceReason | None:
        """Return STALE if the wrench is missing or too old; with clutch or lock none is needed."""
        if sample.clutched or sample.lock is not None:
            return None
        return ForceReason.STALE if self.is_old(sample.wrench, sample.stamp) else None

    def may_begin(self, wrench: Wrench | None, stamp: int) -> bool:
        """Count a wrench that is new; return whether `SMALL_MESSAGES` in a row have been small."""
        if wrench is None or self.is_old(wrench, stamp):
            self._count = 0
            return False
        if wrench.received != self._latest:
            self._latest = wrench.received
            # A torque that is not finite is not below the limit either.
            is_small = hypot(*wrench.torque) < self._limits.small_torque
            self._count = self._count + 1 if is_small else 0
        return self._count >= SMALL_MESSAGES

    def is_old(self, wrench: Wrench | None, stamp: int) -> bool:
        """Whether a wrench is missing, or older or newer than a stamp (ns) by too much."""
        return wrench is None or abs(stamp - wrench.received) > self._longest
