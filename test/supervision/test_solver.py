# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward models to choose from, and where they disagree."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.exceptions import SingularityError, SpmError, UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    matrix_from_zxz,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.closed_form import theta3a_quaternion
from spm_haptic_master.kinematics.estimation.sample_estimation import estimate_sample
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.fkm import METHODS
from spm_haptic_master.supervision.solver import Solver, total_deviation

SIGMA = (radians(0.04),) * 4
FOUR = UsedSensors(SIGMA)


def solved(angles, prior=None, method='estimate'):
    """Return the solution of all four sensors."""
    return Solver(Geometry(), SIGMA, method).solve(angles, FOUR, prior)


def pose(phi, psi=135.0, theta=54.7356):
    """Return the quaternion and the four angles of a pose, given in deg."""
    rotation = matrix_from_zxz(*np.radians((psi, theta, phi)))
    joints = inverse(rotation)
    return (tuple(quaternion_from_matrix(rotation).tolist()),
            (*joints.theta1.tolist(), float(joints.theta3a)))


def moved(angles, sensor, degrees):
    changed = list(angles)
    changed[sensor] += radians(degrees)
    return tuple(changed)


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('phi', [20.0, 70.0])
def test_every_method_finds_the_pose(method, phi):
    truth, angles = pose(phi)
    for prior in (None, pose(phi + 1.0)[0]):
        estimate = solved(angles, prior, method)[0]
        assert rotation_distance(estimate.quaternion, truth) < 1e-6
        assert abs(estimate.parity) < 1e-3
        assert estimate.determined
        assert 0.0 < total_deviation(estimate) < radians(0.2)


def test_the_default_is_the_estimate_of_all_four():
    _, angles = pose(20.0)
    expected = estimate_sample(angles, FOUR, Geometry(), None)
    estimate, apart = solved(angles)
    assert estimate.quaternion == pytest.approx(expected.quaternion, abs=1e-9)
    assert estimate.covariance == pytest.approx(expected.covariance, rel=1e-6)
    assert apart == 0.0


def test_the_solver_has_the_sensors_and_the_geometry_that_it_is_given():
    _, angles = pose(20.0)
    sigma = tuple(2.0 * each for each in SIGMA)
    twice = Solver(Geometry(), sigma).solve(angles, UsedSensors(sigma), None)[0]
    assert total_deviation(twice) == pytest.approx(2.0 * total_deviation(solved(angles)[0]))


@pytest.mark.parametrize('phi', [20.0, 70.0])
def test_theta3a_is_case_2_with_the_parity_of_all_four(phi):
    _, angles = pose(phi)
    angles = moved(angles, 1, 0.1)
    estimate, apart = solved(angles, None, 'theta3a')
    four = solved(angles)[0]
    assert apart == rotation_distance(estimate.quaternion, four.quaternion) > 0.0
    assert estimate.quaternion == theta3a_quaternion(*angles, Geometry()) != four.quaternion
    assert estimate.parity == four.parity
    assert total_deviation(estimate) > total_deviation(four)


def test_classic_does_not_use_th3a():
    truth, angles = pose(20.0)
    estimate = solved(moved(angles, 3, 0.1), truth, 'classic')[0]
    assert rotation_distance(estimate.quaternion, truth) < 1e-6
    assert abs(estimate.parity) > 0.5
    three = Solver(Geometry(), SIGMA).solve(angles, UsedSensors(SIGMA, (3,)), truth)[0]
    assert estimate.covariance == pytest.approx(three.covariance)
    assert total_deviation(estimate) > total_deviation(solved(angles, truth)[0])


def test_classic_refuses_where_two_modes_meet():
    truth, angles = pose(49.3586)
    with pytest.raises(SingularityError, match='too close to distinguish'):
        solved(angles, truth, 'classic')


def test_classic_that_followed_the_wrong_mode_is_not_published():
    """The prior is in the other mode; th3A shows that it is wrong."""
    truth, angles = pose(30.0)
    other, _ = pose(70.0)
    with pytest.raises(SingularityError, match='classic is .* rad from the estimate'):
        solved(angles, other, 'classic')


@pytest.mark.parametrize('method', ['theta3a', 'classic'])
def test_a_method_may_differ_from_the_estimate_by_its_deviations(method):
    """Find the error of th3A at which the two disagree too much, by bisection."""
    truth, angles = pose(20.0)
    low, high = 0.0, 20.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        try:
            solved(moved(angles, 3, middle), truth, method)
            low = middle
        except (SingularityError, UnreachableError):
            high = middle
    changed = moved(angles, 3, low)
    four = solved(changed, truth)[0]
    estimate, found = solved(changed, truth, method)
    apart = rotation_distance(estimate.quaternion, four.quaternion)
    assert found == apart == pytest.approx(
        6.0 * (total_deviation(four) + total_deviation(estimate)), rel=1e-6)


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_without_a_sensor_its_reading_does_not_matter(sensor):
    truth, angles = pose(20.0)
    estimate = Solver(Geometry(), SIGMA).solve(
        moved(angles, sensor, 30.0), UsedSensors(SIGMA, (sensor,)), truth)[0]
    assert rotation_distance(estimate.quaternion, truth) < 1e-6
    assert estimate.parity is None


def test_angles_that_close_no_mechanism_are_an_error():
    with pytest.raises((SingularityError, UnreachableError)):
        solved((1.5, -1.5, 1.5, 1.0))


@pytest.mark.evidence
@pytest.mark.parametrize(
    ('mounted', 'left_out'), [(4, ()), (4, (2,)), (5, ()), (6, ()), (6, (0, 3))])
def test_wherever_one_sensor_is_there_is_an_orientation_or_a_reason(mounted, left_out):
    """No other exception, in 100,000 solutions."""
    rng = np.random.default_rng(12)
    sensors = UsedSensors(SIGMA[:1] * mounted, left_out)
    solver = Solver(Geometry(), sensors.sigma)
    rotations = workspace_pose(*rng.uniform([0.0, 0.0, -1.0], [0.5, 6.28, 2.0], (1000, 3)).T)
    joints = inverse(rotations)
    poses = np.column_stack([joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c])
    reached = np.flatnonzero(np.isfinite(poses).all(axis=1))
    solutions = 0
    for index in range(20_000):
        place = reached[index % len(reached)]
        angles = poses[place, :mounted].tolist()
        prior = tuple(quaternion_from_matrix(rotations[place]).tolist()) if index % 2 else None
        angles[rng.integers(mounted)] = rng.uniform(-4.0, 4.0)
        try:
            found = solver.solve(tuple(angles), sensors, prior)[0]
        except SpmError:
            continue
        assert sum(each * each for each in found.quaternion) == pytest.approx(1.0)
        solutions += 1
    assert solutions > 1000


def test_angles_whose_root_is_hardly_negative_are_no_exception_of_rounding():
    angles = (2.4539857654200543, 0.9035146840646426, 1.4545972821125592, 0.617810762320942,
              0.290689359304329, 0.30756314797107104)
    sensors = UsedSensors(SIGMA[:1] * 6, (2,))
    try:
        estimate = Solver(Geometry(), sensors.sigma).solve(angles, sensors, None)[0]
    except SpmError:
        return
    assert np.isfinite(estimate.quaternion).all()


def test_what_the_last_step_leaves_is_a_small_part_of_the_deviation():
    """The solver stops early; beside the converged estimate, all over the workspace."""
    rng = np.random.default_rng(31)
    left = []
    while len(left) < 600:
        rotation = workspace_pose(rng.uniform(0.0, 0.52), rng.uniform(0.0, 6.28),
                                  rng.uniform(-1.05, 1.75))
        try:
            joints = inverse(rotation)
            angles = np.append(joints.theta1, joints.theta3a) + SIGMA[0] * rng.normal(size=4)
            prior = tuple(quaternion_from_matrix(rotation).tolist())
            converged = estimate_sample(
                tuple(angles.tolist()), FOUR, Geometry(), prior, working_mode=(1, 1, 1))
            found = solved(tuple(angles.tolist()), prior)[0]
        except (UnreachableError, SingularityError):
            continue
        left.append(rotation_distance(found.quaternion, converged.quaternion)
                    / total_deviation(converged))
        assert total_deviation(found) == pytest.approx(total_deviation(converged), rel=0.03)
        assert found.parity == pytest.approx(converged.parity, abs=0.03)
    assert max(left) < 0.03
    assert np.sqrt(np.mean(np.square(left))) < 0.003
