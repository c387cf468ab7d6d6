# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood with four sensors: the bound, the optimum itself, parity, all modes."""

import math

from mechanism import (
    angle_between,
    MODES,
    random_geometry,
    reachable_rotation,
    small_vector,
    tilted,
    turn,
)
import numpy as np
import pytest
from readings import bound, four_angles, SIGMA
from spm_haptic_master.exceptions import SingularityError, SpmError, UnreachableError
from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    forward_theta3a,
    Geometry,
    jacobian,
    matrix_from_quaternion,
    UsedSensors,
)
from spm_haptic_master.kinematics.number_backends import SLICE

# facts.md, section 5: phi, then (closed form, bound, worst ratio) at 0, 13, 20, 26 deg tilt.
TABLE = {
    50: [(0.046, 0.044, 1.06), (0.053, 0.050, 1.09), (0.060, 0.054, 1.16), (0.074, 0.058, 1.36)],
    20: [(0.049, 0.039, 1.23), (0.058, 0.044, 1.40), (0.069, 0.048, 1.67), (0.096, 0.056, 2.38)],
    0: [(0.056, 0.038, 1.47), (0.070, 0.044, 1.79), (0.090, 0.056, 2.32), (0.200, 0.105, 5.21)]}


@pytest.mark.parametrize('phi', TABLE)
def test_table_of_what_four_sensors_contain(phi):
    for tilt, expected in zip((0.0, 13.0, 20.0, 26.0), TABLE[phi], strict=True):
        rows = []
        for azimuth in np.radians(np.arange(0.0, 360.0, 15.0)):
            R = tilted(math.radians(phi), math.radians(tilt), azimuth)
            try:
                angles = four_angles(R)
            except UnreachableError:
                continue
            step = 1e-6 * np.eye(4)
            ahead, behind = (
                forward_theta3a(shifted[:, :3], shifted[:, 3])
                for shifted in (angles + step, angles - step))
            rates = small_vector(ahead @ np.swapaxes(behind, -1, -2)) / 2e-6
            closed_form = 0.04 * np.linalg.norm(rates)
            covariance = estimate(angles[:3], angles[3], math.radians(0.04)).covariance
            rows.append((closed_form, math.degrees(math.sqrt(np.trace(covariance)))))
        closed_form, least = np.array(rows).T
        found = closed_form.max(), least.max(), (closed_form / least).max()
        np.testing.assert_allclose(found[:2], expected[:2], atol=5.5e-4)
        assert found[2] == pytest.approx(expected[2], abs=0.0055)


@pytest.mark.parametrize('phi_deg', [0.0, 20.0, 40.0, 50.0])
def test_monte_carlo_is_at_the_bound_over_the_workspace(phi_deg):
    rng = np.random.default_rng(60)
    sigma = SIGMA * np.ones(4)
    checked = 0
    for tilt in np.radians([0.0, 13.0, 20.0, 26.0]):
        for azimuth in np.radians(np.arange(0.0, 360.0, 60.0) + 10.0):
            R = tilted(math.radians(phi_deg), tilt, azimuth)
            try:
                angles = four_angles(R)
            except UnreachableError:
                continue
            readings = angles + sigma * rng.normal(size=(10000, 4))
            found = estimate(readings[:, :3], readings[:, 3], sigma)
            error = small_vector(found.rotation @ R.T)
            least = bound(R, sigma)
            ratio = math.sqrt((error**2).sum(-1).mean() / np.trace(least))
            assert abs(ratio - 1.0) < 0.03
            assert found.determined.all()
            # The stated covariance is the bound, the errors have it, parity has unit variance.
            np.testing.assert_allclose(
                found.covariance.mean(0), least, atol=0.03 * np.trace(least))
            assert abs(np.einsum('ni,ij,nj->n', error, np.linalg.inv(least), error).mean()
                       - 3.0) < 0.12
            assert abs(found.parity.std() - 1.0) < 0.03 and abs(found.parity.mean()) < 0.05
            checked += 1
    assert checked > 15


def objective(R, readings, sigma, g, mode):
    """Weighted sum of squares of readings minus inverse model."""
    residual = np.vectorize(math.remainder)(readings - four_angles(R, g, mode), 2.0 * math.pi)
    return (residual**2 / np.broadcast_to(sigma, 4)**2).sum()


@pytest.mark.parametrize('mode', MODES)
def test_it_is_the_minimum_in_every_working_mode(mode):
    rng = np.random.default_rng(61)
    checked = 0
    for trial in range(30):
        g = Geometry() if trial % 2 else random_geometry(rng)
        R = reachable_rotation(rng, g, slack=0.05)
        sigma = SIGMA * rng.uniform(0.5, 3.0, 4)
        readings = four_angles(R, g, mode) + sigma * rng.normal(size=4)
        least = bound(R, sigma, g, mode)
        if math.sqrt(np.trace(least)) > 0.02:
            continue  # a quadratic is no longer what the objective is
        found = estimate(readings[:3], readings[3], sigma, g, prior=R)
        checked += 1
        value = objective(found.rotation, readings, sigma, g, mode)
        # Parity is what is left at the minimum ...
        assert found.parity**2 == pytest.approx(value, abs=1e-4 * (1.0 + value))
        # ... and no neighbour has less, by the amount that the covariance predicts.
        root = np.linalg.cholesky(found.covariance)
        for direction in (*np.eye(3), *-np.eye(3)):
            near = objective(
                turn(0.1 * root @ direction) @ found.rotation, readings, sigma, g, mode)
            assert near - value == pytest.approx(0.01, abs=0.004)
    assert checked > 15


def test_consistent_angles_give_the_pose_to_rounding():
    rng = np.random.default_rng(62)
    for _ in range(200):
        R = tilted(rng.uniform(-0.2, 1.0), rng.uniform(0.0, 0.4), rng.uniform(0.0, 6.28))
        try:
            angles = four_angles(R)
        except UnreachableError:
            continue
        found = estimate(angles[:3], angles[3], SIGMA)
        assert angle_between(found.rotation, R) < 1e-12
        assert abs(found.parity) < 1e-8


def test_floats_single_and_batch_agree():
    rng = np.random.default_rng(63)
    R = tilted(0.3, 0.2, 1.0)
    readings = four_angles(R) + SIGMA * rng.normal(size=(6, 4))
    sigma = SIGMA * np.array([1.0, 2.0, 0.5, 1.5])
    batch = estimate(readings[:, :3].reshape(2, 3, 3), readings[:, 3].reshape(2, 3), sigma)
    assert batch.rotation.shape == (2, 3, 3, 3) and batch.covariance.shape == (2, 3, 3, 3)
    assert batch.parity.shape == batch.determined.shape == (2, 3)
    for row, reading in enumerate(readings):
        place = divmod(row, 3)
        single = estimate(reading[:3], reading[3], sigma)
        sample = estimate_sample(
            tuple(reading.tolist()), UsedSensors(tuple(sigma.tolist())), Geometry())
        assert all(type(value) is float for value in (*sample.quaternion, *sample.covariance))
        assert type(sample.parity) is float and sample.determined is True
        rotation = matrix_from_quaternion(sample.quaternion)
        for found in (batch.rotation[place], rotation):
            np.testing.assert_allclose(found, single.rotation, atol=1e-13)
        covariance = np.reshape(sample.covariance, (3, 3))
        for found in (batch.covariance[place], covariance):
            np.testing.assert_allclose(found, single.covariance, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(
            [batch.parity[place], sample.parity], single.parity, atol=1e-8)


def test_long_batches_are_their_rows():
    rng = np.random.default_rng(64)
    R = tilted(0.3, 0.2, 1.0)
    readings = four_angles(R) + SIGMA * rng.normal(size=(2 * SLICE + 5, 4))
    readings[SLICE + 3] = [1.5, -1.5, 1.5, 1.0]  # closes no mechanism
    found = estimate(readings[:, :3], readings[:, 3], SIGMA)
    answered = np.isfinite(found.rotation).all((1, 2))
    assert np.flatnonzero(~answered).tolist() == [SLICE + 3]
    np.testing.assert_array_equal(found.determined, answered)
    for row in (0, SLICE - 1, SLICE, SLICE + 4, 2 * SLICE - 1, 2 * SLICE, 2 * SLICE + 4):
        single = estimate(readings[row, :3], readings[row, 3], SIGMA)
        np.testing.assert_allclose(found.rotation[row], single.rotation, atol=1e-12)
        np.testing.assert_allclose(found.covariance[row], single.covariance, rtol=1e-8)
        assert found.parity[row] == pytest.approx(single.parity, abs=1e-8)


@pytest.mark.parametrize('sensor', range(4))
def test_parity_sees_a_fault_with_a_steady_sign(sensor):
    signs = set()
    for phi_deg in (0.0, 10.0, 20.0, 30.0):
        angles = four_angles(tilted(math.radians(phi_deg), 0.1, 0.5))
        shifted = angles + 20.0 * SIGMA * np.eye(4)[sensor]
        parity = estimate(shifted[:3], shifted[3], SIGMA).parity
        # To first order: the shift's part outside the span of the Jacobian.
        G = jacobian(tilted(math.radians(phi_deg), 0.1, 0.5), sensors=4)
        null = np.linalg.svd(G)[0][:, 3]
        assert abs(parity) == pytest.approx(20.0 * abs(null[sensor]), rel=0.05)
        sample = estimate_sample(
            tuple(angles.tolist()), UsedSensors((SIGMA,) * 4), Geometry())
        assert parity == pytest.approx(
            20.0 * SIGMA * sample.parity_gains[sensor][0], rel=0.05)
        signs.add(np.sign(parity))
    assert len(signs) == 1


def test_determined_is_not_consistent():
    angles = four_angles(tilted(0.3, 0.2, 1.0))
    G = jacobian(tilted(0.3, 0.2, 1.0), sensors=4)
    fault = SIGMA * np.linalg.svd(G)[0][:, 3]
    readings = angles + fault * np.array([0.0, 6.9, -6.9, 7.1, -7.1, 500.0])[:, None]
    batch = estimate(readings[:, :3], readings[:, 3], SIGMA)
    assert batch.determined.all()
    expected = [True, True, True, False, False, False]
    np.testing.assert_array_equal(batch.consistent, expected)
    for row, reading in enumerate(readings):
        single = estimate(reading[:3], reading[3], SIGMA)
        assert single.consistent == expected[row] and single.consistent.shape == ()


def test_what_is_not_determined_is_not_consistent():
    angles = four_angles(tilted(0.3, 0.2, 1.0))
    for sigma in (SIGMA, 0.5):
        found = estimate(angles[:3], angles[3], sigma)
        assert abs(found.parity) < 1e-6
        assert found.determined == found.consistent == (sigma == SIGMA)


def test_nothing_is_consistent_with_a_sensor_missing_or_without_an_answer():
    R = tilted(0.3, 0.2, 1.0)
    angles = four_angles(R)
    found = estimate(angles[:3], angles[3], SIGMA, prior=R, missing='joint_1b')
    assert found.determined and not found.consistent
    rows = estimate([[1.5, -1.5, 1.5]], [1.0], SIGMA)
    assert np.isnan(rows.rotation).all() and not rows.consistent[0]


def test_gross_contradictions_do_not_pass_quietly():
    rng = np.random.default_rng(67)
    loud = 0
    for _ in range(500):
        readings = rng.uniform(-math.pi, math.pi, 4)
        try:
            found = estimate(readings[:3], readings[3], SIGMA)
        except (UnreachableError, SingularityError):
            loud += 1
            continue
        R = found.rotation
        np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) > 0.0
        if abs(found.parity) > 10.0:
            loud += 1
            continue
        # What little passes is a pose that the readings fit.
        fits = []
        for mode in MODES:
            try:
                fits.append(objective(R, readings, SIGMA, Geometry(), mode))
            except SpmError:
                continue
        assert min(fits) == pytest.approx(found.parity**2, rel=1e-2, abs=1e-3)
    assert loud > 450


def test_rows_that_fail_are_nan_and_only_those():
    rng = np.random.default_rng(68)
    good = four_angles(tilted(0.3, 0.1, 0.0))
    readings = np.concatenate([rng.uniform(-math.pi, math.pi, (100, 4)), [good]])
    batch = estimate(readings[:, :3], readings[:, 3], SIGMA)
    for row, reading in enumerate(readings):
        try:
            single = estimate(reading[:3], reading[3], SIGMA)
        except SpmError:
            assert np.isnan(batch.rotation[row]).all() and not batch.determined[row]
            continue
        # Far from any mechanism Gauss-Newton converges slowly: both stop within the last step.
        np.testing.assert_allclose(batch.rotation[row], single.rotation, atol=1e-5)
        assert batch.determined[row] == single.determined
    assert np.isnan(batch.rotation[:-1]).any() and batch.determined[-1]
