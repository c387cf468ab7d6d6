# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five and six sensors: a fault is seen everywhere, and six go on without the faulty one."""

from itertools import combinations

from device import every, offset, ramp, run, stuck
import numpy as np
import pytest
from rig import few
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Sample of the fault's beginning, and samples within which it is silent or goes on (20 ms).
BEGIN = 100
ALERT = 20
SENSORS = (3, 0, 5, 1, 2, 4)


def outcome(kind, sensors, change=None, seconds=0.4, **options):
    """Return the outcome of a motion; no error is beyond its level."""
    found = run(kind, sensors, seconds, change=change, **options)
    assert found.within_level
    return found


def missing(first, last, *sensors):
    def change(readings):
        readings[first:last, list(sensors)] = np.nan

    return change


@pytest.mark.parametrize(
    ('fault', 'sensor'),
    few(
        [
            ('singular', offset, 1.0),
            ('crossing', ramp, 10.0),
            ('through', stuck),
        ],
        (3, 4),
    ),
)
def test_five_are_silent_where_four_see_nothing(fault, sensor):
    kind, make, *size = fault
    change = make(BEGIN, sensor, *size)
    found = outcome(kind, 5, spoil=change, seconds=0.5)
    assert not found.published[-100:].any()


# Six without a faulty one ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ('fault', 'sensor'),
    few(
        [
            ('singular', ramp, 10.0),
            ('crossing', offset, 1.0),
            ('sweep', offset, 30.0),
        ],
        SENSORS,
    ),
)
def test_six_isolate_the_faulty_one_and_go_on(fault, sensor):
    kind, change, size = fault
    found = outcome(kind, 6, change(BEGIN, sensor, size))
    assert found.longest_silence() <= ALERT
    assert found.published[-1]
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    # Nobody checks it, and that is declared.
    unchecked = found.result.unchecked[-1]
    assert unchecked[sensor] > 0.2
    assert (np.delete(unchecked, sensor) == 0.0).all()


@pytest.mark.parametrize(
    ('motion', 'sensor'),
    few(
        [
            ('sweep', 250.0),
            ('fast', 500.0),
            ('turning', 1000.0),
        ],
        SENSORS,
        others=pytest.mark.evidence,
    ),
)
def test_six_go_on_within_a_window_without_one_that_is_stuck(motion, sensor):
    """The five others pass their trial first: 20 ms, and ten samples at least."""
    kind, rate = motion
    seconds = 1.6 + 0.1 * sensor
    begin = round(seconds * rate) // 2
    found = run(
        kind,
        6,
        seconds,
        rate,
        spoil=stuck(begin, sensor),
        seed=sensor,
    )
    assert found.longest_silence(begin) <= max(0.02 * rate, 10.0) + 1.0
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'


@pytest.mark.parametrize(
    ('growth', 'sensor'),
    few(
        [
            (0.35, 1.0, 1.8),
            (2.0, 0.001, 0.5),
        ],
        SENSORS,
        count=2,
    ),
)
def test_one_of_six_that_grows_noisy_is_excluded(growth, sensor):
    """Within a second, or at once."""
    size, slow, seconds = growth

    def grow(readings):
        since_onset = np.arange(len(readings)) * 1e-3 - 0.3
        share = np.clip(since_onset / slow, 0.0, 1.0)
        noise = np.random.default_rng(sensor).normal(size=len(readings))
        readings[:, sensor] += np.radians(size) * share * noise

    found = run('sweep', 6, seconds, spoil=grow)
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    assert found.published[-150:].mean() > 0.99
    assert found.longest_undeclared(sensor) <= 0.02


@pytest.mark.parametrize(
    ('kind', 'change', 'silence', 'excluded', 'seconds'),
    [
        # Wrong before the start.
        ('crossing', offset(0, 3, 20.0), 0, 'joint_3a', 0.3),
        # A drift so slow that for a while the others agree without a healthy sensor as well.
        ('rest', ramp(BEGIN, 0, 1.0), 3 * ALERT, 'joint_1a', 1.0),
        # A spike of another sensor.
        (
            'rest',
            every(offset(BEGIN, 3, 3.0), offset(250, 0, 4.0, 251)),
            ALERT,
            'joint_3a',
            0.4,
        ),
    ],
)
def test_six_go_on_and_name_it(kind, change, silence, excluded, seconds):
    found = outcome(kind, 6, change, seconds)
    assert found.states[-1] == f'degraded: {excluded} excluded'
    assert found.longest_silence() <= silence


# Silence --------------------------------------------------------------------------------------


@pytest.mark.parametrize('first', [0, 3])
def test_a_second_faulty_sensor_is_silence(first):
    change = every(
        offset(BEGIN, first, 3.0),
        offset(BEGIN + 100, 5, 3.0),
    )
    found = outcome('sweep', 6, change)
    assert found.published[BEGIN + ALERT : BEGIN + 100].all()
    assert not found.published[BEGIN + 100 :].any()
    assert found.states[-1].startswith('silent: ')


@pytest.mark.parametrize(
    ('kind', 'change', 'parameters', 'words'),
    [
        ('sweep', offset(BEGIN, 3, 1.0), {'degraded': 'stop'}, 'silent: joint_3a '),
        # Two that jump at once need no acknowledgement.
        ('rest', offset(BEGIN, [0, 1], 3.0), {}, 'silent: inconsistent angles'),
        ('rest', None, {'working_mode': [1, -1, 1]}, 'silent: '),
    ],
)
def test_six_that_may_not_or_cannot_go_on_are_silent(kind, change, parameters, words):
    found = outcome(kind, 6, change, 0.3, **parameters)
    assert not found.published[BEGIN:].any()
    assert found.states[-1].startswith(words)
    assert 'acknowledged' not in found.states[-1]


# Without a reading ----------------------------------------------------------------------------


def pairs_of_six():
    """Return each pair of six sensors; those that are not of opposite places are slow."""
    cases = []
    for pair in combinations(range(6), 2):
        marks = () if sum(pair) == 5 else pytest.mark.slow
        cases.append(pytest.param(6, pair, marks=marks))
    return cases


@pytest.mark.parametrize(
    ('sensors', 'gone'),
    [
        (5, (1,)),
        (5, (4,)),
        *((6, (sensor,)) for sensor in range(6)),
        *pairs_of_six(),
    ],
)
def test_one_of_five_or_two_of_six_that_are_missing_cost_no_orientation(sensors, gone):
    found = outcome('sweep', sensors, seconds=0.25, spoil=missing(100, 180, *gone))
    assert found.published[10:].mean() > 0.99
    assert len(gone) > 1 or found.published[10:].all()
    words = ', '.join(f'{ALL_JOINT_NAMES[sensor]} missing' for sensor in gone)
    assert found.states == ['starting', 'healthy', f'degraded: {words}', 'healthy']
    assert (found.result.unchecked[175, gone] > 0.07).all()


def test_a_sensor_that_comes_back_wrong_is_left_out():
    change = every(missing(100, 200, 4), offset(200, 4, 4.0))
    found = outcome('sweep', 6, spoil=change)
    assert found.published[10:].all()
    assert found.states[-1] == 'degraded: joint_3b missing'
