# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Gaps between samples, and stamps that go back: no fault is lost in them."""

from device import every, offset, paused, run, stuck
import numpy as np
import pytest
from rig import few


@pytest.mark.parametrize(
    ('place', 'gap', 'wrong'),
    few(
        ['singular', 'rest', 'sweep'],
        [6, 20, 200, 700],
        [1, 2],
        count=6,
    ),
)
def test_a_jump_that_a_gap_interrupts_does_not_come_through_after_it(place, gap, wrong):
    """Neither where no parity shows it (joint_3a at the singularity) nor anywhere else."""
    # The platform waits meanwhile: what is measured is the same.
    outcome = run(
        place,
        seconds=0.4,
        change=offset(200 - wrong, 3, 1.0),
        times=paused(400, (200, gap)),
    )
    assert outcome.published[5 : 200 - wrong].all()
    assert not outcome.published[200 if place == 'singular' else 220 :].any()


@pytest.mark.parametrize('missing', [1, 3, 5])
def test_a_step_behind_a_gap_is_seen_at_the_singularity(missing):
    """One lost sample let a step of 1 deg pass, five one of 2 deg."""
    keep = np.ones(800, bool)
    keep[400 - missing : 400] = False
    outcome = run(
        'singular',
        seconds=0.8,
        change=offset(400, 3, 2.0),
        keep=keep,
    )
    assert np.nanmax(outcome.error) < 0.25
    assert 'joint_3a jumped' in outcome.states[-1]


@pytest.mark.parametrize(('gap', 'degraded'), few([0, 10], ['allow', 'stop']))
def test_a_second_sensor_that_goes_wrong_during_a_fault_is_not_forgotten(gap, degraded):
    """joint_1a comes back; joint_3a, which no other sensor can check here, slipped meanwhile."""
    outcome = run(
        'singular',
        seconds=1.8,
        degraded=degraded,
        times=paused(1800, (321, gap)),
        change=every(offset(300, 0, 2.0, 350), offset(320, 3, 1.0)),
    )
    assert not outcome.published[323:].any()
    assert outcome.states[-1].startswith('silent: ')


def test_a_stuck_value_that_gaps_interrupt_stays_silent():
    """Every 17th millisecond samples go on after 7 without one; the noise is known by then."""
    index = np.arange(2000)
    keep = (index <= 1300) | (index % 17 >= 7)
    outcome = run('taught singular', spoil=stuck(1300, 3), keep=keep)
    assert outcome.published[5:1300].all()
    # Twenty equal readings with their gaps.
    assert not outcome.published[index[keep] > 1340].any()
    assert 'joint_3a frozen' in outcome.states[-1]


def test_a_known_fault_outlasts_a_gap():
    outcome = run(
        'singular',
        seconds=0.5,
        change=offset(200, 3, 5.0),
        times=paused(500, (300, 700)),
    )
    assert not outcome.published[200:].any()
    assert outcome.states[-1] == 'silent: joint_3a jumped'
