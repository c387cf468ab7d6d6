# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `ros2 bag record` writes: every storage and compression, split, and not ended."""

from contextlib import closing
import re
import sqlite3

from bag_writer import (
    JOINTS,
    KINDS,
    ORIENTATION,
    POSE,
    serialized,
    TRANSFORM,
    write_bag,
    write_messages,
)
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.validation import recordings
import yaml

# Stamps (s) and unit quaternions; exact in a stamp of seconds and nanoseconds.
NUMBER = np.arange(60)
ROWS = np.column_stack(
    [
        1000.0 + 0.25 * NUMBER,
        np.sin(0.01 * NUMBER),
        0.0 * NUMBER,
        0.0 * NUMBER,
        np.cos(0.01 * NUMBER),
    ]
)
PARTS = ROWS.reshape(12, 5, 5)
EVERY_TOPIC = dict.fromkeys(KINDS, ROWS)


def check(path, *reads):
    """Assert that topics are read as they were written."""
    for read, topic in reads or (
        (recordings.read_orientation, 'orientation'),
        (recordings.read_joints, 'measured_js'),
        (recordings.read_capture, 'platform/pose'),
    ):
        track = read(path, topic)
        np.testing.assert_array_equal(track.time, ROWS[:, 0])
        np.testing.assert_allclose(track.values, ROWS[:, 1:], atol=1e-15)


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [
        (storage, compression)
        for storage in StoragePlugin
        for compression in CompressionMode
        # sqlite3 has no compression of its own.
        if (storage, compression) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)
    ],
)
def test_every_storage_and_compression(
    tmp_path,
    storage,
    compression,
):
    path = write_bag(tmp_path / 'session', EVERY_TOPIC, storage, compression)
    check(path)
    (file,) = (each for each in path.iterdir() if each.name != 'metadata.yaml')
    if compression in (CompressionMode.NONE, CompressionMode.STORAGE):
        check(file)
    elif compression == CompressionMode.FILE:
        assert file.suffix == '.zstd'
        with pytest.raises(InputError, match='compressed as a whole; expected its directory'):
            recordings.read_orientation(file, 'orientation')


def test_a_slide_beside_the_joints_is_a_topic_of_its_own(tmp_path, monkeypatch):
    """`measured_js` is that of the joints; the slide's has the times of its readings."""
    slide = '/left/insertion/measured_js'
    monkeypatch.setitem(KINDS, slide, KINDS[JOINTS])
    joints = [(JOINTS, round(row[0] * 1e9), serialized(JOINTS, row)) for row in ROWS]
    readings = [(slide, at, content) for _, at, content in joints[::2]]
    path = write_messages(tmp_path / 'session', [*joints, *readings])
    assert len(recordings.read_joints(path, 'measured_js').time) == 60
    np.testing.assert_array_equal(recordings.read_axis_times(path, 'insertion'), ROWS[::2, 0])
    assert recordings.read_axis_times(path, 'gripper').size == 0


def describe(
    path,
    names,
    counts,
):
    """Write the metadata.yaml of a directory; what depends on the storage stays as it is."""
    metadata = path / 'metadata.yaml'
    content = yaml.safe_load(metadata.read_text())
    about = content['rosbag2_bagfile_information']
    about |= {
        'relative_file_paths': names,
        'files': [],
        'message_count': sum(counts.values()),
    }
    for topic in about['topics_with_message_count']:
        topic['message_count'] = counts[topic['topic_metadata']['name']]
    metadata.write_text(yaml.safe_dump(content))


def split_recording(path, storage):
    """Write twelve files of five rows of each topic; return their names in order."""
    names = []
    for number, part in enumerate(PARTS):
        one = write_bag(path.with_name(f'one_{number}'), dict.fromkeys(KINDS, part), storage)
        path.mkdir(exist_ok=True)
        for file in one.iterdir():
            name = file.name.replace('one', path.name)
            file.rename(path / name)
            names += [name] * (name != 'metadata.yaml')
    describe(path, names, dict.fromkeys(KINDS, 60))
    return names


@pytest.fixture
def split(tmp_path):
    """Return directory and names of a recording in MCAP."""
    path = tmp_path / 'session'
    return path, split_recording(path, StoragePlugin.MCAP)


@pytest.mark.parametrize('listed', [list, sorted])
@pytest.mark.parametrize('storage', StoragePlugin)
def test_a_split_recording(
    tmp_path,
    storage,
    listed,
):
    path = tmp_path / 'session'
    describe(path, listed(split_recording(path, storage)), dict.fromkeys(KINDS, 60))
    check(path)


def refused(path, *words):
    with pytest.raises(InputError) as error:
        recordings.read_orientation(path, 'orientation')
    text = str(error.value)
    assert '\n' not in text
    for each in (str(path), *words):
        assert each in text


def test_a_recording_that_was_not_ended(split):
    """Its recorder was killed: without metadata.yaml, a last file without its end."""
    path, names = split
    (path / 'metadata.yaml').unlink()
    (path / names[-1]).write_bytes((path / names[-1]).read_bytes()[:-20])
    refused(path, 'metadata.yaml: cannot be read', '`ros2 bag reindex ' + str(path))
    refused(path / names[-1], 'no end of an MCAP file', '`ros2 bag reindex ' + str(path))


def test_a_database_with_messages_beside_it(tmp_path):
    path = write_bag(tmp_path / 'session', EVERY_TOPIC, StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(path / 'session.db3')) as connection:
        for statement in (
            'PRAGMA journal_mode=WAL',
            'PRAGMA wal_autocheckpoint=0',
            'DELETE FROM messages WHERE id > 100',
        ):
            connection.execute(statement)
        connection.commit()
        for each in (path, path / 'session.db3'):
            refused(each, 'session.db3-wal holds messages', 'ros2 bag reindex')


def test_a_directory_that_is_not_complete(split):
    path, names = split
    describe(path, names[:-1], dict.fromkeys(KINDS, 55))
    refused(path, 'session_11.mcap in the directory or metadata.yaml alone', 'ros2 bag reindex')
    describe(path, names, dict.fromkeys(KINDS, 61))
    refused(path, '60 messages on /left/orientation, 61 according to metadata.yaml')
    (path / names[3]).unlink()
    refused(path, 'session_3.mcap in the directory or metadata.yaml alone')
    (path / 'metadata.yaml').write_text('rosbag2_bagfile_information: 7')
    refused(path, "metadata.yaml: cannot be read: 'int' object", 'ros2 bag reindex')


@pytest.mark.parametrize(
    'name, content',
    [
        ('a.db3', b'no database ' * 1000),
        ('a.db3', b''),
        ('a.mcap', b'none'),
        ('a.mcap', None),
    ],
)
def test_a_file_that_is_no_recording(
    tmp_path,
    name,
    content,
):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    refused(tmp_path / name, 'cannot be read as rosbag2')


def test_two_arms_in_one_recording(tmp_path):
    path = write_messages(
        tmp_path / 'session',
        [
            (topic, round(row[0] * 1e9), serialized(ORIENTATION, row))
            for topic in (ORIENTATION, '/right/orientation')
            for row in ROWS
        ],
    )
    named = 'orientation is ambiguous: /left/orientation, /right/orientation; name one by'
    refused(path, f'{named} --topic')
    with pytest.raises(InputError, match=f'{named} --capture-topic'):
        recordings.read_capture(path, 'orientation')
    check(path, (recordings.read_orientation, 'right/orientation'))


def test_messages_that_are_not_what_they_are_called(tmp_path):
    good = serialized(ORIENTATION, ROWS[0])
    path = write_messages(
        tmp_path / 'session', [(ORIENTATION, 0, good), (ORIENTATION, 1, good[:-1])]
    )
    refused(path, 'message 2 on /left/orientation: not as expected')
    path = write_bag(tmp_path / 'pose', {POSE: ROWS})
    refused(path, 'nothing on topic orientation; it has /vicon/platform/pose')
    assert recordings.read_joints(path, 'measured_js') is None
    with pytest.raises(InputError, match='pose is of type geometry_msgs/msg/PoseStamped; exp'):
        recordings.read_joints(path, 'platform/pose')


def write_joints(
    path,
    rows,
    names,
):
    """Write a message each second, of the joints of the row's readings or of those given."""
    return write_messages(
        path,
        [
            (
                JOINTS,
                number + 1,
                serialized(JOINTS, [1000.0 + number, *row], names or ALL_JOINT_NAMES[: len(row)]),
            )
            for number, row in enumerate(rows)
        ],
    )


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_joints_without_a_reading_are_nan(tmp_path, sensors):
    """In each second message one is missing, in each fifth of five or six all but three are."""
    rows = np.arange(sensors) + np.zeros((100, 1))
    rows[::2, -1] = np.nan
    rows[::5, 3:] = np.nan
    track = recordings.read_joints(write_joints(tmp_path / 'bag', rows, None), 'measured_js')
    whole = np.isfinite(rows).sum(axis=1) >= 4
    np.testing.assert_array_equal(track.values, rows[whole])
    np.testing.assert_array_equal(track.time, 1000.0 + np.flatnonzero(whole))
    assert track.left_out == 100 - whole.sum()
    assert np.isnan(track.values).any() == (sensors > 4)


@pytest.mark.parametrize(
    ('rows', 'names', 'words'),
    [
        ([[0.1] * 4, [0.1] * 6] * 9, None, 'joint angles of 4 and of 6 sensors'),
        # The readings of joint_3c are never taken for those of joint_3b.
        (
            [[0.1] * 5],
            (*JOINT_NAMES, 'joint_3c'),
            'message 1 on .*: not as expected: no joint_3b am',
        ),
    ],
)
def test_joints_of_other_sensors_are_refused(
    tmp_path,
    rows,
    names,
    words,
):
    with pytest.raises(InputError, match=words):
        recordings.read_joints(write_joints(tmp_path / 'bag', rows, names), 'measured_js')


def test_L6_a_bag_that_humble_reindexed_says_what_to_write(tmp_path):
    path = write_bag(tmp_path / 'session', EVERY_TOPIC)
    metadata = path / 'metadata.yaml'
    metadata.write_text(
        re.sub(r'storage_identifier: \w+', 'storage_identifier: ""', metadata.read_text())
    )
    refused(path, 'metadata.yaml: storage_identifier is empty', 'of Humble', 'write mcap there')


def test_L6_header_stamps_of_0_are_named(tmp_path):
    path = write_messages(
        tmp_path / 'session',
        [
            (ORIENTATION, number, serialized(ORIENTATION, [0.0, *row[1:]]))
            for number, row in enumerate(ROWS)
        ],
    )
    refused(path, 'the header stamps on /left/orientation are all 0')


def test_a_transform_of_a_capture_is_read(tmp_path):
    path = write_bag(tmp_path / 'session', {TRANSFORM: ROWS})
    check(path, (recordings.read_capture, 'vicon/handle'))
