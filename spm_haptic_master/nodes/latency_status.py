# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether orientations go out in time: rate, latency, missed samples, parity statistics."""

from __future__ import annotations

from math import sqrt

from rclpy.node import Node
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.cdr import SECOND
from spm_haptic_master.ros.diagnostic_status import OK, WARN
from spm_haptic_master.ros.overload import more_than, TOO_BUSY
from spm_haptic_master.timing import LatencyMeter, RateMeter

# Share of the samples of one period that may be missing without a warning (unit 1).
MISSING_TOLERATED = 0.02
# Share by which the samples of one period may exceed `rate` (unit 1): SYNC comes from another
# clock, and a driver on a busy machine has jitter; a rate set wrong is off by more.
EXCESS_TOLERATED = 0.1
# Distance of two stamps from which samples between them are missing (sample periods).
GAP = 1.5
# Microseconds per second.
MICROSECONDS = 1e6


class LatencyStatus:
    """
    The entry 'timing' of `fkm` on /diagnostics, and the measurements behind it.

    The samples are expected at `rate`, Hz; `latency_limit`, s, is the largest 99th percentile
    from sample stamp to publication without a warning.
    """

    def __init__(self, node: Node, rate: float, latency_limit: float) -> None:
        # Times from sample stamp to publication, and orientations published.
        self.latency, self.published = LatencyMeter(), RateMeter()
        # Parity of the latest orientation, sigma; None before the first.
        self.parity: float | None = None
        # Why samples were missing since the entry was published; empty if it is not known.
        self.busy = ''
        self._period = SECOND / rate
        self._gap = GAP * self._period
        self._tolerated = MISSING_TOLERATED * rate * diagnostic_status.REPEAT_PERIOD
        self._latency_limit = latency_limit * MICROSECONDS
        self._least_span = self._period / (1.0 + EXCESS_TOLERATED)
        # Stamp of the latest orientation, and that of the latest one when the entry was published.
        self._last: int | None = None
        self._last_reported: int | None = None
        self._missing = 0
        # Orientations published and samples missing when the entry was published last.
        self._counted = (0, 0)
        self._parity_sum = self._parity_squares = 0.0
        self._status = diagnostic_status.StatusPublisher(
            node, 'timing', diagnostic_status.MECHANISM, logs=False)

    def add(self, stamp: int, now: int, parity: float) -> None:
        """Count an orientation: sample stamp (ns), time of publication (ns), parity (sigma)."""
        self.latency.add(now - stamp)
        self.published.count += 1
        if self._last is not None and stamp - self._last > self._gap:
            self._missing += round((stamp - self._last) / self._period) - 1
        self._last = stamp
        self.parity = parity
        self._parity_sum += parity
        self._parity_squares += parity * parity

    def publish(self) -> None:
        """Publish the entry; call it every `diagnostic_status.REPEAT_PERIOD`."""
        count = self.published.count - self._counted[0]
        missing = self._missing - self._counted[1]
        self._counted = self.published.count, self._missing
        # From the stamps: samples that a busy machine held up come in a burst.
        excess = self._last is not None and self._last_reported is not None \
            and self._last - self._last_reported < count * self._least_span
        self._last_reported = self._last
        values: dict[str, object] = {
            'orientation rate (Hz)': self.published.rate(),
            'missed deadlines': self._missing,
            'missed in the last second': missing,
        }
        level, text = OK, 'in time'
        percentiles = self.latency.percentiles(0.5, 0.9, 0.99, 1.0) if count else None
        if percentiles is None:
            level, text = WARN, 'no orientations'
        else:
            p50, p90, p99, largest = percentiles
            values |= {'latency p50 (us)': p50, 'latency p90 (us)': p90, 'latency p99 (us)': p99,
                       'latency max (us)': largest}
            mean = self._parity_sum / count
            values |= {'parity mean (sigma)': mean, 'parity deviation (sigma)':
                       sqrt(max(0.0, self._parity_squares / count - mean * mean))}
            if p99 > self._latency_limit:
                level, text = WARN, f'{TOO_BUSY}: latency p99 {more_than(p99 / MICROSECONDS)}'
            elif missing > self._tolerated:
                level, text = WARN, self.busy or 'samples missing'
            elif excess:
                level, text = WARN, 'more samples than expected'
        self._parity_sum = self._parity_squares = 0.0
        self.busy = ''
        self._status.publish(level, text, values)
