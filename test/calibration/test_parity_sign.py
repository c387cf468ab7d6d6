# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sign of the parity: continuous over the workspace, for four to six sensors."""

import numpy as np
import pytest
from spm_haptic_master.calibration.motion.mechanism_parameters import Layout
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.kinematics import workspace_pose

# White noise of a reading, and error of the third reading (rad).
SIGMA, ERROR = 0.0007, 0.0003


def model_of(sensors):
    """Return the drawn mechanism with a number of sensors."""
    return MotionModel(Layout(sensors), np.full(sensors, SIGMA))


def readings_at(rotation, sensors):
    """Return the readings at poses, of which the third is off by `ERROR`."""
    model = model_of(sensors)
    readings = model.readings(rotation, np.zeros(model.layout.count))
    readings[:, 2] += ERROR
    return readings


def linearised(rotation, sensors, at=None):
    """Return the samples of poses, linearised there or at other orientations."""
    model = model_of(sensors)
    return model.linearised(readings_at(rotation, sensors), rotation if at is None else at,
                            np.zeros(model.layout.count), (0, 1, 2))


def circle(count):
    """Return poses on a circle about the centre, at turns on both sides of the singularity."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, count)
    return workspace_pose(0.25, azimuth, 0.8 + 0.5 * np.sin(azimuth))


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_parity_of_a_constant_error_has_no_jump(sensors):
    found = linearised(circle(2000), sensors)
    assert found.usable.all()
    for parity in found.parity.T:
        assert np.ptp(parity) > 0.1
        assert np.abs(np.diff(parity)).max() < 0.02 * np.abs(parity).max()


def test_first_component_is_the_parity_of_the_first_four_sensors():
    rotation = circle(50)
    four = linearised(rotation, 4)
    for sensors in (5, 6):
        more = linearised(rotation, sensors)
        np.testing.assert_allclose(more.parity[:, 0], four.parity[:, 0], atol=1e-9)
        np.testing.assert_allclose(more.derivative[:, 0], four.derivative[:, 0], atol=1e-5)


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_parity_vector_is_what_no_orientation_explains(sensors):
    """Its size is the least weighted distance of the readings from those of any rotation."""
    rotation = circle(20)
    found = linearised(rotation, sensors)
    best = found.rotation
    for _ in range(3):
        best = linearised(rotation, sensors, best).rotation
    model = model_of(sensors)
    error = readings_at(rotation, sensors) - model.readings(best, np.zeros(model.layout.count))
    np.testing.assert_allclose(np.linalg.norm(found.parity, axis=1),
                               np.linalg.norm(error, axis=1) / SIGMA, rtol=0.01)
