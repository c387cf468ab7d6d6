# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The directed search of `make faults`: its device, its cases, and what is a violation."""

from benchmarks import integrity_attack
from benchmarks.attack_device import Device, wrapped
from benchmarks.attack_kinds import KINDS
from benchmarks.attack_scene import Choices, Impossible
from benchmarks.integrity_attack import BOUND, held, score, search, Task
from mechanism import random_rotations
import numpy as np
import pytest
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.supervision import Supervised

PAPER = tuple(np.radians([39.3, 34.1, 18.2]).tolist())


def first_case(kind, seed=1):
    """Return the first possible case of a kind."""
    rng = np.random.default_rng(seed)
    for _ in range(200):
        try:
            return KINDS[kind](Choices(rng))
        except Impossible:
            continue
    raise AssertionError(f'{kind} has no case')


@pytest.mark.parametrize(
    'mode',
    [
        (1, 1, 1),
        (1, -1, 1),
        (-1, -1, -1),
    ],
)
def test_the_attacked_device_has_the_same_angles_by_formulas_of_its_own(mode):
    rotations = random_rotations(np.random.default_rng(1), 4000)
    found = Device(PAPER, mode).readings(rotations)
    joints = inverse(rotations, Geometry(*PAPER), mode)
    expected = np.column_stack([joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c])
    reached = np.isfinite(expected).all(axis=1)
    assert reached.sum() > 100
    assert (np.isfinite(found).all(axis=1) == reached).all()
    assert np.abs(wrapped(found - expected))[reached].max() < 1e-12


def test_rivals_read_the_same_by_all_sensors_but_one():
    device = Device(PAPER)
    place = workspace_pose(*np.radians([5.0, 30.0, 44.4]))
    rivals = device.rivals(place, (0, 1, 2), np.random.default_rng(1))
    difference = wrapped(device.readings(rivals) - device.readings(place))
    assert len(rivals)
    assert np.abs(difference[:, :3]).max() < 1e-7
    assert np.abs(difference[:, 3]).min() > np.radians(5.0)


def test_an_orientation_is_found_that_some_sensors_determine_hardly():
    device = Device(PAPER)
    begin = workspace_pose(*np.radians([5.0, 30.0, 20.0]))
    place = device.undetermined((0, 1, 2, 3), begin, np.random.default_rng(1))
    determined = [
        np.linalg.svd(device.rates(rotation)[:4], compute_uv=False)[-1]
        for rotation in (begin, place)
    ]
    assert determined[1] < 0.1 * determined[0]


@pytest.mark.parametrize('kind', list(KINDS))
def test_each_kind_has_cases_that_its_choices_settle(kind):
    one = first_case(kind)
    again = first_case(kind)
    assert np.array_equal(one.readings, again.readings)
    assert one.words == again.words
    assert len(one.stamps) == len(one.readings) == len(one.rotations)
    assert len(one.readings) > one.window


def test_only_what_lasts_for_longer_than_the_time_to_alert_counts():
    ratios = np.array([0.5, 3.0, 3.0, 2.0, 0.1])
    assert held(ratios, 2) == 2.0
    assert held(ratios, 3) == 0.5


def test_an_orientation_beyond_its_level_is_a_violation():
    case = first_case('healthy near the rim', seed=3)
    assert 0.0 < score(case).level < 1.0
    # The same readings of another truth: 9 deg about the platform's axis.
    turn = (
        workspace_pose(0.0, 0.0, np.radians(29.0)) @ workspace_pose(0.0, 0.0, np.radians(20.0)).T
    )
    case.rotations[:] = turn @ case.rotations
    found = score(case)
    assert found.level > 1.0
    assert found.error_deg == pytest.approx(9.0, abs=1.0)


def test_a_declared_sensor_is_held_to_its_bound(monkeypatch):
    case = first_case('step anywhere')
    real = integrity_attack.supervise

    def unchecked(*args, **parameters):
        result = real(*args, **parameters)
        result.unchecked[:] = 1.0
        result.bounds[:] = 1e-3
        return result

    monkeypatch.setattr(integrity_attack, 'supervise', unchecked)
    found = score(case)
    assert found.level == 0.0
    assert found.bound > 1.0


def supervised(case, state, published=True, unchecked=0.0, level=0.1):
    """Return a made-up result: each sample at rest, at the base frame."""
    n, sensors = case.readings.shape
    return Supervised(
        published=np.full(n, published),
        quaternion=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        covariance=np.zeros((n, 3, 3)),
        protection_level=np.full(n, level),
        unchecked=np.full((n, sensors), unchecked),
        bounds=np.full((n, sensors), np.inf),
        state=[(0, state)],
    )


@pytest.mark.parametrize(
    ('alone', 'is_violation'),
    [
        pytest.param({'unchecked': np.inf}, False, id='goes out unchecked without the first'),
        pytest.param({'level': 3.0}, False, id='is within its level without the first'),
        pytest.param({'level': 0.5}, True, id='is beyond its level without the first'),
        pytest.param({'published': False}, True, id='is silent without the first'),
    ],
)
def test_a_first_fault_may_cost_no_protection_against_the_second(monkeypatch, alone, is_violation):
    found = score_of_two_faults(monkeypatch, alone, seed=2, sensors=4)
    assert (found.level > 1.0) is is_violation


def test_four_of_five_go_on_by_what_they_check_themselves(monkeypatch):
    found = score_of_two_faults(monkeypatch, {'published': False}, seed=1, sensors=5)
    assert found.level == 0.0


def score_of_two_faults(monkeypatch, alone, seed, sensors):
    """Return the score of 1 deg off, unchecked, a sensor left out; `alone` without the first."""
    case = first_case('glitch of one, drift of another', seed)
    assert case.readings.shape[1] == sensors
    case.rotations[:] = workspace_pose(0.0, 0.0, np.radians(1.0)) @ workspace_pose(0.0, 0.0, 0.0).T
    with_both = supervised(case, 'degraded: joint_1a excluded', unchecked=1.0)
    results = iter([with_both, supervised(case, 'healthy', **alone)])
    monkeypatch.setattr(integrity_attack, 'supervise', lambda *args, **parameters: next(results))
    return score(case)


@pytest.mark.slow
def test_a_search_is_the_same_each_time_and_no_worse_than_its_random_half(monkeypatch):
    task = Task('drift of th3A through the singularity', BOUND, seed=1, runs=4)
    found = search(task)
    assert found == search(task)
    monkeypatch.setattr(integrity_attack, 'RANDOM_SHARE', 1.0)
    drawn = search(task._replace(runs=2))
    assert found.score.of(BOUND) >= drawn.score.of(BOUND) > 0.0
