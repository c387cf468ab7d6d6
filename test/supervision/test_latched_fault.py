# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pending symptoms, and a latched fault: widening, clearing, degraded operation, restart."""

from isolation import (
    DT,
    FROZEN,
    Isolation,
    JUMPED,
    OTHER,
    PARITY,
    STUCK,
)
import pytest
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.supervision.symptom import Symptom

# Pending symptoms -------------------------------------------------------------------------------


def test_a_pending_symptom_is_latched_where_the_motion_is_lost():
    isolation = Isolation()
    isolation.sample(JUMPED)
    isolation.latch_pending()
    assert isolation.fault == JUMPED
    assert isolation.state == 'silent: joint_1a jumped'


def test_a_clean_sample_clears_what_is_pending():
    isolation = Isolation()
    isolation.sample(JUMPED)
    isolation.sample()
    isolation.latch_pending()
    assert isolation.fault is None


def test_only_symptoms_of_a_sensor_are_pending():
    isolation = Isolation()
    isolation.sample(PARITY, FROZEN)
    isolation.latch_pending()
    assert isolation.fault is None


def test_nothing_is_latched_while_starting():
    isolation = Isolation(healthy=False)
    isolation.sample(JUMPED)
    isolation.latch_pending()
    assert isolation.fault is None


def test_pending_symptoms_are_latched_once():
    isolation = Isolation(recovery=0.01)
    isolation.sample(JUMPED)
    isolation.latch_pending()
    isolation.fault = None
    isolation.latch_pending()
    assert isolation.fault is None


def test_pending_symptoms_of_sensors_that_returned_are_cleared():
    isolation = Isolation()
    isolation.sample(JUMPED, OTHER)
    isolation.clear_pending([0, 1])
    isolation.latch_pending()
    assert isolation.fault == OTHER


def test_a_pending_symptom_widens_a_fault():
    isolation = Isolation(degraded=True)
    isolation.sample(STUCK)
    isolation.sample(OTHER)
    isolation.latch_pending()
    assert isolation.state == 'silent: joint_1b frozen and joint_3a too fast'
    assert not isolation.degraded_allowed


# A latched fault --------------------------------------------------------------------------------

def test_a_second_sensor_widens_the_fault_after_three_samples():
    isolation = Isolation(degraded=True)
    isolation.sample(STUCK)
    isolation.sample(OTHER, PARITY)
    isolation.sample(OTHER, PARITY)
    assert isolation.state == 'silent: joint_1b frozen'
    assert isolation.degraded_allowed
    isolation.joints.restarted.clear()
    assert isolation.sample(OTHER, PARITY) == 'joint_1b frozen and joint_3a too fast'
    assert isolation.state == 'silent: joint_1b frozen and joint_3a too fast'
    assert isolation.fault.sensor is None
    assert not isolation.degraded_allowed
    assert isolation.joints.restarted == [[3]]
    # A third one changes nothing.
    for _ in range(5):
        assert isolation.sample(JUMPED) == 'joint_1b frozen and joint_3a too fast'


def test_symptoms_of_the_faulty_sensor_or_of_none_do_not_widen_it():
    isolation = Isolation()
    for _ in range(3):
        isolation.sample(JUMPED)
    for _ in range(9):
        isolation.sample(JUMPED, PARITY)
    assert isolation.fault == JUMPED


@pytest.mark.parametrize('sensor', [0, None])
def test_a_fault_is_cleared_after_the_recovery_time_of_consistency(sensor):
    isolation = Isolation(recovery=0.0105, degraded=True)
    isolation.sample(Symptom('broken', '', sensor, fault=True))
    text = isolation.fault.text
    assert [isolation.sample() for _ in range(10)] == [text] * 10
    assert isolation.sample() == ''
    assert isolation.fault is None
    assert (isolation.state, isolation.degraded_allowed) == ('healthy', False)


def test_recovery_begins_again_after_each_symptom():
    isolation = Isolation(recovery=0.0105)
    isolation.sample(STUCK)
    for symptom in (FROZEN, PARITY, STUCK):
        for _ in range(10):
            isolation.sample()
        isolation.sample(symptom)
        assert isolation.fault is not None


def test_a_second_fault_needs_the_whole_recovery_time():
    isolation = Isolation(recovery=0.0105)
    for _ in range(2):
        isolation.sample(STUCK)
        assert [isolation.sample() for _ in range(11)] == ['joint_1b frozen'] * 10 + ['']


def test_recovery_is_reached_at_its_time():
    isolation = Isolation(recovery=4 * DT)
    isolation.sample(STUCK)
    assert [isolation.sample() for _ in range(4)] == ['joint_1b frozen'] * 3 + ['']


def test_a_gap_counts_for_two_periods_of_consistency():
    isolation = Isolation(recovery=0.0105)
    isolation.sample(STUCK)
    assert [isolation.sample(dt=1.0) for _ in range(6)] == ['joint_1b frozen'] * 5 + ['']


@pytest.mark.parametrize(('sensor', 'sensitivity', 'cleared'), [
    (3, (0.6, 0.6, 0.5, 0.09), False), (3, (0.6, 0.6, 0.5, -0.09), False),
    (3, (0.6, 0.6, 0.5, 0.1), True), (3, (0.6, 0.6, 0.5, -0.1), True),
    (0, (0.6, 0.6, 0.5, 0.0), True), (None, (0.6, 0.6, 0.5, 0.09), False),
    (None, (0.6, -0.6, 0.5, 0.1), True), (None, None, False)])
def test_consistency_counts_where_the_parity_checks_the_sensor(sensor, sensitivity, cleared):
    isolation = Isolation(recovery=0.01)
    isolation.sample(Symptom('broken', '', sensor, fault=True))
    for _ in range(20):
        isolation.sample(sensitivity=sensitivity)
    assert (isolation.fault is None) == cleared


def test_a_sample_without_an_estimate_is_not_consistent():
    isolation = Isolation(recovery=0.0105)
    isolation.sample(STUCK)
    for _ in range(10):
        isolation.sample()
    assert not isolation.clear(isolation.fault, None, [], DT)
    assert [isolation.sample() for _ in range(11)] == ['joint_1b frozen'] * 10 + ['']


def test_degraded_operation_stops_with_the_reason():
    isolation = Isolation(degraded=True)
    isolation.sample(STUCK)
    isolation.confirm_degraded(isolation.fault)
    assert isolation.state == 'degraded: joint_1b frozen'
    with pytest.raises(RejectedError, match='^joint_1b frozen, no more: why$'):
        isolation.stop_degraded(isolation.fault, 'no more', 'why')
    assert isolation.state == 'silent: joint_1b frozen, no more'
    assert isolation.fault.text == 'joint_1b frozen, no more'
    assert not isolation.degraded_allowed


# Restart ----------------------------------------------------------------------------------------

def test_restart_starts_again():
    isolation = Isolation(start_samples=3)
    isolation.restart()
    assert (isolation.state, isolation.starting, isolation.fault) == ('starting', True, None)
    assert [isolation.sample() for _ in range(3)] == ['starting', 'starting', '']


def test_restart_counts_no_bad_sample_from_before():
    isolation = Isolation()
    isolation.sample(PARITY)
    isolation.sample(PARITY)
    isolation.restart()
    isolation.sample(JUMPED)
    assert isolation.joints.restarted == []


def test_restart_keeps_a_fault_and_ends_degraded_operation():
    isolation = Isolation(degraded=True, recovery=0.0105)
    isolation.sample(STUCK)
    for _ in range(10):
        isolation.sample()
    isolation.restart()
    assert isolation.state == 'silent: joint_1b frozen'
    assert not isolation.degraded_allowed
    assert [isolation.sample() for _ in range(11)] == ['joint_1b frozen'] * 10 + ['']


def test_restart_latches_what_is_pending():
    isolation = Isolation()
    isolation.sample(JUMPED)
    isolation.restart()
    assert isolation.fault == JUMPED
    assert isolation.state == 'silent: joint_1a jumped'
