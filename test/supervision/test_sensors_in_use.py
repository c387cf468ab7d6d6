# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The sensors that are not in use: faulty, missing, or not trusted again."""

from math import inf, nan, radians

from device import encoders, joint_angles
import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix, workspace_pose
from spm_haptic_master.supervision.sensor_set import Sample
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.solver import Solver

DT = 2.0 ** -10
BIAS = (radians(0.05),) * 6
LIMITS = product_limits(bias=BIAS, recovery=100 * DT, window=20 * DT)
ROTATION = workspace_pose(*np.radians((8.0, 30.0, 20.0)))
PRIOR = tuple(quaternion_from_matrix(ROTATION).tolist())
READINGS = encoders(np.tile(joint_angles(ROTATION[None], 6), (1000, 1)))


def without(*places):
    return tuple(nan if place in places else 0.1 for place in range(6))


FULL = without()


def noted(*samples):
    """Return the sensors in use after samples."""
    sigma = (radians(0.04),) * 6
    sensors = SensorsInUse(Solver(Geometry(), sigma), sigma, LIMITS)
    for angles in samples:
        sensors.note(angles)
    return sensors


def excluded(*places):
    sensors = noted(FULL)
    for place in places:
        sensors.exclude(place)
    return sensors


def readmit(sensors, index, bad=False, **offsets):
    """Let the sensors that are left out prove themselves by a sample; offsets, deg, by place."""
    angles = READINGS[index].copy()
    for place, size in offsets.items():
        angles[int(place[1:])] += radians(size)
    sample = Sample(index * 1_000_000, tuple(angles.tolist()), PRIOR, None, BIAS,
                    (1.0,) * 6)
    sensors.readmit(sample, DT, LIMITS.alert_limit, bad)


def agreements(sensors, place):
    """Return after how many samples of agreement a sensor is used again."""
    for count in range(1, 1000):
        readmit(sensors, count)
        if place not in sensors.left_out:
            return count
    return None


def test_at_first_all_sensors_are_in_use_and_fewer_than_three_are_no_set():
    sensors = noted()
    assert (sensors.left_out, sensors.names, sensors.words) == ((), (), '')
    assert sensors.used.sensors.used == (0, 1, 2, 3, 4, 5)
    assert sensors.without(0, 4, 5).sensors.used == (1, 2, 3)
    assert sensors.without(0) is sensors.without(0, 0)
    assert sensors.without(0, 1, 2, 3) is None


def test_a_lost_frame_leaves_a_sensor_out_of_that_sample_only():
    sensors = noted(without(4), without(4))
    assert (sensors.missing, sensors.left_out, sensors.names) == ((4,), (4,), ())
    assert sensors.used.sensors.used == (0, 1, 2, 3, 5)
    sensors.note(FULL)
    assert sensors.missing == sensors.left_out == ()
    assert noted(*[without(4), without(4), FULL] * 20).names == ()


def test_a_sensor_missing_for_three_samples_is_used_after_a_window_of_agreement():
    sensors = noted(*[without(4)] * 3)
    assert (sensors.names, sensors.words) == (('joint_3b',), 'joint_3b missing')
    assert agreements(sensors, 4) is None
    sensors.note(FULL)
    assert sensors.left_out == (4,)
    assert agreements(sensors, 4) == 20
    assert (sensors.names, sensors.words) == ((), '')


@pytest.mark.parametrize(('left_out', 'angles', 'words'), [
    ((), without(4, 5), None), ((), without(3, 4, 5), 'joint_3a missing'),
    ((), (inf, *FULL[1:]), 'angle not finite'), ((), (-inf, *FULL[1:]), 'angle not finite'),
    # Too few in use, though each has a reading.
    ((1, 2), FULL, None), ((1, 2, 3), FULL, 'missing')])
def test_what_does_not_suffice_is_the_cause_of_silence(left_out, angles, words):
    cause = excluded(*left_out).note(angles)
    assert (cause and cause.words) == words


@pytest.mark.parametrize('contradiction', [None, {'p1': 5.0}, {'bad': True}, 'missing'])
def test_a_faulty_sensor_is_used_after_its_recovery_in_one_piece(contradiction):
    sensors = excluded(1)
    assert (sensors.left_out, sensors.words) == ((1,), 'joint_1b excluded')
    if contradiction == 'missing':
        for angles in [without(1)] * 5 + [FULL]:
            sensors.note(angles)
        assert sensors.words == 'joint_1b excluded'
    elif contradiction:
        for index in range(1, 100):
            readmit(sensors, index)
        readmit(sensors, 100, **contradiction)
    assert agreements(sensors, 1) == 100


def test_several_sensors_are_named_in_their_order():
    sensors = noted(*[without(5, 3)] * 3)
    sensors.exclude(0)
    assert sensors.left_out == (0, 3, 5)
    assert sensors.names == ('joint_1a', 'joint_3a', 'joint_3c')
    assert sensors.words == 'joint_1a excluded, joint_3a missing, joint_3c missing'
