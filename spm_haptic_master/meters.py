# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a program measures of itself: rates, and percentiles of times."""

from __future__ import annotations

import time

WINDOW = 1000  # values kept: a second at 1 kHz


class RateMeter:
    """Events a second, between one reading and the next."""

    def __init__(self):
        self.count = 0
        self._read_count = 0
        self._read_at = time.monotonic()
        self._rate = 0.0

    def rate(self, shortest: float = 0.2) -> float:
        """Return Hz since the last reading that lies at least `shortest` seconds back."""
        now = time.monotonic()
        elapsed = now - self._read_at
        if elapsed >= shortest:
            self._rate = (self.count - self._read_count) / elapsed
            self._read_count, self._read_at = self.count, now
        return self._rate


class LatencyMeter:
    """The newest latencies, and their percentiles."""

    def __init__(self):
        self._values = [0] * WINDOW
        self.count = 0

    def add(self, latency: int) -> None:
        """Take one latency, ns."""
        self._values[self.count % WINDOW] = latency
        self.count += 1

    def percentiles(self, *parts: float) -> tuple[float, ...] | None:
        """Return the latency, us, that each part (0 .. 1) of the window stays under."""
        kept = sorted(self._values[:min(self.count, WINDOW)])
        if not kept:
            return None
        return tuple(kept[min(int(part * len(kept)), len(kept) - 1)] * 1e-3 for part in parts)
