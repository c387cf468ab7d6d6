# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether orientations go out in time: rate, latency, missed samples, parity statistics."""

from __future__ import annotations

from math import sqrt

from rclpy.node import Node

from spm_haptic_master.meters import LatencyMeter, RateMeter
from spm_haptic_master.nodes.diagnostic_status import Health, OK, WARN

PERIOD = 1.0  # s, of the entry on /diagnostics
# Part of a second's samples that may be missing before that is a warning (unit 1).
MISSING_TOLERATED = 0.02


class Timing:
    """
    A node's entry 'timing' on /diagnostics, and what it is made of.

    Parameters
    ----------
    node : Node
        Whose timing it is.
    rate : float
        Samples a second that should come.
    latency_limit : float
        s; a larger p99 from sample stamp to publication is an overload.

    """

    def __init__(self, node: Node, rate: float, latency_limit: float):
        self.latency = LatencyMeter()
        self.published = RateMeter()
        self._period = 1e9 / rate
        self._gap = 1.5 * self._period
        self._tolerated = MISSING_TOLERATED * rate * PERIOD
        self._latency_limit = latency_limit * 1e6
        self._last: int | None = None
        self._missing = 0
        self._told = (0, 0)
        self._parity_sum = self._parity_squares = 0.0
        self._health = Health(node, 'timing', 'spherical parallel manipulator', logs=False)

    def take(self, stamp: int, now: int, parity: float) -> None:
        """Count an orientation of the sample stamped `stamp`, published `now` (ns)."""
        self.latency.add(now - stamp)
        self.published.count += 1
        if self._last is not None and stamp - self._last > self._gap:
            self._missing += round((stamp - self._last) / self._period) - 1
        self._last = stamp
        self._parity_sum += parity
        self._parity_squares += parity * parity

    def tell(self) -> None:
        """Publish the entry; to be called every `PERIOD`."""
        count = self.published.count - self._told[0]
        missing = self._missing - self._told[1]
        self._told = self.published.count, self._missing
        values = {
            'orientation rate (Hz)': self.published.rate(),
            'missed deadlines': self._missing,
            'missed in the last second': missing,
        }
        level, text = OK, 'in time'
        if count:
            p50, p90, p99, largest = self.latency.percentiles(0.5, 0.9, 0.99, 1.0)
            values |= {'latency p50 (us)': p50, 'latency p90 (us)': p90, 'latency p99 (us)': p99,
                       'latency max (us)': largest}
            mean = self._parity_sum / count
            values |= {'parity mean (sigma)': mean, 'parity deviation (sigma)':
                       sqrt(max(0.0, self._parity_squares / count - mean * mean))}
            if p99 > self._latency_limit:
                level, text = WARN, 'overload: latency'
            elif missing > self._tolerated:
                level, text = WARN, 'samples missing'
        else:
            level, text = WARN, 'no orientations'
        self._parity_sum = self._parity_squares = 0.0
        self._health.say(level, text, values)
