# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A latched fault: its words, what widens it, and when it is over."""

from math import inf
from types import SimpleNamespace

import pytest
from spm_haptic_master.supervision.fault import FaultLatch
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

DT = 2.0 ** -10
RECOVERY = 8 * DT
CHECKED = (0.0,) * 4
PARITY = Symptom(Reason.INCONSISTENT, 'parity 8')
FROZEN = Symptom(Reason.FROZEN, '30 equal readings', 1, Severity.LATCH)


class Latched(FaultLatch):
    """A fault, and the joints that have jumped back since."""

    def __init__(self, symptom, jumped=(), entries=1, used=range(4)):
        self.back = ()
        super().__init__(
            SimpleNamespace(used=SimpleNamespace(
                entries=entries, sensors=SimpleNamespace(used=used))),
            SimpleNamespace(returned=lambda sensor: sensor in self.back), RECOVERY)
        self.latch(symptom, jumped)

    def further(self, jumped, named, sensor=None):
        """Add a further bad sample."""
        self.widen(self.symptom, jumped, named, sensor)


def clears(fault, times, unchecked=CHECKED, back=()):
    """Return whether a fault is over after each consistent sample; `back` have jumped back."""
    fault.back = back
    return [fault.clears(lambda sensor: unchecked[sensor] <= DT, DT) for _ in range(times)]


# Words --------------------------------------------------------------------------------------

@pytest.mark.parametrize(('symptom', 'words'), [
    (FROZEN, 'joint_1b frozen'), (PARITY, 'inconsistent angles, sensor undetermined'),
    (Symptom(Reason.NO_FIT), 'no orientation fits')])
def test_the_words_name_the_sensor_or_that_it_is_not_known(symptom, words):
    assert Latched(symptom).words == words


def test_a_sensor_that_is_isolated_later_is_named():
    fault = Latched(PARITY)
    fault.further([], [None], 3)
    assert fault.words == 'joint_3a inconsistent angles'


def test_evidence_of_another_sensor_makes_every_sensor_a_suspect():
    fault = Latched(FROZEN)
    fault.further([], [1])
    assert fault.symptom.sensor == 1
    fault.further([], [1, 3])
    assert fault.words == 'frozen, sensor undetermined'


# Cleared ------------------------------------------------------------------------------------

@pytest.mark.parametrize('symptom', [PARITY, FROZEN])
def test_a_fault_is_over_after_a_time_of_consistency(symptom):
    assert clears(Latched(symptom), 8) == [False] * 7 + [True]


def test_a_bad_sample_begins_the_time_again():
    fault = Latched(FROZEN)
    for _ in range(3):
        assert not any(clears(fault, 7))
        fault.further([], [1])
    assert clears(fault, 8)[-1]


@pytest.mark.parametrize(('sensor', 'unchecked', 'counts'), [
    (3, (0.0, 0.0, 0.0, 2.0 * DT), False), (3, (0.0, 0.0, 0.0, inf), False),
    (3, (inf, inf, inf, DT), True), (0, (inf, 0.0, 0.0, 0.0), False),
    (None, (0.0, 0.0, 0.0, inf), False), (None, (0.0, 0.0, 0.0, DT), True)])
def test_only_samples_in_which_the_others_check_the_suspects_count(sensor, unchecked, counts):
    """All sensors, where it is not known which one is faulty."""
    fault = Latched(PARITY._replace(sensor=sensor))
    assert any(clears(fault, 20, unchecked)) == counts


def test_a_sensor_that_is_left_out_is_no_suspect():
    fault = Latched(PARITY, entries=2, used=[0, 2, 3, 4])
    assert any(clears(fault, 8, (0.0, inf, 0.0, 0.0, 0.0)))


def test_a_moment_out_of_sight_interrupts_and_does_not_begin_again():
    fault = Latched(FROZEN)
    clears(fault, 7)
    assert not any(clears(fault, 20, (0.0, inf, 0.0, 0.0)))
    assert clears(fault, 1) == [True]


# Sensors that jumped ------------------------------------------------------------------------

def test_a_fault_of_sensors_that_all_jumped_back_is_over_where_none_is_checked():
    fault = Latched(PARITY, [0, 3])
    assert clears(fault, 8, (inf,) * 4, back=(0, 3)) == [False] * 7 + [True]


def test_one_that_stays_where_it_jumped_has_to_be_checked():
    fault = Latched(PARITY, [3])
    assert not any(clears(fault, 20, (inf,) * 4))
    assert any(clears(fault, 8))


def test_a_glitch_during_another_fault_does_not_end_that_unchecked():
    """A drift was found; then another sensor jumps and jumps back."""
    fault = Latched(Symptom(Reason.DRIFTED))
    fault.further([0], [])
    assert not any(clears(fault, 20, (inf,) * 4, back=(0,)))


def test_two_that_jumped_and_stay_wait_for_a_person():
    fault = Latched(PARITY, [0, 1])
    assert fault.waits
    assert fault.words == 'joint_1a and joint_1b jumped, to be acknowledged'
    assert not any(clears(fault, 100))
    fault.acknowledge()
    assert not fault.waits
    # Then what is wrong has to be checked for the recovery.
    assert not any(clears(fault, 20, (inf,) * 4))
    assert clears(fault, 8) == [False] * 7 + [True]


def test_so_do_two_that_jumped_one_after_the_other():
    fault = Latched(FROZEN, [0])
    fault.further([0], [])
    assert not fault.waits
    fault.further([3], [])
    assert fault.waits


@pytest.mark.parametrize('back', [0, 1])
def test_a_pair_of_which_one_jumped_back_needs_no_person(back):
    fault = Latched(PARITY, [0, 1])
    assert any(clears(fault, 8, back=(back,)))
    assert not fault.waits


def test_with_two_parities_a_pair_cannot_cancel():
    fault = Latched(PARITY, [0, 1], entries=2)
    assert not fault.waits
    assert clears(fault, 8)[-1]
