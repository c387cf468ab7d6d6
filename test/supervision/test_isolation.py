# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which sensor is faulty: by the parity of five and six, by the motion alone of four."""

from math import radians

from device import encoders, joint_angles
import numpy as np
import pytest
from rig import product_limits, Rig
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix, workspace_pose
from spm_haptic_master.supervision.fault import isolated
from spm_haptic_master.supervision.sensor_set import Sample
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

SIGMA, BIAS = radians(0.04), radians(0.05)
MS = 1_000_000
JUMPED = Symptom(Reason.JUMPED, sensor=1, severity=Severity.LATCH)
POSES = [(8.0, 30.0, 20.0), (15.0, 200.0, 60.0), (0.0, 0.0, 35.0)]


class Bench:
    """Sensors at rest in a pose, each sample solved by all of them."""

    def __init__(self, sensors, pose, seed=1, samples=200):
        self.bias, self.factors = (BIAS,) * sensors, (1.0,) * sensors
        sigma = (SIGMA,) * sensors
        self.sets = SensorsInUse(Solver(Geometry(), sigma), sigma, product_limits(bias=self.bias))
        self.used, self.evidence = self.sets.used, []
        rotation = workspace_pose(*np.radians(pose))
        self.prior = tuple(quaternion_from_matrix(rotation).tolist())
        self.readings = encoders(
            np.tile(joint_angles(rotation[None], sensors), (samples, 1)), seed=seed)
        self.now = 0

    def take(self, subject=None, **offsets):
        """Return what contradicts the next sample; offsets, deg, by the sensor's place."""
        self.now += 1
        angles = self.readings[self.now].copy()
        for place, size in offsets.items():
            angles[int(place[1:])] += np.radians(size)
        self.sample = Sample(self.now * MS, tuple(angles.tolist()), self.prior,
                             (self.now - 1) * MS, self.bias, self.factors)
        return (subject or self.used).take(self.sample)

    def faulty(self, *symptoms, alone=()):
        """Return the faulty sensor after one more bad sample."""
        self.evidence += [found for symptom in symptoms if symptom.sensor is None
                          and (found := self.used.evidence(symptom)) is not None]
        return isolated(self.sets, self.sample, symptoms, alone, self.evidence[-3:])


def found(sensors, pose, sensor, size, seed=1, samples=3):
    """Return the sensor that a step of a sensor is isolated to, or None."""
    bench, result = Bench(sensors, pose, seed), np.nan
    for _ in range(30):
        bench.take()
    for _ in range(samples):
        symptom = bench.take(**{f'p{sensor}': size})
        if symptom is not None:
            result = bench.faulty(symptom)
    return result


def steps(sensors, size, poses=15):
    """Return each stepped sensor, and what it was isolated to, at poses of the workspace."""
    rng = np.random.default_rng(1)
    rows = []
    for seed in range(poses):
        pose = (rng.uniform(0.0, 20.0), rng.uniform(0.0, 360.0), rng.uniform(0.0, 90.0))
        for sensor in range(sensors):
            signed = size * rng.choice([-1.0, 1.0])
            samples = 3 if size > 0.5 else 21
            rows.append((sensor, found(sensors, pose, sensor, signed, seed, samples)))
    return rows


# Five and six sensors -----------------------------------------------------------------------

@pytest.mark.parametrize(('sensors', 'size', 'share'), [
    (5, 0.5, 0.0), (5, 2.0, 0.5), (5, 20.0, 0.9), (6, 0.5, 0.9), (6, 2.0, 1.0), (6, 20.0, 1.0)])
def test_a_step_is_isolated_to_its_sensor_or_to_none(sensors, size, share):
    """A small one of five may be that of another sensor as well: then to none."""
    rows = steps(sensors, size)
    assert not [row for row in rows if row[1] not in (row[0], None)]
    assert np.mean([sensor == isolated for sensor, isolated in rows]) >= share


@pytest.mark.parametrize(('pose', 'sensor', 'size'), [
    ((0.0, 116.0, 70.0), 1, 13.0), ((1.0, 244.0, 44.0), 4, 16.0), ((8.0, 304.0, 81.0), 1, -13.0),
    ((13.0, 282.0, 86.0), 1, 21.0)])
def test_an_orientation_that_does_not_continue_the_motion_isolates_no_sensor(pose, sensor, size):
    """Without another sensor than the faulty one, four fit another orientation by chance."""
    assert found(5, pose, sensor, size) in (None, sensor)


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('sensor', range(6))
def test_a_drift_of_one_of_six_is_isolated_by_the_mean_of_the_window(pose, sensor):
    """0.36 deg: nine standard deviations of the noise, too few for one sample."""
    bench = Bench(6, pose)
    symptoms = [bench.take(**{f'p{sensor}': 0.36}) for _ in range(40)]
    detected = next(each for each in symptoms if each is not None)
    assert detected.reason is Reason.DRIFTED
    assert bench.faulty(detected) in (None, sensor)
    parity = bench.used.evidence(detected)[0]
    assert min(range(6), key=lambda each: bench.used.unexplained(each, parity)) == sensor


def test_a_sensor_that_names_itself_is_the_faulty_one_and_two_are_not_one():
    bench = Bench(6, POSES[0])
    bench.take()
    assert bench.faulty(JUMPED) == 1
    assert bench.faulty(JUMPED, JUMPED._replace(sensor=4)) is None
    assert bench.faulty(JUMPED._replace(severity=Severity.WITHHOLD)) is None
    for pose in POSES:
        bench = Bench(6, pose)
        assert bench.faulty(bench.take(p0=8.0, p4=5.0)) is None


# Four sensors -------------------------------------------------------------------------------

@pytest.mark.parametrize('sensor', range(4))
@pytest.mark.parametrize('pose', POSES)
def test_of_four_the_joint_that_left_its_motion_alone_is_faulty(pose, sensor):
    bench = Bench(4, pose)
    symptom = bench.take(**{f'p{sensor}': 5.0})
    for alone, faulty in (([sensor], sensor), ([], None), ([0, 2], None)):
        assert bench.faulty(symptom, alone=alone) == faulty


# Sets of sensors ----------------------------------------------------------------------------

@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('noise', [1.0, 3.0])
def test_the_parity_bounds_the_noise_that_a_motion_may_pretend(sensors, noise):
    """By about what the sensor has."""
    bench, rng = Bench(sensors, POSES[0], samples=1100), np.random.default_rng(3)
    for _ in range(1000):
        bench.take(p3=0.04 * np.sqrt(noise**2 - 1.0) * rng.normal())
    assert 0.9 * noise < bench.used.noise_bounds()[3] < 1.3 * noise


# What follows from it -----------------------------------------------------------------------

@pytest.mark.parametrize(('pose', 'moved'), [
    ((9.57, 295.27, 79.69), {'th1b': -10.0}), ((10.5, 142.0, 61.7), {'th1b': 10.0})])
def test_one_fault_of_five_is_never_beyond_the_level(pose, moved):
    rig = Rig(5, pose, degraded='allow')
    assert max(rig.errors(600, **moved), default=0.0) < 1.0
    assert rig.verdict.left_out in ((), ('joint_1b',))


def test_a_second_fault_of_six_excludes_no_healthy_sensor():
    rig = Rig(6, (0.3, 88.8, 77.5))
    rig.samples(150, th1a=2.4)
    assert rig.verdict.left_out == ('joint_1a',)
    assert max(rig.errors(150, th1a=2.4, th1b=-3.2)[2:], default=0.0) < 1.0
    assert not {'joint_1c', 'joint_3a', 'joint_3b', 'joint_3c'} & set(rig.verdict.left_out)
