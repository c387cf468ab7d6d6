# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the diagnostics ask at their rate, held against the functions that take their time."""

import numpy as np
import pytest

from spm_haptic_master.exceptions import UnreachableError
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    matrix_from_zxz,
    nearest_singularity,
    quaternion_from_matrix,
)
from spm_haptic_master.kinematics.singularity import approach, nearness

GEOMETRY = Geometry()
MODE = (1, 1, 1)


def pose(psi, theta, phi):
    rotation = matrix_from_zxz(*np.radians([psi, theta, phi]))
    return rotation, tuple(quaternion_from_matrix(rotation).tolist())


@pytest.mark.parametrize('zxz', [
    (135.0, 54.7356, 20.0), (135.0, 54.7356, 49.0), (120.0, 45.0, 30.0), (150.0, 60.0, 60.0)])
def test_nearness_is_the_dexterity(zxz):
    rotation, quaternion = pose(*zxz)
    got = nearness(quaternion, GEOMETRY, MODE)
    assert got.three == pytest.approx(float(dexterity(rotation)), rel=1e-9)
    assert got.four == pytest.approx(float(dexterity(rotation, sensors=4)), rel=1e-9)


def test_nearness_out_of_reach():
    with pytest.raises(UnreachableError):
        nearness(pose(0.0, 170.0, 0.0)[1], GEOMETRY, MODE)


@pytest.mark.parametrize('zxz', [
    (135.0, 54.7356, 40.0), (135.0, 54.7356, 49.0), (135.0, 54.7356, 55.0), (125.0, 50.0, 45.0),
    (140.0, 60.0, 52.0)])
def test_approach_is_the_nearest_singularity(zxz):
    rotation, quaternion = pose(*zxz)
    got, slow = approach(quaternion, GEOMETRY, MODE), nearest_singularity(rotation)
    assert got.distance == pytest.approx(slow.distance, abs=2e-6)
    assert np.allclose(got.axis, slow.axis, atol=1e-3)


def test_distance_in_degrees_along_the_central_axis():
    for phi in (45.0, 48.0, 51.0, 55.0):
        got = approach(pose(135.0, 54.735610317, phi)[1], GEOMETRY, MODE)
        assert np.degrees(got.distance) == pytest.approx(abs(phi - 49.358591780), abs=1e-4)
        # Self-rotation is a turn about the platform axis, on (1, 1, 1).
        towards = np.sign(49.358591780 - phi)
        assert np.allclose(got.axis, towards / np.sqrt(3.0), atol=1e-4)
