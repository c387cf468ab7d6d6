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


def test_the_first_time_is_the_period_and_the_next_ones_are_averaged_until_a_restart():
    assert after(4 * MS).period == pytest.approx(4e-3, rel=1e-12)
    assert after(MS, MS, MS).period == pytest.approx(1e-3, rel=1e-12)
    assert after(MS, 2 * MS).period == pytest.approx(1e-3 * (1.0 + 1.0 / 50.0))
    assert after(MS, 400 * MS).period == pytest.approx(1e-3 * (1.0 + 19.0 / 50.0))
    clock = after(MS, MS // 2)
    assert clock.period == pytest.approx(1e-3 * (1.0 - 0.5 / 50.0))
    clock.restart()
    assert (clock.period, clock.jitter) == (0.0, 0.0)
    assert clock.step(clock.stamp + 3 * MS) == pytest.approx(3e-3) == clock.period


@pytest.mark.parametrize('step', [MS * 3 // 4, MS * 5 // 4])
def test_the_jitter_is_the_mean_deviation_from_the_period(step):
    assert after(MS, MS).jitter == 0.0
    assert after(MS, step).jitter == pytest.approx(0.25e-3 / 50.0)
    clock = after(MS, *[MS - 200_000, MS + 200_000] * 300)
    assert clock.jitter == pytest.approx(0.2e-3, rel=0.02)
    # A lost sample is none.
    assert after(MS, 1_499_000).jitter > 0.0 == after(2**20, 3 * 2**19).jitter


def test_more_than_half_a_second_ends_the_motion():
    clock = after(MS)
    assert clock.step(clock.stamp + 500 * MS) == 0.5
    period = clock.period
    assert clock.step(clock.stamp + 500 * MS + 1) == inf
    # It is no period, but the next time is counted from it.
    assert clock.period == period
    assert clock.step(clock.stamp + MS) == pytest.approx(1e-3)


@pytest.mark.parametrize('back', [0, 1, MS, 10_000 * MS])
def test_a_stamp_that_does_not_grow_is_not_taken_in(back):
    clock = after(MS)
    assert clock.step(6 * MS - back) == pytest.approx(-max(back, 1) * 1e-9)
    assert (clock.stamp, clock.period) == (6 * MS, pytest.approx(1e-3))
    assert clock.step(7 * MS) == pytest.approx(1e-3)


def test_a_hundred_of_them_in_a_row_are_a_clock_that_was_set_back_as_often_as_it_is():
    clock = after(MS)
    for _ in range(3):
        assert all(-inf < clock.step(MS) < 0.0 for _ in range(99))
        clock.step(clock.stamp + 1)
    for _ in range(2):
        assert all(-inf < clock.step(MS) < 0.0 for _ in range(99))
        assert clock.step(MS) == -inf
        assert clock.stamp is None
        assert clock.step(2 * MS) == 0.0
        assert clock.stamp == 2 * MS
