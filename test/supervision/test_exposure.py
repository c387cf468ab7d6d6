# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The time since each sensor was last checked by the others."""

from math import inf, nextafter

import pytest
from rig import product_limits
from spm_haptic_master.supervision.exposure import Exposure

MS = 1_000_000
LIMIT = 0.02
SEEN, UNSEEN = [0.01] * 4, [0.01, 0.01, 0.01, inf]


def after(parts, stamps):
    """Return an exposure after consistent samples of the right solution at times, ms."""
    exposure = Exposure(4, 0.02)
    take(exposure, parts, stamps)
    return exposure


def take(exposure, parts, stamps, confirmed=True):
    for stamp in stamps:
        exposure.take(stamp * MS, parts, LIMIT, confirmed)


def unchecked(exposure):
    """Return the sensors that have never been checked."""
    return tuple(sensor for sensor, time in enumerate(exposure.times(0)) if time == inf)


def test_a_window_of_consistent_samples_is_a_check():
    exposure = after(SEEN, range(20))
    assert unchecked(exposure) == (0, 1, 2, 3)
    take(exposure, SEEN, [20])
    assert exposure.times(20 * MS) == (0.0,) * 4
    assert exposure.times(27 * MS) == pytest.approx((0.007,) * 4)


@pytest.mark.parametrize('sensor', range(4))
def test_a_sensor_is_checked_where_its_part_is_within_the_alert_limit(sensor):
    for part, expected in ((LIMIT, ()), (nextafter(LIMIT, 1.0), (sensor,)), (inf, (sensor,))):
        parts = [0.001] * 4
        parts[sensor] = part
        assert unchecked(after(parts, range(21))) == expected


def test_one_sample_out_of_sight_begins_its_window_again():
    exposure = after(SEEN, range(20))
    take(exposure, UNSEEN, [20])
    take(exposure, SEEN, range(21, 41))
    assert unchecked(exposure) == (3,)
    take(exposure, SEEN, [41])
    assert unchecked(exposure) == ()
    # Then the time unchecked grows from the last check.
    take(exposure, UNSEEN, range(42, 80))
    assert exposure.times(79 * MS) == pytest.approx((0.0, 0.0, 0.0, 0.038))


def test_a_solution_that_may_be_the_wrong_one_checks_no_sensor():
    """However long it is consistent; once it is confirmed, the window before counts."""
    exposure = Exposure(4, 0.02)
    take(exposure, SEEN, range(1000), confirmed=False)
    assert unchecked(exposure) == (0, 1, 2, 3)
    take(exposure, SEEN, [1000])
    assert unchecked(exposure) == ()
    take(exposure, SEEN, range(1001, 1101), confirmed=False)
    assert exposure.times(1100 * MS) == pytest.approx((0.1,) * 4)


@pytest.mark.parametrize(('limits', 'words'), [
    ({'start_checked': True}, 'joint_3a not checked yet'),
    ({'unchecked_limit': 1.0}, 'joint_3a unchecked for too long')])
def test_a_sensor_in_use_has_to_be_checked_and_one_that_is_left_out_has_not(limits, words):
    exposure = after(UNSEEN, range(0, 1500, 5))
    limits = product_limits(**limits)
    assert exposure.overdue(1500 * MS, limits, ()).words == words
    assert exposure.overdue(1500 * MS, limits, (3,)) is None
    assert exposure.overdue(1500 * MS, product_limits(), ()) is None
