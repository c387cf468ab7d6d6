# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Something that is done once a period."""

from __future__ import annotations


class Periodic:
    """
    When something is due; the first time at once.

    Parameters
    ----------
    period : float
        Least time between two times, s.

    """

    def __init__(self, period: float) -> None:
        self._period = period
        self._last: float | None = None

    def is_due(self, now: float) -> bool:
        """Return whether it is due at a time, s; if so, the next period begins."""
        if self._last is not None and now - self._last < self._period:
            return False
        self._last = now
        return True

    def begin(self, now: float) -> None:
        """Begin a period at a time, s."""
        self._last = now

    def hasten(self) -> None:
        """Have it due at once."""
        self._last = None
