# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Faults of one sensor: when they are detected, in which sensor, and what was published before."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.joints import JOINT_NAMES
from supervised import (
    CENTRE,
    PERIOD,
    PLACES,
    readings,
    rest,
    Run,
    supervisor,
    swinging,
    turning,
)


@pytest.mark.parametrize('index', [0, 1, 2])
@pytest.mark.parametrize('sensor', [0, 3])
@pytest.mark.parametrize('gap', [0, 700])
def test_a_first_reading_that_is_wrong_does_not_silence_for_good(index, sensor, gap):
    _, angles = readings(rest(20.0), 600)
    subject = supervisor()
    if gap:
        Run(subject, angles)
    angles[index, sensor] += radians(5.0)
    run = Run(subject, angles, first=600 + gap if gap else 0)
    assert not run.out[:index + 1].any()
    assert run.out[30:].all()
    assert run.states[-1] == 'healthy'


@pytest.mark.parametrize('speed', [pytest.param(30.0, marks=pytest.mark.evidence), 150.0])
def test_classic_never_follows_the_wrong_mode(speed):
    count = int(40.0 / speed * 1000.0)
    rotations, angles = readings(
        lambda t: np.broadcast_arrays(135.0 + 0.0 * t, CENTRE, 30.0 + speed * t), count)
    run = Run(supervisor('classic', alert_limit=radians(5.0)), angles, rotations)
    assert run.out[5:100].all()
    assert not run.out.all()
    assert np.all(run.error[run.out] < run.level[run.out])
    # By default its level ends it at phi 33 deg.
    usual = Run(supervisor('classic'), angles, rotations)
    assert usual.out[5:30].all()
    assert usual.out.sum() < run.out.sum()


@pytest.mark.parametrize('place', PLACES)
def test_theta3a_is_published_as_the_paper_has_it(place):
    """Its distance from the estimate is in the parts of the level, and withholds nothing else."""
    rotations, angles = readings(PLACES[place], 2000)
    run = Run(supervisor('theta3a'), angles, rotations)
    assert run.out[4:].all()
    assert np.all(run.error[4:] < run.level[4:])
    assert np.all(run.error[4:] < radians(0.6))


def test_starting_takes_consistent_samples():
    _, angles = readings(rest(20.0), 20)
    run = Run(supervisor(start_samples=5), angles)
    assert run.reasons[:5] == ['starting'] * 4 + [None]
    assert run.out[4:].all()
    angles[2, 1] += radians(5.0)
    run = Run(supervisor(start_samples=5), angles)
    assert np.flatnonzero(run.out)[0] == 7


@pytest.mark.parametrize('place', PLACES)
@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
@pytest.mark.parametrize('step', [1.0, -1.0, 3.0, 30.0])
def test_a_step_is_detected_and_a_large_one_at_once_and_named(place, sensor, step):
    rotations, angles = readings(PLACES[place], 350, seed=sensor)
    angles[200:, sensor] += radians(step)
    run = Run(supervisor(), angles, rotations)
    assert run.out[5:200].all()
    assert run.covered(sensor)
    if abs(step) > 1.0:
        assert not run.out[202:].any()
        assert JOINT_NAMES[sensor] in run.states[-1]


@pytest.mark.parametrize('sensor', range(3), ids=JOINT_NAMES[:3])
def test_a_small_offset_that_creeps_in_is_detected_but_not_named(sensor):
    rotations, angles = readings(resting(20.0), 2500, seed=sensor)
    # 1 deg/s: no jump, and within the human motion limit.
    angles[1000:2000, sensor] += radians(1.0) * np.arange(1000) * PERIOD * 1e-9
    angles[2000:, sensor] += radians(1.0)
    run = Run(supervisor(), angles, rotations)
    seen = np.flatnonzero(~run.out[5:])[0] + 5
    assert 1000 < seen < 1500
    assert not run.out[seen:].any()
    assert 'sensor undetermined' in run.states[-1]
    assert np.all(run.unchecked[1000:seen] == 0.0)
    assert np.all(run.error[1000:seen] < run.level[1000:seen])


def resting(phi):
    """Return a motion that turns to and fro once, which confirms the solution, and rests."""
    return lambda t: np.broadcast_arrays(
        135.0 + 0.0 * t, CENTRE, phi + 8.0 * np.sin(np.pi * np.minimum(t / 0.4, 1.0)))


def after_rest(phi):
    """Return a motion that turns to and fro after 1.2 s of rest, which teach the noise."""
    return lambda t: np.broadcast_arrays(
        135.0 + 0.0 * t, CENTRE, phi + 6.0 * np.sin(np.pi * np.maximum(t - 1.2, 0.0)))


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_a_value_stuck_while_moving_is_named(sensor):
    rotations, angles = readings(after_rest(20.0), 2500, seed=sensor)
    angles[1500:, sensor] = angles[1500, sensor]
    run = Run(supervisor(), angles, rotations)
    assert run.out[5:1500].all()
    seen = np.flatnonzero(~run.out[1500:])[0] + 1500
    assert seen <= 1520
    assert not run.out[seen:].any()
    assert JOINT_NAMES[sensor] in run.states[1600]
    assert np.all(run.error[1500:seen] < run.level[1500:seen])


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_a_value_stuck_before_its_noise_is_known_is_detected_by_the_others(sensor):
    rotations, angles = readings(PLACES['turning'], 2000, seed=sensor)
    angles[1000:, sensor] = angles[1000, sensor]
    run = Run(supervisor(), angles, rotations)
    assert run.out[5:1000].all()
    assert not run.out[1060:].any()
    assert run.covered(sensor)
    # And wrong by less than the alert limit until then.
    assert np.nanmax(run.error[1000:]) < radians(0.5)


def test_th3a_stuck_at_the_singularity_is_named_though_no_parity_shows_it():
    rotations, angles = readings(after_rest(49.3586), 4000)
    angles[1500:, 3] = angles[1500, 3]
    run = Run(supervisor(), angles, rotations)
    assert run.out[5:1500].all()
    assert not run.out[1520:].any()
    assert 'joint_3a frozen' in run.states[-1]


def test_th3a_stuck_there_before_its_noise_is_known_is_declared_unchecked():
    rotations, angles = readings(turning(2.0, 0.5, 49.3586), 3000)
    angles[1000:, 3] = angles[1000, 3]
    run = Run(supervisor(), angles, rotations)
    assert np.all(run.unchecked[:, 3] > 0.0)


@pytest.mark.parametrize('place', ['centre', 'edge', 'swinging'])
@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
@pytest.mark.parametrize('step', [0.3, 0.5, 0.8])
@pytest.mark.parametrize('seeds', [
    pytest.param(range(2), id='few'),
    pytest.param(range(2, 5), id='more', marks=pytest.mark.evidence)])
def test_after_its_detection_a_smaller_step_never_comes_through(place, sensor, step, seeds):
    for seed in seeds:
        rotations, angles = readings(PLACES[place], 400, seed=seed)
        angles[150:, sensor] += radians(step)
        run = Run(supervisor(), angles, rotations)
        detected = np.flatnonzero(~run.out[150:])
        if len(detected):
            late = slice(150 + detected[0], None)
            assert not np.any(run.error[late] > run.level[late])
        else:
            assert not np.any(run.error[150:] > run.level[150:])


def test_a_fault_is_cleared_only_after_a_time_of_consistency():
    _, angles = readings(resting(20.0), 4000)
    angles[1000:1500, 1] += radians(2.0)
    run = Run(supervisor(recovery=1.0), angles)
    assert not run.out[1000:2500].any()
    back = np.flatnonzero(run.out[1000:])[0] + 1000
    # The recovery time, after the window in which the others check it.
    assert 2500 + 18 <= back <= 2500 + 22
    assert run.out[back:].all()
    assert run.states[-1] == 'healthy'


def test_a_fault_that_the_parity_cannot_show_is_not_cleared():
    _, angles = readings(rest(49.3586), 4000)
    angles[1000:, 3] += radians(2.0)
    run = Run(supervisor(recovery=0.5), angles)
    assert not run.out[1000:].any()
    assert 'joint_3a jumped' in run.states[-1]


def test_too_fast_for_a_human():
    _, angles = readings(swinging(10.0, 3.0), 2000)
    run = Run(supervisor(joint_speed=1.0), angles)
    assert 'orientation does not continue the motion' in run.reasons
