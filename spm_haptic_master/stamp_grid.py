# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every n-th sample, by the stamps: a rate below that of the samples."""

from __future__ import annotations

# Nanoseconds per second.
SECOND = 1_000_000_000


class StampGrid:
    """
    Decides which samples are the next of a lower rate.

    The stamps' jitter is not passed on: over many samples the rate is the one asked for.

    Parameters
    ----------
    rate : float
        Rate of the chosen samples, Hz; 0: that of all samples.
    sample_rate : float
        Rate of all samples, Hz.

    """

    def __init__(self, rate: float, sample_rate: float) -> None:
        self._period = round(SECOND / rate) if 0.0 < rate < sample_rate else 0
        # By this much a sample may come before its time: half of its own period.
        self._slack = round(0.5 * SECOND / sample_rate)
        self._due = 0

    def is_due(self, stamp: int) -> bool:
        """Return whether the sample of a stamp, ns, is one; call it for each sample in turn."""
        period, due = self._period, self._due
        if not period:
            return True
        # A clock that was set back ends the wait.
        if due - 2 * period <= stamp < due - self._slack:
            return False
        due += period
        self._due = due if stamp < due <= stamp + 2 * period else stamp + period
        return True
