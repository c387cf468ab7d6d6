# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Receive times of any interface, mapped to the Unix epoch."""

import pytest
from spm_haptic_master.encoders.receive_clock import ReceiveClock

START = 1_760_000_000.0
# s; a day apart a device has an epoch of its own.
OWN_EPOCH = 86400.0


@pytest.mark.parametrize(('received', 'mapped'), [
    # Without times, those of arrival; near this clock, the interface's; a day away, another epoch.
    (0.0, START), *((START - delay, START - delay) for delay in (
        0.0, 1.0, OWN_EPOCH - 1.0, 1.0 - OWN_EPOCH)),
    (START - OWN_EPOCH, START), (START + OWN_EPOCH, START)])
def test_the_first_frame_decides_by_its_time(received, mapped):
    assert ReceiveClock().epoch(received, START) == mapped


@pytest.mark.parametrize('frames', [
    # The least delay of this span and the one before counts.
    ((10.0, 0.005, 0.005), (10.1, 0.102, 0.102), (10.2, 0.207, 0.202),
     (11.1, 1.106, 1.102), (11.2, 1.204, 1.202), (12.2, 2.209, 2.204), (12.3, 2.308, 2.304),
     (13.4, 3.409, 3.408)),
    # A span ends after exactly a second.
    ((10.0, 0.0, 0.0), (9.998, 0.0, -0.002), (10.994, 1.0, 0.994), (11.989, 2.0, 1.995)),
    # An offset holds up to a day's difference.
    ((1e6, 0.0, 0.0), (1e6 - OWN_EPOCH, 0.0, -OWN_EPOCH), (1e6 - OWN_EPOCH - 1.0, 0.0, 0.0)),
    # A device that restarts gets a new offset at once.
    ((200_000.0, 0.0, 0.0), (1.0, 0.5, 0.5), (1.1, 0.65, 0.6)),
    # A clock that is set back begins a new span.
    ((100.0, 0.0, 0.0), (101.0, -3600.0, -3600.0), (101.1, -3599.7, -3599.9),
     (102.5, -3598.6, -3598.6))])
def test_offsets_are_those_of_the_least_delay(frames):
    clock = ReceiveClock()
    for received, arrived, expected in frames:
        assert clock.epoch(received, START + arrived) == pytest.approx(START + expected, abs=1e-6)
