# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which sensor is faulty: a step is isolated to the sensor that made it, or to none."""

import numpy as np
import pytest
from rig import NAMES, Rig
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES


def left_out(sensors, pose, sensor, size):
    """Return the sensors that a step of one, at rest in a pose, has excluded."""
    rig = Rig(sensors, pose, degraded='allow', alert_limit_deg=30.0)
    rig.samples(30, **{NAMES[sensor]: size})
    return rig.left_out


@pytest.mark.parametrize(('sensors', 'size', 'share'), [
    (5, 0.5, 0.0), (5, 2.0, 0.5), (5, 20.0, 0.9), (6, 0.5, 0.9), (6, 2.0, 1.0), (6, 20.0, 1.0)])
def test_a_step_is_isolated_to_its_sensor_or_to_none(sensors, size, share):
    """A small step of one of five may be that of another as well: then to none."""
    rng, found = np.random.default_rng(1), []
    for _ in range(2):
        pose = (rng.uniform(0.0, 20.0), rng.uniform(0.0, 360.0), rng.uniform(0.0, 90.0))
        for sensor in range(sensors):
            names = left_out(sensors, pose, sensor, size * rng.choice([-1.0, 1.0]))
            assert names in ((), (ALL_JOINT_NAMES[sensor],))
            found.append(bool(names))
    assert np.mean(found) >= share


@pytest.mark.parametrize(('pose', 'sensor', 'size'), [
    ((0.0, 116.0, 70.0), 1, 13.0), ((1.0, 244.0, 44.0), 4, 16.0), ((8.0, 304.0, 81.0), 1, -13.0),
    ((13.0, 282.0, 86.0), 1, 21.0)])
def test_an_orientation_that_does_not_continue_the_motion_isolates_no_sensor(pose, sensor, size):
    """Without another sensor than the faulty one, four fit another orientation by chance."""
    assert left_out(5, pose, sensor, size) in ((), (ALL_JOINT_NAMES[sensor],))


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
