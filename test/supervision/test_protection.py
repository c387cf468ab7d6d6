# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protection level, beside the pseudo-inverse."""

from itertools import product
from math import radians, sqrt

from device import joint_angles, random_pose
import numpy as np
import pytest
from rig import few, product_limits
from spm_haptic_master import kinematics
from spm_haptic_master.supervision.protection import (
    integrity,
    MISSED_DETECTION,
    protection_level,
)

# Threshold of the mean of 20 samples at one false alarm in 10,000 hours, with missed detection.
REACH = (6.9 + 5.3) / sqrt(20.0)


# Noise and bias of six sensors (rad), and factors of their noise.
SIGMA = np.radians([0.02, 0.04, 0.06, 0.03, 0.05, 0.035])
BIAS = np.radians([0.05, 0.02, 0.0, 0.1, 0.03, 0.04])
FACTORS = np.array([1.5, 1.0, 2.0, 1.2, 1.0, 1.1])


def sample_at(rotation, sensors, missing):
    """Return the estimate of exact readings at a pose, a sensor or None missing."""
    readings = joint_angles(rotation[None], sensors)[0]
    left_out = () if missing is None else (missing,)
    used = kinematics.UsedSensors(tuple(SIGMA[:sensors].tolist()), left_out)
    return kinematics.estimate_sample(
        tuple(readings.tolist()),
        used,
        kinematics.Geometry(),
        tuple(kinematics.quaternion_from_matrix(rotation).tolist()),
    )


def there_are(sensors, missing):
    """Return which of the sensors are not missing."""
    return np.arange(sensors) != (-1 if missing is None else missing)


@pytest.mark.parametrize(
    ('sensors', 'missing'),
    [
        (4, None),
        *product((5, 6), (None, 1, 3, 4)),
    ],
)
@pytest.mark.parametrize('pose', [(0.1, 1.0, 0.3), (0.2, 2.5, 0.7)])
def test_it_is_the_pseudo_inverse_of_the_whitened_jacobian(sensors, missing, pose):
    rotation = kinematics.workspace_pose(*pose)
    bias = BIAS[:sensors]
    factors = FACTORS[:sensors]
    sample = sample_at(rotation, sensors, missing)
    worth = integrity(sample, tuple(bias.tolist()), tuple(factors.tolist()))

    there = there_are(sensors, missing)
    jacobian = kinematics.jacobian(rotation, sensors=sensors)
    sigma = SIGMA[:sensors]
    whitened = (jacobian / sigma[:, None])[there]
    gain = np.linalg.pinv(whitened)
    unexplained = np.eye(there.sum()) - whitened @ gain
    share = np.sqrt(np.diagonal(unexplained))
    turns = np.linalg.norm(gain, axis=0)
    moved = (bias / sigma)[there]
    wider = factors[there]

    slopes = np.array(worth.slopes)
    np.testing.assert_allclose(slopes[there], turns / share, rtol=1e-5)
    assert np.isinf(slopes[~there]).all()
    bound = share @ moved
    if sensors > 4:
        bound = min(np.linalg.norm(moved), bound)
    assert worth.bias == pytest.approx(bound, rel=1e-6)
    assert worth.deviation == pytest.approx(np.linalg.norm(gain * wider), rel=1e-6)
    variance = 1.0 + (wider**2 - 1.0) @ share**2
    assert worth.noise == pytest.approx(sqrt(variance), rel=1e-5)
    # Noise of six deviations and bias of a reading, over the error 1 / (4 x 2 K^2) with which two
    # solutions meet.
    errors = sigma[there] * (6.0 * wider + moved)
    gains = turns / sigma[there]
    assert worth.fold_share == pytest.approx(8.0 * gains**2 @ errors, rel=1e-5)
    second_order = 2.0 / (1.0 + sqrt(1.0 - worth.fold_share))
    healthy = MISSED_DETECTION * worth.deviation + second_order * turns @ moved
    assert worth.healthy == pytest.approx(healthy, rel=1e-6)
    levels = slopes * (REACH * worth.noise + 2.0 * worth.bias) + worth.healthy
    np.testing.assert_allclose(worth.parts(REACH), levels)


@pytest.mark.parametrize(
    ('sensors', 'missing'),
    [
        (4, None),
        (5, None),
        (5, 1),
        (6, None),
        (6, 1),
    ],
)
def test_a_bound_of_the_parity_replaces_what_large_biases_would_allow(sensors, missing):
    """Errors of any direction whose part that no motion explains is as long as the bound."""
    rotation = kinematics.workspace_pose(0.2, 1.0, 0.4)
    sample = sample_at(rotation, sensors, missing)
    large = (radians(5.0),) * sensors
    noise = (1.0,) * sensors
    parity_bias = radians(0.03)
    bound = integrity(sample, large, noise, parity_bias).bias
    assert bound < integrity(sample, large, noise).bias

    errors = np.random.default_rng(1).normal(size=(2000, sensors))
    jacobian = kinematics.jacobian(rotation, sensors=sensors)
    unexplained = errors @ without(jacobian)
    errors *= parity_bias / np.linalg.norm(unexplained, axis=1, keepdims=True)
    there = there_are(sensors, missing)
    sigma = SIGMA[:sensors]
    whitened = (jacobian / sigma[:, None])[there]
    parity = (errors / sigma)[:, there] @ without(whitened)
    moved = np.linalg.norm(parity, axis=1)
    assert 0.5 * bound < moved.max()
    assert moved.max() <= bound * (1.0 + 1e-6)

    # With small biases nothing changes.
    small = (radians(0.001),) * sensors
    assert integrity(sample, small, noise, parity_bias) == integrity(sample, small, noise)


def without(columns):
    """Return the projection that leaves what no combination of columns explains."""
    return np.eye(len(columns)) - columns @ np.linalg.pinv(columns)


def largest_error_over_level(sensors, bias, sigma, alert, pose):
    """Return the largest error over level of one faulty sensor and biases that oppose it; rad."""
    angles = tuple(joint_angles(pose[None], sensors)[0].tolist())
    used = kinematics.UsedSensors((sigma,) * sensors)
    sample = kinematics.estimate_sample(angles, used, kinematics.Geometry())
    worth = integrity(sample, (bias,) * sensors, (1.0,) * sensors)
    threshold = product_limits().threshold(sensors - 3)
    parts = np.array(worth.parts((threshold + MISSED_DETECTION) / sqrt(20.0)))
    level = max([*parts[parts <= alert], worth.healthy])
    limit = threshold / sqrt(20.0) + worth.bias
    # Orientation and parity by each reading; rad / rad, and standard deviations / rad.
    whitened = kinematics.jacobian(pose, sensors=sensors) / sigma
    gains = np.linalg.pinv(whitened).T / sigma
    changes = without(whitened) / sigma
    worst = 0.0
    signs = list(product((-1.0, 1.0), repeat=sensors))
    for sensor in np.flatnonzero(parts <= alert):
        others = bias * np.array(signs)
        others[:, sensor] = 0.0
        # Largest fault, of either sign, whose mean parity stays within the limit.
        along = changes[sensor]
        length = along @ along
        rest = others @ changes
        beyond = (rest**2).sum(axis=1) - limit**2
        half = rest @ along / length
        root = np.sqrt(half**2 - beyond / length)
        for fault in (root - half, -root - half):
            others[:, sensor] = fault
            error = np.linalg.norm(others @ gains, axis=1).max()
            worst = max(worst, error / level)
    return worst


@pytest.mark.parametrize(
    ('noise', 'alert', 'sensors'),
    few(
        [(0.05, 0.04), (0.1, 0.02), (0.1, 0.01), (0.05, 0.005)],
        [0.5, 1.0],
        [4, 5, 6],
        count=6,
    ),
)
def test_no_undetected_fault_is_beyond_the_level_whatever_the_signs_of_the_biases(
    noise, alert, sensors
):
    """Every combination of signs, the largest fault that the window does not detect."""
    bias, sigma, limit = np.radians((*noise, alert)).tolist()
    rng = np.random.default_rng(1)
    found = []
    for _ in range(10):
        pose = random_pose(rng)
        found.append(largest_error_over_level(sensors, bias, sigma, limit, pose))
    assert 0.1 < max(found) <= 1.0


@pytest.mark.parametrize(
    ('parts', 'healthy', 'level'),
    [
        ([0.1, 0.2, 0.15], 0.05, 0.2),
        ([0.2, 0.1, 0.15], 0.05, 0.2),
        # One beyond the alert limit is not in it: its sensor is not checked.
        ([0.1, 0.31, np.inf], 0.05, 0.1),
        ([0.1, 0.3, 0.31], 0.05, 0.3),
        ([np.inf] * 4, 0.05, 0.05),
        ([0.1, 0.2], 0.25, 0.25),
        ([0.1, 0.2], 0.4, 0.4),
    ],
)
def test_the_level_is_the_largest_part_within_the_alert_limit(parts, healthy, level):
    assert protection_level(parts, 0.3, healthy) == level
