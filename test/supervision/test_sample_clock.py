# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The times between samples: period, jitter, gaps, stamps that do not grow."""

from math import inf

import pytest
from spm_haptic_master.supervision.sample_clock import SampleClock

MS = 1_000_000


def after(*steps, first=5 * MS):
    """Return a clock after samples so many ns apart."""
    clock, stamp = SampleClock(), first
    clock.step(stamp)
    for step in steps:
        stamp += step
        clock.step(stamp)
    return clock


def test_the_time_since_the_last_sample_none_before_the_first():
    clock = SampleClock()
    assert clock.stamp is None
    assert clock.step(5 * MS) == 0.0
    assert (clock.stamp, clock.period, clock.jitter) == (5 * MS, 0.0, 0.0)
    assert clock.step(7 * MS) == pytest.approx(2e-3)
    assert clock.stamp == 7 * MS
    assert clock.step(7 * MS + 1) == pytest.approx(1e-9)


def test_period_and_jitter_are_averaged_until_a_restart():
    clock = after(4 * MS)
    assert (clock.period, clock.jitter) == (pytest.approx(4e-3), 0.0)
    clock = after(MS, *[MS - 200_000, MS + 200_000] * 300)
    assert clock.period == pytest.approx(1e-3, rel=0.02)
    assert clock.jitter == pytest.approx(0.2e-3, rel=0.02)
    # A gap counts for twenty periods at most, and for no jitter.
    clock = after(MS, 400 * MS)
    assert (clock.period, clock.jitter) == (pytest.approx(1e-3 * (1.0 + 19.0 / 50.0)), 0.0)
    clock.restart()
    assert (clock.period, clock.jitter) == (0.0, 0.0)
    assert clock.step(clock.stamp + 3 * MS) == pytest.approx(3e-3) == clock.period


def test_more_than_half_a_second_ends_the_motion():
    clock = after(MS)
    assert clock.step(clock.stamp + 500 * MS) == 0.5
    period = clock.period
    assert clock.step(clock.stamp + 500 * MS + 1) == inf
    # It is no period, but the next time is counted from it.
    assert clock.period == period
    assert clock.step(clock.stamp + MS) == pytest.approx(1e-3)
