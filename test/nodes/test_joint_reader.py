# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The position of one joint from serialized messages, whatever their publisher puts into them."""

from math import inf, nan

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.nodes.joint_reader import JointReader


def serialized(position, stamp=7_000_000_005, frame='base', name='insertion', **more):
    message = JointState(name=[name], position=position, **more)
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    return serialize_message(message)


@pytest.fixture
def reader():
    return JointReader('insertion')


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'abcd', 'spm_base'])
@pytest.mark.parametrize(
    'more',
    [
        {},
        {'velocity': [3.0]},
        {'effort': [-1.0]},
    ],
)
def test_stamps_and_positions_of_one_publisher(reader, frame, more):
    for stamp, position in ((5, 0.25), (7_000_000_005, -0.1), (8_000_000_000, 0.0)):
        data = serialized([position], stamp, frame, **more)
        assert reader.read(data) == (stamp, position)


def test_messages_of_several_publishers(reader):
    for _ in range(3):
        assert reader.read(serialized([0.1], frame='left')) == (7_000_000_005, 0.1)
        assert reader.read(serialized([0.2], frame='right')) == (7_000_000_005, 0.2)
        assert reader.read(serialized([0.3], frame='right', velocity=[1.0]))[1] == 0.3


@pytest.mark.parametrize(
    ('position', 'name'),
    [
        ([nan], 'insertion'),
        ([inf], 'insertion'),
        ([], 'insertion'),
        ([0.1, 0.2], 'insertion'),
        ([0.1], 'insertiom'),
        ([0.1], 'gripper'),
    ],
)
def test_what_is_not_its_joint_has_no_position(reader, position, name):
    data = serialized(position, name=name)
    assert reader.read(data) is None
    assert reader.read(serialized([0.1])) == (7_000_000_005, 0.1)
    assert reader.read(data) is None
