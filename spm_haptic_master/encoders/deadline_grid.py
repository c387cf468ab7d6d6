# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Periodic deadlines on an absolute grid: lateness does not accumulate, misses are counted."""

from __future__ import annotations

import time


class DeadlineGrid:
    """Deadlines one `period`, s, apart, starting at the first wait."""

    def __init__(self, period: float):
        self._period = period
        self._next: float | None = None
        # Deadlines skipped because the thread woke more than a period late.
        self.missed = 0
        # Time from the deadline to the end of the latest wait, s.
        self.lateness = 0.0

    def restart(self) -> None:
        """Start a new grid at the next wait, as after a pause."""
        self._next = None

    def wait(self, timeout: float) -> bool:
        """Sleep until the next deadline; return False if it is over `timeout` seconds ahead."""
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
