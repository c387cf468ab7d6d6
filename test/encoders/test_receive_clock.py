# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Receive times of any interface, mapped to the Unix epoch."""

import pytest
from spm_haptic_master.encoders.receive_clock import ReceiveClock

START = 1_760_000_000.0
# s; a day apart a device has an epoch of its own. The least delay is collected for a second.
OWN_EPOCH, SPAN = 86400.0, 1.0


@pytest.mark.parametrize(('epoch', 'drift'), [(0.0, 0.0), (12.5, 50e-6), (12.5, -50e-6)])
def test_receive_times_of_a_devices_own_epoch_are_carried_over(epoch, drift):
    """The stamp never lies before the frame, and lags by no more than the least delay."""
    clock = ReceiveClock()
    worst = 0.0
    for number in range(5000):
        true = START + number * 1e-3
        received = true if not epoch else epoch + number * 1e-3 * (1.0 + drift)
        arrived = true + 1e-4 + (7e-3 if number % 100 < 5 else 0.0)
        error = abs(clock.epoch(received, arrived) - true)
        if number >= 10:  # the first have nothing to be held against
            worst = max(worst, error)
    assert worst < (1e-9 if not epoch else 2.2e-4)


def test_an_interface_without_times_gets_those_of_arrival():
    assert ReceiveClock().epoch(0.0, START) == START


@pytest.mark.parametrize('delay', [0.0, 1.0, OWN_EPOCH - 1.0, 1.0 - OWN_EPOCH])
def test_a_receive_time_near_this_clock_is_kept(delay):
    assert ReceiveClock().epoch(START - delay, START) == START - delay


def test_the_least_delay_of_this_span_and_the_one_before_counts():
    clock = ReceiveClock()

    def offset(at, delay):
        """Return how far the mapped time lies behind the device's, for a frame at `at` s."""
        return clock.epoch(10.0 + at, START + at + delay) - (START + at)

    assert offset(0.0, 0.005) == pytest.approx(0.005, abs=1e-6)
    assert offset(0.1, 0.002) == pytest.approx(0.002, abs=1e-6)
    assert offset(0.2, 0.007) == pytest.approx(0.002, abs=1e-6)
    # The next span: what the one before found still counts ...
    assert offset(SPAN + 0.1, 0.006) == pytest.approx(0.002, abs=1e-6)
    assert offset(SPAN + 0.2, 0.004) == pytest.approx(0.002, abs=1e-6)
    # ... and is forgotten in the one after.
    assert offset(2 * SPAN + 0.2, 0.009) == pytest.approx(0.004, abs=1e-6)
    assert offset(2 * SPAN + 0.3, 0.008) == pytest.approx(0.004, abs=1e-6)
    assert offset(3 * SPAN + 0.4, 0.009) == pytest.approx(0.008, abs=1e-6)


def test_a_span_ends_after_exactly_a_second():
    clock = ReceiveClock()
    for received, arrived, expected in (
            (10.0, 0.0, 0.0), (9.998, 0.0, -0.002), (10.994, SPAN, 0.994),
            (11.989, 2 * SPAN, 1.995)):
        assert clock.epoch(received, START + arrived) == pytest.approx(START + expected, abs=1e-6)


def test_an_offset_holds_up_to_a_days_difference():
    clock = ReceiveClock()
    assert clock.epoch(1_000_000.0, START) == START
    assert clock.epoch(1_000_000.0 - OWN_EPOCH, START) == START - OWN_EPOCH
    assert clock.epoch(1_000_000.0 - OWN_EPOCH - 1.0, START) == START


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_receive_time_a_day_away_is_of_another_epoch(sign):
    clock = ReceiveClock()
    assert clock.epoch(START - sign * OWN_EPOCH, START) == START


def test_a_device_that_restarts_gets_a_new_offset_at_once():
    clock = ReceiveClock()
    assert clock.epoch(200_000.0, START) == pytest.approx(START, abs=1e-6)
    assert clock.epoch(1.0, START + 0.5) == pytest.approx(START + 0.5, abs=1e-6)
    assert clock.epoch(1.1, START + 0.65) == pytest.approx(START + 0.6, abs=1e-6)


def test_a_clock_set_back_begins_a_new_span():
    clock = ReceiveClock()
    clock.epoch(100.0, START)
    back = START - 3600.0
    assert clock.epoch(101.0, back) == pytest.approx(back, abs=1e-6)
    assert clock.epoch(101.1, back + 0.3) == pytest.approx(back + 0.1, abs=1e-6)
    assert clock.epoch(102.5, back + 1.4) == pytest.approx(back + 1.4, abs=1e-6)
