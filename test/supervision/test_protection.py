# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protection level, beside the pseudo-inverse."""

from itertools import product
from math import sqrt

from device import joint_angles
import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    estimate_sample,
    Geometry,
    jacobian,
    quaternion_from_matrix,
    UsedSensors,
    workspace_pose,
)
from spm_haptic_master.supervision.protection import integrity, MISSED_DETECTION

# Threshold of the mean of 20 samples at one false alarm in 10,000 hours, with missed detection.
REACH = (6.9 + 5.3) / sqrt(20.0)


@pytest.mark.parametrize(('sensors', 'missing'), [
    (4, None), *product((5, 6), (None, 1, 3, 4))])
@pytest.mark.parametrize('pose', [(0.1, 1.0, 0.3), (0.2, 2.5, 0.7)])
def test_it_is_the_pseudo_inverse_of_the_whitened_jacobian(sensors, missing, pose):
    rotation = workspace_pose(*pose)
    sigma = np.radians([0.02, 0.04, 0.06, 0.03, 0.05, 0.035])[:sensors]
    bias = np.radians([0.05, 0.02, 0.0, 0.1, 0.03, 0.04])[:sensors]
    factors = np.array([1.5, 1.0, 2.0, 1.2, 1.0, 1.1])[:sensors]
    used = UsedSensors(tuple(sigma.tolist()), () if missing is None else (missing,))
    sample = estimate_sample(tuple(joint_angles(rotation[None], sensors)[0].tolist()), used,
                             Geometry(), tuple(quaternion_from_matrix(rotation).tolist()))
    worth = integrity(sample, tuple(bias.tolist()), tuple(factors.tolist()))
    there = np.arange(sensors) != (-1 if missing is None else missing)
    whitened = (jacobian(rotation, sensors=sensors) / sigma[:, None])[there]
    gain = np.linalg.pinv(whitened)
    share = np.sqrt(np.diagonal(np.eye(there.sum()) - whitened @ gain))
    turns, moved = np.linalg.norm(gain, axis=0), (bias / sigma)[there]
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
