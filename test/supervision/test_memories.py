# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the supervision remembers ends with what set it, and no skipped sample is forgotten."""

from types import SimpleNamespace

from device import run
import numpy as np
import pytest
from spm_haptic_master.supervision.fault import FaultLatch
from spm_haptic_master.supervision.sample_clock import SampleClock
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

SECOND = 10**9
UNDETERMINED = Symptom(Reason.INCONSISTENT, severity=Severity.LATCH)


def latched(stamp):
    """Return a latch of four sensors with a fault of an undetermined one."""
    used = SimpleNamespace(entries=1, sensors=SimpleNamespace(used=(0, 1, 2, 3)))
    sensors = SimpleNamespace(used=used, passing=lambda stamp, onset: [])
    joints = SimpleNamespace(
        left=lambda used: [],
        alone=lambda used: [],
        departure=lambda sensor: 0,
        has_returned=lambda sensor, departure: True,
    )
    latch = FaultLatch(sensors, joints, 1.0)
    latch.latch(stamp, UNDETERMINED)
    return latch


def clears(latch, stamp):
    """Return whether a consistent sample ends the fault; the others have checked no sensor."""
    return latch.clears(SimpleNamespace(has_seen=lambda sensor, since: False), stamp)


def test_an_acknowledgement_does_not_end_what_came_after_it():
    latch = latched(0)
    latch.acknowledge()
    latch.note_bad(SimpleNamespace(stamp=SECOND // 2), [UNDETERMINED])
    assert not clears(latch, SECOND)
    assert not clears(latch, 3 * SECOND)
    # A second one does end it, after the recovery.
    latch.acknowledge()
    assert clears(latch, 3 * SECOND)


def test_recovery_is_time_in_which_no_sample_is_withheld():
    latch = latched(0)
    latch.acknowledge()
    assert not clears(latch, SECOND)
    latch.note_bad(SimpleNamespace(stamp=2 * SECOND), [withheld(Reason.MISSING, '')])
    assert not clears(latch, 3 * SECOND)
    assert clears(latch, 4 * SECOND)


def test_a_clock_that_is_set_back_after_one_sample_restarts():
    clock = SampleClock()
    clock.step(1000 * SECOND)
    ticks = [clock.step(900 * SECOND + index * 1_000_000) for index in range(150)]
    assert any(tick.restarts for tick in ticks)
    assert not ticks[-1].is_old


@pytest.mark.parametrize('value', [np.nan, 1e7, 1e300])
def test_readings_of_no_size_that_an_angle_has_are_skipped_as_missing_ones(value):
    """In motion the other joints were said to have jumped, to be acknowledged, for ever."""

    def spoil(readings):
        readings[1000:1020, 1] = value

    found = run('fast', seconds=3.0, spoil=spoil)
    assert found.states[-1] == 'healthy'


def test_one_such_reading_of_six_leaves_out_its_sensor():
    def spoil(readings):
        readings[1000:, 4] = 1e7

    found = run('fast', sensors=6, seconds=2.0, spoil=spoil)
    assert found.states[-1] == 'degraded: joint_3b missing'
