# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From symptoms to a fault: start, spikes, latch, isolation of the sensor."""

from isolation import (
    DRIFT,
    FROZEN,
    Isolation,
    JUMPED,
    OTHER,
    PARITY,
    QUIET,
    STUCK,
)
import pytest
from spm_haptic_master.exceptions import RejectedError


def test_it_starts_after_clean_samples():
    isolation = Isolation(healthy=False, start_samples=3)
    assert (isolation.state, isolation.starting) == ('starting', True)
    isolation.update([], QUIET)
    with pytest.raises(RejectedError, match='^starting: 1 consistent samples of 3$'):
        isolation.settle()
    assert isolation.sample() == 'starting'
    assert isolation.state == 'starting'
    assert isolation.sample() == ''
    assert (isolation.state, isolation.starting) == ('healthy', False)


def test_a_symptom_while_starting_counts_from_the_beginning_and_is_no_fault():
    isolation = Isolation(healthy=False, start_samples=3)
    isolation.sample()
    isolation.sample()
    assert [isolation.sample(DRIFT) for _ in range(9)] == [DRIFT.text] * 9
    assert isolation.fault is None
    assert isolation.state == 'starting'
    assert [isolation.sample() for _ in range(3)] == ['starting', 'starting', '']


def test_a_joint_that_goes_on_jumping_while_starting_is_tracked_from_where_it_is():
    isolation = Isolation(healthy=False)
    isolation.sample(JUMPED, PARITY)
    isolation.sample(JUMPED, PARITY)
    assert isolation.joints.restarted == []
    isolation.sample(JUMPED, PARITY)
    assert isolation.joints.restarted == [[0]]
    assert isolation.fault is None


@pytest.mark.parametrize('bad', [1, 2])
def test_a_spike_is_withheld_and_ten_clean_samples_after_it_are_settling(bad):
    isolation = Isolation()
    assert [isolation.sample(JUMPED) for _ in range(bad)] == ['joint_1a jumped'] * bad
    assert [isolation.sample() for _ in range(9)] == ['settling'] * 9
    assert isolation.state == 'healthy'
    assert isolation.sample() == ''
    assert isolation.fault is None
    # Ten are due after a spike only, not after each sample that a monitor times by itself.
    assert isolation.sample(FROZEN) == 'joint_1b frozen'
    assert isolation.sample() == ''


def test_settling_names_the_samples_that_are_due():
    isolation = Isolation()
    isolation.sample(JUMPED)
    isolation.update([], QUIET)
    with pytest.raises(RejectedError, match='^settling: 1 consistent samples of 10$'):
        isolation.settle()


def test_three_bad_samples_in_a_row_are_a_fault():
    isolation = Isolation()
    isolation.sample(JUMPED)
    isolation.sample(JUMPED)
    assert (isolation.fault, isolation.state) == (None, 'healthy')
    assert isolation.sample(JUMPED) == 'joint_1a jumped'
    assert isolation.fault == JUMPED
    assert isolation.state == 'silent: joint_1a jumped'
    assert isolation.joints.restarted == [[0]]


def test_bad_samples_not_in_a_row_are_no_fault():
    isolation = Isolation()
    for _ in range(10):
        isolation.sample(JUMPED)
        isolation.sample(JUMPED)
        isolation.sample()
    assert isolation.fault is None


def test_a_symptom_that_is_a_fault_is_latched_at_once_and_reported_first():
    isolation = Isolation()
    assert isolation.sample(PARITY, DRIFT) == 'angles drifted apart, sensor undetermined'
    assert isolation.fault == DRIFT
    assert isolation.joints.restarted == [[0, 1, 2, 3]]


def test_a_self_timed_symptom_is_no_fault_before_its_monitor_decides_so():
    isolation = Isolation()
    assert {isolation.sample(FROZEN) for _ in range(50)} == {'joint_1b frozen'}
    assert (isolation.fault, isolation.state) == (None, 'healthy')
    isolation.sample(STUCK)
    assert isolation.fault == STUCK


def test_a_bad_sample_beside_a_self_timed_symptom_counts():
    isolation = Isolation()
    for _ in range(3):
        isolation.sample(FROZEN, PARITY)
    assert isolation.fault is not None


def test_symptoms_of_two_sensors_leave_it_undetermined():
    isolation = Isolation(degraded=True)
    for _ in range(3):
        isolation.sample(JUMPED, OTHER, innovations=(9.0, 0.0, 0.0, 0.0))
    assert isolation.fault == JUMPED._replace(sensor=None)
    assert isolation.state == 'silent: jumped, sensor undetermined'
    assert isolation.joints.restarted == [[0, 1, 2, 3]]
    assert not isolation.degraded_allowed


def test_a_symptom_of_one_sensor_isolates_the_parity_to_it():
    isolation = Isolation()
    for _ in range(3):
        assert isolation.sample(PARITY, OTHER) == 'inconsistent angles, sensor undetermined'
    assert isolation.fault == PARITY._replace(sensor=3)
    assert isolation.state == 'silent: joint_3a inconsistent angles'


@pytest.mark.parametrize(('onset', 'sensor'), [
    ((0.0, 0.0, 5.1, 0.0), 2), ((0.0, 0.0, -5.1, 0.0), 2), ((3.4, -3.4, 5.1, 3.4), 2),
    ((0.0, 0.0, 5.0, 0.0), None), ((0.0, 3.5, 5.1, 0.0), 2),
    ((0.0, 3.6, 5.1, 0.0), None), ((0.0, -3.6, 5.1, 0.0), None),
    ((6.0, 6.0, 0.0, 0.0), None), (QUIET, None)])
@pytest.mark.parametrize('bad', [1, 3])
def test_the_innovations_at_the_onset_isolate_a_fault(onset, sensor, bad):
    """Those of the first bad sample; what the joints do afterwards follows from it."""
    isolation = Isolation(degraded=True)
    isolation.sample(DRIFT if bad == 1 else PARITY, innovations=onset)
    for _ in range(bad - 1):
        isolation.sample(PARITY, innovations=(9.0, 0.0, 0.0, 0.0))
    assert isolation.fault.sensor == sensor
    assert isolation.degraded_allowed == (sensor is not None)
    assert isolation.joints.restarted == [[0, 1, 2, 3] if sensor is None else [sensor]]


@pytest.mark.parametrize('degraded', [False, True])
def test_degraded_operation_is_allowed_by_the_limits_and_for_a_known_sensor(degraded):
    isolation = Isolation(degraded=degraded)
    assert not isolation.degraded_allowed
    isolation.sample(STUCK)
    assert isolation.degraded_allowed == degraded
