# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How long ago each sensor was last checked, and which have to be before an orientation."""

from math import inf

import pytest
from rig import product_limits
from spm_haptic_master.supervision.exposure import CheckTimes, Exposure
from spm_haptic_master.supervision.symptom import Reason, Severity

MS = 1_000_000
BEGIN = 5_000
LIMIT = 0.02
WITHIN = [0.01] * 4
NOT_THE_LAST = [0.01, 0.01, 0.01, 0.03]


def noted(exposure, times, parts=WITHIN):
    """Note consistent samples at times, ms after the begin; return their exposure."""
    for time in times:
        exposure.note_consistent((BEGIN + time) * MS, parts, LIMIT)
    return exposure


def new(window=0.02):
    return Exposure(4, window)


def at(time):
    return round((BEGIN + time) * MS)


@pytest.mark.parametrize(
    ('window', 'step', 'checked'),
    [
        # Of a window's time, and of ten samples at least.
        (0.02, 1, 20),
        (0.02, 4, 36),
        (0.005, 1, 9),
    ],
)
def test_a_sensor_is_checked_once_its_part_was_within_the_limit_for_a_window(
    window, step, checked
):
    exposure = noted(new(window), range(0, checked, step))
    assert exposure.times(at(checked)) == (inf,) * 4
    noted(exposure, [checked])
    assert exposure.times(at(checked)) == (0.0,) * 4
    assert exposure.times(at(checked + 250)) == pytest.approx((0.25,) * 4)


def test_the_times_of_checks_begin_with_their_first_sample():
    checks = CheckTimes(4, 0)
    assert [checks.note_parts(at(time), WITHIN, LIMIT) for time in range(10)] == [()] * 10
    assert checks.latest == [at(9)] * 4
    assert checks.is_after(0, at(8))
    assert not checks.is_after(0, at(9))


@pytest.mark.parametrize('part', [0.02, 0.0201])
def test_a_part_beyond_the_limit_hides_its_sensor_and_begins_its_window_again(part):
    exposure = new()
    assert exposure.hidden == (0, 1, 2, 3)
    noted(exposure, range(30))
    assert exposure.hidden == ()
    is_beyond = part > LIMIT
    noted(exposure, [30], [0.01, part, 0.01, 0.01])
    assert exposure.hidden == ((1,) if is_beyond else ())
    noted(exposure, range(31, 51))
    assert exposure.hidden == ()
    assert exposure.times(at(50))[1] == pytest.approx(0.021 if is_beyond else 0.0)
    assert exposure.times(at(50))[0] == 0.0
    noted(exposure, [51])
    assert exposure.times(at(51)) == (0.0,) * 4


def test_a_sample_that_is_not_consistent_begins_every_window_again():
    exposure = noted(new(), range(30))
    exposure.interrupt()
    noted(exposure, range(30, 50))
    assert exposure.times(at(49)) == pytest.approx((0.02,) * 4)
    noted(exposure, [50])
    assert exposure.times(at(50)) == (0.0,) * 4


def test_a_pause_hides_all_sensors_and_what_was_checked_stays_that_long_ago():
    exposure = noted(new(), range(30))
    exposure.restart()
    assert exposure.hidden == (0, 1, 2, 3)
    assert exposure.times(at(629)) == pytest.approx((0.6,) * 4)
    noted(exposure, range(629, 649))
    assert exposure.hidden == ()
    assert exposure.times(at(648))[0] > 0.6
    noted(exposure, [649])
    assert exposure.times(at(649)) == (0.0,) * 4


def test_after_a_fault_its_sensor_is_cleared_by_a_check_with_or_without_its_rivals():
    """A rival from before the fault does not count."""
    exposure = noted(new(), range(30), NOT_THE_LAST)
    exposure.interrupt()
    assert exposure.is_cleared(0, at(28))
    assert not exposure.is_cleared(0, at(29))
    assert not exposure.is_cleared(3, at(0))
    for time in range(30, 51):
        noted(exposure, [time], NOT_THE_LAST)
        assert not exposure.is_cleared(3, at(29))
        exposure.note_after_fault(at(time), WITHIN, LIMIT)
    assert exposure.is_cleared(3, at(49))
    assert exposure.is_cleared(0, at(49))
    assert not exposure.is_cleared(3, at(50))
    # What is told of the sensors has those rivals.
    assert exposure.hidden == (3,)
    assert exposure.times(at(50))[3] == inf
    # An interruption begins these windows again too.
    exposure.interrupt()
    for time in range(51, 71):
        exposure.note_after_fault(at(time), WITHIN, LIMIT)
    assert not exposure.is_cleared(3, at(50))


# What has to be checked -----------------------------------------------------------------------


def overdue(exposure, time, left_out=(), **limits):
    """Return the sensor that has to be checked, with the reason; None without one."""
    symptom = exposure.overdue(at(time), product_limits(**limits), left_out)
    return symptom and (symptom.sensor, symptom.reason)


def test_with_start_checked_each_sensor_in_use_is_checked_once_since_the_pause():
    start = {'start_checked': True, 'unchecked_limit': 0.0}
    exposure = new()
    assert overdue(exposure, 0, **start) is None
    noted(exposure, range(20))
    assert overdue(exposure, 19, **start) == (0, Reason.NOT_CHECKED)
    assert overdue(exposure, 19, (0, 2), **start) == (1, Reason.NOT_CHECKED)
    assert overdue(exposure, 19, (0, 1, 2, 3), **start) is None
    assert overdue(exposure, 19, start_checked=False) is None
    noted(exposure, [20, 21], NOT_THE_LAST)
    assert overdue(exposure, 21, **start) == (3, Reason.NOT_CHECKED)
    assert overdue(exposure, 21, (3,), **start) is None
    symptom = exposure.overdue(at(21), product_limits(**start), ())
    assert symptom.severity is Severity.WITHHOLD
    # After a pause again.
    exposure.restart()
    noted(exposure, range(700, 720), WITHIN)
    assert overdue(exposure, 720, **start) == (0, Reason.NOT_CHECKED)
    noted(exposure, [720, 721], WITHIN)
    assert overdue(exposure, 721, **start) is None


@pytest.mark.parametrize('start_checked', [False, True])
def test_no_sensor_in_use_is_unchecked_for_longer_than_its_limit(start_checked):
    often = {'unchecked_limit': 2.0, 'start_checked': start_checked}
    exposure = noted(new(), range(30))
    noted(exposure, range(30, 2029), NOT_THE_LAST)
    assert overdue(exposure, 2029, **often) is None
    noted(exposure, [2032], NOT_THE_LAST)
    assert overdue(exposure, 2032, **often) == (3, Reason.UNCHECKED)
    assert overdue(exposure, 2032, (3,), **often) is None
    assert overdue(exposure, 2032, unchecked_limit=0.0) is None
    symptom = exposure.overdue(at(2032), product_limits(**often), ())
    assert symptom.detail == '2 s, limit 2'
    assert symptom.severity is Severity.WITHHOLD
    noted(exposure, range(2033, 2055))
    assert overdue(exposure, 2054, **often) is None


def test_one_that_was_never_checked_counts_since_the_first_consistent_sample_ever():
    """A pause does not restart that time."""
    exposure = noted(new(), range(1500), NOT_THE_LAST)
    assert overdue(exposure, 1499, unchecked_limit=2.0) is None
    exposure.restart()
    assert overdue(exposure, 2100, unchecked_limit=2.0) is None
    noted(exposure, range(2100, 2130), NOT_THE_LAST)
    assert overdue(exposure, 2130, unchecked_limit=2.0) == (3, Reason.UNCHECKED)
    assert overdue(exposure, 2130, unchecked_limit=3.0) is None


def test_more_than_a_second_unchecked_is_a_caution():
    exposure = new()
    assert exposure.cautions(at(5000)) == {}
    noted(exposure, range(30), NOT_THE_LAST)
    assert exposure.cautions(at(990)) == {}
    assert exposure.cautions(at(1010)) == {
        'unchecked joint_3a': 'joint_3a unchecked since the start',
    }
    assert exposure.cautions(at(3029)) == {
        'unchecked joint_1a': 'joint_1a unchecked for 3 s',
        'unchecked joint_1b': 'joint_1b unchecked for 3 s',
        'unchecked joint_1c': 'joint_1c unchecked for 3 s',
        'unchecked joint_3a': 'joint_3a unchecked since the start',
    }
