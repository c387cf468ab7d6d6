# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The supervision of a mechanism as built: what it publishes, and its protection level."""

from math import radians

from built_mechanism import random_built
import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import inverse, matrix_from_quaternion, workspace_pose
from spm_haptic_master.supervision import supervise

SAMPLES = 120
BUILT = random_built(np.random.default_rng(7))
GEOMETRY = {'geometry__proximal_deg': np.degrees(BUILT.alpha),
            'geometry__distal_deg': np.degrees(BUILT.beta),
            'geometry__base_axes': BUILT.base, 'geometry__platform_axes': BUILT.platform}
STAMPS = np.arange(SAMPLES) * 1_000_000
TRUTH = workspace_pose(radians(10.0), np.linspace(0.0, 0.1, SAMPLES), radians(15.0))


def readings(fault=0.0, sensor=0):
    """Return the angles of a slow motion with noise, one sensor off by a fault from 60 on, rad."""
    joints = inverse(TRUTH, BUILT.geometry)
    angles = np.column_stack([joints.theta1, joints.theta3a])
    angles += np.random.default_rng(1).normal(0.0, radians(0.04), angles.shape)
    angles[60:, sensor] += fault
    return angles


def errors_deg(found):
    """Return the errors of what was published, deg, and the protection levels."""
    seen = found.published
    apart = matrix_from_quaternion(found.quaternion[seen]) - TRUTH[seen]
    return np.degrees(np.linalg.norm(apart, axis=(1, 2)) / np.sqrt(2.0)), \
        found.protection_level[seen]


def test_it_is_published_and_right():
    found = supervise(STAMPS, readings(), **GEOMETRY)
    assert found.published.sum() == SAMPLES - 4
    errors, _ = errors_deg(found)
    assert np.sqrt((errors**2).mean()) < 0.08
    assert not supervise(STAMPS, readings()).published[30:].any()


def test_axes_may_be_matrices_or_numbers():
    flat = {name: np.ravel(value).tolist() for name, value in GEOMETRY.items()}
    np.testing.assert_array_equal(supervise(STAMPS, readings(), **GEOMETRY).quaternion,
                                  supervise(STAMPS, readings(), **flat).quaternion)
    nested = {**GEOMETRY, 'geometry__base_axes': BUILT.base.tolist()}
    assert supervise(STAMPS, readings(), **nested).published.any()
    with pytest.raises(SettingError, match=r"'geometry\.base_axes' .* a list of 9"):
        supervise(STAMPS, readings(), geometry__base_axes=np.eye(2))


@pytest.mark.parametrize('sensor', range(4))
@pytest.mark.parametrize('fault_deg', [0.1, 0.3, -0.5, 2.0])
def test_no_fault_turns_it_by_more_than_its_protection_level(sensor, fault_deg):
    found = supervise(STAMPS, readings(radians(fault_deg), sensor), **GEOMETRY)
    errors, levels = errors_deg(found)
    assert found.published[:60].sum() == 56
    assert (errors < levels).all()
    # A large fault is seen.
    assert abs(fault_deg) < 1.0 or not found.published[62:].any()
