# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The protection level: the theory's numbers, from an independent model."""

from math import degrees, radians, sqrt

from device import SINGULAR
import numpy as np
import pytest
from spm_haptic_master.kinematics import Geometry, inverse, quaternion_from_matrix, workspace_pose
from spm_haptic_master.kinematics.estimation.sample_estimation import estimate_sample
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.protection import integrity

SIGMA = radians(0.04)
# Threshold of the mean of 20 samples at one false alarm in 10,000 hours, with missed detection.
REACH = (6.9 + 5.3) / sqrt(20.0)
# phi in deg; each sensor's part of the level, deg, without and with 0.05 deg of nominal bias, and
# its slope: an independent model's, at the centre of the workspace.
TABLE = [
    (10.0, (0.7, 0.6, 2.8, 1.1), (.07, .06, .30, .11), (.14, .11, .57, .21)),
    (25.0, (0.6, 0.6, 1.7, 1.7), (.07, .06, .19, .19), (.13, .12, .35, .35)),
    (40.0, (0.7, 0.7, 1.2, 4.8), (.07, .07, .13, .52), (.14, .14, .23, .97)),
    (45.0, (0.7, 0.7, 1.0, 11.), (.08, .08, .11, 1.2), (.14, .15, .20, 2.1)),
    (60.0, (0.8, 1.1, 0.7, 4.5), (.09, .12, .08, .49), (.17, .22, .14, .90)),
    (75.0, (1.0, 1.6, 0.6, 1.9), (.10, .18, .06, .20), (.19, .33, .11, .38)),
]


def estimate_at(rotation):
    joints = inverse(rotation)
    return estimate_sample((*joints.theta1.tolist(), float(joints.theta3a)),
                           UsedSensors((SIGMA,) * 4), Geometry())


def parts(rotation, bias_deg):
    worth = integrity(estimate_at(rotation), (radians(bias_deg),) * 4, (1.0,) * 4)
    return worth, [degrees(level - worth.healthy) for level in worth.levels(REACH)]


@pytest.mark.parametrize(('phi', 'slopes', 'without', 'biased'), TABLE)
def test_parts_of_each_sensor_are_those_of_an_independent_model(phi, slopes, without, biased):
    pose = workspace_pose(0.0, 0.0, radians(phi))
    worth, found = parts(pose, 0.0)
    assert np.array(worth.slopes) / SIGMA == pytest.approx(slopes, rel=0.05, abs=0.06)
    assert found == pytest.approx(without, rel=0.05, abs=0.005)
    # The model counts the bias once.
    twice = 2.0 * np.array(biased) - without
    assert parts(pose, 0.05)[1] == pytest.approx(twice, rel=0.05, abs=0.016)


def test_th3a_is_beyond_every_limit_at_the_singularity():
    _, found = parts(workspace_pose(0.0, 0.0, radians(SINGULAR)), 0.05)
    assert found[:3] == pytest.approx([.20, .23, .26], abs=0.012)
    assert found[3] > 1e4


@pytest.mark.parametrize('sensor', range(4))
def test_a_fault_at_the_level_turns_the_orientation_as_far_as_it_says(sensor):
    """Finite differences of the estimate: error over parity is the slope."""
    rotation = workspace_pose(0.15, 1.0, 0.4)
    joints = inverse(rotation)
    angles = [*joints.theta1.tolist(), float(joints.theta3a)]
    slope = integrity(estimate_at(rotation), (0.0,) * 4, (1.0,) * 4).slopes[sensor]
    step = radians(1e-3)
    angles[sensor] += step
    moved = estimate_sample(tuple(angles), UsedSensors((SIGMA,) * 4), Geometry())
    turn = rotation_distance(moved.quaternion, tuple(quaternion_from_matrix(rotation).tolist()))
    assert turn / abs(moved.parity) == pytest.approx(slope, rel=1e-3)
