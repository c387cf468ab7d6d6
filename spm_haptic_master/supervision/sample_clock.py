# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The stamps of the samples: their period, its jitter, gaps, and a clock that was set back."""

from __future__ import annotations

from math import inf

RESTART_GAP = 0.5  # s; the motion before such a gap is of no use
# Samples in a row with stamps that go back, which are a clock that was set back (samples).
OLDER_SAMPLES = 100
PERIOD_SAMPLES = 50.0  # over which period and jitter are averaged
# Periods that a longer gap counts for at most; mean deviations of the jitter of a stamp.
GAP_PERIODS, JITTER_DEVIATIONS = 20.0, 4.0


class SampleClock:
    """
    Times between samples.

    `stamp` is the latest stamp, ns, None before the first; `period` the usual time between
    samples, s, 0 before the second; `jitter` the mean deviation from it, s.
    """

    def __init__(self) -> None:
        self.stamp: int | None = None
        # Stamps in a row that went back.
        self._older = 0
        self.restart()

    def restart(self) -> None:
        """Forget the period."""
        self.period = self.jitter = 0.0

    def step(self, stamp: int) -> float:
        """
        Return the time since the last sample, s, and take the stamp in.

        0 at the first sample, infinite after a gap that ends the motion, negative where the stamp
        does not grow (it is not taken in then), negative infinite once that shows that the clock
        was set back: the next sample is then the first one.
        """
        if self.stamp is None:
            self.stamp = stamp
            return 0.0
        dt = (stamp - self.stamp) * 1e-9
        if dt <= 0.0:
            self._older += 1
            if self._older < OLDER_SAMPLES:
                return dt or -1e-9
            self.stamp, self._older = None, 0
            return -inf
        self.stamp, self._older = stamp, 0
        if dt > RESTART_GAP:
            return inf
        period = self.period or dt
        self.period = period + (min(dt, GAP_PERIODS * period) - period) / PERIOD_SAMPLES
        if dt < 1.5 * period:
            self.jitter += (abs(dt - period) - self.jitter) / PERIOD_SAMPLES
        return dt
