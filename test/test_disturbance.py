# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A measurement that a busy machine has spoilt skips its test, once, and is counted."""

from types import SimpleNamespace

import disturbance
from disturbance import SKIPPED
import numpy as np
import pytest
from spm_haptic_master.exceptions import SpmError


@pytest.mark.parametrize(
    ('lateness_us', 'ticks', 'limit', 'skips'),
    [
        (11_000.0, 0, disturbance.DISTURBED_LATENESS, True),
        (1_000.0, 1e9, disturbance.DISTURBED_LATENESS, True),
        (9_000.0, 0, disturbance.DISTURBED_LATENESS, False),
        (90_000.0, 0, disturbance.BESIDE_OTHERS, False),
    ],
)
def test_what_does_not_hold_fails_but_skips_where_the_machine_was_too_busy(
    monkeypatch, lateness_us, ticks, limit, skips
):
    monkeypatch.setattr(
        disturbance, 'Control', lambda: SimpleNamespace(stop=lambda: np.array([0.0, lateness_us]))
    )
    used = iter((0.0, ticks) * 2)
    monkeypatch.setattr(disturbance, '_ticks_of_others', lambda: next(used))
    fails = {
        'expected_exception': pytest.skip.Exception if skips else AssertionError,
        'match': SKIPPED if skips else '3.0; control thread',
    }
    with disturbance.Disturbance(limit) as found:
        pass
    found.expect(True)
    with pytest.raises(**fails):
        found.expect(False, 3.0)
    with pytest.raises(**fails), disturbance.Disturbance(limit):
        raise SpmError('3.0')


def test_the_skips_of_a_busy_machine_are_counted():
    reports = [
        SimpleNamespace(longrepr=('file', 3, f'Skipped: {reason}'))
        for reason in (f'{SKIPPED}20 ms late', 'no Chromium', f'{SKIPPED}9 % of a core')
    ]
    assert disturbance.number_of_skips(reports) == 2
