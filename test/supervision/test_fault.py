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
CHECKED, UNCHECKED = (0.0,) * 4, (inf,) * 4
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


def cleared_after(fault, unchecked=CHECKED, back=()):
    """Return after how many consistent samples a fault is over, None if never."""
    fault.back = back
    for count in range(1, 100):
        if fault.clears(lambda sensor: unchecked[sensor] <= DT, DT):
            return count
    return None


@pytest.mark.parametrize(('symptom', 'words'), [
    (FROZEN, 'joint_1b frozen'), (PARITY, 'inconsistent angles, sensor undetermined'),
    (Symptom(Reason.NO_FIT), 'no orientation fits')])
def test_the_words_name_the_sensor_or_that_it_is_not_known(symptom, words):
    fault = Latched(symptom)
    assert fault.words == words
    fault.further([], [1])
    assert fault.words == words
    # Evidence of another sensor makes every sensor a suspect, until one is isolated.
    fault.further([], [1, 3])
    assert fault.symptom.sensor is None
    fault.further([], [None], 3)
    assert fault.words == f'joint_3a {symptom.reason.value}'


def test_a_fault_is_over_after_a_time_of_consistency_that_a_bad_sample_begins_again():
    fault = Latched(FROZEN)
    for _ in range(3):
        assert not any(fault.clears(lambda sensor: True, DT) for _ in range(7))
        fault.further([], [1])
    # A moment out of sight interrupts it, and does not begin it again.
    assert not any(fault.clears(lambda sensor: True, DT) for _ in range(7))
    assert cleared_after(fault, (0.0, inf, 0.0, 0.0)) is None
    assert cleared_after(fault) == 1


@pytest.mark.parametrize(('sensor', 'jumped', 'unchecked', 'back', 'count'), [
    # Samples count while the others check the faulty sensor, or all where none is isolated.
    (3, [], (0.0, 0.0, 0.0, inf), (), None), (3, [], (inf, inf, inf, DT), (), 8),
    (None, [], (0.0, 0.0, 0.0, inf), (), None), (None, [], (0.0, 0.0, 0.0, DT), (), 8),
    # A fault of sensors that all jumped back is over where none is checked.
    (None, [0, 3], UNCHECKED, (0, 3), 8), (None, [3], UNCHECKED, (), None),
    # Of two that stay, one may hide the other: a person has to clear that.
    (None, [0, 1], CHECKED, (), None), (None, [0, 1], CHECKED, (1,), 8)])
def test_what_clears_a_fault(sensor, jumped, unchecked, back, count):
    fault = Latched(PARITY._replace(sensor=sensor), jumped)
    assert cleared_after(fault, unchecked, back) == count


def test_with_two_parities_a_pair_cannot_cancel_and_a_sensor_left_out_is_no_suspect():
    assert cleared_after(Latched(PARITY, [0, 1], entries=2)) == 8
    left_out = Latched(PARITY, entries=2, used=[0, 2, 3, 4])
    assert cleared_after(left_out, (0.0, inf, 0.0, 0.0, 0.0)) == 8


def test_a_glitch_during_another_fault_does_not_end_that_unchecked():
    fault = Latched(Symptom(Reason.DRIFTED))
    fault.further([0], [])
    assert cleared_after(fault, UNCHECKED, back=(0,)) is None


def test_two_that_jumped_and_stay_wait_for_a_person():
    fault = Latched(PARITY, [0])
    fault.further([0], [])
    assert not fault.waits and not fault.acknowledge()
    fault.further([1], [])
    assert fault.waits
    assert fault.words == 'joint_1a and joint_1b jumped, to be acknowledged'
    assert cleared_after(fault) is None
    assert fault.acknowledge() and not fault.waits
    # Then what is wrong has to be checked for the recovery.
    assert cleared_after(fault, UNCHECKED) is None
    assert cleared_after(fault) == 8
