# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five and six sensors: a fault is seen everywhere, and six go on without the faulty one."""

from itertools import combinations

from device import every, joint_angles, motion, offset, ramp, run, stuck
import numpy as np
import pytest
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Sample of the fault's beginning, and samples within which it is silent or goes on (20 ms).
BEGIN, ALERT = 300, 20
EACH_SENSOR = pytest.mark.parametrize('sensor', [
    0, 3, 5, *(pytest.param(sensor, marks=pytest.mark.slow) for sensor in (1, 2, 4))])


def outcome(kind, sensors, change=None, seconds=0.8, **options):
    """Return the outcome of a motion; no error is beyond its level."""
    found = run(kind, sensors, seconds, change=change, **options)
    assert found.within_level
    return found


def missing(first, last, *sensors):
    def change(readings):
        readings[first:last, list(sensors)] = np.nan
    return change


# Five -----------------------------------------------------------------------------------------

@pytest.mark.parametrize('sensor', [3, 4])
@pytest.mark.parametrize(('kind', 'fault', 'size'), [
    ('singular', offset, [1.0]), ('crossing', ramp, [10.0]), ('through', stuck, [])])
def test_five_are_silent_where_four_see_nothing(sensor, kind, fault, size):
    found = outcome(kind, 5, spoil=fault(BEGIN, sensor, *size))
    assert not found.published[-300:].any()


# Six without a faulty one ---------------------------------------------------------------------

@EACH_SENSOR
@pytest.mark.parametrize(('kind', 'fault', 'size'), [
    ('crossing', offset, 1.0), ('sweep', offset, 30.0), ('singular', ramp, 10.0)])
def test_six_isolate_the_faulty_one_and_go_on(sensor, kind, fault, size):
    found = outcome(kind, 6, fault(BEGIN, sensor, size))
    assert found.longest_silence() <= ALERT and found.published[-1]
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    # Nobody checks it, and that is declared.
    unchecked = found.result.unchecked[-1]
    assert unchecked[sensor] > 0.2 and (np.delete(unchecked, sensor) == 0.0).all()


@pytest.mark.parametrize(('kind', 'rate'), [
    ('sweep', 250.0), ('fast', 500.0), ('turning', 1000.0)])
@EACH_SENSOR
def test_six_go_on_within_20_ms_without_one_that_is_stuck(sensor, kind, rate):
    seconds = 1.6 + 0.1 * sensor
    begin = round(seconds * rate) // 2
    found = run(kind, 6, seconds, rate, spoil=stuck(begin, sensor), seed=sensor)
    assert found.longest_silence(begin) / rate <= 0.02
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'


@EACH_SENSOR
@pytest.mark.parametrize(('size', 'slow'), [(0.5, 1.0), (2.0, 0.001)],
                         ids=['within a second', 'at once'])
def test_one_of_six_that_grows_noisy_is_excluded(sensor, size, slow):
    def grow(readings):
        growth = np.clip((np.arange(len(readings)) * 1e-3 - 0.3) / slow, 0.0, 1.0)
        readings[:, sensor] += np.radians(size) * growth * np.random.default_rng(sensor).normal(
            size=len(readings))
    found = run('sweep', 6, 1.8, spoil=grow)
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    assert found.published[1500:].mean() > 0.99
    assert found.longest_undeclared(sensor) <= 0.02


@pytest.mark.parametrize(('kind', 'change', 'silence', 'excluded'), [
    # Wrong before the start.
    ('crossing', offset(0, 3, 20.0), 0, 'joint_3a'),
    # A drift too slow to name the sensor at once.
    ('rest', ramp(BEGIN, 0, 1.0), 2 * ALERT, 'joint_1a'),
    # A spike of another sensor.
    ('rest', every(offset(BEGIN, 3, 3.0), offset(500, 0, 4.0, 501)), ALERT, 'joint_3a')])
def test_six_go_on_and_name_it(kind, change, silence, excluded):
    found = outcome(kind, 6, change, seconds=1.4)
    assert found.states[-1] == f'degraded: {excluded} excluded'
    assert found.longest_silence() <= silence


@pytest.mark.parametrize(('bad', 'of'), [(1, 9), (2, 4), (2, 11)])
def test_a_sensor_with_spikes_that_return_is_excluded(bad, of):
    def spikes(angles):
        index = np.arange(len(angles))
        angles[(index >= BEGIN) & (index % of < bad), 0] += np.radians(5.0)
    found = outcome('rest', 6, spikes)
    assert found.states[-1] == 'degraded: joint_1a excluded'
    assert found.longest_silence() <= 3 * ALERT and found.published[500:].all()


@pytest.mark.parametrize('sensor', [0, 3, 5])
def test_a_sensor_out_of_its_range_from_the_start_is_excluded(sensor):
    high = (np.degrees(joint_angles(motion('rest', 0.001), 6)[0]) + 20.0).tolist()
    found = outcome('rest', 6, offset(0, sensor, 40.0), joint_max_deg=high)
    assert found.states[-1] == f'degraded: {ALL_JOINT_NAMES[sensor]} excluded'
    assert found.published[30:].all()


@pytest.mark.parametrize('glitches', [(5, 3), (3, 5, 4)])
def test_a_glitch_of_another_sensor_does_not_end_six_without_a_faulty_one(glitches):
    found = run('sweep', 6, 2.0, recovery=0.3, spoil=every(offset(BEGIN, 0, 3.0), *(
        offset(first, sensor, 4.0, first + 3)
        for first, sensor in zip(range(600, 900, 100), glitches, strict=False))))
    # Within the recovery and half a second.
    assert found.published[1200 + 100 * len(glitches):].all()
    assert found.states[-1] == 'degraded: joint_1a excluded'


# Silence --------------------------------------------------------------------------------------

@pytest.mark.parametrize('first', [0, 3])
def test_a_second_faulty_sensor_is_silence(first):
    found = outcome('sweep', 6, every(offset(BEGIN, first, 3.0), offset(BEGIN + 200, 5, 3.0)))
    assert found.published[BEGIN + ALERT:BEGIN + 200].all()
    assert not found.published[BEGIN + 200:].any()
    assert found.states[-1].startswith('silent: ')


@pytest.mark.parametrize(('kind', 'change', 'parameters', 'words'), [
    ('sweep', offset(BEGIN, 3, 1.0), {'degraded': 'stop'}, 'silent: joint_3a '),
    # Two that jump at once need no acknowledgement.
    ('rest', offset(BEGIN, [0, 1], 3.0), {}, 'silent: inconsistent angles'),
    ('rest', None, {'working_mode': [1, -1, 1]}, 'silent: ')])
def test_six_that_may_not_or_cannot_go_on_are_silent(kind, change, parameters, words):
    found = outcome(kind, 6, change, **parameters)
    assert not found.published[BEGIN:].any()
    assert found.states[-1].startswith(words) and 'acknowledged' not in found.states[-1]


# Without a reading ----------------------------------------------------------------------------

@pytest.mark.parametrize('sensors', [5, 6])
def test_a_missing_sensor_costs_no_orientation(sensors):
    for sensor, name in enumerate(ALL_JOINT_NAMES[:sensors]):
        found = outcome('sweep', sensors, seconds=0.5, spoil=missing(200, 400, sensor))
        assert found.published[10:].all()
        assert found.states == ['starting', 'healthy', f'degraded: {name} missing', 'healthy']
        assert found.result.unchecked[390, sensor] > 0.18


def test_any_two_of_six_may_be_missing():
    for first, second in combinations(range(6), 2):
        found = outcome('sweep', 6, seconds=0.3, spoil=missing(150, None, first, second))
        assert found.published[10:].mean() > 0.99
        assert found.states[-1] == (f'degraded: {ALL_JOINT_NAMES[first]} missing, '
                                    f'{ALL_JOINT_NAMES[second]} missing')


def test_a_sensor_that_comes_back_wrong_is_left_out():
    found = outcome('sweep', 6, spoil=every(missing(200, 400, 4), offset(400, 4, 4.0)))
    assert found.published[10:].all()
    assert found.states[-1] == 'degraded: joint_3b missing'
