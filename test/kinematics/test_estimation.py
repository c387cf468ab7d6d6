# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maximum likelihood: the bound, the optimum itself, parity, three of four, every working mode."""

import math

from mechanism import (
    angle_between,
    CENTRE,
    chain,
    MODES,
    random_geometry,
    reachable_rotation,
    SINGULAR_PHI,
    small_vector,
    tilted,
    turn,
    zxz,
)
import numpy as np
import pytest

from spm_haptic_master.exceptions import InputError, SingularityError, SpmError, UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import (
    estimate,
    estimate_sample,
    forward_theta3a,
    Geometry,
    inverse,
    inverse_angles,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    linkage,
    turn_equation,
    turn_of_second_joint,
)
from spm_haptic_master.kinematics.number_backends import FLOATS

PAPER = Geometry()
SIGMA = math.radians(0.04)


def four_angles(R, g=PAPER, mode=(1, 1, 1)):
    """Return the true readings th1A, th1B, th1C, th3A."""
    joints = inverse(R, g, mode)
    return np.concatenate([joints.theta1, joints.theta3a[..., None]], axis=-1)


def bound(R, sigma, g=PAPER, mode=(1, 1, 1)):
    """Cramer-Rao bound: covariance of the rotation vector, from the Jacobian."""
    G = jacobian(R, g, mode, sensors=4) / np.broadcast_to(sigma, 4)[:, None]
    return np.linalg.inv(G.T @ G)


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
            assert found.valid.all()
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
        # ... and no neighbour has less, by the amount the covariance says.
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
    assert batch.parity.shape == batch.valid.shape == (2, 3)
    for row, reading in enumerate(readings):
        place = divmod(row, 3)
        single = estimate(reading[:3], reading[3], sigma)
        sample = estimate_sample(*reading.tolist(), tuple(sigma.tolist()), Geometry())
        assert all(type(value) is float for value in (*sample.quaternion, *sample.covariance))
        assert type(sample.parity) is float and sample.valid is True
        rotation = matrix_from_quaternion(sample.quaternion)
        for found in (batch.rotation[place], rotation):
            np.testing.assert_allclose(found, single.rotation, atol=1e-13)
        covariance = np.reshape(sample.covariance, (3, 3))
        for found in (batch.covariance[place], covariance):
            np.testing.assert_allclose(found, single.covariance, rtol=1e-9, atol=1e-18)
        np.testing.assert_allclose(
            [batch.parity[place], sample.parity], single.parity, atol=1e-8)


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
        sample = estimate_sample(*angles.tolist(), (SIGMA,) * 4, Geometry())
        assert parity == pytest.approx(20.0 * sample.sensitivity[sensor], rel=0.05)
        signs.add(np.sign(parity))
    assert len(signs) == 1


@pytest.mark.parametrize('missing', JOINT_NAMES)
def test_any_three_of_four(missing):
    rng = np.random.default_rng(65)
    index = JOINT_NAMES.index(missing)
    present = [sensor for sensor in range(4) if sensor != index]
    for mode in MODES:
        R = reachable_rotation(rng, Geometry(), slack=0.1)
        G = jacobian(R, working_mode=mode, sensors=4)[present]
        if np.linalg.cond(G) > 20.0:
            continue
        sigma = SIGMA * np.array([1.0, 2.0, 0.5, 1.5])
        prior = turn(math.radians(0.5) * rng.normal(size=3)) @ R
        angles = four_angles(R, mode=mode)
        without = np.where(np.arange(4) == index, np.nan, angles)
        exact = estimate(without[:3], without[3], sigma, prior=prior, missing=missing)
        assert angle_between(exact.rotation, R) < 1e-9
        assert exact.valid and np.isnan(exact.parity)
        inverse_rows = np.linalg.inv(G)
        expected = inverse_rows @ np.diag(sigma[present]**2) @ inverse_rows.T
        np.testing.assert_allclose(exact.covariance, expected, rtol=1e-3, atol=1e-9)
        readings = angles + sigma * rng.normal(size=(300, 4))
        readings[:, index] = np.nan
        noisy = estimate(readings[:, :3], readings[:, 3], sigma, prior=prior, missing=missing)
        error = small_vector(noisy.rotation @ R.T)
        chi2 = np.einsum('ni,ij,nj->n', error, np.linalg.inv(expected), error).mean()
        assert abs(chi2 - 3.0) < 0.6
        # The three readings there are must be met.
        met = four_angles(noisy.rotation[0], mode=mode)[present]
        np.testing.assert_allclose(met, readings[0, present], atol=1e-7)


def test_three_active_sensors_at_the_singularity_are_not_valid():
    R = zxz(*CENTRE, SINGULAR_PHI)
    angles = four_angles(R)
    assert estimate(angles[:3], angles[3], SIGMA).valid
    try:
        found = estimate(angles[:3], angles[3], SIGMA, prior=R, missing='joint_3a')
    except SingularityError:
        return
    assert not found.valid


def test_three_active_sensors_are_valid_only_away_from_the_singularity():
    # 1-sigma bound about 2.9 deg at phi = 50 deg (facts.md, section 4), growing towards 49.36 deg.
    deviations = []
    for phi_deg in (53.0, 50.0, 49.46):
        R = zxz(*CENTRE, math.radians(phi_deg))
        angles = four_angles(R)
        found = estimate(angles[:3], angles[3], SIGMA, prior=R, missing='joint_3a')
        assert angle_between(found.rotation, R) < 1e-9
        deviations.append(math.degrees(math.sqrt(np.trace(found.covariance))))
        assert found.valid == (phi_deg > 49.5)
    assert deviations[0] < deviations[1] < deviations[2]
    assert deviations[1] == pytest.approx(2.9, abs=0.05)


def test_missing_needs_a_prior():
    angles = four_angles(tilted(0.3, 0.0, 0.0))
    with pytest.raises(InputError, match='prior'):
        estimate(angles[:3], angles[3], SIGMA, missing='joint_1b')
    with pytest.raises(InputError, match='prior'):
        estimate_sample(*angles.tolist(), (SIGMA,) * 4, Geometry(), missing='joint_1b')


def degenerate_pose(rng, g):
    """Find a pose at which the closed form's determinant vanishes, by bisection along a turn."""
    def determinant(R):
        th1a, th1b, th1c, _, th3a = inverse_angles(tuple(R.ravel().tolist()), g)
        _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, g, FLOATS)
        return turn_of_second_joint(leg_b, leg_c, g)[2]

    while True:
        R, axis = reachable_rotation(rng, g, slack=0.1), 0.1 * rng.normal(size=3)
        try:
            start, end = determinant(R), determinant(turn(axis) @ R)
            if start * end >= 0.0:
                continue
            low, high = 0.0, 1.0
            for _ in range(55):
                middle = 0.5 * (low + high)
                if determinant(turn(middle * axis) @ R) * start > 0.0:
                    low = middle
                else:
                    high = middle
        except UnreachableError:
            continue
        return turn(low * axis) @ R


def test_where_the_closed_form_is_degenerate_a_prior_selects():
    rng = np.random.default_rng(66)
    g = Geometry()
    ambiguous = 0
    for _ in range(30):
        R = degenerate_pose(rng, g)
        angles = four_angles(R, g)
        with pytest.raises(SingularityError):
            forward_theta3a(angles[:3], angles[3], g)
        prior = turn(math.radians(1.0) * rng.normal(size=3)) @ R
        found = estimate(angles[:3], angles[3], SIGMA, g, prior=prior)
        assert angle_between(found.rotation, R) < 1e-7
        np.testing.assert_allclose(
            found.covariance, bound(R, SIGMA, g), rtol=1e-3,
            atol=1e-3 * np.trace(found.covariance))
        try:
            alone = estimate(angles[:3], angles[3], SIGMA, g)
        except SingularityError as error:
            ambiguous += 1
            assert 'prior selects' in str(error)
            rows = estimate(angles[None, :3], angles[None, 3], SIGMA, g)
            assert np.isnan(rows.rotation).all() and not rows.valid[0]
        else:
            assert angle_between(alone.rotation, R) < 1e-7
    assert ambiguous > 0


def rival_of(R):
    """Readings at a pose, the other root of leg B's turn equation as an orientation."""
    joints = inverse(R)
    readings = four_angles(R)
    th1a, th1b, th1c, th3a = readings.tolist()
    _, _, leg_b, leg_c = linkage(th1a, th1b, th1c, th3a, PAPER, FLOATS)
    rival = max(
        both_turns(turn_equation(*leg_b, PAPER)),
        key=lambda th2a: abs(math.remainder(th2a - joints.theta2a, 2.0 * math.pi)))
    return readings, chain(th1a, rival, th3a, PAPER), turn_of_second_joint(leg_b, leg_c, PAPER)[2]


def test_two_solutions_are_ambiguous_up_to_three_sigma():
    rng = np.random.default_rng(72)
    R = turn([1e-3, 2e-3, -1e-3]) @ degenerate_pose(rng, PAPER)
    readings, prior, determinant = rival_of(R)
    # With a large sigma the prior selects the rival. Its parity is inversely proportional to it.
    large = 1.0
    rival = estimate(readings[:3], readings[3], large, prior=prior)
    assert angle_between(rival.rotation, R) > 0.1
    for squared, ambiguous in ((8.8, True), (9.2, False)):
        sigma = large * abs(rival.parity) / math.sqrt(squared)
        assert abs(determinant) < 10.0 * sigma
        if ambiguous:
            with pytest.raises(SingularityError, match='prior selects'):
                estimate(readings[:3], readings[3], sigma)
            found = estimate(readings[:3], readings[3], sigma, prior=prior)
            assert angle_between(found.rotation, rival.rotation) < 1e-6
        else:
            for last in (None, prior):
                found = estimate(readings[:3], readings[3], sigma, prior=last)
                assert angle_between(found.rotation, R) < 1e-9


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
            assert np.isnan(batch.rotation[row]).all() and not batch.valid[row]
            continue
        # Far from any mechanism Gauss-Newton converges slowly: both stop within the last step.
        np.testing.assert_allclose(batch.rotation[row], single.rotation, atol=1e-5)
        assert batch.valid[row] == single.valid
    assert np.isnan(batch.rotation[:-1]).any() and batch.valid[-1]


def test_a_prior_has_no_weight():
    angles = four_angles(tilted(0.3, 0.1, 0.0)) + SIGMA * np.array([1.0, -1.0, 2.0, 0.5])
    plain = estimate(angles[:3], angles[3], SIGMA)
    other = estimate(angles[:3], angles[3], SIGMA, prior=tilted(0.2, 0.2, 2.0))
    np.testing.assert_array_equal(plain.rotation, other.rotation)
    sample = estimate_sample(
        *angles.tolist(), (SIGMA,) * 4, Geometry(),
        prior=tuple(quaternion_from_matrix(tilted(0.2, 0.2, 2.0)).tolist()))
    np.testing.assert_allclose(
        matrix_from_quaternion(sample.quaternion), plain.rotation, atol=1e-14)
