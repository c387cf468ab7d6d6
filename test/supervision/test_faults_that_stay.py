# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What must not end a fault or hide it: other faults, gaps, glitches, a first good sample."""

from math import nan

from device import every, offset, paused, run
import numpy as np
import pytest
from rig import Rig

# Sample at which a fault begins, and samples after which it has to be silent or without it.
BEGIN = 100
ALERT = 20


def test_a_latched_fault_is_not_hidden_by_a_missing_angle():
    rig = Rig()
    rig.samples(30, th1b=5.0)
    assert rig.state == 'silent: joint_1b jumped'
    rig.samples(30, th1a=nan, th1b=5.0)
    assert rig.state == 'silent: joint_1b jumped'


@pytest.mark.parametrize(
    ('samples', 'size'),
    [
        (100, 1.0),
        (100, 20.0),
        (20, 5.0),
    ],
)
def test_a_second_sensor_that_jumps_is_silence(samples, size):
    rig = Rig(degraded='allow')
    rig.samples(samples, th1b=5.0)
    assert rig.state == 'degraded: joint_1b excluded'
    assert rig.errors(100, th1b=5.0, th3a=size)[1:] == []


def test_an_orientation_faster_than_a_human_does_not_continue_the_motion():
    assert (
        'orientation does not continue the motion' in run('fast', joint_speed=1.0).result.reasons
    )


def test_a_fault_is_cleared_only_after_a_time_of_consistency():
    outcome = run('resting', change=offset(600, 1, 2.0, 900), recovery=0.5)
    assert not outcome.published[600:1400].any()
    assert outcome.published[1450:].all()
    assert outcome.states[-1] == 'healthy'


@pytest.mark.parametrize('gap', [200, 450, 2000])
def test_after_a_gap_jumps_are_detected_as_before(gap):
    times = paused(1000, (500, gap))
    outcome = run(
        'singular',
        seconds=1.0,
        change=offset(530, 3, 1.0),
        times=times,
    )
    assert outcome.published[505:530].all()
    assert not outcome.published[530:].any()
    assert 'joint_3a jumped' in outcome.states[-1]


def test_after_a_restart_no_sensor_is_checked_and_the_level_falls_as_the_window_fills():
    rig = Rig(alert_limit_deg=2.0)
    rig.samples(100)
    before = rig.verdict.protection_level
    rig.sample(after=600)
    assert rig.state == 'starting'
    assert min(rig.supervisor.unchecked()) >= 0.6
    levels = [rig.sample().protection_level for _ in range(100)]
    # Of the sensors without a rival: th1C and th3A have one again until the device has turned.
    assert levels[4] > 1.04 * levels[-1]
    assert levels[-1] < before


@pytest.mark.parametrize('sensors', [4, 6])
def test_while_each_twelfth_sample_is_a_spike_the_state_is_not_healthy(sensors):
    def spikes(readings):
        readings[100:500:12, 1] += np.radians(5.0)

    found = run('turning', sensors, 0.7, spoil=spikes)
    assert any(text.startswith('degraded: ') for text in found.states)
    assert found.published[100:].mean() > 0.9
    assert found.within_level


@pytest.mark.parametrize(
    ('bad', 'of'),
    [
        (1, 9),
        (2, 4),
        (2, 11),
    ],
)
def test_a_sensor_with_spikes_that_return_is_excluded(bad, of):
    def spikes(readings):
        index = np.arange(len(readings))
        readings[(index >= BEGIN) & (index % of < bad), 0] += np.radians(5.0)

    found = run('rest', 6, 0.4, change=spikes)
    assert found.states[-1] == 'degraded: joint_1a excluded'
    assert found.longest_silence() <= 3 * ALERT
    assert found.published[BEGIN + 200 :].all()
    assert found.within_level


def test_a_glitch_of_another_sensor_does_not_end_six_without_a_faulty_one():
    fault = offset(BEGIN, 0, 3.0)
    glitches = every(fault, offset(400, 5, 4.0, 403), offset(500, 3, 4.0, 503))
    found = run('sweep', 6, 1.6, recovery=0.3, spoil=glitches)
    # Within the recovery and half a second.
    assert found.published[1200:].all()
    assert found.states[-1] == 'degraded: joint_1a excluded'


def test_several_sensors_are_named_in_their_order():
    rig = Rig(6, alert_limit_deg=5.0)
    rig.samples(3, th3c=nan, th1c=nan)
    assert rig.state == 'degraded: joint_1c missing, joint_3c missing'
