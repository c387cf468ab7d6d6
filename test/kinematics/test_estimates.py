# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood with four to six sensors: the bound, the optimum, parity, all modes."""

import math

from built_mechanism import nominal, random_built
import mechanism
import numpy as np
import pytest
from readings import all_angles, bound, estimated, four_angles, PAPER, SIGMA, UNEQUAL, wrapped
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import SingularityError, SpmError
from spm_haptic_master.kinematics.estimation.gauss_newton import fit_rows
from spm_haptic_master.kinematics.number_backends import SLICE

# Poses: central, singular, tilted, at the edge (tilt, azimuth, phi, rad).
POSES = [
    (0.0, 0.0, 0.5),
    (0.0, 0.0, mechanism.SINGULAR_PHI),
    (0.15, 1.0, 1.1),
    (0.28, 4.0, 0.9),
]


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('as_built', [False, True])
def test_noise_is_at_the_bound_and_the_parity_vector_is_white(pose, sensors, as_built):
    rng = np.random.default_rng(303)
    g = random_built(rng).geometry if as_built else PAPER
    R = kinematics.workspace_pose(*pose)
    sigma = UNEQUAL[:sensors]
    noise = sigma * rng.normal(size=(8000, sensors))
    readings = all_angles(R, g)[:sensors] + noise
    found = estimated(readings, sigma, g)
    error = mechanism.small_vector(found.rotation @ R.T)
    variance = (error**2).sum(-1).mean()
    least = bound(R, sigma, g, sensors=sensors)
    least_variance = np.trace(least)
    assert variance / least_variance == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(found.covariance.mean(0), least, atol=0.03 * least_variance)
    vectors = found.parity_vector
    assert vectors.shape == (8000, sensors - 3)
    white = np.eye(sensors - 3).squeeze()
    np.testing.assert_allclose(np.cov(vectors.T), white, atol=0.05)
    np.testing.assert_allclose(vectors.mean(0), 0.0, atol=0.05)
    # One entry keeps its sign.
    expected = vectors[:, 0] if sensors == 4 else np.linalg.norm(vectors, axis=-1)
    np.testing.assert_allclose(found.parity, expected, rtol=1e-12)
    assert found.determined.all()
    assert found.consistent.mean() > 0.999


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_it_is_the_minimum_in_every_working_mode(sensors):
    rng = np.random.default_rng(304)
    checked = 0
    for trial in range(24):
        mode = mechanism.MODES[trial % 8]
        g = random_built(rng).geometry
        R = nominal().reachable_rotation(rng, slack=0.12)
        sigma = SIGMA * rng.uniform(0.5, 3.0, sensors)
        noise = sigma * rng.normal(size=sensors)
        readings = all_angles(R, g, mode)[:sensors] + noise

        def objective(rotation, g=g, mode=mode, readings=readings, sigma=sigma):
            expected = all_angles(rotation, g, mode)[:sensors]
            residual = wrapped(readings - expected) / sigma
            return (residual**2).sum()

        try:
            found = estimated(readings, sigma, g, prior=R)
        except SingularityError:
            continue
        if math.sqrt(np.trace(found.covariance)) > 0.01:
            continue  # a quadratic is no longer what the objective is
        # Parity is what is left at the minimum, ...
        value = objective(found.rotation)
        assert found.parity**2 == pytest.approx(value, abs=2e-3 * (1.0 + value))
        # ... and no neighbour has less, by the amount that the covariance predicts.
        root = np.linalg.cholesky(found.covariance)
        for direction in (*np.eye(3), *-np.eye(3)):
            aside = mechanism.turn(0.1 * root @ direction)
            near = objective(aside @ found.rotation)
            assert near - value == pytest.approx(0.01, abs=0.004)
        checked += 1
    assert checked > 15


def test_rows_are_fitted_together_where_the_closed_form_starts_them():
    """One by one they would take ten times as long."""
    rng = np.random.default_rng(305)
    R = kinematics.workspace_pose(0.15, 1.0, 1.1)
    readings = four_angles(R) + SIGMA * rng.normal(size=(50, 4))
    rotation, _, _ = fit_rows(readings, kinematics.UsedSensors((SIGMA,) * 4), PAPER)
    assert not np.isnan(rotation).any()
    for matrix in rotation:
        assert mechanism.angle_between(matrix, R) < 20.0 * SIGMA


# Rows of a batch of more than two slices, and those of them that close no mechanism.
ROWS = 2 * SLICE + 6
FAILING = [7, SLICE + 3]
# Rows at the ends of the batch and of its slices.
AT_ENDS = [
    0,
    SLICE - 1,
    SLICE,
    SLICE + 4,
    2 * SLICE - 1,
    2 * SLICE,
    2 * SLICE + 5,
]


def readings_of_a_long_batch(sensors):
    """Return noisy readings of one pose, some of which close no mechanism, (`ROWS`, sensors)."""
    rng = np.random.default_rng(64)
    true = all_angles(mechanism.tilted(0.3, 0.2, 1.0))[:sensors]
    noise = UNEQUAL[:sensors] * rng.normal(size=(ROWS, sensors))
    readings = true + noise
    closes_no_mechanism = [1.5, -1.5, 1.5, 1.0, 2.0, -2.0]
    readings[FAILING] = closes_no_mechanism[:sensors]
    return readings


def rows_of(batch, name):
    """Return an attribute of a batch, one row after the other."""
    values = getattr(batch, name)
    return values.reshape(ROWS, *values.shape[2:])


@pytest.mark.parametrize('sensors', [4, 6])
def test_only_the_rows_that_fail_are_nan(sensors):
    readings = readings_of_a_long_batch(sensors)
    batch = estimated(readings.reshape(2, SLICE + 3, sensors), UNEQUAL[:sensors])
    assert batch.parity_vector.shape == (2, SLICE + 3, sensors - 3)
    answered = np.isfinite(rows_of(batch, 'rotation')).all((1, 2))
    assert np.flatnonzero(~answered).tolist() == FAILING
    vector = rows_of(batch, 'parity_vector')
    np.testing.assert_array_equal(np.isfinite(vector).all(-1), answered)
    np.testing.assert_array_equal(rows_of(batch, 'determined'), answered)
    assert not rows_of(batch, 'consistent')[FAILING].any()
    with pytest.raises(SpmError):
        estimated(readings[FAILING[0]], UNEQUAL[:sensors])


@pytest.mark.parametrize('sensors', [4, 6])
def test_long_batches_are_their_rows(sensors):
    sigma = UNEQUAL[:sensors]
    readings = readings_of_a_long_batch(sensors)
    batch = estimated(readings.reshape(2, SLICE + 3, sensors), sigma)
    used = kinematics.UsedSensors(tuple(sigma))
    for row in AT_ENDS:
        single = estimated(readings[row], sigma)
        rotation = rows_of(batch, 'rotation')[row]
        covariance = rows_of(batch, 'covariance')[row]
        parity_vector = rows_of(batch, 'parity_vector')[row]
        parity = rows_of(batch, 'parity')[row]
        np.testing.assert_allclose(rotation, single.rotation, atol=1e-12)
        np.testing.assert_allclose(covariance, single.covariance, rtol=1e-5)
        np.testing.assert_allclose(parity_vector, single.parity_vector, atol=1e-6)
        # The path of one sample, in floats.
        sample = kinematics.estimate_sample(tuple(readings[row].tolist()), used, PAPER)
        rotation = kinematics.matrix_from_quaternion(sample.quaternion)
        covariance = np.reshape(sample.covariance, (3, 3))
        np.testing.assert_allclose(rotation, single.rotation, atol=1e-12)
        np.testing.assert_allclose(covariance, single.covariance, rtol=1e-5)
        np.testing.assert_allclose(sample.parity_vector, single.parity_vector, atol=1e-6)
        assert parity == pytest.approx(sample.parity, abs=1e-6)
        assert sample.parity == pytest.approx(float(single.parity), abs=1e-12)


def test_determined_is_not_consistent():
    R = mechanism.tilted(0.3, 0.2, 1.0)
    left, _, _ = np.linalg.svd(kinematics.jacobian(R, sensors=4))
    unseen_by_the_pose = left[:, 3]
    parities = np.array([0.0, 6.9, -6.9, 7.1, -7.1, 500.0])
    faults = np.outer(parities, SIGMA * unseen_by_the_pose)
    readings = four_angles(R) + faults
    batch = estimated(readings)
    assert batch.determined.all()
    expected = [True, True, True, False, False, False]
    np.testing.assert_array_equal(batch.consistent, expected)
    for row, reading in enumerate(readings):
        single = estimated(reading)
        assert single.consistent == expected[row]
        assert single.consistent.shape == ()


@pytest.mark.parametrize('total, determined', [(0.0999, True), (0.1001, False)])
def test_an_estimate_is_determined_up_to_a_total_deviation(total, determined):
    """What is not determined is not consistent."""
    # The readings of a pose agree: the covariance is proportional to the square of sigma.
    readings = four_angles(mechanism.tilted(0.5, 0.2, 1.0))
    deviation = math.sqrt(np.trace(estimated(readings).covariance))
    sigma = SIGMA * total / deviation
    single = estimated(readings, sigma)
    batch = estimated(readings[None], sigma)
    assert math.sqrt(np.trace(single.covariance)) == pytest.approx(total, rel=1e-9)
    assert batch.covariance[0] == pytest.approx(single.covariance)
    for found in (single, batch):
        assert found.determined == determined == found.consistent


def test_readings_beyond_half_a_turn_are_the_same():
    rng = np.random.default_rng(309)
    poses = (
        kinematics.workspace_pose(0.1, 1.0, 0.4),
        mechanism.tilted(0.9, 0.2, 3.0),
    )
    turns = np.array([1, -1, 0, 2, -1, 3])
    for R in poses:
        readings = all_angles(R) + SIGMA * rng.normal(size=6)
        plain = estimated(readings)
        turned = estimated(readings + 2.0 * math.pi * turns)
        np.testing.assert_allclose(turned.rotation, plain.rotation, atol=1e-12)
        np.testing.assert_allclose(turned.parity_vector, plain.parity_vector, atol=1e-7)
