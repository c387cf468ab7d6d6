# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A latched fault: its words, what widens it, and when it is over."""

from math import inf

import pytest
from spm_haptic_master.supervision.fault import Fault
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

DT = 2.0 ** -10
RECOVERY = 8 * DT
FOUR = range(4)
CHECKED = (0.0,) * 4
PARITY = Symptom(Reason.INCONSISTENT, 'parity 8')
FROZEN = Symptom(Reason.FROZEN, '30 equal readings', 1, Severity.LATCH)


def clears(fault, times, unchecked=CHECKED, used=FOUR, back=()):
    """Return whether a fault is over after each consistent sample; `back` have jumped back."""
    return [fault.clears(lambda sensor: unchecked[sensor] <= DT, lambda sensor: sensor in back,
                         used, DT, RECOVERY) for _ in range(times)]


# Words --------------------------------------------------------------------------------------

@pytest.mark.parametrize(('symptom', 'words'), [
    (FROZEN, 'joint_1b frozen'), (PARITY, 'inconsistent angles, sensor undetermined'),
    (Symptom(Reason.NO_FIT), 'no orientation fits')])
def test_the_words_name_the_sensor_or_that_it_is_not_known(symptom, words):
    assert Fault(symptom, [], True).words == words


def test_a_sensor_that_alone_left_its_motion_jumped():
    """Where the symptom names no cause of its own; one that was frozen stays that."""
    assert Fault(PARITY._replace(sensor=0), [0], True, True).words == 'joint_1a jumped'
    assert Fault(FROZEN, [1], True, True).words == 'joint_1b frozen'


def test_a_sensor_that_is_isolated_later_is_named():
    fault = Fault(PARITY, [], True)
    fault.widen([], [None], 3)
    assert fault.words == 'joint_3a inconsistent angles'


def test_evidence_of_another_sensor_makes_every_sensor_a_suspect():
    fault = Fault(FROZEN, [], True)
    fault.widen([], [1])
    assert fault.symptom.sensor == 1
    fault.widen([], [1, 3])
    assert fault.words == 'frozen, sensor undetermined'


# Cleared ------------------------------------------------------------------------------------

@pytest.mark.parametrize('symptom', [PARITY, FROZEN])
def test_a_fault_is_over_after_a_time_of_consistency(symptom):
    assert clears(Fault(symptom, [], True), 8) == [False] * 7 + [True]


def test_a_bad_sample_begins_the_time_again():
    fault = Fault(FROZEN, [], True)
    for _ in range(3):
        assert not any(clears(fault, 7))
        fault.widen([], [1])
    assert clears(fault, 8)[-1]


@pytest.mark.parametrize(('sensor', 'unchecked', 'counts'), [
    (3, (0.0, 0.0, 0.0, 2.0 * DT), False), (3, (0.0, 0.0, 0.0, inf), False),
    (3, (inf, inf, inf, DT), True), (0, (inf, 0.0, 0.0, 0.0), False),
    (None, (0.0, 0.0, 0.0, inf), False), (None, (0.0, 0.0, 0.0, DT), True)])
def test_only_samples_in_which_the_others_check_the_suspects_count(sensor, unchecked, counts):
    """All sensors, where it is not known which one is faulty."""
    fault = Fault(PARITY._replace(sensor=sensor), [], True)
    assert any(clears(fault, 20, unchecked)) == counts


def test_a_sensor_that_is_left_out_is_no_suspect():
    assert any(clears(Fault(PARITY, [], False), 8, (0.0, inf, 0.0, 0.0, 0.0), [0, 2, 3, 4]))


def test_a_moment_out_of_sight_interrupts_and_does_not_begin_again():
    fault = Fault(FROZEN, [], True)
    clears(fault, 7)
    assert not any(clears(fault, 20, (0.0, inf, 0.0, 0.0)))
    assert clears(fault, 1) == [True]


# Sensors that jumped ------------------------------------------------------------------------

def test_a_fault_of_sensors_that_all_jumped_back_is_over_where_none_is_checked():
    fault = Fault(PARITY, [0, 3], True)
    assert clears(fault, 8, (inf,) * 4, back=(0, 3)) == [False] * 7 + [True]


def test_one_that_stays_where_it_jumped_has_to_be_checked():
    fault = Fault(PARITY, [3], True)
    assert not any(clears(fault, 20, (inf,) * 4))
    assert any(clears(fault, 8))


def test_a_glitch_during_another_fault_does_not_end_that_unchecked():
    """A drift was found; then another sensor jumps and jumps back."""
    fault = Fault(Symptom(Reason.DRIFTED), [], True)
    fault.widen([0], [])
    assert not any(clears(fault, 20, (inf,) * 4, back=(0,)))


def test_two_that_jumped_and_stay_wait_for_a_person():
    fault = Fault(PARITY, [0, 1], True)
    assert fault.waits
    assert fault.words == 'joint_1a and joint_1b jumped, to be acknowledged'
    assert not any(clears(fault, 100))
    fault.acknowledge()
    assert not fault.waits
    # Then what is wrong has to be checked for the recovery.
    assert not any(clears(fault, 20, (inf,) * 4))
    assert clears(fault, 8) == [False] * 7 + [True]


def test_so_do_two_that_jumped_one_after_the_other():
    fault = Fault(FROZEN, [0], True)
    fault.widen([0], [])
    assert not fault.waits
    fault.widen([3], [])
    assert fault.waits


@pytest.mark.parametrize('back', [0, 1])
def test_a_pair_of_which_one_jumped_back_needs_no_person(back):
    fault = Fault(PARITY, [0, 1], True)
    assert any(clears(fault, 8, back=(back,)))
    assert not fault.waits


def test_with_two_parities_a_pair_cannot_cancel():
    fault = Fault(PARITY, [0, 1], False)
    assert not fault.waits
    assert clears(fault, 8)[-1]
