# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether an orientation near another explains readings, also where they determine none."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.exceptions import SpmError, UnreachableError
from spm_haptic_master.kinematics import Geometry, UsedSensors
from spm_haptic_master.kinematics.estimation.damped_fit import explaining_orientation
from spm_haptic_master.kinematics.estimation.sample_estimates import estimate_sample
from spm_haptic_master.kinematics.inverse_model import measured_angles
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)
from spm_haptic_master.kinematics.workspace import workspace_pose

SIGMA = radians(0.0128)
# Largest norm of the residuals: 6 standard deviations.
MOST = 6.0
USUAL = tuple(quaternion_from_matrix(workspace_pose(radians(15), radians(30), radians(20))))
# About 5 deg from the usual one.
BESIDE = tuple(quaternion_from_matrix(workspace_pose(radians(18), radians(36), radians(22))))
MODE = (1, 1, 1)
# Where th1A, th1B, th1C and th3A determine an orientation hardly, in this working mode.
SINGULAR = (0.2127785, 0.175282, 0.8432406, 0.4614617)
SINGULAR_MODE = (-1, -1, 1)


def angles_at(quaternion, mode, sensors=5):
    """Return the angles of a device at an orientation, rad."""
    unit = np.array(quaternion) / np.linalg.norm(quaternion)
    return np.array(measured_angles(rotation_from_quaternion(*unit), Geometry(), mode, sensors))


def explained(readings, start=BESIDE, mode=MODE, left_out=()):
    """Return what explains the readings from an orientation on."""
    sensors = UsedSensors((SIGMA,) * len(readings), left_out)
    return explaining_orientation(start, tuple(readings), sensors, Geometry(), mode, MOST)


def test_healthy_readings_are_explained_by_the_orientation_of_the_device():
    found = explained(angles_at(USUAL, MODE))
    assert rotation_distance(found, USUAL) < 3.0 * SIGMA


@pytest.mark.parametrize('place', range(5))
def test_a_fault_that_the_others_contradict_is_not_explained(place):
    readings = angles_at(USUAL, MODE)
    readings[place] += radians(1.0)
    assert explained(readings) is None


@pytest.mark.parametrize('place', range(5))
def test_a_sensor_that_is_left_out_may_have_any_reading(place):
    readings = angles_at(USUAL, MODE)
    readings[place] = np.nan
    assert explained(readings, left_out=(place,)) is not None


def test_readings_are_explained_where_they_determine_no_orientation():
    """Noise makes the angles fit no orientation, or two of them, in most of these samples."""
    angles = angles_at(SINGULAR, SINGULAR_MODE)
    sensors = UsedSensors((SIGMA,) * 5, (4,))
    noise = np.random.default_rng(0).normal(size=(40, 5)) * SIGMA
    refused = 0
    for readings in angles + noise:
        try:
            estimate_sample(tuple(readings), sensors, Geometry(), None, SINGULAR_MODE)
        except SpmError:
            refused += 1
        assert explained(readings, SINGULAR, SINGULAR_MODE, left_out=(4,)) is not None
    assert refused > 20


def test_an_orientation_in_another_working_mode_explains_nothing():
    readings = angles_at(USUAL, (1, 1, -1))
    assert explained(readings) is None


def test_a_leg_without_a_reading_has_to_reach_the_orientation_to_start_from():
    readings = angles_at(USUAL, MODE)
    upside_down = (1.0, 0.0, 0.0, 0.0)
    assert explained(readings, upside_down, left_out=(0,)) is None


def test_readings_are_explained_without_an_orientation_to_start_from():
    found = explained(angles_at(USUAL, MODE), start=None)
    assert rotation_distance(found, USUAL) < 3.0 * SIGMA


def test_readings_that_fit_nowhere_are_not_explained_without_a_start():
    readings = angles_at(USUAL, MODE)
    readings[1] += radians(30.0)
    assert explained(readings, start=None) is None


@pytest.mark.parametrize('azimuth', [0.0, 30.0, 150.0, 270.0])
@pytest.mark.parametrize('has_start', [True, False])
def test_a_leg_at_the_end_of_its_reach_explains_nothing_and_raises_nothing(azimuth, has_start):
    """There it is on the boundary of its working mode, which the steps cannot pass."""
    edge = edge_of_reach(radians(azimuth))
    assert explained(angles_at(edge, MODE), edge if has_start else None) is None


def edge_of_reach(azimuth):
    """Return the last orientation that all legs reach as the platform tilts towards an azimuth."""
    reached = radians(15)
    beyond = radians(110)
    for _ in range(60):
        tilt = 0.5 * (reached + beyond)
        try:
            angles_at(tilted(tilt, azimuth), MODE)
            reached = tilt
        except UnreachableError:
            beyond = tilt
    return tilted(reached, azimuth)


def tilted(tilt, azimuth):
    """Return an orientation of the workspace, as a quaternion."""
    return tuple(quaternion_from_matrix(workspace_pose(tilt, azimuth, radians(20))))
