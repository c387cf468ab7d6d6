# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which sensor is faulty: a step is isolated to the sensor that made it, or to none."""

from math import radians

from device import encoders, joint_angles
import numpy as np
import pytest
from rig import product_limits, Rig
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix, workspace_pose
from spm_haptic_master.supervision.fault import isolated
from spm_haptic_master.supervision.sensor_set import Sample, Solver
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse

NOISE, BIAS = 0.04, radians(0.05)  # deg, rad
HEALTHY = 25  # samples before the step


def found(sensors, pose, sensor, size, seed=1, samples=3, noise=NOISE):
    """Return the sensor that a step of a sensor at rest in a pose is isolated to, or None."""
    sigma, bias, factors = (radians(noise),) * sensors, (BIAS,) * sensors, (1.0,) * sensors
    sets = SensorsInUse(Solver(Geometry(), sigma), sigma, product_limits(bias=bias))
    rotation = workspace_pose(*np.radians(pose))
    prior = tuple(quaternion_from_matrix(rotation).tolist())
    readings = encoders(
        np.tile(joint_angles(rotation[None], sensors), (HEALTHY + samples, 1)), noise, seed=seed)
    readings[HEALTHY:, sensor] += radians(size)
    evidence, result = [], np.nan
    for index, angles in enumerate(readings.tolist()):
        sample = Sample(index * 1_000_000, tuple(angles), prior, (index - 1) * 1_000_000, bias,
                        factors)
        symptom = sets.used.take(sample)
        if symptom is not None:
            assert index >= HEALTHY
            evidence += filter(None, [sets.used.evidence(symptom)])
            result = isolated(sets, sample, [symptom], (), evidence[-3:])
    return result


@pytest.mark.parametrize(('sensors', 'size', 'share', 'noise'), [
    (5, 0.5, 0.0, NOISE), (5, 2.0, 0.5, NOISE), (5, 20.0, 0.9, NOISE), (6, 0.5, 0.9, NOISE),
    (6, 2.0, 1.0, NOISE), (6, 20.0, 1.0, NOISE), (6, 30.0, 0.9, 0.7)])
def test_a_step_is_isolated_to_its_sensor_or_to_none(sensors, size, share, noise):
    """A small one of five may be that of another sensor as well: then to none."""
    rng, rows = np.random.default_rng(1), []
    for seed in range(8 if size > 0.5 else 3):
        pose = (rng.uniform(0.0, 20.0), rng.uniform(0.0, 360.0), rng.uniform(0.0, 90.0))
        for sensor in range(sensors):
            signed, samples = size * rng.choice([-1.0, 1.0]), 3 if size > 0.5 else 21
            rows.append((sensor, found(sensors, pose, sensor, signed, seed, samples, noise)))
    assert not [row for row in rows if row[1] not in (row[0], None)]
    assert np.mean([sensor == isolated for sensor, isolated in rows]) >= share


@pytest.mark.parametrize(('pose', 'sensor', 'size'), [
    ((0.0, 116.0, 70.0), 1, 13.0), ((1.0, 244.0, 44.0), 4, 16.0), ((8.0, 304.0, 81.0), 1, -13.0),
    ((13.0, 282.0, 86.0), 1, 21.0)])
def test_an_orientation_that_does_not_continue_the_motion_isolates_no_sensor(pose, sensor, size):
    """Without another sensor than the faulty one, four fit another orientation by chance."""
    assert found(5, pose, sensor, size) in (None, sensor)


@pytest.mark.parametrize(('pose', 'moved'), [
    ((9.57, 295.27, 79.69), {'th1b': -10.0}), ((10.5, 142.0, 61.7), {'th1b': 10.0})])
def test_one_fault_of_five_is_never_beyond_the_level(pose, moved):
    rig = Rig(5, pose, degraded='allow')
    assert max(rig.errors(600, **moved), default=0.0) < 1.0
    assert rig.left_out in ((), ('joint_1b',))


def test_a_second_fault_of_six_excludes_no_healthy_sensor():
    rig = Rig(6, (0.3, 88.8, 77.5))
    rig.samples(150, th1a=2.4)
    assert rig.left_out == ('joint_1a',)
    assert max(rig.errors(150, th1a=2.4, th1b=-3.2)[2:], default=0.0) < 1.0
    assert not {'joint_1c', 'joint_3a', 'joint_3b', 'joint_3c'} & set(rig.left_out)
