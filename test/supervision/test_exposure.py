# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time since each sensor was last checked by the others."""

from math import inf, nextafter

import pytest
from spm_haptic_master.supervision.exposure import Exposure

MS = 1_000_000
LIMIT = 0.02
SEEN, UNSEEN = [0.01] * 4, [0.01, 0.01, 0.01, inf]


def after(parts, stamps, window=0.02):
    """Return an exposure after consistent samples at times, ms."""
    exposure = Exposure(4, window)
    for stamp in stamps:
        exposure.take(stamp * MS, parts, LIMIT)
    return exposure


def test_no_sensor_is_checked_at_the_beginning():
    exposure = Exposure(4, 0.02)
    assert exposure.times(0) == (inf,) * 4
    assert exposure.unchecked() == (0, 1, 2, 3)
    assert len(Exposure(6, 0.02).times(0)) == 6


def test_a_window_of_consistent_samples_is_a_check():
    exposure = after(SEEN, range(20))
    assert exposure.unchecked() == (0, 1, 2, 3)
    exposure.take(20 * MS, SEEN, LIMIT)
    assert exposure.unchecked() == ()
    assert exposure.times(20 * MS) == (0.0,) * 4
    assert exposure.times(27 * MS) == pytest.approx((0.007,) * 4)


@pytest.mark.parametrize(('window', 'last'), [(0.001, 1), (0.1, 100)])
def test_the_window_is_a_setting(window, last):
    assert after(SEEN, range(last), window).unchecked() == (0, 1, 2, 3)
    assert after(SEEN, range(last + 1), window).unchecked() == ()


@pytest.mark.parametrize('sensor', range(4))
def test_a_sensor_is_checked_where_its_part_is_within_the_alert_limit(sensor):
    for part, unchecked in ((LIMIT, ()), (nextafter(LIMIT, 1.0), (sensor,)), (inf, (sensor,))):
        parts = [0.001] * 4
        parts[sensor] = part
        assert after(parts, range(21)).unchecked() == unchecked


def test_the_time_unchecked_grows_from_the_last_check():
    exposure = after(SEEN, range(30))
    for stamp in range(30, 80):
        exposure.take(stamp * MS, UNSEEN, LIMIT)
    assert exposure.times(79 * MS) == pytest.approx((0.0, 0.0, 0.0, 0.05))
    assert exposure.unchecked() == ()


def test_one_sample_out_of_sight_begins_the_window_again():
    exposure = after(SEEN, range(20))
    exposure.take(20 * MS, UNSEEN, LIMIT)
    for stamp in range(21, 41):
        exposure.take(stamp * MS, SEEN, LIMIT)
        assert exposure.unchecked() == (3,)
    exposure.take(41 * MS, SEEN, LIMIT)
    assert exposure.unchecked() == ()


def test_an_inconsistent_sample_begins_the_windows_again_and_forgets_no_check():
    exposure = after(SEEN, range(30))
    exposure.interrupt()
    for stamp in range(30, 50):
        exposure.take(stamp * MS, SEEN, LIMIT)
        assert exposure.times(stamp * MS) == pytest.approx(((stamp - 29) * 1e-3,) * 4)
    exposure.take(50 * MS, SEEN, LIMIT)
    assert exposure.times(50 * MS) == (0.0,) * 4


def test_restart_forgets_every_check_and_window():
    exposure = after(SEEN, range(30))
    exposure.restart()
    assert exposure.times(30 * MS) == (inf,) * 4
    for stamp in range(30, 50):
        exposure.take(stamp * MS, SEEN, LIMIT)
    assert exposure.unchecked() == (0, 1, 2, 3)
    exposure.take(50 * MS, SEEN, LIMIT)
    assert exposure.unchecked() == ()


@pytest.mark.parametrize(('parts', 'level'), [
    ([0.01, 0.015, 0.005, 0.001], 0.015), ([0.01, 0.015, 0.005, inf], 0.015),
    ([0.01, LIMIT, 0.03, inf], LIMIT), ([inf] * 4, 0.0), ([0.001, 0.002, 0.003, 0.004], 0.004)])
def test_the_level_is_the_largest_part_within_the_limit(parts, level):
    """At once: a sensor that could be checked, but was not yet, is in the level."""
    assert Exposure(4, 0.02).take(0, parts, LIMIT) == level
