# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time of the samples: it never goes back; pauses, clocks that are set back, bursts."""

import pytest
from spm_haptic_master.supervision.sample_clock import SampleClock

MS = 1_000_000
# A stamp as of a driver that counts from its own start.
BEGIN = 7_000 * MS


def stepped(clock, *milliseconds, begin=BEGIN):
    """Return the last step of a clock to stamps so many ms apart."""
    stamp = begin
    tick = clock.step(stamp)
    for each in milliseconds:
        stamp += round(each * MS)
        tick = clock.step(stamp)
    return tick


def regular(count=60):
    """Return a clock after samples 1 ms apart, and the stamp of the last one."""
    clock = SampleClock()
    stepped(clock, *[1] * count)
    return clock, BEGIN + count * MS


def test_the_time_begins_with_a_millisecond_and_goes_on_with_the_stamps():
    clock = SampleClock()
    assert clock.now == 0
    first = clock.step(BEGIN)
    assert (first.elapsed, first.restarts, first.is_old) == (0.0, False, False)
    assert clock.now == MS
    second = clock.step(BEGIN + 4 * MS)
    assert second.elapsed == pytest.approx(4e-3)
    assert not second.restarts
    assert clock.now == 5 * MS


@pytest.mark.parametrize(('gap', 'restarts'), [(499, False), (500, False), (501, True)])
def test_a_gap_of_more_than_half_a_second_is_a_pause(gap, restarts):
    clock, last = regular()
    period = clock.period
    tick = clock.step(last + gap * MS)
    assert tick.restarts == restarts
    assert tick.elapsed == pytest.approx(0.0 if restarts else gap * 1e-3)
    assert clock.now == (61 + gap) * MS
    assert (clock.period == period) == restarts


@pytest.mark.parametrize(('back', 'elapsed'), [(0, -1e-9), (2, -2e-3)])
def test_a_stamp_that_does_not_grow_is_old_while_the_time_goes_on_by_periods(back, elapsed):
    clock, last = regular()
    for count in (1, 2, 3):
        tick = clock.step(last - back * MS)
        assert tick.is_old
        assert tick.elapsed == pytest.approx(elapsed)
        assert not tick.restarts
        assert clock.now == pytest.approx((61 + count) * MS, abs=10)
    # A newer one goes on as if they had not been.
    assert clock.step(last + MS).elapsed == pytest.approx(1e-3)
    assert clock.now == 62 * MS


@pytest.mark.parametrize(
    ('period', 'count'),
    [
        (60, 3),
        (40, 3),
        (30, 4),
        (25, 4),
        (11, 10),
    ],
)
def test_three_older_stamps_and_as_many_as_come_in_a_tenth_of_a_second_set_it_back(period, count):
    clock = SampleClock()
    stepped(clock, *[period] * 60)
    before = clock.now
    restarts = [clock.step(stamp * period * MS).restarts for stamp in range(count)]
    assert restarts == [False] * (count - 1) + [True]
    # The next stamp, of any value, continues the time by a millisecond.
    assert clock.now == pytest.approx(before + count * period * MS, abs=100)
    after = clock.now
    tick = clock.step(42)
    assert (tick.elapsed, tick.restarts, tick.is_old) == (0.0, False, False)
    assert clock.now == after + MS
    # And older ones are counted anew.
    assert not clock.step(41).restarts
    assert clock.step(42 + period * MS).elapsed == pytest.approx(period * 1e-3)


def test_older_stamps_between_newer_ones_do_not_add_up():
    clock = SampleClock()
    stepped(clock, *[60] * 60)
    stamp = BEGIN + 3600 * MS
    for _ in range(5):
        assert not clock.step(stamp - 1).restarts
        assert not clock.step(stamp - 1).restarts
        stamp += 60 * MS
        assert not clock.step(stamp).restarts


def test_where_the_period_is_not_known_three_older_stamps_suffice():
    """Right after a restart, and at the begin."""
    clock, last = regular()
    clock.restart()
    assert [clock.step(last - MS).restarts for _ in range(3)] == [False, False, True]
    clock = SampleClock()
    clock.step(BEGIN)
    assert [clock.step(BEGIN - MS).restarts for _ in range(3)] == [False, False, True]


def test_a_restart_forgets_period_jitter_and_what_a_burst_would_catch_up():
    clock = SampleClock()
    stepped(clock, *[4, 4.4, 3.6] * 30, 20)
    assert clock.period > 3.5e-3
    assert clock.jitter > 1e-4
    clock.restart()
    assert (clock.period, clock.jitter) == (0.0, 0.0)
    # A stamp shortly after the last one is no burst then.
    stamp = BEGIN + clock.now - MS
    assert clock.step(stamp + 400_000).elapsed == pytest.approx(4e-4)
    assert clock.period == pytest.approx(1e-3)
    assert clock.step(stamp + 3_400_000).elapsed == pytest.approx(3e-3)
    assert clock.period == pytest.approx(1.7e-3)


def test_the_period_is_a_millisecond_at_least_until_fifty_samples_told_it():
    """The first stamps may be those of a burst."""
    clock = SampleClock()
    stepped(clock, *[0.1] * 49)
    assert clock.period == 1e-3
    clock.step(BEGIN + 5 * MS)
    assert clock.period == pytest.approx(1e-4)


def test_the_period_is_a_mean_over_fifty_samples():
    clock, last = regular(200)
    clock.step(last + 2 * MS)
    assert clock.period == pytest.approx(1.02e-3)


@pytest.mark.parametrize(
    ('gap', 'jitter'),
    [
        (0.6, 0.392e-3 / 50),
        (1.4, 0.392e-3 / 50),
        (1.6, 0.0),
    ],
)
def test_the_deviation_of_a_stamp_is_jitter_where_none_is_missing(gap, jitter):
    clock, last = regular(200)
    clock.step(last + round(gap * MS))
    assert clock.jitter == pytest.approx(jitter, abs=1e-12)


@pytest.mark.parametrize(
    ('stamps', 'elapsed'),
    [
        # A gap of three periods: two samples were late, and come a period apart.
        ((3.0, 0.1), 1.0),
        ((3.0, 0.1, 0.1), 1.0),
        ((3.0, 0.1, 0.1, 0.1), 0.1),
        ((3.0, 0.4), 1.0),
        # The first usual distance ends the burst.
        ((3.0, 0.6), 0.6),
        ((3.0, 0.6, 0.1), 0.1),
        ((3.0, 1.4, 0.1), 0.1),
        ((3.0, 1.0), 1.0),
        # No gap, no burst; too short a gap for a sample in it.
        ((1.0, 0.1), 0.1),
        ((1.4, 0.1), 0.1),
        ((1.6, 0.1), 0.1),
        ((2.1, 0.1), 1.0),
        ((3.0,), 3.0),
    ],
)
def test_samples_that_waited_for_each_other_were_sampled_a_period_apart(stamps, elapsed):
    clock, stamp = regular()
    for milliseconds in stamps:
        stamp += round(milliseconds * MS)
        tick = clock.step(stamp)
    assert tick.elapsed == pytest.approx(elapsed * 1e-3, rel=0.05)
