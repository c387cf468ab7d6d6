# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five and six sensors: angles, Jacobian, estimate at the bound, parity vector, one missing."""

import math

from built_mechanism import random_built
from mechanism import (
    about_x,
    about_z,
    angle_between,
    MODES,
    reachable_rotation,
    second_axes,
    SINGULAR_PHI,
    small_vector,
    tilted,
    turn,
)
import numpy as np
import pytest
from readings import SIGMA
from spm_haptic_master.exceptions import InputError, SingularityError, SpmError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import (
    dexterity,
    estimate,
    estimate_sample,
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.kinematics.number_backends import SLICE

PAPER = Geometry()
Z = np.array([0.0, 0.0, 1.0])
# Standard deviations of six sensors (rad).
UNEQUAL = SIGMA * np.array([1.0, 2.0, 0.5, 1.5, 0.8, 1.2])
# Poses: central, singular, tilted, at the edge (tilt, azimuth, phi, rad).
POSES = [(0.0, 0.0, 0.5), (0.0, 0.0, SINGULAR_PHI), (0.15, 1.0, 1.1), (0.28, 4.0, 0.9)]


def all_angles(R, g=PAPER, mode=(1, 1, 1)):
    """Return the true readings of six sensors."""
    joints = inverse(R, g, mode)
    return np.concatenate([joints.theta1, np.stack(
        [joints.theta3a, joints.theta3b, joints.theta3c], axis=-1)], axis=-1)


def estimated(readings, sigma=SIGMA, g=PAPER, **options):
    """Estimate from readings (..., N)."""
    more = dict(zip(('theta3b', 'theta3c'), np.moveaxis(readings[..., 4:], -1, 0), strict=False))
    return estimate(readings[..., :3], readings[..., 3], sigma, g, **more, **options)


def sampled(readings, sigma, g=PAPER, left_out=(), **options):
    """Estimate one sample in floats."""
    sensors = UsedSensors(tuple(np.broadcast_to(sigma, len(readings)).tolist()), left_out)
    return estimate_sample(tuple(readings.tolist()), sensors, g, **options)


def whitened_jacobian(R, sigma, sensors, g=PAPER, mode=(1, 1, 1)):
    return jacobian(R, g, mode, sensors) / np.broadcast_to(sigma, sensors)[:, None]


@pytest.mark.parametrize('mode', MODES)
def test_third_joints_place_the_second_axes(mode):
    rng = np.random.default_rng(300)
    for _ in range(20):
        R = reachable_rotation(rng, PAPER, slack=0.02)
        th1a, th1b, th1c, *thirds = all_angles(R, mode=mode)
        for k, (angle, second) in enumerate(
                zip(thirds, second_axes((th1a, th1b, th1c), PAPER), strict=True)):
            found = (R @ about_z(2.0 * math.pi * k / 3.0) @ about_x(-PAPER.gamma)
                     @ about_z(-angle) @ about_x(-PAPER.beta) @ Z)
            np.testing.assert_allclose(found, second, atol=1e-12)


def test_third_joints_of_a_mechanism_as_built():
    rng = np.random.default_rng(301)
    for trial in range(30):
        built, mode = random_built(rng), MODES[trial % 8]
        R = built.reachable_rotation(rng)
        angles = all_angles(R, built.geometry, mode)
        for k, second in enumerate(built.second_axes(angles[:3])):
            first, at_zero, third, zero = built.zero[k]
            # Z2k as the platform sees it, which only th3k moves.
            seen = zero.T @ turn(-angles[3 + k] * third) @ at_zero
            np.testing.assert_allclose(R @ seen, second, atol=1e-12)
            assert np.linalg.norm(first) == pytest.approx(1.0)


@pytest.mark.parametrize('mode', MODES)
def test_jacobians_are_finite_differences(mode):
    rng = np.random.default_rng(302)
    for trial in range(10):
        built = random_built(rng)
        g = built.geometry if trial % 2 else PAPER
        R = built.reachable_rotation(rng, slack=0.15)
        columns = [np.angle(np.exp(1j * (all_angles(turn(1e-5 * axis) @ R, g, mode)
                                         - all_angles(turn(-1e-5 * axis) @ R, g, mode)))) / 2e-5
                   for axis in np.eye(3)]
        expected = np.stack(columns, axis=-1)
        for sensors in (3, 4, 5, 6):
            G = jacobian(R, g, mode, sensors)
            np.testing.assert_allclose(
                G, expected[:sensors], rtol=1e-6, atol=1e-6 * np.abs(expected).max())
            values = np.linalg.svd(expected[:sensors], compute_uv=False)
            assert dexterity(R, g, mode, sensors) == pytest.approx(
                values[2] / values[0], rel=1e-5, abs=1e-8)


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('sensors', [5, 6])
@pytest.mark.parametrize('as_built', [False, True])
def test_noise_is_at_the_bound_and_the_parity_vector_is_white(pose, sensors, as_built):
    rng = np.random.default_rng(303)
    g = random_built(rng).geometry if as_built else PAPER
    R, sigma = workspace_pose(*pose), UNEQUAL[:sensors]
    readings = all_angles(R, g)[:sensors] + sigma * rng.normal(size=(20000, sensors))
    found = estimated(readings, sigma, g)
    error = small_vector(found.rotation @ R.T)
    H = whitened_jacobian(R, sigma, sensors, g)
    least = np.linalg.inv(H.T @ H)
    assert (error**2).sum(-1).mean() / np.trace(least) == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(found.covariance.mean(0), least, atol=0.03 * np.trace(least))
    assert found.parity_vector.shape == (20000, sensors - 3)
    np.testing.assert_allclose(np.cov(found.parity_vector.T), np.eye(sensors - 3), atol=0.05)
    np.testing.assert_allclose(found.parity_vector.mean(0), 0.0, atol=0.05)
    np.testing.assert_allclose(
        found.parity, np.linalg.norm(found.parity_vector, axis=-1), rtol=1e-12)
    assert found.determined.all() and found.consistent.mean() > 0.999


@pytest.mark.parametrize('sensors', [5, 6])
def test_it_is_the_minimum_in_every_working_mode(sensors):
    rng = np.random.default_rng(304)
    checked = 0
    for trial in range(60):
        mode, g = MODES[trial % 8], random_built(rng).geometry
        R = reachable_rotation(rng, PAPER, slack=0.12)
        sigma = SIGMA * rng.uniform(0.5, 3.0, sensors)
        readings = all_angles(R, g, mode)[:sensors] + sigma * rng.normal(size=sensors)
        try:
            found = estimated(readings, sigma, g, prior=R)
        except SingularityError:
            continue

        def objective(rotation, g=g, mode=mode, readings=readings, sigma=sigma):
            residual = np.angle(np.exp(1j * (
                readings - all_angles(rotation, g, mode)[:sensors]))) / sigma
            return (residual**2).sum()

        if math.sqrt(np.trace(found.covariance)) > 0.01:
            continue  # a quadratic is no longer what the objective is
        value = objective(found.rotation)
        assert found.parity**2 == pytest.approx(value, abs=2e-3 * (1.0 + value))
        root = np.linalg.cholesky(found.covariance)
        for direction in (*np.eye(3), *-np.eye(3)):
            near = objective(turn(0.1 * root @ direction) @ found.rotation)
            assert near - value == pytest.approx(0.01, abs=0.004)
        checked += 1
    assert checked > 40


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_floats_single_and_batch_agree(sensors):
    rng = np.random.default_rng(305)
    g = random_built(rng).geometry
    R, sigma = workspace_pose(0.2, 1.0, 0.4), UNEQUAL[:sensors]
    readings = all_angles(R, g)[:sensors] + sigma * rng.normal(size=(6, sensors))
    batch = estimated(readings.reshape(2, 3, sensors), sigma, g)
    assert batch.parity_vector.shape == (2, 3, sensors - 3)
    for row, reading in enumerate(readings):
        place = divmod(row, 3)
        single, sample = estimated(reading, sigma, g), sampled(reading, sigma, g)
        for rotation in (batch.rotation[place], matrix_from_quaternion(sample.quaternion)):
            np.testing.assert_allclose(rotation, single.rotation, atol=1e-12)
        for covariance in (batch.covariance[place], np.reshape(sample.covariance, (3, 3))):
            np.testing.assert_allclose(covariance, single.covariance, rtol=1e-7)
        for vector in (batch.parity_vector[place], sample.parity_vector):
            np.testing.assert_allclose(vector, single.parity_vector, atol=1e-7)
        assert batch.parity[place] == pytest.approx(sample.parity, abs=1e-7)
        assert sample.parity == pytest.approx(float(single.parity), abs=1e-12)
        assert all(type(value) is float for value in (*sample.quaternion, *sample.parity_vector))


def test_the_vector_of_four_is_their_parity():
    rng = np.random.default_rng(306)
    readings = all_angles(workspace_pose(0.1, 2.0, 0.3)) + UNEQUAL * rng.normal(size=6)
    four = estimated(readings[:4], UNEQUAL[:4])
    np.testing.assert_array_equal(four.parity_vector, [four.parity])
    assert four.parity < 0.0 or four.parity > 0.0
    five, six = estimated(readings[:5], UNEQUAL[:5]), estimated(readings, UNEQUAL)
    # A further sensor changes nothing of what the earlier ones say of each other.
    assert five.parity_vector[0] == pytest.approx(four.parity, abs=0.01)
    np.testing.assert_allclose(six.parity_vector[:2], five.parity_vector, atol=0.01)


def test_rows_that_fail_are_nan_and_only_those():
    rng = np.random.default_rng(307)
    readings = all_angles(workspace_pose(0.1, 2.0, 0.3)) + SIGMA * rng.normal(size=(SLICE + 3, 6))
    readings[SLICE + 1, :3] = [1.5, -1.5, 1.5]
    found = estimated(readings)
    answered = np.isfinite(found.parity_vector).all(-1)
    np.testing.assert_array_equal(answered, np.isfinite(found.rotation).all((1, 2)))
    with pytest.raises(SpmError):
        estimated(readings[SLICE + 1])
    assert np.flatnonzero(~answered).tolist() == [SLICE + 1]
    np.testing.assert_array_equal(found.determined, answered)


@pytest.mark.parametrize('sensors, index', [
    (sensors, index) for sensors in (5, 6) for index in range(sensors)])
@pytest.mark.parametrize('pose', POSES[1:3])
def test_any_one_missing_without_a_prior(sensors, index, pose):
    rng = np.random.default_rng(308)
    g, missing = random_built(rng).geometry, ALL_JOINT_NAMES[index]
    R, sigma = workspace_pose(*pose), UNEQUAL[:sensors]
    true = all_angles(R, g)[:sensors]
    true[index] = math.nan
    exact = estimated(true, sigma, g, missing=missing)
    assert angle_between(exact.rotation, R) < 1e-9
    np.testing.assert_allclose(exact.parity_vector, 0.0, atol=1e-6)
    H = np.delete(whitened_jacobian(R, sigma, sensors, g), index, axis=0)
    least = np.linalg.inv(H.T @ H)
    np.testing.assert_allclose(exact.covariance, least, atol=1e-4 * np.trace(least))
    readings = true + sigma * rng.normal(size=(1000, sensors))
    found = estimated(readings, sigma, g, missing=missing)
    assert found.parity_vector.shape == (1000, sensors - 4)
    error = small_vector(found.rotation @ R.T)
    # 1000 samples: six standard deviations of a chi-square of three.
    assert (error**2).sum(-1).mean() / np.trace(least) == pytest.approx(1.0, abs=0.2)
    np.testing.assert_allclose(
        np.cov(found.parity_vector.T), np.eye(sensors - 4).squeeze(), atol=0.25)


def test_a_fault_of_the_missing_sensor_is_out_of_the_answer():
    readings = all_angles(workspace_pose(0.1, 2.0, 0.6))
    for index, name in enumerate(ALL_JOINT_NAMES):
        wrong = readings + np.radians(1.0) * (np.arange(6) == index)
        assert estimated(wrong).parity > 5.0
        found = estimated(wrong, missing=name)
        assert abs(found.parity_vector).max() < 1e-6 and found.consistent
        sample = sampled(wrong, SIGMA, left_out=(index,))
        assert abs(sample.parity) < 1e-6 and sample.gains[index] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('pose', POSES[:1] + POSES[2:])
def test_directions_are_those_of_the_projection(sensors, pose):
    R, sigma = workspace_pose(*pose), UNEQUAL[:sensors]
    readings = all_angles(R)[:sensors]
    sample = sampled(readings, sigma)
    directions = np.array(sample.parity_gains) * sigma[:, None]
    H = whitened_jacobian(R, sigma, sensors)
    P = np.eye(sensors) - H @ np.linalg.pinv(H)
    np.testing.assert_allclose(directions @ directions.T, P, atol=1e-7)
    np.testing.assert_allclose(directions.T @ directions, np.eye(sensors - 3), atol=1e-7)
    # A small fault moves the parity vector along its sensor's direction.
    for sensor in range(sensors):
        moved = sampled(readings + 0.1 * sigma * (np.arange(sensors) == sensor), sigma)
        np.testing.assert_allclose(
            np.array(moved.parity_vector) / 0.1, directions[sensor], atol=3e-3)


@pytest.mark.parametrize('missing', range(6))
def test_directions_with_a_sensor_missing(missing):
    R = workspace_pose(0.15, 1.0, 1.1)
    prior = tuple(quaternion_from_matrix(R).tolist())
    sample = sampled(all_angles(R), UNEQUAL, left_out=(missing,), prior=prior)
    directions = np.array(sample.parity_gains) * UNEQUAL[:, None]
    there = np.arange(6) != missing
    H = whitened_jacobian(R, UNEQUAL, 6)[there]
    P = np.eye(5) - H @ np.linalg.pinv(H)
    np.testing.assert_allclose(directions[there] @ directions[there].T, P, atol=1e-7)
    np.testing.assert_array_equal(directions[missing], 0.0)


def test_readings_beyond_half_a_turn_are_the_same():
    rng = np.random.default_rng(309)
    for R in (workspace_pose(0.1, 1.0, 0.4), tilted(0.9, 0.2, 3.0)):
        readings = all_angles(R) + SIGMA * rng.normal(size=6)
        plain = estimated(readings)
        turned = estimated(readings + 2.0 * math.pi * np.array([1, -1, 0, 2, -1, 3]))
        np.testing.assert_allclose(turned.rotation, plain.rotation, atol=1e-12)
        np.testing.assert_allclose(turned.parity_vector, plain.parity_vector, atol=1e-7)


def test_where_case_2_is_degenerate_the_further_sensors_give_the_start():
    """The closed form of leg A has two solutions there: four sensors need a prior."""
    rng = np.random.default_rng(310)
    found = 0
    for _ in range(4000):
        R = reachable_rotation(rng, PAPER, slack=0.1)
        angles = all_angles(R)
        try:
            estimated(angles[:4])
        except SingularityError:
            for sensors in (5, 6):
                assert angle_between(estimated(angles[:sensors]).rotation, R) < 1e-8
            found += 1
    assert found > 3


def test_bad_input():
    angles = all_angles(workspace_pose(0.1, 1.0, 0.4))
    th1, th3a, th3b, th3c = angles[:3], *angles[3:]
    with pytest.raises(InputError, match='theta3b = None: .* theta3c is given'):
        estimate(th1, th3a, SIGMA, theta3c=th3c)
    with pytest.raises(InputError, match='sigma = .*: expected one .* or five'):
        estimate(th1, th3a, [SIGMA] * 4, theta3b=th3b)
    with pytest.raises(InputError, match='sigma = .*: expected one .* or six'):
        estimate(th1, th3a, [SIGMA] * 5, theta3b=th3b, theta3c=th3c)
    with pytest.raises(InputError, match='theta3b: entry'):
        estimate(th1, th3a, SIGMA, theta3b=math.nan)
    with pytest.raises(InputError, match="missing = 'joint_3c'"):
        estimate(th1, th3a, SIGMA, theta3b=th3b, missing='joint_3c')
    with pytest.raises(InputError, match="missing = 'joint_3b'"):
        estimate(th1, th3a, SIGMA, missing='joint_3b')
    with pytest.raises(InputError, match=r'th1, theta3a, theta3b, prior: .*\(4,\).*\(5,\)'):
        estimate(np.ones((4, 3)), np.ones(4), SIGMA, theta3b=np.ones(5))
    for sensors in (2, 7, 5.0):
        with pytest.raises(InputError, match='sensors ='):
            jacobian(workspace_pose(0.1, 1.0, 0.4), sensors=sensors)


def test_where_no_leg_gives_a_start_the_solutions_of_all_legs_are_tried():
    R = workspace_pose(0.1, 1.0, 0.4)
    angles = all_angles(R)
    for prior in (None, turn([0.02, 0.0, 0.0]) @ R):
        assert angle_between(estimated(angles, 0.3, prior=prior).rotation, R) < 1e-9
