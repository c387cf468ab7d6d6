# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The usual time between samples, and its jitter."""

import pytest
from spm_haptic_master.supervision.supervisor import SampleClock

MS = 1_000_000


def after(*steps):
    """Return a clock after samples so many ns apart."""
    clock, stamp = SampleClock(), 5 * MS
    for step in (0, *steps):
        stamp += step
        clock.step(stamp)
    return clock


def test_period_and_jitter_are_averages():
    assert (after(4 * MS).period, after(4 * MS).jitter) == (pytest.approx(4e-3), 0.0)
    assert after(MS, *[2 * MS] * 500).period == pytest.approx(2e-3, rel=1e-3)
    clock = after(MS, *[MS - 200_000, MS + 200_000] * 300)
    assert clock.period == pytest.approx(1e-3, rel=0.02)
    assert clock.jitter == pytest.approx(0.2e-3, rel=0.02)


def test_a_gap_counts_for_twenty_periods_at_most_and_a_lost_sample_for_no_jitter():
    clock = after(MS, 400 * MS)
    assert clock.period == pytest.approx(1e-3 * (1.0 + 19.0 / 50.0)) and clock.jitter == 0.0
    assert after(MS, 2 * MS).jitter == 0.0
