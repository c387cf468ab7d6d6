# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Rates, percentiles of latencies, every n-th sample by the stamps, periodic deadlines."""

from __future__ import annotations

import time

# Nanoseconds per second.
SECOND = 1_000_000_000
# Latencies kept for the percentiles (samples): 1 s at 1 kHz.
WINDOW = 1000
# Shortest interval over which a rate is measured (s).
RATE_INTERVAL = 0.2


class RateMeter:
    """
    Rate of events between one reading and the next.

    The caller increments `count` at each event; `rate` may be read at any time.
    """

    def __init__(self) -> None:
        self.count = 0
        self._read_count = 0
        self._read_at = time.monotonic()
        self._rate = 0.0

    def rate(self) -> float:
        """Return the rate since the last reading at least `RATE_INTERVAL` ago, Hz."""
        now = time.monotonic()
        elapsed = now - self._read_at
        if elapsed >= RATE_INTERVAL:
            self._rate = (self.count - self._read_count) / elapsed
            self._read_count, self._read_at = self.count, now
        return self._rate


class LatencyMeter:
    """The latest `WINDOW` latencies, and their percentiles."""

    def __init__(self) -> None:
        self._values = [0] * WINDOW
        self.count = 0

    def add(self, latency: int) -> None:
        """Add one latency, ns."""
        self._values[self.count % WINDOW] = latency
        self.count += 1

    def percentiles(self, *parts: float) -> tuple[float, ...] | None:
        """
        Return quantiles of the latest latencies.

        Parameters
        ----------
        *parts : float
            The quantiles, 0 .. 1: 0.99 is the 99th percentile.

        Returns
        -------
        tuple of float or None
            The latencies, us; None before the first one.

        """
        kept = sorted(self._values[: min(self.count, WINDOW)])
        if not kept:
            return None
        return tuple(kept[min(int(part * len(kept)), len(kept) - 1)] * 1e-3 for part in parts)


class StampGrid:
    """
    Selects samples at a lower rate, despite the jitter of their stamps.

    Parameters
    ----------
    rate : float
        Rate of the selected samples, Hz; 0: all.
    sample_rate : float
        Rate of the samples, Hz.

    """

    def __init__(self, rate: float, sample_rate: float) -> None:
        if 0.0 < rate < sample_rate:
            self._period = round(SECOND / rate)
        else:
            self._period = 0
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
        if stamp < due <= stamp + 2 * period:
            self._due = due
        else:
            self._due = stamp + period
        return True


class Periodic:
    """
    When something is due: the first time at once, then once a period.

    Parameters
    ----------
    period : float
        Time between two of them, s.

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


class DeadlineGrid:
    """
    Deadlines on an absolute grid, which starts at the first wait.

    Parameters
    ----------
    period : float
        Time between two deadlines, s.

    """

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
        """
        Sleep until the next deadline.

        Parameters
        ----------
        timeout : float
            Longest sleep, s.

        Returns
        -------
        bool
            Whether the deadline has come; False if it is further ahead.

        """
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
