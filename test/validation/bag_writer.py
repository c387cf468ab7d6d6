# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recordings as `ros2 bag record` writes them, by libraries that come from PyPI only."""

import numpy as np
import pytest
from spm_haptic_master.kinematics.joints import JOINT_NAMES

pytest.importorskip('rosbags')
from rosbags import rosbag2  # noqa: E402, I100
from rosbags.typesys import get_typestore, Stores  # noqa: E402

STORE = get_typestore(Stores.ROS2_JAZZY)
ORIENTATION = '/left/orientation'
JOINTS = '/left/measured_js'
POSE = '/vicon/platform/pose'
TRANSFORM = '/vicon/handle'
KINDS = {
    ORIENTATION: 'geometry_msgs/msg/QuaternionStamped',
    JOINTS: 'sensor_msgs/msg/JointState',
    POSE: 'geometry_msgs/msg/PoseStamped',
    TRANSFORM: 'geometry_msgs/msg/TransformStamped',
}


def serialized(
    topic,
    row,
    names=JOINT_NAMES,
):
    """Return the message of a stamp, s, and of a quaternion or joint angles."""
    t, *values = map(float, row)
    kind = KINDS[topic]
    header = STORE.types['std_msgs/msg/Header'](
        STORE.types['builtin_interfaces/msg/Time'](*divmod(round(t * 1e9), 1_000_000_000)),
        'a_base_of_any_name',
    )
    if topic == JOINTS:
        # Sensors in another order than ours, and an additional one.
        fields = (
            [*names[::-1], 'joint_of_another_device'],
            np.array([*values[::-1], 9.0]),
            np.array([]),
            np.array([]),
        )
    else:
        fields = (STORE.types['geometry_msgs/msg/Quaternion'](*values),)
    if topic == POSE:
        fields = (
            STORE.types['geometry_msgs/msg/Pose'](
                STORE.types['geometry_msgs/msg/Point'](1.0, 2.0, 3.0), *fields
            ),
        )
    if topic == TRANSFORM:
        fields = (
            'handle',
            STORE.types['geometry_msgs/msg/Transform'](
                STORE.types['geometry_msgs/msg/Vector3'](1.0, 2.0, 3.0), *fields
            ),
        )
    return STORE.serialize_cdr(STORE.types[kind](header, *fields), kind)


def write_messages(
    path,
    messages,
    storage=rosbag2.StoragePlugin.MCAP,
    compression=rosbag2.CompressionMode.NONE,
):
    """Write a directory of messages: topic, log time (ns), content."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, time, content in messages:
            if topic not in connections:
                kind = KINDS[topic.replace('/right', '/left')]
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], time, content)
    return path


def write_bag(path, rows, *options):
    """Write a directory of rows (stamp in s, values) by topic."""
    return write_messages(
        path,
        [
            (topic, round(row[0] * 1e9), serialized(topic, row))
            for topic, each in rows.items()
            for row in each
        ],
        *options,
    )
