# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A SYNC of another rate is reported; one that is late or lost on a busy machine is not."""

import numpy as np
import pytest
from spm_haptic_master.encoders.frame_checks import recent, SyncRate


def heard(stamps, rate=1000.0):
    found = SyncRate(1.0 / rate)
    for stamp in stamps:
        found.heard(stamp)
    return found


@pytest.mark.parametrize('bus', [100.0, 200.0, 500.0, 2000.0, 30.0])
def test_another_rate_is_reported_with_the_cure(bus):
    found = heard(np.arange(0.0, 3.0, 1.0 / bus))
    assert found.measured == pytest.approx(bus, rel=0.02)
    assert found.text() == (f'SYNC comes at {bus:.0f} Hz, rate is 1000 Hz: give rate, as it is on '
                            'the bus, to all nodes (can_scan prints it)')


def test_the_configured_rate_is_not_reported_on_a_busy_machine():
    rng = np.random.default_rng(5)
    stamps = np.arange(0.0, 5.0, 1e-3)
    assert heard(stamps).text() is None
    # Two of three are lost, or late by up to two periods.
    assert heard(stamps[rng.random(len(stamps)) < 1.0 / 3.0]).text() is None
    assert heard(np.sort(stamps + rng.uniform(0.0, 2e-3, len(stamps)))).text() is None


def test_the_report_ends_with_its_cause_and_a_gap_is_no_rate():
    assert heard([*np.arange(0.0, 2.0, 5e-3), *np.arange(2.0, 4.0, 1e-3)]).text() is None
    assert heard([0.0, 0.001, 3.0, 3.001, 9.0, *np.arange(7.0, 9.0, 1e-3)]).text() is None
    assert heard([], 200.0).text() is None


@pytest.mark.parametrize(('when', 'expected'), [
    (None, False), (64.0, True), (63.51, True), (63.5, False), (64.49, True), (64.5, False)])
def test_recent_is_within_the_span_on_either_side(when, expected):
    assert recent(when, 64.0, 0.5) == expected
