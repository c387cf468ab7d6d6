# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Samples and orientations on the wire are what rclpy itself writes and reads."""

from math import inf, nan
import random
from struct import pack

from geometry_msgs.msg import PoseStamped, QuaternionStamped
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.ros import cdr

FOUR = cdr.JointsFormat(4)
STAMPS = (0, 999_999_999, 1_000_000_000, 1_732_184_000_123_456_789, (2**31 - 1) * 10**9)


def numbers(seed, count=4):
    return tuple(random.Random(seed).uniform(-3.2, 3.2) for _ in range(count))


def joints(stamp=0, position=(0.1, -0.2, 0.3, -0.4), name=JOINT_NAMES, frame='', **more):
    return framed(
        JointState(
            name=list(name),
            position=list(position),
            **more,
        ),
        frame,
        stamp,
    )


def framed(message, frame, stamp=STAMPS[3]):
    """Return a message with a header."""
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    return message


@pytest.mark.parametrize('frame', ['', 'a', 'spm_base', 'left_spm_base', 'a_longer_frame_id'])
@pytest.mark.parametrize(
    ('sensors', 'missing'),
    [
        (4, ()),
        (5, ()),
        (5, (4,)),
        (5, (0,)),
        (6, ()),
        (6, (5,)),
        (6, (0, 3)),
    ],
)
def test_joints_are_written_and_read_as_by_rclpy(sensors, missing, frame):
    """A joint without a reading is NaN."""
    names = ALL_JOINT_NAMES[:sensors]
    form = cdr.JointsFormat(sensors, frame)
    for stamp in STAMPS:
        angles = tuple(
            nan if index in missing else angle
            for index, angle in enumerate(numbers(stamp, sensors))
        )
        message = joints(stamp, angles, names, frame)
        written = form.write(stamp, angles)
        assert repr(deserialize_message(written, JointState)) == repr(message)
        for data in (written, serialize_message(message)):
            for reader in form, cdr.JointsFormat(sensors):
                assert repr(reader.read(data)) == repr((stamp, angles))


def test_a_joint_state_of_another_layout_is_read_too():
    for more in ({'velocity': [1.0] * 4}, {'effort': [1.0] * 4}):
        assert FOUR.read(serialize_message(joints(7, numbers(1), **more))) == (7, numbers(1))
    # As another vendor's DDS on another processor writes it: every number the other way round.
    text = b''.join(pack('>I9s3x', 9, name.encode() + b'\0') for name in JOINT_NAMES)
    data = (
        b'\0\0\0\0'
        + pack('>iI', 5, 6)
        + pack('>Is3x', 1, b'\0')
        + pack('>I', 4)
        + text
        + pack('>I4d', 4, *numbers(2))
        + pack('>II', 0, 0)
    )
    assert FOUR.read(data) == (5_000_000_006, numbers(2))


@pytest.mark.parametrize(
    ('given', 'reason'),
    [
        *(
            ({'name': name}, 'misnamed sample')
            for name in (
                (),
                JOINT_NAMES[:1],
                (JOINT_NAMES[1], JOINT_NAMES[0], *JOINT_NAMES[2:]),
                (*JOINT_NAMES[:3], 'joint_3b'),
                (*JOINT_NAMES, 'more'),
            )
        ),
        *(
            (
                {'name': ALL_JOINT_NAMES[:sensors], 'position': [1.0] * sensors},
                f'another number of sensors: {sensors}, expected 4: give `sensors` for all nodes',
            )
            for sensors in (5, 6)
        ),
        *(({'position': [1.0] * count}, 'incomplete sample') for count in (0, 1, 3, 5, 8)),
    ],
)
def test_other_joints_and_another_number_of_positions_are_refused(given, reason):
    with pytest.raises(RejectedError, match=reason):
        FOUR.read(serialize_message(joints(**given)))


@pytest.mark.parametrize('length', range(9))
def test_orientations_and_poses_are_written_and_read_as_by_rclpy(length):
    quaternion = numbers(length)
    frame = 'spm_base_of_left_arm'[:length]
    orientation = framed(QuaternionStamped(), frame)
    pose = framed(PoseStamped(), frame)
    for q in (orientation.quaternion, pose.pose.orientation):
        q.x, q.y, q.z, q.w = quaternion
    pose.pose.position.x = 0.1
    pose.pose.position.y = -0.2
    pose.pose.position.z = 0.3
    written = cdr.OrientationWriter(frame).write(STAMPS[3], quaternion)
    assert deserialize_message(written, QuaternionStamped) == orientation
    assert (
        deserialize_message(
            cdr.PoseWriter(frame).write(STAMPS[3], (0.1, -0.2, 0.3), quaternion), PoseStamped
        )
        == pose
    )
    reader = cdr.OrientationReader()
    for data in (
        written,
        serialize_message(orientation),
        serialize_message(framed(orientation, 'b')),
        written,
    ):
        assert reader.read(data) == (STAMPS[3], quaternion)


def test_the_frame_of_a_publisher_is_learnt(monkeypatch):
    """Only its first sample is deserialized by rclpy, which takes far longer."""
    calls = []
    monkeypatch.setattr(
        cdr,
        'deserialize_message',
        lambda data, kind: calls.append(kind) or deserialize_message(data, kind),
    )
    for kind, writer, reader in (
        (JointState, cdr.JointsFormat(4, 'left_spm_base'), cdr.JointsFormat(4)),
        (QuaternionStamped, cdr.OrientationWriter('left_spm_base'), cdr.OrientationReader()),
    ):
        for k in range(5):
            assert reader.read(writer.write(k, numbers(k))) == (k, numbers(k))
        assert calls.pop() == kind
        assert not calls


@pytest.mark.parametrize(
    ('angles', 'reason'),
    [
        ((0.1, 0.1, 0.1, nan), 'no reading of joint_3a; expected at least 4'),
        ((nan, nan, 0.1, 0.1, 0.1, nan), 'no reading of joint_1a, joint_1b, joint_3c; expected'),
        ((0.1, 0.1, -inf, 0.1, 0.1, 0.1), 'infinite: joint_1c'),
    ],
)
def test_fewer_than_four_readings_and_an_infinite_one_are_refused(angles, reason):
    form = cdr.JointsFormat(len(angles))
    with pytest.raises(RejectedError, match=f'angle not finite.*{reason}'):
        form.read(form.write(0, angles))
