# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An absolute-time grid: lateness never accumulates, and what was missed is counted."""

from __future__ import annotations

import time


class DeadlineGrid:
    """
    Deadlines `period` seconds apart from the moment of the first wait.

    Parameters
    ----------
    period : float
        s, greater than 0.

    Attributes
    ----------
    missed : int
        Deadlines passed over because the thread woke more than a period late.
    lateness : float
        s; how long after its deadline the latest wait ended.

    """

    def __init__(self, period: float):
        self._period = period
        self._next: float | None = None
        self.missed = 0
        self.lateness = 0.0

    def restart(self) -> None:
        """Lay the grid anew from the next wait on, as after a pause."""
        self._next = None

    def wait(self, timeout: float) -> bool:
        """Sleep to the next deadline; False if it lies more than `timeout` seconds ahead."""
        now = time.monotonic()
        if self._next is None:
            self._next = now
        ahead = self._next - now
        if ahead > timeout:
            time.sleep(timeout)
            return False
        if ahead > 0.0:
            time.sleep(ahead)
            now = time.monotonic()
        self.lateness = max(0.0, now - self._next)
        passed = int(self.lateness / self._period)
        self.missed += passed
        self._next += (passed + 1) * self._period
        return True
