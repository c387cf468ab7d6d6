# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each joint by itself: range, jump, speed, frozen value, and the sampling period."""

from math import radians

from product_limits import product_limits
import pytest
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.supervision.joint_monitor import JointMonitor

DT = 1e-3
SIGMA = radians(0.04)
# Standard deviation of the innovation (rad), and what 500 rad/s^2 adds to it at 1 kHz (rad).
DEVIATION = 1.343 * SIGMA
ALLOWANCE = 500.0 * DT ** 2 / 0.2
JUMP = product_limits().threshold * DEVIATION + ALLOWANCE
PLACE = (0.3, 0.4, 0.5, 0.6)


def monitor_at_rest(count=50, sigma=SIGMA, **limits):
    """Return a monitor after `count` equal samples of joints without noise."""
    monitor = JointMonitor((sigma,) * 4, product_limits(**limits))
    for index in range(count):
        assert monitor.evaluate(PLACE, DT if index else 0.0) == []
    return monitor


def lively(index, sensor, reading):
    """Return a sample in which all joints change but `sensor`, which reads `reading`."""
    sample = [angle + (index % 2) * 1e-6 for angle in PLACE]
    sample[sensor] = reading
    return tuple(sample)


def moved(sensor, angle):
    return tuple(value + angle * (index == sensor) for index, value in enumerate(PLACE))


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_out_of_range(sensor):
    low, high = [-3.0] * 4, [3.0] * 4
    low[sensor], high[sensor] = PLACE[sensor] - 1e-4, PLACE[sensor] + 1e-4
    monitor = monitor_at_rest(joint_min=tuple(low), joint_max=tuple(high))
    for bound in (low, high):
        sample = list(PLACE)
        sample[sensor] = bound[sensor]
        assert monitor.evaluate(tuple(sample), DT) == []
    for beyond in (PLACE[sensor] - 2e-4, PLACE[sensor] + 2e-4):
        sample[sensor] = beyond
        symptom, = monitor.evaluate(tuple(sample), DT)
        assert symptom.text == f'{JOINT_NAMES[sensor]} out of range'
        assert symptom.detail == f'{JOINT_NAMES[sensor]} {beyond:.4f} rad'
        assert not symptom.fault
        assert not symptom.self_timed


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_a_reading_off_the_motion_by_more_than_noise_and_a_human_has_jumped(sensor, sign):
    assert monitor_at_rest().evaluate(moved(sensor, 0.99 * sign * JUMP), DT) == []
    symptom, = monitor_at_rest().evaluate(moved(sensor, 1.01 * sign * JUMP), DT)
    assert symptom.text == f'{JOINT_NAMES[sensor]} jumped'
    assert symptom.detail == f'{JOINT_NAMES[sensor]} {1.01 * sign * JUMP:+.4f} rad off its motion'
    assert not symptom.fault
    assert not symptom.self_timed


def test_a_noisier_sensor_has_a_larger_limit():
    sigma = (SIGMA, 3.0 * SIGMA, SIGMA, SIGMA)
    monitor = JointMonitor(sigma, product_limits())
    for index in range(50):
        monitor.evaluate(PLACE, DT if index else 0.0)
    assert monitor.evaluate(moved(1, 2.0 * JUMP), DT) == []
    assert monitor.innovations[1] == pytest.approx(2.0 * JUMP / (3.0 * DEVIATION))
    assert monitor.evaluate(moved(2, 2.0 * JUMP), DT) != []


def test_innovations_are_in_standard_deviations():
    monitor = monitor_at_rest()
    monitor.evaluate(moved(2, 4.0 * DEVIATION), DT)
    assert monitor.innovations == pytest.approx((0.0, 0.0, 4.0, 0.0))


def test_a_human_may_accelerate_further_in_a_longer_time():
    allowed = product_limits().threshold * DEVIATION + 500.0 * (3.0 * DT) ** 2 / 0.2
    assert monitor_at_rest().evaluate(moved(0, 0.99 * allowed), 3.0 * DT) == []
    assert monitor_at_rest().evaluate(moved(0, 1.01 * allowed), 3.0 * DT) != []
    # And no less far where two samples come at once: the period is what counts.
    assert monitor_at_rest().evaluate(moved(0, 0.97 * JUMP), 1e-5) == []


def test_after_a_jump_only_half_the_limit_is_a_return():
    monitor = monitor_at_rest()
    monitor.evaluate(moved(3, 0.2), DT)
    symptom, = monitor.evaluate(moved(3, 0.51 * JUMP), DT)
    assert symptom.text == 'joint_3a jumped'
    assert monitor.evaluate(moved(3, 0.49 * JUMP), DT) == []
    # Back, the whole limit holds again.
    monitor = monitor_at_rest()
    monitor.evaluate(moved(3, 0.2), DT)
    monitor.evaluate(PLACE, DT)
    assert monitor.evaluate(moved(3, 0.9 * JUMP), DT) == []


def test_after_out_of_range_a_joint_has_to_return_likewise():
    monitor = monitor_at_rest()
    monitor.evaluate((0.3, 3.5, 0.5, 0.6), DT)
    assert [symptom.text for symptom in monitor.evaluate(moved(1, 0.6 * JUMP), DT)] == [
        'joint_1b jumped']
    assert monitor.evaluate(moved(1, 0.4 * JUMP), DT) == []


def test_a_moving_joint_coasts_on_while_it_jumps():
    monitor = JointMonitor((SIGMA,) * 4, product_limits())
    for index in range(50):
        monitor.evaluate(moved(0, 2e-3 * index), DT if index else 0.0)
    for index in range(50, 60):
        assert monitor.evaluate(moved(0, 2e-3 * index + 0.1), DT) != []
    assert monitor.evaluate(moved(0, 2e-3 * 60), DT) == []
    # Likewise out of range.
    for _ in range(61, 70):
        assert monitor.evaluate((3.5, *PLACE[1:]), DT) != []
    assert monitor.evaluate(moved(0, 2e-3 * 70), DT) == []


@pytest.mark.parametrize('speed', [2.0, -2.0])
def test_too_fast(speed):
    monitor = JointMonitor((SIGMA,) * 4, product_limits(joint_speed=1.9))
    symptoms = [monitor.evaluate(moved(1, speed * DT * index), DT if index else 0.0)
                for index in range(10)]
    assert symptoms[0] == []
    symptom, = symptoms[-1]
    assert symptom.text == 'joint_1b too fast'
    assert symptom.detail == f'joint_1b {speed:.1f} rad/s'
    assert not symptom.fault
    assert not symptom.self_timed
    monitor = JointMonitor((SIGMA,) * 4, product_limits(joint_speed=2.1))
    assert not any(monitor.evaluate(moved(1, speed * DT * index), DT if index else 0.0)
                   for index in range(10))


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_a_value_repeated_ten_times_while_the_others_change_is_frozen(sensor):
    monitor = JointMonitor((SIGMA,) * 4, product_limits())
    for index in range(50):
        monitor.evaluate(lively(index, sensor, 0.7 + index % 2 * 1e-6), DT if index else 0.0)
    found = [monitor.evaluate(lively(index, sensor, 0.7), DT) for index in range(25)]
    assert found[:10] == [[]] * 10
    assert all(symptoms[0].text == f'{JOINT_NAMES[sensor]} frozen' for symptoms in found[10:])
    assert found[10][0].detail == f'{JOINT_NAMES[sensor]} 11 times 0.700000 rad'
    assert all(symptoms[0].self_timed for symptoms in found[10:])
    # A fault after 20 repeats, by `frozen_samples`.
    assert [symptoms[0].fault for symptoms in found[10:]] == [False] * 10 + [True] * 5
    assert monitor.evaluate(lively(1, sensor, 0.700002), DT) == []


@pytest.mark.parametrize(('speed', 'repeats'), [(1.3, 4), (0.65, 6), (0.5, 8), (0.2, 10)])
def test_a_moving_joint_is_frozen_once_it_misses_four_deviations(speed, repeats):
    monitor = JointMonitor((SIGMA,) * 4, product_limits())
    for index in range(200):
        monitor.evaluate(lively(index, 0, -1.0 + speed * DT * index), DT if index else 0.0)
    found = [monitor.evaluate(lively(index, 0, -1.0 + speed * DT * 199), DT)
             for index in range(12)]
    assert [bool(symptoms) for symptoms in found].index(True) + 1 == repeats


def test_a_frozen_value_needs_three_lively_sensors():
    """One more that changes in every third sample only is not lively enough."""
    monitor = JointMonitor((SIGMA,) * 4, product_limits())
    found = []
    for index in range(200):
        sample = [angle + (index % 2) * 1e-6 for angle in PLACE]
        sample[0] = 0.3
        sample[2] = 0.5 + (index // 3) % 2 * 1e-6
        found += monitor.evaluate(tuple(sample), DT if index else 0.0)
    assert found == []
    for index in range(200):
        sample = [angle + (index % 2) * 1e-6 for angle in PLACE]
        sample[0] = 0.3
        # Changes in seven of ten.
        sample[2] = 0.5 + index * 1e-6 * (index % 10 < 7)
        found += monitor.evaluate(tuple(sample), DT)
    assert [symptom.text for symptom in found[-1:]] == ['joint_1a frozen']


def test_frozen_samples_zero_turns_the_test_off():
    monitor = JointMonitor((SIGMA,) * 4, product_limits(frozen_samples=0))
    assert not any(monitor.evaluate(lively(index, 2, 0.7), DT if index else 0.0)
                   for index in range(200))
    monitor = JointMonitor((SIGMA,) * 4, product_limits(frozen_samples=1))
    assert any(monitor.evaluate(lively(index, 2, 0.7), DT if index else 0.0)
               for index in range(200))


def test_the_period_is_averaged_and_a_long_gap_counts_for_twenty():
    monitor = monitor_at_rest(3)
    assert monitor.period == pytest.approx(DT, rel=1e-12)
    monitor.evaluate(PLACE, 2.0 * DT)
    assert monitor.period == pytest.approx(1.02 * DT)
    monitor = monitor_at_rest(3)
    monitor.evaluate(PLACE, 1000.0 * DT)
    assert monitor.period == pytest.approx((1.0 + 19.0 / 50.0) * DT)


def test_the_first_distance_of_samples_is_the_period():
    monitor = JointMonitor((SIGMA,) * 4, product_limits())
    monitor.evaluate(PLACE, 0.0)
    assert monitor.period == 0.0
    monitor.evaluate(PLACE, 0.004)
    assert monitor.period == pytest.approx(0.004)


def test_more_than_five_periods_are_a_gap():
    monitor = monitor_at_rest(3)
    assert not monitor.is_gap(5.0 * DT)
    assert monitor.is_gap(5.1 * DT)
    assert not JointMonitor((SIGMA,) * 4, product_limits()).is_gap(1.0)


def test_reset_motion_lets_every_joint_be_anywhere():
    monitor = monitor_at_rest()
    monitor.reset_motion()
    assert monitor.evaluate(moved(3, 0.5), DT) == []
    assert monitor.period == pytest.approx(DT)


def test_restart_forgets_the_period_as_well():
    monitor = monitor_at_rest()
    monitor.restart()
    assert monitor.period == 0.0
    assert monitor.evaluate(moved(3, 0.5), 0.0) == []


def test_restart_of_some_sensors_leaves_the_others():
    monitor = monitor_at_rest()
    monitor.restart_sensors((1, 3))
    symptoms = monitor.evaluate(tuple(angle + 0.5 for angle in PLACE), DT)
    assert [symptom.text for symptom in symptoms] == ['joint_1a jumped', 'joint_1c jumped']


def test_a_joint_that_jumped_and_is_where_it_was_has_returned():
    limit = 0.5 * product_limits().threshold * DEVIATION
    monitor = monitor_at_rest()
    assert monitor.returned(PLACE) == []
    monitor.evaluate(moved(2, 0.1), DT)
    assert monitor.returned(PLACE) == [2]
    for sign in (1.0, -1.0):
        assert monitor.returned(moved(2, 0.99 * sign * limit)) == [2]
        assert monitor.returned(moved(2, 1.01 * sign * limit)) == []
