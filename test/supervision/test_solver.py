# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The forward models to choose from, and where they disagree."""

from math import radians, sqrt

import numpy as np
import pytest
from spm_haptic_master.exceptions import SingularityError, UnreachableError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    matrix_from_zxz,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.closed_form import theta3a_quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.sample_estimation import estimate_sample
from spm_haptic_master.supervision.solver import METHODS, Solver, total_deviation

SIGMA = (radians(0.04),) * 4


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
        estimate = Solver(Geometry(), SIGMA, method).solve(angles, prior).estimate
        assert rotation_distance(estimate.quaternion, truth) < 1e-6
        assert abs(estimate.parity) < 1e-3
        assert estimate.determined
        assert 0.0 < total_deviation(estimate) < radians(0.2)


def test_the_default_is_the_estimate_of_all_four():
    _, angles = pose(20.0)
    assert Solver(Geometry(), SIGMA).solve(angles, None) == (estimate_sample(
        *angles, SIGMA, Geometry(), None), 0.0)


def test_the_solver_has_the_sensors_and_the_geometry_that_it_is_given():
    _, angles = pose(20.0)
    twice = Solver(Geometry(), tuple(2.0 * each for each in SIGMA)).solve(angles, None).estimate
    once = Solver(Geometry(), SIGMA).solve(angles, None).estimate
    assert total_deviation(twice) == pytest.approx(2.0 * total_deviation(once))


@pytest.mark.parametrize('phi', [20.0, 70.0])
def test_theta3a_is_case_2_with_the_parity_of_all_four(phi):
    _, angles = pose(phi)
    angles = moved(angles, 1, 0.1)
    estimate, apart = Solver(Geometry(), SIGMA, 'theta3a').solve(angles, None)
    four = Solver(Geometry(), SIGMA).solve(angles, None).estimate
    assert apart == rotation_distance(estimate.quaternion, four.quaternion) > 0.0
    assert estimate.quaternion == theta3a_quaternion(*angles, Geometry()) != four.quaternion
    assert estimate.parity == four.parity
    assert total_deviation(estimate) > total_deviation(four)


def test_classic_does_not_use_th3a():
    truth, angles = pose(20.0)
    solver = Solver(Geometry(), SIGMA, 'classic')
    estimate = solver.solve(moved(angles, 3, 0.1), truth).estimate
    assert rotation_distance(estimate.quaternion, truth) < 1e-6
    assert abs(estimate.parity) > 0.5
    three = solver.without('joint_3a', angles, truth)
    assert estimate.covariance == pytest.approx(three.covariance)
    assert total_deviation(estimate) > total_deviation(Solver(Geometry(), SIGMA).solve(
        angles, truth).estimate)


def test_classic_refuses_where_two_modes_meet():
    truth, angles = pose(49.3586)
    with pytest.raises(SingularityError, match='too close to distinguish'):
        Solver(Geometry(), SIGMA, 'classic').solve(angles, truth)


def test_classic_that_followed_the_wrong_mode_is_not_published():
    """The prior is in the other mode; th3A shows that it is wrong."""
    truth, angles = pose(30.0)
    other, _ = pose(70.0)
    with pytest.raises(SingularityError, match='classic is .* rad from the estimate'):
        Solver(Geometry(), SIGMA, 'classic').solve(angles, other)


@pytest.mark.parametrize('method', ['theta3a', 'classic'])
def test_a_method_may_differ_from_the_estimate_by_its_deviations(method):
    """Find the error of th3A at which the two disagree too much, by bisection."""
    truth, angles = pose(20.0)
    solver = Solver(Geometry(), SIGMA, method)
    low, high = 0.0, 20.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        try:
            solver.solve(moved(angles, 3, middle), truth)
            low = middle
        except (SingularityError, UnreachableError):
            high = middle
    changed = moved(angles, 3, low)
    four = Solver(Geometry(), SIGMA).solve(changed, truth).estimate
    estimate, found = solver.solve(changed, truth)
    apart = rotation_distance(estimate.quaternion, four.quaternion)
    assert found == apart == pytest.approx(
        6.0 * (total_deviation(four) + total_deviation(estimate)), rel=1e-6)


@pytest.mark.parametrize('sensor', range(4), ids=JOINT_NAMES)
def test_without_a_sensor_its_reading_does_not_matter(sensor):
    truth, angles = pose(20.0)
    estimate = Solver(Geometry(), SIGMA).without(
        JOINT_NAMES[sensor], moved(angles, sensor, 30.0), truth)
    assert rotation_distance(estimate.quaternion, truth) < 1e-6
    assert estimate.parity is None


def test_angles_that_close_no_mechanism_are_an_error():
    with pytest.raises((SingularityError, UnreachableError)):
        Solver(Geometry(), SIGMA).solve((1.5, -1.5, 1.5, 1.0), None)


def test_total_deviation_is_the_root_of_the_trace():
    estimate = Solver(Geometry(), SIGMA).solve(pose(20.0)[1], None).estimate._replace(
        covariance=(1.0, 9.0, 9.0, 9.0, 4.0, 9.0, 9.0, 9.0, 16.0))
    assert total_deviation(estimate) == sqrt(21.0)


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
            converged = estimate_sample(*angles.tolist(), SIGMA, Geometry(), prior,
                                        working_mode=(1, 1, 1))
            found = Solver(Geometry(), SIGMA).solve(tuple(angles.tolist()), prior).estimate
        except (UnreachableError, SingularityError):
            continue
        left.append(rotation_distance(found.quaternion, converged.quaternion)
                    / total_deviation(converged))
        assert total_deviation(found) == pytest.approx(total_deviation(converged), rel=0.03)
        assert found.parity == pytest.approx(converged.parity, abs=0.03)
    assert max(left) < 0.03
    assert np.sqrt(np.mean(np.square(left))) < 0.003
