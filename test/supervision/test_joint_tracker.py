# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motion of one joint: prediction, repeats, liveliness."""

from math import pi, radians

import numpy as np
import pytest
from spm_haptic_master.supervision.joint_tracker import INNOVATION_DEVIATION, JointTracker

DT = 1e-3


def feed(tracker, readings, dt=DT, period=DT):
    """Pass readings through the tracker and return their innovations."""
    innovations = []
    for reading in readings:
        innovations.append(tracker.innovation(reading, dt))
        tracker.update(reading, innovations[-1], dt, period)
    return innovations


def ramp(speed, count, start=0.1):
    return [start + speed * DT * index for index in range(count)]


def test_the_first_two_readings_determine_the_motion():
    tracker = JointTracker()
    assert feed(tracker, [1.0, 1.002]) == [0.0, 0.0]
    assert tracker.angle == 1.002
    assert tracker.velocity == pytest.approx(2.0)


def test_a_reading_is_predicted_from_position_and_velocity():
    tracker = JointTracker()
    feed(tracker, [1.0, 1.002])
    assert tracker.innovation(1.007, DT) == pytest.approx(0.003)
    assert tracker.innovation(1.007, 2.0 * DT) == pytest.approx(0.001)
    tracker.update(1.007, 0.003, DT, DT)
    assert tracker.angle == pytest.approx(1.004 + 0.6 * 0.003)
    assert tracker.velocity == pytest.approx(2.0 + 0.2 * 0.003 / DT)


@pytest.mark.parametrize('speed', [3.0, -3.0])
def test_a_steady_motion_has_no_innovation(speed):
    tracker = JointTracker()
    assert np.allclose(feed(tracker, ramp(speed, 100)), 0.0, atol=1e-12)
    assert tracker.velocity == pytest.approx(speed)


def test_a_constant_acceleration_lags_as_the_gains_promise():
    tracker = JointTracker()
    innovations = feed(tracker, [0.5 * 40.0 * (index * DT) ** 2 for index in range(200)])
    assert innovations[-1] == pytest.approx(40.0 * DT ** 2 / 0.2, rel=1e-6)


def test_readings_closer_than_the_period_are_no_speed():
    tracker = JointTracker()
    feed(tracker, [1.0, 1.002], dt=1e-5)
    assert tracker.velocity == pytest.approx(2.0)
    tracker.update(1.002, 0.001, 1e-5, DT)
    assert tracker.velocity == pytest.approx(2.0 + 0.2)


def test_a_turn_past_pi_is_no_jump():
    tracker = JointTracker()
    readings = [(angle + pi) % (2.0 * pi) - pi for angle in ramp(2.0, 200, pi - 0.2)]
    assert np.allclose(feed(tracker, readings), 0.0, atol=1e-9)
    assert tracker.velocity == pytest.approx(2.0)
    assert tracker.offset(readings[-1] + 0.1) == pytest.approx(0.1)
    # Past pi between the first two readings as well.
    tracker = JointTracker()
    feed(tracker, [pi - 0.001, -pi + 0.001])
    assert tracker.velocity == pytest.approx(2.0)


def test_repeats_are_counted_until_the_value_changes():
    tracker = JointTracker()
    feed(tracker, [0.1, 0.2, 0.2, 0.2])
    assert tracker.repeats == 2
    feed(tracker, [0.3])
    assert tracker.repeats == 0


@pytest.mark.parametrize('speed', [1.5, -1.5])
@pytest.mark.parametrize('count', [10, 30])
def test_repeats_miss_the_motion_before_them(speed, count):
    """The steady velocity, averaged over 16 readings, has not reached the speed yet."""
    tracker = JointTracker()
    readings = ramp(speed, count)
    feed(tracker, [*readings, readings[-1], readings[-1], readings[-1]])
    steady = abs(speed) * (1.0 - (15.0 / 16.0) ** (count - 2))
    assert tracker.missed_motion == pytest.approx(3 * DT * steady)
    feed(tracker, [readings[-1] + 0.1])
    assert tracker.missed_motion == 0.0


def test_repeats_where_a_motion_reverses_miss_little():
    """The steady velocity still has the speed before; the filter's own is near 0."""
    tracker = JointTracker()
    times = np.arange(200) * DT
    readings = (0.1 * np.cos(2.0 * np.pi * 2.5 * times)).tolist()
    feed(tracker, [*readings, readings[-1], readings[-1]])
    assert tracker.missed_motion < 0.2 * 2.0 * DT * 0.1 * 2.0 * np.pi * 2.5


def test_a_resting_noisy_joint_misses_little():
    rng = np.random.default_rng(1)
    missed = []
    for _ in range(200):
        tracker = JointTracker()
        readings = rng.normal(0.0, radians(0.04), 100).tolist()
        feed(tracker, [*readings, readings[-1]])
        missed.append(tracker.missed_motion)
    # The filter's own velocity alone would miss twice as much.
    assert np.mean(missed) < 0.06 * radians(0.04)


def test_liveliness_is_the_fraction_of_readings_that_change():
    tracker = JointTracker()
    feed(tracker, ramp(1.0, 10))
    changing = 1.0 - (15.0 / 16.0) ** 10
    assert tracker.liveliness == pytest.approx(changing)
    feed(tracker, [0.5] * 4)
    assert tracker.liveliness == pytest.approx(
        (changing + (1.0 - changing) / 16.0) * (15.0 / 16.0) ** 3)


def test_coasting_extrapolates_without_the_reading():
    tracker = JointTracker()
    feed(tracker, [1.0, 1.002])
    assert not tracker.coasting
    tracker.coast(3.0 * DT)
    assert tracker.coasting
    assert tracker.angle == pytest.approx(1.008)
    assert tracker.velocity == pytest.approx(2.0)
    assert tracker.offset(1.009) == pytest.approx(0.001)
    feed(tracker, [1.010])
    assert not tracker.coasting


def test_reset_motion_keeps_the_repeats():
    tracker = JointTracker()
    feed(tracker, [*ramp(1.0, 30), 0.2, 0.2, 0.2])
    missed = tracker.missed_motion
    tracker.coast(DT)
    tracker.reset_motion()
    assert not tracker.coasting
    assert tracker.velocity == 0.0
    assert (tracker.repeats, tracker.missed_motion) == (2, missed)
    assert feed(tracker, [0.2, 0.9]) == [0.0, 0.0]
    assert tracker.velocity == pytest.approx(700.0)


def test_restart_forgets_the_repeats_and_keeps_the_liveliness():
    tracker = JointTracker()
    readings = ramp(1.0, 30)
    feed(tracker, [*readings, readings[-1]])
    lively = tracker.liveliness
    tracker.restart()
    assert (tracker.repeats, tracker.missed_motion, tracker.velocity) == (0, 0.0, 0.0)
    assert tracker.liveliness == lively > 0.5
    # The same value is a first reading, and no motion is missed by those that repeat it.
    assert feed(tracker, [readings[-1]]) == [0.0]
    assert tracker.repeats == 0
    feed(tracker, [readings[-1]])
    assert (tracker.repeats, tracker.missed_motion) == (1, 0.0)


def test_a_new_tracker_is_not_lively():
    tracker = JointTracker()
    assert (tracker.liveliness, tracker.repeats, tracker.missed_motion) == (0.0, 0, 0.0)
    assert not tracker.coasting


def test_the_innovation_of_noise_has_the_deviation_that_its_name_promises():
    sigma = radians(0.04)
    tracker = JointTracker()
    innovations = feed(tracker, np.random.default_rng(3).normal(0.0, sigma, 100_000).tolist())
    assert np.std(innovations[100:]) / sigma == pytest.approx(INNOVATION_DEVIATION, rel=0.01)
