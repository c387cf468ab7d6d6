# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of what comes: the frames of one encoder, and the rate of SYNC; times in words."""

from __future__ import annotations

from collections import Counter

import can
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.timing import LatencyMeter, RateMeter

# Reasons for rejecting a frame that is an answer without a reading.
STATUS_ERROR = 'status bits report an error'
UNCHANGED = 'rolling counter unchanged'
# Time over which SYNC is counted (s), and the fewest that show a rate.
SPAN, FEWEST = 1.0, 10
# Largest relative deviation of the time between two SYNCs that are one period apart (unit 1).
TOLERANCE = 0.25
# Smallest share of such SYNCs (unit 1): where SYNCs come late or are lost on a busy machine, many
# are still one period apart; on a bus of another rate hardly any is.
SHARE = 0.1


def recent(when: float | None, now: float, span: float) -> bool:
    """Return whether `when` is within `span` s of `now`; after a clock was set back it is not."""
    return when is not None and abs(now - when) < span


def percentiles_text(meter: LatencyMeter) -> str:
    """Return median, 99th percentile and maximum, us, of the latest latencies; empty if none."""
    return ' / '.join(f'{value:.0f}' for value in meter.percentiles(0.5, 0.99, 1.0) or ())


class Encoder:
    """Frames of one encoder: their checks and counters."""

    def __init__(self, layout: EncoderLayout):
        self.layout = layout
        # Time of the latest good frame, s since the Unix epoch; None before the first.
        self.heard: float | None = None
        # Time, s since the Unix epoch, and reason of the latest rejection.
        self.refused: tuple[float, str] | None = None
        self.rejects: Counter[str] = Counter()
        self.frames = RateMeter()
        # Numbers that the rolling counter left out before the latest good frame, if it has one.
        self.lost: int | None = None
        self._counter: int | None = None

    def check(self, message: can.Message) -> tuple[int, str | None]:
        """Return the counts in a frame of this encoder, and None or why it is rejected."""
        layout, data = self.layout, message.data
        if len(data) != layout.data_length:
            return 0, self.reject(message, f'{len(data)} bytes instead of {layout.data_length}')
        counts = layout.counts(data)
        if counts is None:
            return 0, self.reject(message, 'counts beyond a turn')
        if self._is_unchanged(layout.counter(data)):
            return 0, self.reject(message, UNCHANGED)
        if not layout.healthy(data):
            return 0, self.reject(message, STATUS_ERROR)
        self.heard = message.timestamp
        self.frames.count += 1
        return counts, None

    def restart(self) -> None:
        """Take the next value of the rolling counter as the first one."""
        self._counter = None

    def reject(self, message: can.Message, reason: str) -> str:
        """Count a rejected frame; return the reason."""
        self.rejects[reason] += 1
        self.refused = message.timestamp, reason
        return reason

    def _is_unchanged(self, counter: int | None) -> bool:
        """Note the rolling counter, if there is one; return whether it is that of before."""
        if counter is None:
            return False
        before, self._counter, self.lost = self._counter, counter, None
        if before is not None and counter != before:
            self.lost = (counter - before - 1) % self.layout.counter_modulus
            if self.lost:
                self.rejects['rolling counter jumped (frame kept)'] += 1
        return counter == before


class SyncRate:
    """Compares the times between SYNCs with the configured `period`, s, in spans of a second."""

    def __init__(self, period: float):
        self._period = period
        self._began: float | None = None
        self._last = 0.0
        self._count = self._fits = 0
        # Rate of the latest span, Hz, if that is another than the configured one.
        self.measured: float | None = None

    def heard(self, stamp: float) -> None:
        """Count a SYNC received at `stamp`, s."""
        if self._began is None or not 0.0 <= stamp - self._last <= SPAN:
            self._begin(stamp)
            return
        self._count += 1
        self._fits += self._period * (1.0 - TOLERANCE) < stamp - self._last \
            < self._period * (1.0 + TOLERANCE)
        self._last = stamp
        span = stamp - self._began
        if span >= SPAN and self._count >= FEWEST:
            other = self._fits < SHARE * self._count
            self.measured = self._count / span if other else None
            self._begin(stamp)

    def text(self) -> str | None:
        """Return that the rate is another one, in words; None if it is not."""
        measured = self.measured
        return None if measured is None else (
            f'SYNC comes at {measured:.0f} Hz, rate is {1.0 / self._period:g} Hz: give rate, as '
            'it is on the bus, to all nodes (can_scan prints it)')

    def _begin(self, stamp: float) -> None:
        self._began = self._last = stamp
        self._count = self._fits = 0
