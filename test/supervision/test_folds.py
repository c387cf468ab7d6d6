# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parts of the level to second order: the curvatures are renewed before they are old."""

from math import inf

import numpy as np
from rig import product_limits
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.inverse_model import measured_angles, RIG_WORKING_MODE
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)
from spm_haptic_master.supervision.folds import Folds
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensor_set import SensorSet
from spm_haptic_master.supervision.solver import Solver

LIMITS = product_limits()
SIGMA = (np.radians(0.04),) * 4
# The worst of 1,200 turns: steps of 0.01 rad, the orientation at which it begins (x, y, z, w), the
# axis. The curvature of th1A is near 0 on the way, and the fold is at the end of a leg's reach.
STEPS = 37
START = (0.298540, 0.403338, 0.775272, 0.383595)
AXIS = (-0.586926, 0.506396, -0.631729)


def judged(sensor_set, quaternion, stamp):
    """Return the orientation of exact readings at a quaternion, and what it is worth."""
    angles = measured_angles(
        rotation_from_quaternion(*quaternion), Geometry(), RIG_WORKING_MODE, 4
    )
    sample = Sample(
        stamp=stamp,
        angles=angles,
        prior=Place(stamp - 500_000, quaternion),
        bias=LIMITS.bias,
        factors=(1.0,) * 4,
        parity_bias=LIMITS.parity_bias,
        period=0.0005,
    )
    sensor_set.solve(sample)
    return sensor_set.estimate, sensor_set.worth


def test_no_curvature_is_kept_on_the_way_into_a_fold():
    """Where it was near 0 it was kept for 0.2 rad: 2 deg where no fault is detected at all."""
    start = tuple((np.array(START) / np.linalg.norm(START)).tolist())
    solver = Solver(Geometry(), SIGMA, RIG_WORKING_MODE, LIMITS.bias)
    sensor_set = SensorSet(solver, SIGMA, LIMITS)
    kept = Folds(4)
    tried = 0
    for step in range(STEPS + 1):
        turn = quaternion_from_vector(*(0.01 * step * np.array(AXIS)).tolist())
        estimate, worth = judged(sensor_set, multiply_quaternions(turn, start), 500_000 * step)
        parts = kept.parts(sensor_set, estimate, worth)
        renewed = Folds(4).parts(sensor_set, estimate, worth)
        # Where the device cannot turn by 0.03 rad there is no curvature at all.
        known = [solver.curvature(estimate, sensor) < inf for sensor in range(4)]
        for sensor in np.flatnonzero(np.array(parts) < np.radians(3.0)):
            if known[sensor]:
                assert renewed[sensor] <= 1.1 * parts[sensor], (step, sensor)
                tried += 1
    assert tried > 10
