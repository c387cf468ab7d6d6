# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The last orientation: how long it selects, what may follow it, and its sign."""

from math import cos, sin

import pytest
from spm_haptic_master.supervision.continuity_monitor import ContinuityMonitor

MS = 1_000_000
SPEED = 10.0
DEVIATION = 1e-3


def turned(angle):
    """Return the quaternion of a rotation by `angle`, rad, about x."""
    return sin(0.5 * angle), 0.0, 0.0, cos(0.5 * angle)


@pytest.fixture
def monitor():
    """Return a monitor whose last orientation is at 0 ns."""
    monitor = ContinuityMonitor(SPEED)
    monitor.publish(0, turned(0.0))
    return monitor


def test_before_the_first_orientation_anything_may_come():
    monitor = ContinuityMonitor(SPEED)
    assert monitor.prior(0) is None
    assert monitor.check(0, turned(3.0), DEVIATION) is None


def test_an_orientation_selects_for_a_tenth_of_a_second(monitor):
    assert monitor.prior(100 * MS) == turned(0.0)
    assert monitor.prior(100 * MS + 1) is None
    assert monitor.check(100 * MS + 1, turned(3.0), DEVIATION) is None


@pytest.mark.parametrize('milliseconds', [1, 7, 50])
def test_the_turn_is_limited_by_time_and_deviation(monitor, milliseconds):
    reach = SPEED * milliseconds * 1e-3 + 6.0 * DEVIATION
    stamp = milliseconds * MS
    assert monitor.check(stamp, turned(0.98 * reach), DEVIATION) is None
    assert monitor.check(stamp, turned(-0.98 * reach), DEVIATION) is None
    symptom = monitor.check(stamp, turned(1.02 * reach), DEVIATION)
    assert symptom.reason == 'orientation does not continue the motion'
    assert symptom.sensor is None
    assert symptom.detail == f'{1.02 * reach:.3f} rad off the last one, limit {reach:.3f}'


def test_the_sign_of_an_orientation_is_no_turn(monitor):
    assert monitor.check(MS, tuple(-each for each in turned(0.0)), DEVIATION) is None


def test_the_first_orientation_has_a_positive_w_and_the_others_its_sign():
    monitor = ContinuityMonitor(SPEED)
    assert monitor.publish(0, (0.0, 0.6, 0.0, -0.8)) == (0.0, -0.6, 0.0, 0.8)
    assert monitor.publish(MS, (0.0, -0.6, 0.0, 0.8)) == (0.0, -0.6, 0.0, 0.8)
    # Past half a turn w is negative, and nothing jumps.
    assert monitor.publish(2 * MS, (0.0, -1.0, 0.0, -0.01)) == (0.0, -1.0, 0.0, -0.01)
    assert monitor.publish(3 * MS, (0.0, 1.0, 0.0, 0.01)) == (0.0, -1.0, 0.0, -0.01)


def test_only_an_orientation_withheld_for_its_worth_is_followed(monitor):
    monitor.follow(MS, turned(0.01))
    assert monitor.prior(MS) == turned(0.0)
    monitor.following = True
    monitor.follow(MS, turned(0.01))
    assert monitor.prior(101 * MS) == turned(0.01)
    assert monitor.following


def test_a_motion_that_was_lost_is_not_followed(monitor):
    monitor.following = True
    monitor.follow(101 * MS, turned(0.01))
    assert monitor.prior(101 * MS) is None


def test_an_orientation_that_is_published_ends_the_following(monitor):
    monitor.following = True
    monitor.publish(MS, turned(0.01))
    assert not monitor.following


def test_forgetting_lets_the_next_one_start_as_the_first_did(monitor):
    monitor.following = True
    monitor.forget()
    assert monitor.prior(MS) is None
    assert not monitor.following
    assert monitor.check(MS, turned(3.0), DEVIATION) is None
    # The sign goes on.
    assert monitor.publish(MS, (0.0, 0.0, 0.0, -1.0)) == (0.0, 0.0, 0.0, 1.0)


def test_an_undetermined_sample_is_remembered_for_a_tenth_of_a_second(monitor):
    assert not monitor.was_undetermined(0)
    monitor.note_undetermined(5 * MS)
    assert monitor.was_undetermined(105 * MS)
    assert not monitor.was_undetermined(105 * MS + 1)
