# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The two tests of the parity: a single sample, and a window."""

import numpy as np
import pytest
from spm_haptic_master.supervision.parity_monitor import ParityMonitor

LIMIT = 6.9


@pytest.mark.parametrize('parity', [LIMIT, -LIMIT, 0.0])
def test_a_parity_up_to_the_limit_is_healthy(parity):
    assert ParityMonitor(LIMIT).evaluate(parity) == []


@pytest.mark.parametrize('parity', [6.91, -6.91, np.nan, np.inf])
def test_a_parity_beyond_the_limit_is_a_symptom_of_no_sensor_yet(parity):
    symptom, = ParityMonitor(LIMIT).evaluate(parity)
    assert symptom.text == 'inconsistent angles, sensor undetermined'
    assert symptom.detail == f'parity {parity:.1f} sigma, limit 6.9'
    assert not symptom.fault
    assert not symptom.self_timed


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_small_parities_add_up_to_a_fault(sign):
    """Of n parities p the normalised sum is p sqrt(n): 2.4 passes after 9 samples."""
    monitor = ParityMonitor(LIMIT)
    symptoms = [monitor.evaluate(2.4 * sign) for _ in range(9)]
    assert symptoms[:8] == [[]] * 8
    symptom, = symptoms[8]
    assert symptom.text == 'angles drifted apart, sensor undetermined'
    assert symptom.detail == f'parity of 9 samples {7.2 * sign:.1f} sigma, limit 6.9'
    assert symptom.fault
    assert not symptom.self_timed


def test_the_window_has_twenty_samples():
    """1.52 sqrt(20) = 6.80 stays below the limit for ever, 1.55 sqrt(20) = 6.93 does not."""
    monitor = ParityMonitor(LIMIT)
    assert not any(monitor.evaluate(1.52) for _ in range(100))
    assert any(monitor.evaluate(1.55) for _ in range(20))


def test_the_window_is_tested_from_five_samples_on():
    monitor = ParityMonitor(LIMIT)
    assert not any(monitor.evaluate(6.0) for _ in range(4))
    assert monitor.evaluate(6.0)


def test_a_window_at_the_limit_is_healthy():
    monitor = ParityMonitor(6.0)
    assert not any(monitor.evaluate(2.0) for _ in range(9))
    assert monitor.evaluate(2.0)


def test_a_bad_sample_does_not_enter_the_window():
    monitor = ParityMonitor(LIMIT)
    for _ in range(10):
        monitor.evaluate(0.0)
    assert monitor.evaluate(1000.0)
    assert monitor.evaluate(0.0) == []


def test_restart_empties_the_window():
    monitor = ParityMonitor(LIMIT)
    for _ in range(8):
        monitor.evaluate(2.4)
    monitor.restart()
    assert not any(monitor.evaluate(2.4) for _ in range(8))
    assert monitor.evaluate(2.4)
