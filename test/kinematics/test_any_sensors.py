# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any three to six sensors in use of four, five or six mounted ones, one sample at a time."""

from itertools import combinations
import math
import random

from mechanism import turn
import numpy as np
import pytest
from readings import SIGMA
from spm_haptic_master.exceptions import AmbiguousError, SingularityError, SpmError
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    inverse,
    matrix_from_quaternion,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)

PAPER = Geometry()
SIGMAS = tuple((SIGMA * np.array([1.0, 2.0, 0.5, 1.5, 0.8, 1.2])).tolist())
SETS = [UsedSensors(SIGMAS[:mounted], left_out) for mounted in (4, 5, 6)
        for number in range(mounted - 2) for left_out in combinations(range(mounted), number)]
# Away from the singularities of all sets of three.
POSES = [(0.05, 3.8, 0.4), (0.02, 1.6, 0.5), (0.07, 2.9, 0.4)]
# Factors of a reading of a faulty sensor.
SCALES = (1.0,) * 50 + (1e30,)
# Readings of six sensors, th1C left out, whose residual of th3B has a variance below zero, by
# rounding.
ROUNDED = (2.4539857654200543, 0.9035146840646426, 1.4545972821125592, 0.617810762320942,
           0.290689359304329, 0.30756314797107104)


def named(sensors):
    return f'{len(sensors.sigma)}:{"".join(map(str, sensors.used))}'


def readings_at(R, sensors, mode=(1, 1, 1)):
    """Return the true readings of the mounted sensors; NaN of those that are left out."""
    joints = inverse(R, PAPER, mode)
    every = [*joints.theta1.tolist(), *map(float, (joints.theta3a, joints.theta3b,
                                                   joints.theta3c))]
    return tuple(angle if place in sensors.used else math.nan
                 for place, angle in enumerate(every[:len(sensors.sigma)]))


def quaternion(R):
    return tuple(quaternion_from_matrix(R).tolist())


def rotated(sample, R):
    """Return the rotation vector, small, from R to a sample's orientation."""
    error = matrix_from_quaternion(sample.quaternion) @ R.T
    return 0.5 * np.array([error[2, 1] - error[1, 2], error[0, 2] - error[2, 0],
                           error[1, 0] - error[0, 1]])


@pytest.mark.parametrize('sensors', SETS, ids=named)
def test_true_readings_give_the_pose(sensors):
    """Four and more need no prior; a sensor that is left out may be NaN."""
    for pose in POSES:
        R = workspace_pose(*pose)
        readings = readings_at(R, sensors)
        priors = [quaternion(turn([0.01, -0.01, 0.01]) @ R)]
        if sensors.count > 3:
            priors.append(None)
        for prior in priors:
            sample = estimate_sample(readings, sensors, PAPER, prior, (1, 1, 1))
            assert np.linalg.norm(rotated(sample, R)) < 1e-7
            assert len(sample.parity_vector) == sensors.count - 3
            assert np.abs(sample.parity_vector).max(initial=0.0) < 1e-6
            assert (sample.parity is None) == (sensors.count == 3)


@pytest.mark.parametrize('sensors', SETS, ids=named)
def test_gains_are_finite_differences(sensors):
    for pose in POSES:
        R = workspace_pose(*pose)
        readings, prior = readings_at(R, sensors), quaternion(R)
        sample = estimate_sample(readings, sensors, PAPER, prior, last_step=1e-9)
        assert len(sample.gains) == len(sample.parity_gains) == len(sensors.sigma)
        step = 1e-5
        for place in range(len(sensors.sigma)):
            ahead, behind = (estimate_sample(
                (*readings[:place], readings[place] + change, *readings[place + 1:]), sensors,
                PAPER, prior, last_step=1e-9) for change in (step, -step))
            turned = (rotated(ahead, R) - rotated(behind, R)) / (2.0 * step)
            moved = (np.array(ahead.parity_vector) - behind.parity_vector) / (2.0 * step)
            gains, parity_gains = sample.gains[place], np.array(sample.parity_gains[place])
            assert len(parity_gains) == sensors.count - 3
            if place in sensors.used:
                scale = np.abs(sample.gains).max()
                np.testing.assert_allclose(turned, gains, rtol=1e-3, atol=1e-4 * scale)
                np.testing.assert_allclose(moved * SIGMA, parity_gains * SIGMA, atol=1e-3)
            else:
                assert gains == (0.0, 0.0, 0.0) and not parity_gains.any()
        sigma = np.array(sensors.sigma)[:, None]
        weighted = sigma * np.array(sample.gains)
        np.testing.assert_allclose(
            weighted.T @ weighted, np.reshape(sample.covariance, (3, 3)), rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize('sensors', [each for each in SETS if each.count > 3], ids=named)
@pytest.mark.parametrize('leg', range(3))
def test_a_solution_in_another_working_mode_is_none(sensors, leg):
    """Where the leg has a sensor in use; a leg without one may have any."""
    R = workspace_pose(0.05, 0.5, 0.4)
    mode = tuple(-1 if each == leg else 1 for each in range(3))
    readings = readings_at(R, sensors, mode)
    assert np.linalg.norm(rotated(estimate_sample(readings, sensors, PAPER), R)) < 1e-7
    if {leg, 3 + leg} & set(sensors.used):
        for prior in (None, quaternion(R)):
            with pytest.raises(SpmError):
                estimate_sample(readings, sensors, PAPER, prior, (1, 1, 1))
    else:
        estimate_sample(readings, sensors, PAPER, None, (1, 1, 1))


def test_a_set_whose_solutions_explain_the_readings_equally_needs_a_prior():
    """The closed form of leg A is degenerate: th1B and th1C measure the same closure."""
    rng = np.random.default_rng(5)
    found = 0
    sensors = UsedSensors((SIGMA,) * 6, (4, 5))
    while not found:
        pose = rng.uniform(0.0, 0.45), rng.uniform(0.0, 6.28), rng.uniform(-1.0, 2.5)
        try:
            readings = readings_at(workspace_pose(*pose), sensors)
            estimate_sample(readings, sensors, PAPER)
        except AmbiguousError:
            R = workspace_pose(*pose)
            sample = estimate_sample(readings, sensors, PAPER, quaternion(R))
            assert np.linalg.norm(rotated(sample, R)) < 1e-6
            found += 1
        except SpmError:
            continue


def test_a_variance_that_rounding_makes_negative_is_no_error_of_arithmetic():
    for left_out in range(6):
        sensors = UsedSensors((SIGMA,) * 6, (left_out,))
        try:
            sample = estimate_sample(ROUNDED, sensors, PAPER, None, (1, 1, 1))
        except SingularityError:
            continue
        assert np.isfinite(sample.parity_vector).all()


def poses_and_readings(seed):
    """Return lists of six readings, and quaternions, of random poses within reach."""
    rng = np.random.default_rng(seed)
    R = np.stack([workspace_pose(*pose) for pose in rng.uniform(
        (0.0, 0.0, -1.0), (0.5, 6.3, 2.5), (300, 3))])
    joints = inverse(R)
    every = np.column_stack([joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c])
    reached = np.isfinite(every).all(axis=1)
    return every[reached].tolist(), [tuple(each) for each in
                                     quaternion_from_matrix(R[reached]).tolist()]


def call_with_random_readings(seed, calls):
    """Estimate from random readings, random sets and priors; only SpmError may be raised."""
    rng = random.Random(seed)
    every, known = poses_and_readings(seed)
    answered = 0
    for _ in range(calls):
        sensors = rng.choice(SETS)
        pose = rng.randrange(len(known))
        readings = every[pose][:len(sensors.sigma)]
        if rng.random() < 0.75:
            # One sensor anywhere.
            readings[rng.choice(sensors.used)] = rng.uniform(-7.0, 7.0) * rng.choice(SCALES)
        else:
            readings = [rng.uniform(-4.0, 4.0) for _ in readings]
        prior = None
        if sensors.count == 3 or rng.random() < 0.5:
            prior = known[rng.choice((pose, 0))]
        mode = rng.choice((None, (1, 1, 1)))
        try:
            sample = estimate_sample(tuple(readings), sensors, PAPER, prior, mode, 2e-3)
        except SpmError:
            continue
        answered += 1
        assert math.isfinite(sum(sample.quaternion) + sum(sample.parity_vector))
        assert sum(sample.covariance[::4]) > 0.0
    assert answered > 0.1 * calls


@pytest.mark.parametrize('seed', range(4))
def test_nothing_but_its_own_errors_is_raised(seed):
    call_with_random_readings(seed, 5000)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(4, 20))
def test_nothing_but_its_own_errors_is_raised_in_a_hundred_thousand_calls(seed):
    call_with_random_readings(seed, 5000)


@pytest.mark.parametrize('large', [1e16, 1e300, 1.7e308, -1.7e308])
def test_readings_of_any_size_are_angles(large):
    sensors = UsedSensors((SIGMA,) * 6)
    for places in combinations(range(6), 2):
        readings = [large if place in places else 0.4 for place in range(6)]
        try:
            estimate_sample(tuple(readings), sensors, PAPER)
        except SpmError:
            continue
