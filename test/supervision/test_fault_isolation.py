# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From symptoms to a fault: pending, latch, isolation of the sensor, widening, clearing."""

from types import SimpleNamespace

from product_limits import product_limits
import pytest

from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.supervision.fault_isolation import FaultIsolation
from spm_haptic_master.supervision.symptom import Symptom

DT = 1e-3
QUIET = (0.0, 0.0, 0.0, 0.0)
# A symptom of sensor 0, of sensor 3, of no sensor, one latched at once, one timed by its monitor.
JUMPED = Symptom('jumped', '0.1 rad', 0)
OTHER = Symptom('too fast', '30 rad/s', 3)
PARITY = Symptom('inconsistent angles', 'parity 8')
DRIFT = Symptom('angles drifted apart', 'parity 7', fault=True)
FROZEN = Symptom('frozen', '15 times', 1, self_timed=True)
STUCK = FROZEN._replace(fault=True)


class Joints:
    """Records which trackers are restarted."""

    period = DT

    def __init__(self):
        self.restarted = []

    def restart_sensors(self, sensors):
        self.restarted.append(list(sensors))


class Isolation(FaultIsolation):
    """The fault isolation with recorded restarts, and one call a sample."""

    def __init__(self, healthy=True, **limits):
        self.joints = Joints()
        super().__init__(product_limits(**limits), self.joints)
        if healthy:
            for _ in range(5):
                self.sample()

    def sample(self, *symptoms, innovations=QUIET, sensitivity=(0.5,) * 4, dt=DT):
        """Return why the sample is withheld, '' if it is not, as the supervisor asks."""
        symptoms = list(symptoms)
        estimate = SimpleNamespace(sensitivity=sensitivity)
        self.update(symptoms, innovations)
        try:
            if self.fault is not None and not self.clear(self.fault, estimate, symptoms, dt):
                self.restart_persistent(symptoms)
                return self.fault.text
            if symptoms:
                self.withhold(symptoms)
            self.settle()
        except RejectedError as rejection:
            return rejection.reason
        self.confirm()
        return ''


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
    ((0.0, 0.0, 4.9, 0.0), None), ((0.0, 3.6, 5.1, 0.0), None), ((0.0, -3.6, 5.1, 0.0), None),
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
