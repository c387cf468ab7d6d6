# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Gaps between samples, and stamps that go back: no fault is lost in them."""

from math import radians

import numpy as np
import pytest
from supervised import (
    PERIOD,
    PLACES,
    readings,
    rest,
    Run,
    supervisor,
    turning,
)


def test_a_known_fault_outlasts_a_gap():
    _, angles = readings(rest(49.3586), 2000)
    angles[1000:, 3] += radians(5.0)
    subject = supervisor()
    assert 'joint_3a' in Run(subject, angles[:1500]).states[-1]
    run = Run(subject, angles[1500:], first=1500 + 700)
    assert not run.out.any()
    assert 'joint_3a' in run.states[0]


@pytest.mark.parametrize('wrong', [1, 2])
@pytest.mark.parametrize('gap', [6, 20, 200, 700])
@pytest.mark.parametrize('place', ['singular', 'centre', 'swinging'])
def test_a_jump_that_a_gap_interrupts_does_not_come_through_after_it(place, wrong, gap):
    """Neither where no parity shows it (joint_3a at the singularity) nor anywhere else."""
    rotations, angles = readings({**PLACES, 'singular': rest(49.3586)}[place], 600)
    angles[300 - wrong:, 3] += radians(1.0)
    subject = supervisor()
    before = Run(subject, angles[:300], rotations[:300])
    assert before.out[5:300 - wrong].all()
    # The platform waits meanwhile: what is measured is the same.
    run = Run(subject, angles[300:], rotations[300:], first=300 + gap)
    assert not run.out[0 if place == 'singular' else 20:].any()


@pytest.mark.parametrize('gap', [None, 10])
@pytest.mark.parametrize('degraded', [False, True])
def test_a_second_sensor_that_goes_wrong_during_a_fault_is_not_forgotten(gap, degraded):
    """joint_1a comes back; joint_3a, which no other sensor can check here, slipped meanwhile."""
    _, angles = readings(rest(49.3586), 2600)
    angles[1000:1050, 0] += radians(2.0)
    angles[1020:, 3] += radians(1.0)
    subject = supervisor(degraded=degraded)
    Run(subject, angles[:1021])
    run = Run(subject, angles[1021:], first=1021 + (gap or 0))
    assert not run.out[2:].any()
    assert run.states[-1].startswith('silent: ')


def test_a_step_before_a_gap_is_not_forgotten():
    _, angles = readings(rest(49.3586), 1000)
    angles[501:, 3] += radians(2.0)
    subject = supervisor()
    Run(subject, angles[:500])
    Run(subject, angles[500:502], first=506)
    assert not Run(subject, angles[502:], first=520).out[2:].any()


def test_a_stuck_value_in_bursts_half_a_second_apart_stays_silent():
    rotations, angles = readings(turning(2.0, 0.5, 49.3586), 20_000)
    angles[2000:, 3] = angles[2000, 3]
    subject = supervisor()
    Run(subject, angles[:2020], rotations[:2020])
    out = []
    for start in range(2600, 19_000, 600):
        burst = slice(start, start + 12)
        out.append(Run(subject, angles[burst], rotations[burst], first=start).out.any())
    assert not any(out)


def test_a_stuck_value_that_gaps_interrupt_stays_silent():
    """Every 17th millisecond samples go on after 7 without one; the noise is known by then."""
    _, slow = readings(rest(49.3586), 1200)
    _, angles = readings(turning(2.0, 0.5, 49.3586), 2000)
    angles = np.vstack([slow, angles])
    angles[1300:, 3] = angles[1300, 3]
    subject, out = supervisor(), []
    for index in range(3200):
        if index > 1300 and index % 17 < 7:
            continue
        verdict = subject.take(index * PERIOD, tuple(angles[index].tolist()))
        if verdict.estimate is not None:
            out.append(index)
    assert set(range(5, 1300)) <= set(out)
    # Twenty equal readings with their gaps.
    assert max(out) <= 1340
    assert 'joint_3a frozen' in verdict.text


@pytest.mark.parametrize('gap', [200, 450, 2000])
def test_after_a_gap_jumps_are_detected_as_before(gap):
    _, angles = readings(rest(49.3586), 1000)
    angles[530:, 3] += radians(1.0)
    subject = supervisor()
    Run(subject, angles[:500])
    run = Run(subject, angles[500:], first=500 + gap)
    assert run.out[5:30].all()
    assert not run.out[30:].any()
    assert 'joint_3a jumped' in run.states[-1]


def test_after_a_gap_it_restarts():
    subject = supervisor()
    _, angles = readings(rest(20.0), 100)
    assert Run(subject, angles).out[-1]
    # Another pose after a second: no jump, but consistency has to be shown again.
    _, angles = readings(rest(40.0), 100)
    run = Run(subject, angles, first=1100)
    assert run.reasons[:4] == ['starting'] * 4
    assert run.out[4:].all()


def test_a_clock_that_was_set_back_is_followed():
    _, angles = readings(rest(20.0), 1000)
    subject = supervisor()
    Run(subject, angles[:500], first=10_000)
    run = Run(subject, angles[500:], first=0)
    assert not run.out[:100].any()
    assert run.out[105:].all()
