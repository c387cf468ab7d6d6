# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The mechanism as built: every model against an independent statement of the mechanism."""

import copy
import math
import pickle

from built_mechanism import ALPHA, BETA, Built, GAMMA, nominal, random_built
from mechanism import angle_between, MODES, random_rotations, small_vector, turn
import numpy as np
import pytest
from spm_haptic_master.exceptions import GeometryError, UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import (
    dexterity,
    estimate,
    estimate_sample,
    forward_all,
    forward_theta2a,
    forward_theta3a,
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    measured_angles,
    mechanism_angles,
    parallel_determinant,
    quaternion_from_matrix,
    singularity_locus,
    theta3a_quaternion,
    track_mode,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.kinematics.closed_form import theta3a_gains
from spm_haptic_master.kinematics.leg_kernels import (
    linkage,
    turn_of_second_joint,
    turn_of_third_joint,
)
from spm_haptic_master.kinematics.number_backends import FLOATS
from spm_haptic_master.kinematics.singularity import approach, determinant_gradient, nearness

SIGMA = math.radians(0.04)
# Smallest determinant of A, and |B_kk| of a leg, beyond which rounding of 1e-16 stays below 1e-9.
WELL_POSED = 1e-4
# Largest error of a closed form times its determinant (rad): below 1e-9 rad where the determinant
# exceeds 4e-6, as at all but one in two thousand poses.
CLOSED_FORM_ROUNDING = 4e-15


def wrapped(angles):
    """Angles into ]-pi, pi]."""
    return np.angle(np.exp(1j * np.asarray(angles)))


def four_angles(R, g, mode=(1, 1, 1)):
    joints = inverse(R, g, mode)
    return np.append(joints.theta1, joints.theta3a)


def closed_form_determinants(joints, g):
    """Return the determinants of Cases 1 and 2."""
    th1 = joints.theta1.tolist()
    _, _, leg_b, leg_c = linkage(*th1, float(joints.theta3a), g, FLOATS)
    return (turn_of_third_joint(*th1, float(joints.theta2a), g, FLOATS)[2],
            turn_of_second_joint(leg_b, leg_c)[2])


# Zeros and frames ------------------------------------------------------------------------------

@pytest.mark.parametrize('angles', [
    (ALPHA, BETA, GAMMA), (0.7, 1.1, 0.9), (1.2, 0.8, 2.0), (0.9, 0.9, 0.01)])
def test_nominal_axes_are_the_nominal_mechanism(angles):
    built, g = nominal(*angles), Geometry(*angles)
    as_built = built.geometry
    np.testing.assert_allclose(as_built.platform_axes, g.platform_axes, atol=1e-15)
    assert as_built.base_axes == g.base_axes
    np.testing.assert_allclose(as_built.chain, g.chain, atol=1e-15)
    rng = np.random.default_rng(180)
    for _ in range(20):
        R = built.reachable_rotation(rng)
        for mode in MODES:
            here, there = inverse(R, as_built, mode), inverse(R, g, mode)
            np.testing.assert_allclose(wrapped(here.theta1 - there.theta1), 0.0, atol=1e-12)
            np.testing.assert_allclose(wrapped(here.theta2a - there.theta2a), 0.0, atol=1e-12)
            np.testing.assert_allclose(wrapped(here.theta3a - there.theta3a), 0.0, atol=1e-12)


def test_zeros_of_the_joints_are_those_of_the_independent_statement():
    rng = np.random.default_rng(181)
    for _ in range(30):
        built = random_built(rng, 20.0)
        for k, leg in enumerate(built.geometry.legs):
            first, second, third, R = built.zero[k]
            in_base = np.reshape(leg.base_frame, (3, 3))
            np.testing.assert_allclose(in_base[:, 2], first, atol=1e-14)
            np.testing.assert_allclose(leg.second[0] + np.array(leg.second[1]), second, atol=1e-14)
            in_platform = np.reshape(leg.platform_frame, (3, 3))
            np.testing.assert_allclose(in_platform[:, 2], built.platform[k], atol=1e-14)
            np.testing.assert_allclose((R @ in_platform)[:, 2], third, atol=1e-14)
            np.testing.assert_allclose((R @ in_platform)[:, 0], in_base[:, 0], atol=1e-14)


def test_other_frames_are_the_same_mechanism():
    # A turned base or platform frame turns R, and moves each joint's zero by a constant.
    rng = np.random.default_rng(182)
    built = random_built(rng)
    base, platform = turn([0.3, -0.2, 0.4]), turn([-0.2, 0.3, 0.5])
    moved = Built(built.base @ base.T, built.platform @ platform.T, built.alpha, built.beta)
    offsets = []
    for _ in range(10):
        R = built.reachable_rotation(rng)
        here = four_angles(R, built.geometry)
        there = four_angles(base @ R @ platform.T, moved.geometry)
        offsets.append(wrapped(there - here))
        np.testing.assert_allclose(
            jacobian(base @ R @ platform.T, moved.geometry, sensors=4),
            jacobian(R, built.geometry, sensors=4) @ base.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(wrapped(np.array(offsets) - offsets[0]), 0.0, atol=1e-9)
    assert np.abs(offsets[0]).max() > 0.1


# Models ----------------------------------------------------------------------------------------

def check_models(built, mode, rng):
    """Check inverse and forward models at one random pose; return whether it was well posed."""
    g = built.geometry
    R = built.reachable_rotation(rng)
    joints = inverse(R, g, mode)
    th1, th2a, th3a = joints.theta1, float(joints.theta2a), float(joints.theta3a)
    # The independent mechanism closes, in the working mode asked for.
    np.testing.assert_allclose(built.closures(th1, R), 0.0, atol=1e-12)
    assert built.working_mode(th1, R) == mode
    assert angle_between(built.chain(0, th1[0], th2a, th3a), R) < 1e-9
    floats = mechanism_angles(tuple(R.ravel().tolist()), g, mode)
    np.testing.assert_allclose(floats[::3] + floats[1:3], [*th1, th2a, th3a], atol=1e-12)
    modes = forward_all(th1, g)
    assert len(modes) <= 8
    np.testing.assert_allclose(built.closures(th1, modes), 0.0, atol=2e-12)
    # The inverse model leads back, in the working mode of each assembly mode.
    for matrix, volumes in zip(modes, built.leg_volumes(th1, modes), strict=True):
        if np.abs(volumes).min() > 0.01:
            signs = tuple(1 if volume > 0.0 else -1 for volume in volumes)
            again = measured_angles(tuple(matrix.ravel().tolist()), g, signs, 4)[:3]
            np.testing.assert_allclose(wrapped(again - th1), 0.0, atol=1e-9)
    closed_forms = (
        forward_theta2a(th1, th2a, g), forward_theta3a(th1, th3a, g),
        matrix_from_quaternion(theta3a_quaternion(*th1.tolist(), th3a, g)))
    case_1, case_2 = closed_form_determinants(joints, g)
    for found, determinant in zip(closed_forms, (case_1, case_2, case_2), strict=True):
        assert angle_between(found, R) < CLOSED_FORM_ROUNDING / abs(determinant)
    if min(abs(parallel_determinant(R, g, mode)), abs(case_2)) < WELL_POSED:
        return False
    assert min(angle_between(R, matrix) for matrix in modes) < 1e-9
    assert angle_between(estimate(th1, th3a, SIGMA, g, prior=R).rotation, R) < 1e-9
    return abs(case_1) > 4e-6


@pytest.mark.parametrize('mode', MODES)
def test_models_of_twenty_mechanisms_in_a_working_mode(mode):
    rng = np.random.default_rng(183)
    assert sum(check_models(random_built(rng), mode, rng) for _ in range(20)) >= 18


@pytest.mark.slow
def test_models_of_four_hundred_mechanisms_in_all_working_modes():
    rng = np.random.default_rng(184)
    well_posed = 0
    for _ in range(400):
        built = random_built(rng)
        well_posed += sum(check_models(built, mode, rng) for mode in MODES)
    assert well_posed > 0.97 * 400 * 8


def search(built, th1, rng, starts, steps=50):
    """All modes that a damped Newton finds on the closures from many random rotations."""
    second, R = built.second_axes(th1), random_rotations(rng, starts)
    found = []
    for _ in range(steps):
        third = built.platform @ np.swapaxes(R, 1, 2)
        f = (second * third).sum(-1) - np.cos(built.beta)
        error = np.abs(f).max(-1)
        for matrix in R[error < 1e-12]:
            if all(np.abs(matrix - other).max() > 1e-5 for other in found):
                found.append(matrix)
        R, third, f = R[error > 1e-13], third[error > 1e-13], f[error > 1e-13]
        rows = np.cross(third, second)
        damping = 1e-3 * (f**2).sum(-1) + 1e-28
        normal = np.swapaxes(rows, 1, 2) @ rows + damping[:, None, None] * np.eye(3)
        step = -np.linalg.solve(normal, np.swapaxes(rows, 1, 2) @ f[..., None])[..., 0]
        length = np.linalg.norm(step, axis=-1, keepdims=True)
        step *= np.minimum(1.0, 0.5 / np.maximum(length, 1e-30))
        R = np.array([turn(vector) for vector in step]).reshape(-1, 3, 3) @ R
    return found


def check_assembly_modes(built, mode, rng, starts):
    R = built.reachable_rotation(rng)
    th1 = inverse(R, built.geometry, mode).theta1
    modes = forward_all(th1, built.geometry)
    found = search(built, th1, rng, starts)
    assert len(found) == len(modes)
    for matrix in found:
        assert min(angle_between(matrix, other) for other in modes) < 1e-6
    return len(modes)


def test_all_assembly_modes_of_two_mechanisms():
    rng = np.random.default_rng(185)
    for mode in (MODES[0], MODES[5]):
        check_assembly_modes(random_built(rng), mode, rng, 60)


@pytest.mark.slow
def test_all_assembly_modes_of_forty_mechanisms():
    rng = np.random.default_rng(186)
    counts = []
    for trial in range(40):
        # Every other one of a design with more modes than the paper's.
        angles = {} if trial % 2 else {'alpha': 1.05, 'beta': 1.2, 'gamma': 0.87}
        counts.append(check_assembly_modes(
            random_built(rng, **angles), MODES[trial % 8], rng, 250))
    assert {2, 4} <= set(counts) and max(counts) >= 6


def test_tracking_follows_a_mechanism_as_built():
    rng = np.random.default_rng(187)
    built = random_built(rng)
    last = workspace_pose(0.1, 0.3, math.radians(10.0))
    for phi_deg in np.arange(10.0, 30.0, 0.5):
        R = workspace_pose(0.1, 0.3, math.radians(phi_deg))
        tracked = track_mode(inverse(R, built.geometry).theta1, last, built.geometry)
        assert angle_between(tracked.rotation, R) < 1e-9 and not tracked.ambiguous
        last = tracked.rotation


# Velocities and singularities ------------------------------------------------------------------

def differences(R, g, mode, step=1e-5):
    """Rates of th1A, th1B, th1C, th3A along turns about the base axes, by central differences."""
    columns = []
    for axis in np.eye(3):
        ahead, behind = (four_angles(turn(sign * step * axis) @ R, g, mode) for sign in (1, -1))
        columns.append(wrapped(ahead - behind) / (2.0 * step))
    return np.stack(columns, axis=-1)


def check_jacobians(mode, rng, count):
    for _ in range(count):
        built = random_built(rng)
        g, R = built.geometry, built.reachable_rotation(rng, slack=0.1)
        expected = differences(R, g, mode)
        G = jacobian(R, g, mode, sensors=4)
        np.testing.assert_allclose(G, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_array_equal(jacobian(R, g, mode), G[:3])
        # Power balance: motor torques do the work of the moment on the platform.
        torque, omega = rng.normal(size=3), rng.normal(size=3)
        assert torque @ (G[:3] @ omega) == pytest.approx((G[:3].T @ torque) @ omega)
        for sensors in (3, 4):
            values = np.linalg.svd(expected[:sensors], compute_uv=False)
            assert dexterity(R, g, mode, sensors) == pytest.approx(
                values[2] / values[0], rel=1e-5, abs=1e-8)
        near = nearness(tuple(quaternion_from_matrix(R).tolist()), g, mode)
        assert near.three == pytest.approx(dexterity(R, g, mode), abs=1e-9)
        assert near.every == pytest.approx(dexterity(R, g, mode, 4), abs=1e-9)


@pytest.mark.parametrize('mode', MODES)
def test_jacobians_are_finite_differences(mode):
    check_jacobians(mode, np.random.default_rng(188), 15)


@pytest.mark.slow
@pytest.mark.parametrize('mode', MODES)
def test_jacobians_of_four_hundred_mechanisms(mode):
    check_jacobians(mode, np.random.default_rng(200 + MODES.index(mode)), 50)


def test_the_determinants_gradient_is_a_finite_difference():
    rng = np.random.default_rng(189)
    for trial in range(20):
        built, mode = random_built(rng), MODES[trial % 8]
        g, R = built.geometry, built.reachable_rotation(rng, slack=0.1)
        value, gradient = determinant_gradient(tuple(R.ravel().tolist()), g, mode)
        assert value == pytest.approx(parallel_determinant(R, g, mode), abs=1e-12)
        expected = [(parallel_determinant(turn(1e-5 * axis) @ R, g, mode)
                     - parallel_determinant(turn(-1e-5 * axis) @ R, g, mode)) / 2e-5
                    for axis in np.eye(3)]
        np.testing.assert_allclose(gradient, expected, rtol=1e-5, atol=1e-6)


def test_the_nearest_singularity_and_the_locus_are_singular():
    rng = np.random.default_rng(190)
    for _ in range(3):
        g = random_built(rng).geometry
        tilt, azimuth = singularity_locus(math.radians(49.0), 0.4, g, rays=24, circles=12)
        assert len(tilt) > 4
        poses = workspace_pose(tilt, azimuth, math.radians(49.0))
        np.testing.assert_allclose(parallel_determinant(poses, g), 0.0, atol=1e-12)
        assert dexterity(poses, g).max() < 1e-9
        R = workspace_pose(0.05, 1.0, math.radians(40.0))
        found = approach(tuple(quaternion_from_matrix(R).tolist()), g, (1, 1, 1))
        there = turn(found.distance * np.array(found.axis)) @ R
        assert abs(parallel_determinant(there, g)) < 1e-9
        assert 0.01 < found.distance < 0.5


def test_gains_of_the_closed_form_are_finite_differences():
    rng = np.random.default_rng(191)
    for _ in range(10):
        g = random_built(rng).geometry
        R = workspace_pose(rng.uniform(0.0, 0.3), rng.uniform(0.0, 6.0), rng.uniform(0.2, 1.4))
        readings = four_angles(R, g)
        steps = 1e-6 * np.eye(4)
        ahead, behind = (forward_theta3a(shifted[:, :3], shifted[:, 3], g)
                         for shifted in (readings + steps, readings - steps))
        np.testing.assert_allclose(
            theta3a_gains(*readings.tolist(), g),
            small_vector(ahead @ np.swapaxes(behind, 1, 2)) / 2e-6, rtol=1e-5, atol=1e-6)


# Estimate --------------------------------------------------------------------------------------

def bound(R, sigma, g):
    G = differences(R, g, (1, 1, 1)) / np.broadcast_to(sigma, 4)[:, None]
    return np.linalg.inv(G.T @ G)


def check_bound(built, R, sigma, rng, count):
    g = built.geometry
    readings = four_angles(R, g) + sigma * rng.normal(size=(count, 4))
    found = estimate(readings[:, :3], readings[:, 3], sigma, g)
    error, least = small_vector(found.rotation @ R.T), bound(R, sigma, g)
    assert (error**2).sum(-1).mean() / np.trace(least) == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(found.covariance.mean(0), least, atol=0.03 * np.trace(least))
    assert found.parity.std() == pytest.approx(1.0, abs=0.02)
    assert abs(found.parity.mean()) < 0.03
    assert found.consistent.mean() > 0.999


def test_the_estimate_is_at_the_bound():
    rng = np.random.default_rng(192)
    sigma = SIGMA * np.array([1.0, 2.0, 0.5, 1.5])
    for tilt, azimuth, phi_deg in ((0.0, 0.0, 30.0), (0.25, 2.0, 70.0), (0.1, 4.0, 49.0)):
        check_bound(random_built(rng), workspace_pose(tilt, azimuth, math.radians(phi_deg)),
                    sigma, rng, 30000)


@pytest.mark.slow
def test_the_estimate_is_at_the_bound_over_the_workspace():
    rng = np.random.default_rng(193)
    for _ in range(30):
        sigma = SIGMA * rng.uniform(0.5, 2.0, 4)
        R = workspace_pose(rng.uniform(0.0, 0.3), rng.uniform(0.0, 6.3), rng.uniform(0.2, 1.3))
        check_bound(random_built(rng), R, sigma, rng, 30000)


def test_floats_single_and_batch_agree():
    rng = np.random.default_rng(194)
    g = random_built(rng).geometry
    R = workspace_pose(0.1, 1.0, 0.6)
    readings = four_angles(R, g) + SIGMA * rng.normal(size=(5, 4))
    batch = estimate(readings[:, :3], readings[:, 3], SIGMA, g)
    for row, reading in enumerate(readings):
        single = estimate(reading[:3], reading[3], SIGMA, g)
        sample = estimate_sample(tuple(reading.tolist()), UsedSensors((SIGMA,) * 4), g)
        np.testing.assert_allclose(batch.rotation[row], single.rotation, atol=1e-13)
        np.testing.assert_allclose(
            matrix_from_quaternion(sample.quaternion), single.rotation, atol=1e-13)
        np.testing.assert_allclose(batch.covariance[row], single.covariance, rtol=1e-8)
        assert batch.parity[row] == pytest.approx(sample.parity, abs=1e-8)
        # The gains are the covariance of the rotation with the joints over the variance.
        np.testing.assert_allclose(
            SIGMA**2 * np.array(sample.gains),
            differences(single.rotation, g, (1, 1, 1)) @ single.covariance,
            rtol=1e-2, atol=1e-10)


@pytest.mark.parametrize('missing', JOINT_NAMES)
def test_any_three_sensors_of_a_mechanism_as_built(missing):
    rng = np.random.default_rng(195)
    g = random_built(rng).geometry
    R = workspace_pose(0.1, 1.0, 0.3)
    angles = four_angles(R, g)
    index = JOINT_NAMES.index(missing)
    angles[index] = math.nan
    prior = turn(0.01 * rng.normal(size=3)) @ R
    found = estimate(angles[:3], angles[3], SIGMA, g, prior=prior, missing=missing)
    assert angle_between(found.rotation, R) < 1e-9
    G = np.delete(differences(R, g, (1, 1, 1)), index, axis=0) / SIGMA
    np.testing.assert_allclose(
        found.covariance, np.linalg.inv(G.T @ G), rtol=1e-4, atol=1e-10)


def test_tolerances_contradict_the_nominal_model():
    # 0.2 deg of tolerances: the nominal model sees a contradiction and errs, the built one not.
    rng = np.random.default_rng(196)
    errors = []
    for _ in range(20):
        g = random_built(rng, 0.2).geometry
        R = workspace_pose(0.2, rng.uniform(0.0, 6.0), rng.uniform(0.3, 1.2))
        angles = four_angles(R, g)
        right, wrong = (estimate(angles[:3], angles[3], SIGMA, each) for each in (g, Geometry()))
        assert angle_between(right.rotation, R) < 1e-9 and abs(right.parity) < 1e-8
        errors.append(math.degrees(angle_between(wrong.rotation, R)))
    assert 0.05 < np.median(errors) < 0.5


def test_out_of_reach():
    g = random_built(np.random.default_rng(197)).geometry
    R = np.diag([-1.0, -1.0, 1.0])
    with pytest.raises(UnreachableError, match='from_axes'):
        inverse(R, g)
    assert np.isnan(inverse(R[None], g).theta1).all()


# The value -------------------------------------------------------------------------------------

def test_a_mechanism_as_built_is_a_value():
    built = random_built(np.random.default_rng(198))
    g = built.geometry
    again = Built(built.base, built.platform, built.alpha, built.beta).geometry
    assert g is not again and g == again and hash(g) == hash(again) and g != Geometry()
    assert pickle.loads(pickle.dumps(g)) == g == copy.deepcopy(g)
    assert eval(repr(g), {'Geometry': Geometry}) == g
    np.testing.assert_allclose(g.alphas, built.alpha)
    np.testing.assert_allclose(g.betas, built.beta)
    for name in ('alpha', 'beta', 'gamma'):
        with pytest.raises(GeometryError, match=f'{name} of a mechanism as built'):
            getattr(g, name)


GOOD = nominal()


@pytest.mark.parametrize('name, value, quoted', [
    ('base_axes', np.eye(3)[:2], r'\(2, 3\)'), ('base_axes', np.eye(4), r'\(4, 4\)'),
    ('base_axes', np.zeros((2, 3, 3)), r'\(2, 3, 3\)'), ('base_axes', None, 'None'),
    ('base_axes', [['x'] * 3] * 3, 'x'), ('base_axes', np.full((3, 3), np.nan), 'nan'),
    ('base_axes', 1.001 * GOOD.base, r'row 0 = \[0.0, 0.0, 1.001\] has length 1.001'),
    ('base_axes', 0.0 * GOOD.base, 'length 0'),
    ('base_axes', GOOD.base[[0, 0, 2]], 'rows 0 and 1 .*parallel to 0 deg'),
    ('base_axes', np.stack([GOOD.base[0], GOOD.base[1], -GOOD.base[1]]), 'rows 1 and 2 .*parall'),
    ('base_axes', GOOD.base * [[1], [1], [-1]], r'Z1C = \[.*-1.0, .*\] is opposite to'),
    ('platform_axes', GOOD.platform[[0, 1, 1]], 'rows 1 and 2 .*parallel'),
    ('platform_axes', 2.0 * GOOD.platform, 'length 2'),
    ('platform_axes', [[0, 0, -1], [1, 0, 0], [0, 1, 0]], 'Z3A = .* is opposite to'),
    ('platform_axes', GOOD.platform[0], r'\(3,\)'),
    ('alpha', [0.7, 0.7], r'\(2,\)'), ('alpha', 0.7, r'\(\)'),
    ('alpha', [0.7, 0.0, 0.7], 'alpha of leg B = 0.0'),
    ('alpha', [39.3, 39.4, 39.1], 'alpha of leg A = 39.3'),
    ('beta', [0.6, 0.6, math.pi], 'beta of leg C = 3.14'),
    ('beta', [0.6, -0.6, 0.6], 'beta of leg B = -0.6'), ('beta', 'x', 'x'),
    ('beta', [0.6, math.inf, 0.6], 'inf')])
def test_impossible_mechanisms(name, value, quoted):
    arguments = {'base_axes': GOOD.base, 'platform_axes': GOOD.platform, 'alpha': GOOD.alpha,
                 'beta': GOOD.beta, name: value}
    with pytest.raises(GeometryError, match=quoted) as caught:
        Geometry.from_axes(**arguments)
    assert name in str(caught.value) and '\n' not in str(caught.value)


@pytest.mark.parametrize('degrees, accepted', [(0.11, True), (0.09, False)])
def test_axes_apart_by_the_least_angle(degrees, accepted):
    near = turn([math.radians(degrees), 0.0, 0.0]) @ GOOD.base[0]
    opposite = turn([0.0, math.radians(degrees), 0.0]) @ -GOOD.base[1]
    for base in (np.stack([GOOD.base[0], near, GOOD.base[2]]),
                 np.stack([GOOD.base[0], opposite, GOOD.base[2]])):
        if accepted:
            assert Geometry.from_axes(base, GOOD.platform, GOOD.alpha, GOOD.beta)
        else:
            with pytest.raises(GeometryError, match='deg or more between them'):
                Geometry.from_axes(base, GOOD.platform, GOOD.alpha, GOOD.beta)


def test_axes_in_single_precision_are_normalised():
    g = Geometry.from_axes(GOOD.base.astype(np.float32), GOOD.platform.astype(np.float32),
                           GOOD.alpha, GOOD.beta)
    np.testing.assert_allclose(np.linalg.norm(g.platform_axes, axis=1), 1.0, atol=1e-15)
