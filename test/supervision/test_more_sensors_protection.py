# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Protection level with five and six sensors: an independent model's numbers."""

from functools import cache
from itertools import product
from math import acos, degrees, radians, sqrt

from device import SINGULAR
from mechanism import about_x, about_z, CENTRE
import numpy as np
import pytest
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

SIGMA_DEG, BIAS_DEG = 0.04, 0.05
# Threshold of the mean of 20 samples at one false alarm in 10,000 hours, with missed detection.
REACH = (6.9 + MISSED_DETECTION) / sqrt(20.0)
# By the number of sensors: protection level, deg (median, 90 %, largest), standard deviation of
# the orientation, deg (median, largest); None: no limit.
TABLE = {4: ((0.89, 5.4, None), (0.042, 0.050)),
         5: ((0.18, 0.23, 0.40), (0.034, 0.038)),
         6: ((0.11, 0.13, 0.14), (0.028, 0.029))}


def poses():
    """Return the 120 poses of the table."""
    return [about_z(CENTRE[0]) @ about_x(acos(3.0**-0.5)) @ about_z(azimuth) @ about_x(tilt)
            @ about_z(phi - azimuth) for tilt, azimuth, phi in product(
                np.radians((0.0, 8.0, 16.0)), np.radians((0.0, 90.0, 180.0, 270.0)),
                np.radians((0.0, 15.0, 30.0, 40.0, 45.0, 49.3586, 54.0, 60.0, 75.0, 90.0)))]


def sample_at(rotation, sensors, sigma_deg=SIGMA_DEG, missing=None, fault_deg=0.0, faulty=0):
    joints = inverse(rotation)
    angles = [*joints.theta1.tolist(), *map(float, (joints.theta3a, joints.theta3b,
                                                    joints.theta3c))][:sensors]
    angles[faulty] += radians(fault_deg)
    sigma = tuple(np.broadcast_to(np.radians(sigma_deg), sensors).tolist())
    left_out = () if missing is None else (ALL_JOINT_NAMES.index(missing),)
    return estimate_sample(tuple(angles), UsedSensors(sigma, left_out), Geometry(),
                           tuple(quaternion_from_matrix(rotation).tolist()))


@cache
def figures(sensors):
    """Return protection levels and deviations of the poses, deg."""
    bias = (radians(BIAS_DEG),) * sensors
    rows = []
    for rotation in poses():
        sample = sample_at(rotation, sensors)
        worth = integrity(sample, bias, (1.0,) * sensors)
        # The table's bound of what the biases do to the parity.
        level = max(worth.slopes) * (REACH + BIAS_DEG / SIGMA_DEG * sqrt(sensors))
        rows.append((level, worth.deviation))
    return np.degrees(rows).T


@pytest.mark.parametrize('sensors', TABLE)
def test_the_table_of_an_independent_model(sensors):
    levels, deviations = figures(sensors)
    (median, ninety, largest), spread = TABLE[sensors]
    assert len(levels) == 120
    # Half a digit of the print and five hundredths.
    assert np.median(levels) == pytest.approx(median, rel=0.05, abs=0.005)
    assert np.percentile(levels, 90) == pytest.approx(ninety, rel=0.05, abs=0.005)
    assert levels.max() > 1e4 if largest is None else (
        levels.max() == pytest.approx(largest, rel=0.05, abs=0.005))
    assert (np.median(deviations), deviations.max()) == pytest.approx(spread, abs=6e-4)


@pytest.mark.parametrize('sensors', [5, 6])
def test_the_level_is_never_above_the_tables_bound(sensors):
    bias = (radians(BIAS_DEG),) * sensors
    for rotation, bound in zip(poses(), figures(sensors)[0], strict=True):
        worth = integrity(sample_at(rotation, sensors), bias, (1.0,) * sensors)
        # The bound counts the bias once.
        once = max(worth.slopes) * REACH
        assert degrees(max(worth.levels(REACH)) - worth.healthy) <= (
            2.0 * bound - degrees(once)) * (1.0 + 1e-9)


@pytest.mark.parametrize(('sensors', 'missing'), [
    (4, None), *product((5, 6), (None, 'joint_1b', 'joint_3a', 'joint_3b'))])
@pytest.mark.parametrize('pose', [(0.1, 1.0, 0.3), (0.2, 2.5, 0.7), (0.0, 0.0, 1.2)])
def test_it_is_the_pseudo_inverse_of_the_whitened_jacobian(sensors, missing, pose):
    rotation = workspace_pose(*pose)
    sigma = np.array([0.02, 0.04, 0.06, 0.03, 0.05, 0.035])[:sensors]
    bias = np.radians([0.05, 0.02, 0.0, 0.1, 0.03, 0.04])[:sensors]
    worth = integrity(
        sample_at(rotation, sensors, sigma, missing), tuple(bias.tolist()), (1.5,) * sensors)
    there = np.array([name != missing for name in ALL_JOINT_NAMES[:sensors]])
    whitened = (jacobian(rotation, sensors=sensors) / np.radians(sigma)[:, None])[there]
    gain = np.linalg.pinv(whitened)
    share = np.sqrt(np.diagonal(np.eye(there.sum()) - whitened @ gain))
    turns, parts = np.linalg.norm(gain, axis=0), (bias / np.radians(sigma))[there]
    slopes = np.array(worth.slopes)
    np.testing.assert_allclose(slopes[there], turns / share, rtol=1e-5)
    assert np.isinf(slopes[~there]).all()
    assert worth.bias == pytest.approx(min(np.linalg.norm(parts), share @ parts), rel=1e-6)
    assert worth.healthy == pytest.approx(
        1.5 * MISSED_DETECTION * np.sqrt(np.trace(gain @ gain.T)) + turns @ parts, rel=1e-6)
    np.testing.assert_allclose(worth.levels(REACH), slopes * (
        REACH * worth.noise + 2.0 * worth.bias) + worth.healthy)


@pytest.mark.parametrize('sensors', [5, 6])
def test_no_pattern_of_biases_moves_the_parity_beyond_the_bound(sensors):
    bias = np.radians(np.array([0.05, 0.02, 0.01, 0.1, 0.03, 0.04])[:sensors])
    for pose in ((0.1, 1.0, 0.3), (0.2, 2.5, 0.7)):
        sample = sample_at(workspace_pose(*pose), sensors)
        worth = integrity(sample, tuple(bias.tolist()), (1.0,) * sensors)
        moved = [np.linalg.norm((np.array(signs) * bias) @ np.array(sample.parity_gains))
                 for signs in product((-1.0, 1.0), repeat=sensors)]
        assert 0.5 * worth.bias < max(moved) <= worth.bias


@pytest.mark.parametrize('sensors', [5, 6])
@pytest.mark.parametrize('faulty', range(6))
def test_a_fault_turns_the_orientation_as_far_as_its_slope_says(sensors, faulty):
    faulty = min(faulty, sensors - 1)
    for pose in ((0.15, 1.0, 0.4), (0.0, 0.0, radians(SINGULAR))):
        rotation = workspace_pose(*pose)
        slope = integrity(
            sample_at(rotation, sensors), (0.0,) * sensors, (1.0,) * sensors).slopes[faulty]
        moved = sample_at(rotation, sensors, fault_deg=1e-3, faulty=faulty)
        turned = matrix_from_quaternion(moved.quaternion) @ rotation.T
        turn = np.linalg.norm(turned - np.eye(3)) / sqrt(2.0)
        assert turn / moved.parity == pytest.approx(slope, rel=2e-3)


def test_five_sensors_less_th3b_are_the_four():
    for pose in ((0.15, 1.0, 0.4), (0.05, 3.0, 1.1)):
        rotation = workspace_pose(*pose)
        bias = (radians(BIAS_DEG),) * 5
        four = integrity(sample_at(rotation, 4), bias[:4], (1.0,) * 4)
        five = integrity(sample_at(rotation, 5, missing='joint_3b'), bias, (1.0,) * 5)
        assert five.slopes[:4] == pytest.approx(four.slopes, rel=1e-6)
        assert (five.healthy, five.bias) == pytest.approx((four.healthy, four.bias), rel=1e-6)
    singular = workspace_pose(0.0, 0.0, radians(SINGULAR))
    slopes = integrity(sample_at(singular, 5, missing='joint_3b'), bias, (1.0,) * 5).slopes
    assert slopes[3] > 1e3 and slopes[4] == np.inf
