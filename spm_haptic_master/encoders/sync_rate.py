# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether SYNC comes at the configured rate."""

from __future__ import annotations

# Time over which SYNC is counted (s), and the fewest that show a rate.
SPAN, FEWEST = 1.0, 10
# Largest relative deviation of the time between two SYNCs that are one period apart (unit 1).
TOLERANCE = 0.25
# Smallest share of such SYNCs (unit 1): where SYNCs come late or are lost on a busy machine, many
# are still one period apart; on a bus of another rate hardly any is.
SHARE = 0.1


class SyncRate:
    """
    Compares the times between SYNCs with the period, in spans of a second.

    Parameters
    ----------
    period : float
        Configured time between two SYNCs, s.

    Attributes
    ----------
    measured : float or None
        Rate of the latest span, Hz, if that is another than the configured one; else None.

    """

    def __init__(self, period: float):
        self._period = period
        self._shortest, self._longest = period * (1.0 - TOLERANCE), period * (1.0 + TOLERANCE)
        self._began: float | None = None
        self._last = 0.0
        self._count = self._fits = 0
        self.measured: float | None = None

    def heard(self, stamp: float) -> None:
        """Count a SYNC received at `stamp`, s."""
        if self._began is None or not 0.0 <= stamp - self._last <= SPAN:
            self._begin(stamp)
            return
        self._count += 1
        self._fits += self._shortest < stamp - self._last < self._longest
        self._last = stamp
        span = stamp - self._began
        if span >= SPAN and self._count >= FEWEST:
            other = self._fits < SHARE * self._count
            self.measured = self._count / span if other else None
            self._begin(stamp)

    def text(self) -> str | None:
        """Return that the rate is another one, in words; None if it is not."""
        measured = self.measured
        if measured is None:
            return None
        return (f'SYNC comes at {measured:.0f} Hz, rate is {1.0 / self._period:g} Hz: give '
                'rate, as it is on the bus, to all nodes (can_scan prints it)')

    def _begin(self, stamp: float) -> None:
        self._began = self._last = stamp
        self._count = self._fits = 0
