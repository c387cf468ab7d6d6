# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which samples a lower rate takes, by their stamps; rates, percentiles and periods."""

import random

import numpy as np
import pytest
from spm_haptic_master import timing
from spm_haptic_master.timing import LatencyMeter, Periodic, RateMeter, StampGrid, WINDOW

MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS


def chosen(rate, stamps, sample_rate=1000.0):
    grid = StampGrid(rate, sample_rate)
    return [stamp for stamp in stamps if grid.is_due(stamp)]


def test_every_sample():
    stamps = [BEGIN + k * MS for k in range(50)]
    assert all(chosen(rate, stamps) == stamps for rate in (0.0, 1000.0, 5000.0))


@pytest.mark.parametrize('rate', [10.0, 200.0, 333.0, 999.0])
def test_the_rate_is_kept_whatever_the_jitter(rate):
    generator = random.Random(1)
    stamps = [BEGIN + k * MS + generator.randrange(-MS // 3, MS // 3) for k in range(10_000)]
    found = chosen(rate, stamps)
    assert len(found) == pytest.approx(10.0 * rate, rel=3e-3, abs=1.5)
    # No two are nearer than the rate allows, but for one sample and the jitter.
    assert np.diff(found).min() >= 1e9 / rate - 1.7 * MS


def test_after_a_pause_there_is_one_not_a_burst():
    stamps = [BEGIN + k * MS for k in (*range(100), *range(5000, 5100))]
    assert np.diff(chosen(200.0, stamps)).min() == 5 * MS


def test_a_clock_that_is_set_back_ends_no_output():
    stamps = [BEGIN + k * MS for k in range(100)]
    stamps += [stamp - 3_600_000 * MS for stamp in stamps]
    assert len(chosen(200.0, stamps)) == 40


def test_the_first_time_is_at_once_and_the_next_a_period_later():
    due = Periodic(0.5)
    assert [due.is_due(now) for now in (0.25, 0.5, 0.625, 0.75, 1.0, 1.25)] == [
        True,
        False,
        False,
        True,
        False,
        True,
    ]


def test_percentiles_are_of_the_latest_latencies_and_a_rate_of_the_latest_interval(monkeypatch):
    meter = LatencyMeter()
    assert meter.percentiles(0.5) is None
    meter.add(7000)
    assert meter.percentiles(0.0, 1.0) == (7.0, 7.0)
    for k in random.Random(1).sample(range(WINDOW), WINDOW):
        meter.add(1000 * k)
    assert meter.percentiles(0.0, 0.5, 0.99, 1.0) == pytest.approx((0.0, 500.0, 990.0, 999.0))
    now = [10.0]
    monkeypatch.setattr(timing.time, 'monotonic', lambda: now[0])
    rate = RateMeter()
    rate.count += 50
    now[0] += 0.1
    assert rate.rate() == 0.0
    now[0] += 0.15
    assert rate.rate() == pytest.approx(200.0)
    now[0] += 0.1
    assert rate.rate() == pytest.approx(200.0)
