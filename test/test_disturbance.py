# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A measurement that a busy machine has spoilt skips its test, once, and is counted."""

from types import SimpleNamespace

import disturbance
from disturbance import BESIDE_OTHERS, Disturbance, measure_undisturbed, number_of_skips, SKIPPED
import numpy as np
import pytest


@pytest.fixture(params=['late', 'load'])
def busy(request, monkeypatch):
    """Give a machine that is late, or that other programs use; without it, a quiet one."""
    make_machine(monkeypatch, 11_000.0 if request.param == 'late' else 1_000.0,
                 1e9 if request.param == 'load' else 0.0)


@pytest.fixture
def quiet(monkeypatch):
    make_machine(monkeypatch, 9_000.0, 0.0)


def make_machine(monkeypatch, lateness_us, ticks):
    control = SimpleNamespace(stop=lambda: np.array([0.0, lateness_us]))
    monkeypatch.setattr(disturbance, 'Control', lambda: control)
    used = iter((0.0, ticks))
    monkeypatch.setattr(disturbance, '_ticks_of_others', lambda: next(used))


def measurements(result):
    """Return a list of the measurements that were made, and what makes one more."""
    made = []

    def measure():
        made.append(result)
        return result

    return made, measure


def test_an_incomplete_measurement_of_a_busy_machine_skips_the_test(busy):
    made, measure = measurements('incomplete')
    with pytest.raises(pytest.skip.Exception, match=SKIPPED):
        measure_undisturbed(measure, lambda found: found == 'complete')
    assert made == ['incomplete']


def test_a_complete_measurement_is_returned_from_a_busy_machine(busy):
    made, measure = measurements('complete')
    assert measure_undisturbed(measure, lambda found: found == 'complete') == 'complete'


def test_an_incomplete_measurement_of_a_quiet_machine_is_evaluated(quiet):
    made, measure = measurements('incomplete')
    assert measure_undisturbed(measure, lambda found: found == 'complete') == 'incomplete'


def test_what_does_not_hold_skips_on_a_busy_machine(busy):
    with Disturbance() as machine:
        pass
    machine.expect(True)
    with pytest.raises(pytest.skip.Exception, match=SKIPPED):
        machine.expect(False, 3.0)


def test_what_does_not_hold_fails_on_a_quiet_machine(quiet):
    with Disturbance() as machine:
        pass
    machine.expect(True)
    with pytest.raises(AssertionError, match='3.0; control thread'):
        machine.expect(False, 3.0)


def test_a_test_beside_others_tolerates_more(monkeypatch):
    make_machine(monkeypatch, 90_000.0, 0.0)
    with Disturbance(BESIDE_OTHERS) as machine:
        pass
    with pytest.raises(AssertionError):
        machine.expect(False)


def test_the_skips_of_a_busy_machine_are_counted():
    reports = [SimpleNamespace(longrepr=('file', 3, f'Skipped: {reason}'))
               for reason in (f'{SKIPPED}20 ms late', 'no Chromium', f'{SKIPPED}9 % of a core')]
    assert number_of_skips(reports) == 2
    assert number_of_skips([]) == 0
