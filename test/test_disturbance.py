# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A measurement that a busy machine has spoilt skips its test, once, and is counted."""

from types import SimpleNamespace

import disturbance
from disturbance import (
    BESIDE_OTHERS,
    Disturbance,
    DISTURBED_LATENESS,
    measure_undisturbed,
    number_of_skips,
    SKIPPED,
)
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


@pytest.mark.parametrize(('busy', 'limit', 'skips'), [
    ({'lateness_us': 11_000.0}, DISTURBED_LATENESS, True),
    ({'ticks': 1e9}, DISTURBED_LATENESS, True),
    ({'lateness_us': 9_000.0}, DISTURBED_LATENESS, False),
    ({'lateness_us': 90_000.0}, BESIDE_OTHERS, False)])
def test_what_does_not_hold_fails_but_skips_where_the_machine_was_too_busy(
        machine, busy, limit, skips):
    machine(**busy)
    with Disturbance(limit) as found:
        pass
    found.expect(True)
    with pytest.raises(pytest.skip.Exception if skips else AssertionError,
                       match=SKIPPED if skips else '3.0; control thread'):
        found.expect(False, 3.0)
    made = iter([1, 2])
    if skips:
        with pytest.raises(pytest.skip.Exception, match=SKIPPED):
            measure_undisturbed(lambda: next(made), lambda result: False)
        assert next(made) == 2  # it is not repeated


def test_the_skips_of_a_busy_machine_are_counted():
    reports = [SimpleNamespace(longrepr=('file', 3, f'Skipped: {reason}'))
               for reason in (f'{SKIPPED}20 ms late', 'no Chromium', f'{SKIPPED}9 % of a core')]
    assert number_of_skips(reports) == 2
