# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every orientation that some readings allow, and the one near another orientation."""

from contextlib import nullcontext
import math

from built_mechanism import nominal, random_built
from mechanism import angle_between, MODES, random_rotations, turn
import numpy as np
import pytest
from readings import all_angles, PAPER, UNEQUAL, wrapped
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics.estimation.gauss_newton import MODE_MARGIN
from spm_haptic_master.kinematics.estimation.solutions import (
    all_solutions,
    fit_near,
    SAME_SOLUTION,
)
from spm_haptic_master.kinematics.leg_kernels import leg_angles, squared_sine
from spm_haptic_master.kinematics.number_backends import FLOATS

MODE = (1, 1, 1)
POSE = kinematics.workspace_pose(0.15, 1.0, 1.1)


def used_sensors(*used):
    """Return six mounted sensors of which some are in use."""
    left_out = tuple(place for place in range(6) if place not in used)
    return kinematics.UsedSensors(tuple(UNEQUAL), left_out)


def quaternion(R):
    """Return the quaternion of a rotation, as a tuple."""
    return tuple(kinematics.quaternion_from_matrix(R).tolist())


def solutions_of(pose, *used):
    """Return the rotations that true readings allow; the others are NaN."""
    readings = np.full(6, np.nan)
    readings[list(used)] = all_angles(pose)[list(used)]
    found = all_solutions(tuple(readings.tolist()), used_sensors(*used), PAPER, MODE)
    return [kinematics.matrix_from_quaternion(solution.quaternion) for solution in found]


def misfit(matrix, pose, used):
    """Return the largest error of the readings, rad; noise may take a leg into its other mode."""
    errors = []
    for mode in MODES:
        apart = wrapped(all_angles(matrix, mode=mode) - all_angles(pose))
        errors.append(np.abs(apart[list(used)]).max())
    return min(errors)


# th1 of each leg; one reading of each leg; two of a leg and one of another; more than three.
USED = [
    (0, 1, 2),
    (3, 1, 2),
    (0, 4, 2),
    (3, 4, 5),
    (0, 3, 1),
    (1, 4, 5),
    (2, 5, 0),
    (0, 1, 2, 3),
    (3, 4, 5, 1),
    (0, 1, 2, 3, 4, 5),
]


@pytest.mark.parametrize('used', USED)
@pytest.mark.parametrize('pose', [POSE, kinematics.workspace_pose(0.28, 4.0, 0.9)])
def test_each_solution_has_the_readings_and_none_is_there_twice(pose, used):
    found = solutions_of(pose, *used)
    assert min(angle_between(pose, matrix) for matrix in found) < 1e-8
    for place, matrix in enumerate(found):
        # Of more than three readings a best fit need not fit exactly.
        assert misfit(matrix, pose, used) < (1e-8 if len(used) == 3 else 0.2)
        for other in found[:place]:
            assert angle_between(matrix, other) > SAME_SOLUTION


def test_the_solutions_of_the_active_joints_are_their_assembly_modes():
    th1 = all_angles(POSE)[:3]
    expected = []
    for matrix in kinematics.forward_all(th1):
        again = kinematics.inverse(matrix).theta1
        if np.abs(wrapped(again - th1)).max() < 1e-6:
            expected.append(matrix)
    found = solutions_of(POSE, 0, 1, 2)
    assert len(found) == len(expected) > 1
    for matrix in expected:
        assert min(angle_between(matrix, other) for other in found) < 1e-6


@pytest.mark.parametrize('used', USED)
def test_from_near_an_orientation_its_solution_is_found(used):
    readings = np.full(6, np.nan)
    readings[list(used)] = all_angles(POSE)[list(used)]
    near = quaternion(turn([0.02, -0.01, 0.015]) @ POSE)
    found = fit_near(near, tuple(readings.tolist()), used_sensors(*used), PAPER, MODE)
    assert angle_between(kinematics.matrix_from_quaternion(found.quaternion), POSE) < 1e-8


def beyond_leg_c(built):
    """Return an orientation that legs A and B reach with some room, and leg C does not."""
    rotations = random_rotations(np.random.default_rng(12), 1000)
    reach = built.margins(rotations)
    is_beyond = (reach[:, :2].min(-1) > 0.2) & (reach[:, 2] < -0.05)
    return rotations[is_beyond][0]


@pytest.mark.parametrize('built', [nominal(), nominal(1.1, 1.0, 0.9), nominal(0.8, 0.9, 0.7)])
def test_a_leg_without_a_sensor_has_to_reach_the_orientation(built):
    R = beyond_leg_c(built)
    g = built.geometry
    rows = tuple(R.ravel().tolist())
    th1a, _, th3a = leg_angles(rows, g.legs[0], 1, FLOATS)
    th1b, _, _ = leg_angles(rows, g.legs[1], 1, FLOATS)
    readings = (th1a, th1b, np.nan, th3a, np.nan, np.nan)
    sensors = used_sensors(0, 1, 3)
    with pytest.raises(UnreachableError, match='leg C does not reach the orientation'):
        fit_near(quaternion(R), readings, sensors, g, MODE)
    for solution in all_solutions(readings, sensors, g, MODE):
        matrix = kinematics.matrix_from_quaternion(solution.quaternion)
        assert built.margins(matrix)[2] > -1e-3


@pytest.mark.parametrize('used', USED)
def test_the_legs_of_a_mechanism_as_built_are_all_different(used):
    rng = np.random.default_rng(31)
    built = random_built(rng)
    g = built.geometry
    R = built.reachable_rotation(rng, slack=0.2)
    readings = np.full(6, np.nan)
    readings[list(used)] = all_angles(R, g)[list(used)]
    found = all_solutions(tuple(readings.tolist()), used_sensors(*used), g, MODE)
    matrices = [kinematics.matrix_from_quaternion(solution.quaternion) for solution in found]
    assert min(angle_between(R, matrix) for matrix in matrices) < 1e-7


@pytest.mark.parametrize(
    ('least', 'most', 'is_reached'),
    [
        (0.5, 0.9, True),
        (1.1, 1.5, False),
    ],
)
def test_noise_may_take_a_leg_without_a_sensor_a_little_beyond_its_reach(least, most, is_reached):
    """B_kk squared, of the leg, is negative there; MODE_MARGIN is the size of its noise."""
    built = nominal(0.8, 0.9, 0.7)
    g = built.geometry
    rotations = random_rotations(np.random.default_rng(3), 20000)
    beyond = -(g.legs[2].sin_alpha ** 2) * squared_sine(
        tuple(rotations.reshape(-1, 9).T), g.legs[2]
    )
    is_chosen = (beyond > least * MODE_MARGIN**2) & (beyond < most * MODE_MARGIN**2)
    is_chosen &= built.margins(rotations)[:, :2].min(-1) > 0.2
    R = rotations[is_chosen][0]
    rows = tuple(R.ravel().tolist())
    th1a, _, th3a = leg_angles(rows, g.legs[0], 1, FLOATS)
    th1b, _, _ = leg_angles(rows, g.legs[1], 1, FLOATS)
    readings = (th1a, th1b, np.nan, th3a, np.nan, np.nan)
    refused = pytest.raises(UnreachableError, match='leg C does not reach')
    with nullcontext() if is_reached else refused:
        found = fit_near(quaternion(R), readings, used_sensors(0, 1, 3), g, MODE)
        assert angle_between(kinematics.matrix_from_quaternion(found.quaternion), R) < 1e-8


@pytest.mark.parametrize('leg', range(3))
def test_the_squared_sine_of_a_leg_is_that_of_its_second_joint(leg):
    rng = np.random.default_rng(32)
    for _ in range(5):
        built = random_built(rng)
        beta = built.geometry.legs[leg].cos_beta
        for th2 in (0.3, -1.2, 2.5):
            R = built.chain(leg, 0.4, th2, -0.9)
            expected = (1.0 - beta**2) * math.sin(th2) ** 2
            found = squared_sine(tuple(R.ravel().tolist()), built.geometry.legs[leg])
            assert found == pytest.approx(expected)
