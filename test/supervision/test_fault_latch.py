# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From symptoms to a fault: pending, latched, isolated, widened, acknowledged, cleared."""

from math import inf, nextafter

import pytest
from spm_haptic_master.supervision.fault_latch import FaultLatch
from spm_haptic_master.supervision.symptom import Symptom

DT = 2.0 ** -10
QUIET = (0.0, 0.0, 0.0, 0.0)
CHECKED = (0.0, 0.0, 0.0, 0.0)
JUMPED = Symptom('jumped', '9.0 sigma', 0)
ALSO_JUMPED = JUMPED._replace(sensor=1)
FAST = Symptom('too fast', '30 rad/s', 3)
PARITY = Symptom('inconsistent angles', 'parity 8')
DRIFT = Symptom('angles drifted apart', 'mean parity 2', fault=True)
REPEATS = Symptom('frozen', '15 times', 1, passive=True)
FROZEN = Symptom('frozen', '30 times', 1, fault=True)
NOTHING_FITS = Symptom('no orientation fits', 'leg A does not close')


def noted(*symptoms, times=1, innovations=QUIET):
    """Return a latch after equal samples with symptoms."""
    latch = FaultLatch()
    for _ in range(times):
        latch.note(list(symptoms), innovations)
    return latch


def latched(*symptoms, innovations=QUIET):
    """Return a latch that has made a fault of symptoms."""
    latch = noted(*symptoms, innovations=innovations)
    latch.latch(list(symptoms))
    return latch


# Samples with symptoms ----------------------------------------------------------------------

def test_without_symptoms_there_is_nothing():
    latch = noted()
    assert (latch.fault, latch.words, latch.bad, latch.acknowledge) == (None, '', 0, False)
    assert not latch.latch_pending()
    assert latch.recovered(True, CHECKED, DT, 1.0)
    assert latch.recovered(False, CHECKED, DT, 1.0)


def test_bad_samples_are_counted_in_a_row():
    latch = noted(PARITY, times=2)
    assert latch.bad == 2
    latch.note([], QUIET)
    assert latch.bad == 0
    latch.note([JUMPED], QUIET)
    assert latch.bad == 1


def test_a_passive_symptom_counts_beside_another_one_only():
    assert noted(REPEATS, times=9).bad == 0
    assert noted(REPEATS, PARITY, times=3).bad == 3


# Pending symptoms ---------------------------------------------------------------------------

def test_a_pending_symptom_is_latched_where_the_motion_is_lost():
    latch = noted(JUMPED)
    assert latch.latch_pending()
    assert latch.fault == JUMPED
    assert latch.words == 'joint_1a jumped'


def test_a_clean_sample_clears_what_is_pending():
    latch = noted(JUMPED)
    latch.note([], QUIET)
    assert not latch.latch_pending()
    assert latch.fault is None


def test_only_symptoms_of_a_sensor_are_pending_and_passive_ones_are_not():
    assert not noted(PARITY, REPEATS).latch_pending()
    assert noted(PARITY, FROZEN).latch_pending()


def test_pending_symptoms_are_latched_once():
    latch = noted(JUMPED)
    latch.latch_pending()
    latch.fault = None
    assert not latch.latch_pending()
    assert latch.fault is None


def test_a_sensor_that_returned_is_not_pending():
    latch = noted(JUMPED, FAST)
    latch.clear_pending(0)
    latch.clear_pending(2)
    latch.latch_pending()
    assert latch.fault == FAST


def test_pending_symptoms_are_those_of_all_bad_samples_in_a_row():
    latch = noted(JUMPED)
    latch.note([FAST], QUIET)
    latch.latch_pending()
    assert latch.words == 'jumped, sensor undetermined'


def test_a_pending_symptom_widens_a_fault():
    latch = latched(FROZEN)
    latch.note([], QUIET)
    latch.note([FAST], QUIET)
    assert latch.latch_pending()
    assert latch.words == 'joint_1b frozen and joint_3a too fast'


# Latched, and isolated ----------------------------------------------------------------------

def test_a_symptom_that_is_a_fault_is_reported_first():
    latch = latched(PARITY, DRIFT)
    assert latch.fault == DRIFT
    assert latch.words == 'angles drifted apart, sensor undetermined'


def test_without_one_the_first_symptom_is_reported():
    assert latched(JUMPED, PARITY).fault == JUMPED


def test_that_no_orientation_fits_has_no_sensor_to_be_determined():
    assert latched(NOTHING_FITS).words == 'no orientation fits'


def test_a_symptom_of_one_sensor_isolates_the_parity_to_it():
    latch = latched(PARITY, FAST, innovations=(9.0, 0.0, 0.0, 0.0))
    assert latch.fault == PARITY._replace(sensor=3)
    assert latch.words == 'joint_3a inconsistent angles'


def test_a_pending_symptom_isolates_the_parity_to_its_sensor():
    latch = noted(FAST)
    latch.note([DRIFT], QUIET)
    latch.latch([DRIFT])
    assert latch.fault.sensor == 3


def test_symptoms_of_two_sensors_leave_it_undetermined():
    latch = latched(JUMPED, FAST, innovations=(9.0, 0.0, 0.0, 0.0))
    assert latch.fault == JUMPED._replace(sensor=None)
    assert latch.words == 'jumped, sensor undetermined'
    # Also if one of them is pending only.
    latch = noted(FAST)
    latch.note([JUMPED], QUIET)
    latch.latch([JUMPED])
    assert latch.fault.sensor is None


@pytest.mark.parametrize(('onset', 'sensor'), [
    ((0.0, 0.0, 5.1, 0.0), 2), ((0.0, 0.0, -5.1, 0.0), 2), ((3.4, -3.4, 5.1, 3.4), 2),
    ((5.1, 0.0, 0.0, 0.0), 0), ((0.0, 0.0, 0.0, 5.1), 3),
    ((0.0, 0.0, 5.0, 0.0), None), ((0.0, 0.0, nextafter(5.0, 6.0), 0.0), 2),
    ((0.0, 3.5, 5.1, 0.0), 2), ((0.0, nextafter(3.5, 4.0), 5.1, 0.0), None),
    ((0.0, -3.6, 5.1, 0.0), None), ((6.0, 6.0, 0.0, 0.0), None), (QUIET, None)])
@pytest.mark.parametrize('times', [1, 3])
def test_the_innovations_at_the_onset_isolate_a_fault(onset, sensor, times):
    """Those of the first bad sample: what the joints do afterwards follows from it."""
    latch = noted()
    latch.note([PARITY], onset)
    for _ in range(times - 1):
        latch.note([PARITY], (9.0, 0.0, 0.0, 0.0))
    latch.latch([PARITY])
    assert latch.fault.sensor == sensor


# Widened, and stopped -----------------------------------------------------------------------

def test_a_second_sensor_widens_the_fault_to_all():
    latch = latched(FROZEN)
    latch.widen([PARITY, FROZEN, FAST])
    assert latch.fault == FROZEN._replace(
        sensor=None, reason='joint_1b frozen and joint_3a too fast')
    # A third one changes nothing.
    latch.widen([JUMPED])
    assert latch.words == 'joint_1b frozen and joint_3a too fast'


@pytest.mark.parametrize('symptoms', [[], [PARITY], [FROZEN, PARITY]])
def test_symptoms_of_the_faulty_sensor_or_of_none_do_not_widen_it(symptoms):
    latch = latched(FROZEN)
    latch.widen(symptoms)
    assert latch.fault == FROZEN


def test_without_a_fault_there_is_nothing_to_widen_or_stop():
    latch = noted(JUMPED)
    latch.widen([FAST])
    latch.stop('why')
    assert latch.fault is None


def test_stopping_gives_the_reason():
    latch = latched(FROZEN)
    latch.stop('the motion was lost')
    assert latch.words == 'joint_1b frozen, the motion was lost'
    assert latch.fault.sensor == 1


# Two that jumped ----------------------------------------------------------------------------

def test_two_sensors_that_jump_need_an_acknowledgement():
    latch = latched(JUMPED, ALSO_JUMPED)
    assert latch.acknowledge
    assert latch.words == 'jumped, sensor undetermined, to be acknowledged'


def test_so_do_two_that_jumped_one_after_the_other():
    latch = noted(JUMPED)
    latch.note([ALSO_JUMPED], QUIET)
    latch.latch([ALSO_JUMPED])
    assert latch.acknowledge
    latch = latched(JUMPED)
    latch.widen([ALSO_JUMPED])
    assert latch.acknowledge
    assert latch.words == 'joint_1a jumped and joint_1b jumped, to be acknowledged'
    latch = noted(JUMPED, ALSO_JUMPED)
    latch.latch_pending()
    assert latch.acknowledge


@pytest.mark.parametrize('first', [PARITY, DRIFT, FROZEN])
def test_so_do_two_that_jump_during_another_fault(first):
    latch = latched(first)
    latch.widen([JUMPED])
    assert not latch.acknowledge
    latch.widen([ALSO_JUMPED])
    assert latch.acknowledge
    latch = latched(first)
    latch.widen([JUMPED, ALSO_JUMPED])
    assert latch.acknowledge


def test_jumps_of_an_earlier_fault_do_not_count():
    latch = latched(JUMPED)
    latch.note([], QUIET)
    assert latch.recovered(True, CHECKED, 1.0, 1.0)
    latch.note([ALSO_JUMPED], QUIET)
    latch.latch([ALSO_JUMPED])
    assert not latch.acknowledge


@pytest.mark.parametrize('symptoms', [[JUMPED], [JUMPED, FAST], [JUMPED, PARITY], [FROZEN, FAST]])
def test_one_that_jumped_needs_none(symptoms):
    assert not latched(*symptoms).acknowledge
    latch = latched(symptoms[0])
    latch.widen(symptoms)
    assert not latch.acknowledge


def test_a_jump_beside_another_symptom_needs_none():
    for first, second in ((FROZEN, JUMPED), (JUMPED, FAST)):
        latch = latched(first)
        latch.widen([second])
        assert latch.fault.sensor is None
        assert not latch.acknowledge


def test_it_is_not_cleared_before_the_acknowledgement():
    latch = latched(JUMPED, ALSO_JUMPED)
    assert not any(latch.recovered(True, CHECKED, 1.0, 1.0) for _ in range(9))
    latch.acknowledge = False
    assert latch.recovered(True, CHECKED, DT, 1.0)
    assert latch.fault is None


# Cleared ------------------------------------------------------------------------------------

@pytest.mark.parametrize('symptom', [FROZEN, DRIFT])
def test_a_fault_is_cleared_after_a_time_of_consistency(symptom):
    latch = latched(symptom)
    found = [latch.recovered(True, CHECKED, DT, 8.0 * DT) for _ in range(8)]
    assert found == [False] * 7 + [True]
    assert (latch.fault, latch.words) == (None, '')


def test_recovery_begins_again_after_a_symptom():
    latch = latched(FROZEN)
    for _ in range(3):
        assert not any(latch.recovered(True, CHECKED, DT, 8.0 * DT) for _ in range(7))
        assert not latch.recovered(False, CHECKED, DT, 8.0 * DT)


def test_a_second_fault_needs_the_whole_recovery_time():
    latch = latched(FROZEN)
    for _ in range(7):
        latch.recovered(True, CHECKED, DT, 8.0 * DT)
    latch.latch([JUMPED])
    assert not any(latch.recovered(True, CHECKED, DT, 8.0 * DT) for _ in range(7))
    assert latch.recovered(True, CHECKED, DT, 8.0 * DT)


@pytest.mark.parametrize(('sensor', 'checked', 'counts'), [
    (3, (0.0, 0.0, 0.0, 2.0 * DT), False), (3, (0.0, 0.0, 0.0, inf), False),
    (3, (0.0, 0.0, 0.0, DT), True), (3, (inf, inf, inf, 0.0), True),
    (0, (0.0, inf, inf, inf), True), (0, (inf, 0.0, 0.0, 0.0), False),
    (None, (0.0, 0.0, 0.0, inf), False), (None, (0.0, 0.0, 0.0, DT), True)])
def test_consistency_counts_where_the_others_check_the_faulty_sensor(sensor, checked, counts):
    """All sensors, where it is not known which one is faulty."""
    latch = latched(Symptom('broken', '', sensor, fault=True))
    for _ in range(20):
        latch.recovered(True, checked, DT, 8.0 * DT)
    assert (latch.fault is None) == counts


def test_a_moment_out_of_sight_interrupts_and_does_not_begin_again():
    latch = latched(FROZEN)
    for _ in range(7):
        latch.recovered(True, CHECKED, DT, 8.0 * DT)
    for _ in range(20):
        assert not latch.recovered(True, (0.0, inf, 0.0, 0.0), DT, 8.0 * DT)
    assert latch.recovered(True, CHECKED, DT, 8.0 * DT)
