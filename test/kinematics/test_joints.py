# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The names of the joints, and what is derived of the sensors in use."""

import math

import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import joints
from spm_haptic_master.kinematics.joints import UsedSensors


def test_the_names_are_those_of_the_rig():
    measured = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a', 'joint_3b', 'joint_3c')
    assert measured[:4] == joints.JOINT_NAMES
    assert measured == joints.ALL_JOINT_NAMES
    assert tuple(f'joint_{name.lower()}' for name in joints.SHORT_NAMES) == measured
    assert joints.MECHANISM_JOINT_NAMES == (
        *('joint_1a', 'joint_2a', 'joint_3a'),
        *('joint_1b', 'joint_2b', 'joint_3b'),
        *('joint_1c', 'joint_2c', 'joint_3c'),
    )
    assert joints.NUMBER_WORDS == {4: 'four', 5: 'five', 6: 'six'}


@pytest.mark.parametrize(
    ('text', 'named'),
    [
        ('', ()),
        ('joint_3a: heartbeat lost; joint_1b silent', ('joint_1b', 'joint_3a')),
        ('joint_1 joint_1ab joint_2a', ()),
    ],
)
def test_a_text_names_the_joints_with_sensors(text, named):
    assert joints.named_joints(text) == named


@pytest.mark.parametrize(
    ('mounted', 'left_out', 'used', 'largest', 'usual'),
    [
        (4, (), (0, 1, 2, 3), 4.0, True),
        (4, (3,), (0, 1, 2), 3.0, False),
        (5, (4,), (0, 1, 2, 3), 4.0, True),
        (6, (), (0, 1, 2, 3, 4, 5), 6.0, True),
        (6, (0, 5), (1, 2, 3, 4), 5.0, False),
        (6, [1, 2, 3], (0, 4, 5), 6.0, False),
    ],
)
def test_what_is_derived_of_the_sensors_in_use(mounted, left_out, used, largest, usual):
    sigma = tuple(1e-3 * (1 + place) for place in range(mounted))
    sensors = UsedSensors(sigma, left_out)
    assert sensors.used == used
    assert sensors.count == len(used)
    assert sensors.largest == pytest.approx(1e-3 * largest)
    assert sensors.usual is usual
    assert sensors.further == mounted - 4
    for place, weight in enumerate(sensors.weights):
        expected = 1.0 / sigma[place] ** 2 if place in used else 0.0
        assert weight == pytest.approx(expected)


@pytest.mark.parametrize(
    ('deviation', 'accepted'),
    [(0.9e-9, False), (1.1e-9, True), (math.pi - 1e-6, True), (math.pi + 1e-6, False)],
)
def test_a_standard_deviation_is_from_a_nanoradian_to_half_a_turn(deviation, accepted):
    sigma = (1e-3, 1e-3, 1e-3, deviation)
    if accepted:
        assert UsedSensors(sigma).sigma == sigma
    else:
        with pytest.raises(InputError, match='from 1e-09 to 3.14159'):
            UsedSensors(sigma)
