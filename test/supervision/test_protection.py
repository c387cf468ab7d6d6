# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protection level: beside the pseudo-inverse, and finite differences of the estimate."""

from itertools import product
from math import radians, sqrt

from device import joint_angles
import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

# Threshold of the mean of 20 samples at one false alarm in 10,000 hours, with missed detection.
REACH = (6.9 + 5.3) / sqrt(20.0)


def sample_at(rotation, sensors=4, sigma_deg=0.04, missing=None, fault_deg=0.0, faulty=0):
    angles = joint_angles(rotation[None], sensors)[0]
    angles[faulty] += radians(fault_deg)
    sigma = tuple(np.broadcast_to(np.radians(sigma_deg), sensors).tolist())
    left_out = () if missing is None else (ALL_JOINT_NAMES.index(missing),)
    return estimate_sample(tuple(angles.tolist()), UsedSensors(sigma, left_out), Geometry(),
                           tuple(quaternion_from_matrix(rotation).tolist()))


@pytest.mark.parametrize(('sensors', 'missing'), [
    (4, None), *product((5, 6), (None, 'joint_1b', 'joint_3a', 'joint_3b'))])
@pytest.mark.parametrize('pose', [(0.1, 1.0, 0.3), (0.2, 2.5, 0.7), (0.0, 0.0, 1.2)])
def test_it_is_the_pseudo_inverse_of_the_whitened_jacobian(sensors, missing, pose):
    rotation = workspace_pose(*pose)
    sigma = np.array([0.02, 0.04, 0.06, 0.03, 0.05, 0.035])[:sensors]
    bias = np.radians([0.05, 0.02, 0.0, 0.1, 0.03, 0.04])[:sensors]
    factors = np.array([1.5, 1.0, 2.0, 1.2, 1.0, 1.1])[:sensors]
    worth = integrity(sample_at(rotation, sensors, sigma, missing), tuple(bias.tolist()),
                      tuple(factors.tolist()))
    there = np.array([name != missing for name in ALL_JOINT_NAMES[:sensors]])
    whitened = (jacobian(rotation, sensors=sensors) / np.radians(sigma)[:, None])[there]
    gain = np.linalg.pinv(whitened)
    share = np.sqrt(np.diagonal(np.eye(there.sum()) - whitened @ gain))
    turns, moved = np.linalg.norm(gain, axis=0), (bias / np.radians(sigma))[there]
    slopes = np.array(worth.slopes)
    np.testing.assert_allclose(slopes[there], turns / share, rtol=1e-5)
    assert np.isinf(slopes[~there]).all()
    bound = share @ moved if sensors == 4 else min(np.linalg.norm(moved), share @ moved)
    assert worth.bias == pytest.approx(bound, rel=1e-6)
    assert worth.deviation == pytest.approx(np.linalg.norm(gain * factors[there]), rel=1e-6)
    assert worth.noise == pytest.approx(
        sqrt(1.0 + (factors[there] ** 2 - 1.0) @ share ** 2), rel=1e-5)
    assert worth.healthy == pytest.approx(
        MISSED_DETECTION * worth.deviation + turns @ moved, rel=1e-6)
    np.testing.assert_allclose(worth.levels(REACH), slopes * (
        REACH * worth.noise + 2.0 * worth.bias) + worth.healthy)


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('faulty', range(6))
def test_a_fault_turns_the_orientation_as_far_as_its_slope_says(sensors, faulty):
    """Finite differences of the estimate: error over parity is the slope."""
    faulty = min(faulty, sensors - 1)
    rotation = workspace_pose(0.15, 1.0, 0.4)
    slope = integrity(
        sample_at(rotation, sensors), (0.0,) * sensors, (1.0,) * sensors).slopes[faulty]
    moved = sample_at(rotation, sensors, fault_deg=1e-3, faulty=faulty)
    turned = matrix_from_quaternion(moved.quaternion) @ rotation.T
    turn = np.linalg.norm(turned - np.eye(3)) / sqrt(2.0)
    assert turn / abs(moved.parity) == pytest.approx(slope, rel=2e-3)
