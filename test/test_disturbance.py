# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A measurement that a busy machine has spoilt skips its test, once, and is counted."""

from types import SimpleNamespace

import disturbance
from disturbance import BESIDE_OTHERS, Disturbance, measure_undisturbed, number_of_skips, SKIPPED
import numpy as np
import pytest


@pytest.fixture
def machine(monkeypatch):
    """Return a function that makes a machine whose threads are late (us), with other programs."""
    def machine(lateness_us=1_000.0, ticks=0.0):
        control = SimpleNamespace(stop=lambda: np.array([0.0, lateness_us]))
        monkeypatch.setattr(disturbance, 'Control', lambda: control)
        used = iter((0.0, ticks) * 2)
        monkeypatch.setattr(disturbance, '_ticks_of_others', lambda: next(used))
    return machine


def measured(limit=disturbance.DISTURBED_LATENESS):
    with Disturbance(limit) as found:
        pass
    return found


@pytest.mark.parametrize('busy', [{'lateness_us': 11_000.0}, {'ticks': 1e9}])
def test_what_a_busy_machine_has_spoilt_skips_the_test(machine, busy):
    machine(**busy)
    found = measured()
    found.expect(True)
    with pytest.raises(pytest.skip.Exception, match=SKIPPED):
        found.expect(False, 3.0)
    made = iter([1, 2])
    with pytest.raises(pytest.skip.Exception, match=SKIPPED):
        measure_undisturbed(lambda: next(made), lambda result: False)
    assert next(made) == 2  # it is not repeated
    machine(**busy)
    assert measure_undisturbed(lambda: 7, lambda result: True) == 7


@pytest.mark.parametrize(('lateness_us', 'limit'), [
    (9_000.0, disturbance.DISTURBED_LATENESS), (90_000.0, BESIDE_OTHERS)])
def test_what_does_not_hold_fails_on_a_quiet_machine(machine, lateness_us, limit):
    machine(lateness_us)
    with pytest.raises(AssertionError, match='3.0; control thread'):
        measured(limit).expect(False, 3.0)
    machine()
    assert measure_undisturbed(lambda: 7, lambda result: False) == 7


def test_the_skips_of_a_busy_machine_are_counted():
    reports = [SimpleNamespace(longrepr=('file', 3, f'Skipped: {reason}'))
               for reason in (f'{SKIPPED}20 ms late', 'no Chromium', f'{SKIPPED}9 % of a core')]
    assert number_of_skips(reports) == 2
