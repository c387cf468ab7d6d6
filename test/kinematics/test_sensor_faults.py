# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The fault of a sensor, where it turns the orientation, and how the parity bends there."""

import math

from mechanism import angle_between, small_vector, turn
import numpy as np
import pytest
from readings import all_angles, bound, PAPER, UNEQUAL, wrapped
from spm_haptic_master import kinematics
from spm_haptic_master.kinematics.estimation.sensor_faults import (
    implied_fault,
    parity_curvature,
    turned_by_fault,
)

MODE = (1, 1, 1)
POSE = kinematics.workspace_pose(0.15, 1.0, 1.1)
# Nominal biases of the six sensors (rad).
BIAS = tuple(1e-3 * np.array([1.0, 0.3, 0.7, 2.0, 0.5, 0.9]))


def sample_of(readings, left_out=()):
    """Return the estimate of one sample by the sensors in use."""
    sigma = tuple(UNEQUAL[: len(readings)])
    sensors = kinematics.UsedSensors(sigma, left_out)
    prior = tuple(kinematics.quaternion_from_matrix(POSE).tolist())
    return kinematics.estimate_sample(tuple(readings), sensors, PAPER, prior, MODE)


def matrix_of(quaternion):
    """Return the rotation matrix of a quaternion."""
    return kinematics.matrix_from_quaternion(quaternion)


def fault_of(sensor, fault, parity_bias):
    """Return the implied fault of one of six sensors, whose reading is off by `fault`, rad."""
    readings = all_angles(POSE)
    others = sample_of(readings, (sensor,))
    reading = readings[sensor] + fault
    return implied_fault(others, sensor, reading, BIAS, parity_bias, PAPER, MODE)


def gains_on(sensor):
    """Return by how much each other sensor's error moves the angle that they imply."""
    used = [place for place in range(6) if place != sensor]
    rows = kinematics.jacobian(POSE, PAPER, MODE, 6)
    weighted = rows[used] / UNEQUAL[used, None] ** 2
    covariance = np.linalg.inv(weighted.T @ rows[used])
    gains = np.zeros(6)
    gains[used] = weighted @ covariance @ rows[sensor]
    variance = UNEQUAL[sensor] ** 2 + rows[sensor] @ covariance @ rows[sensor]
    return gains, math.sqrt(variance)


@pytest.mark.parametrize('sensor', range(6))
@pytest.mark.parametrize('fault', [0.05, -0.2, 2.0 * math.pi + 0.1])
def test_the_implied_fault_is_the_one_that_is_there(sensor, fault):
    found = fault_of(sensor, fault, parity_bias=1.0)
    assert found.fault == pytest.approx(math.remainder(fault, 2.0 * math.pi), abs=1e-9)
    gains, deviation = gains_on(sensor)
    assert found.deviation == pytest.approx(deviation, rel=1e-6)
    most = BIAS[sensor] + np.abs(gains) @ BIAS
    assert found.bias == pytest.approx(most, rel=1e-6)


@pytest.mark.parametrize('sensor', range(6))
def test_the_biases_do_no_more_than_their_part_that_no_motion_explains(sensor):
    gains, _ = gains_on(sensor)
    found = fault_of(sensor, 0.05, parity_bias=1e-4)
    assert found.bias == pytest.approx(1e-4 * math.sqrt(1.0 + gains @ gains), rel=1e-6)


@pytest.mark.parametrize(
    ('sensors', 'sensor'),
    [
        (4, 0),
        (4, 3),
        (5, 1),
        (6, 5),
    ],
)
def test_a_fault_turns_the_orientation_either_way(sensors, sensor):
    readings = all_angles(POSE)[:sensors]
    estimate = sample_of(readings)
    wrong = readings.copy()
    wrong[sensor] += 1e-5
    moved = small_vector(matrix_of(sample_of(wrong).quaternion) @ POSE.T)
    ahead, behind = turned_by_fault(estimate, sensor, 0.01, PAPER, MODE)
    expected = turn(0.01 * moved / np.linalg.norm(moved))
    assert angle_between(matrix_of(ahead), expected @ POSE) < 1e-5
    assert angle_between(matrix_of(behind), expected.T @ POSE) < 1e-5


@pytest.mark.parametrize(
    ('sensors', 'sensor'),
    [
        (4, 0),
        (4, 1),
        (4, 3),
        (5, 2),
        (6, 4),
    ],
)
def test_the_curvature_is_that_of_the_parity_along_the_turn(sensors, sensor):
    """Here by turns of 0.03 rad, with all angles of the inverse model."""
    estimate = sample_of(all_angles(POSE)[:sensors])
    rows = kinematics.jacobian(POSE, PAPER, MODE, sensors)
    direction = bound(POSE, UNEQUAL[:sensors], sensors=sensors) @ rows[sensor]
    direction *= 0.03 / np.linalg.norm(direction)
    here = all_angles(POSE)
    ahead = wrapped(all_angles(turn(direction) @ POSE) - here)
    behind = wrapped(all_angles(turn(-direction) @ POSE) - here)
    gains = np.array(estimate.parity_gains)[:sensors]
    own = gains[sensor] / np.linalg.norm(gains[sensor])
    bent = 0.5 * (ahead + behind)[:sensors] @ gains @ own
    found = parity_curvature(estimate, sensor, PAPER, MODE)
    assert found == pytest.approx(bent / 0.03**2, rel=1e-6)
