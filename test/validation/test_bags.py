# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `ros2 bag record` writes: every storage and compression, split, and not ended."""

from contextlib import contextmanager
from importlib.util import find_spec
import sqlite3
import struct
import sys

import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.validation import bags, recordings
from spm_haptic_master.validation.cdr_messages import Cdr
import yaml

# Writers of recordings, from PyPI only.
pytest.importorskip('mcap_ros2')
pytest.importorskip('rosbags')
from mcap.writer import CompressionType  # noqa: E402, I100
from mcap_ros2.writer import Writer as McapWriter  # noqa: E402
from rosbags.rosbag2 import (  # noqa: E402
    CompressionFormat,
    CompressionMode,
    StoragePlugin,
    Writer,
)
from rosbags.typesys import get_typestore, Stores  # noqa: E402

STORE = get_typestore(Stores.ROS2_JAZZY)
ORIENTATION, JOINTS, POSE = '/left/orientation', '/left/measured_js', '/vicon/platform/pose'
KINDS = {ORIENTATION: 'geometry_msgs/msg/QuaternionStamped',
         JOINTS: 'sensor_msgs/msg/JointState', POSE: 'geometry_msgs/msg/PoseStamped'}
# Rows of each topic.
COUNT = 60


def rows(count=COUNT, first=0):
    """Stamps (s) and unit quaternions, (n, 5); exact in a stamp of seconds and nanoseconds."""
    number = np.arange(first, first + count)
    half = 0.01 * number
    return np.column_stack([1000.0 + 0.25 * number, np.sin(half), 0.0 * half, 0.0 * half,
                            np.cos(half)])


def header(t):
    sec, nanosec = divmod(round(t * 1e9), 1_000_000_000)
    return STORE.types['std_msgs/msg/Header'](
        STORE.types['builtin_interfaces/msg/Time'](sec, nanosec), 'a_base_of_any_name')


def message(topic, row):
    """Return the message of a row on a topic."""
    t, *q = map(float, row)
    quaternion = STORE.types['geometry_msgs/msg/Quaternion'](*q)
    if topic == ORIENTATION:
        return STORE.types[KINDS[topic]](header(t), quaternion)
    if topic == POSE:
        point = STORE.types['geometry_msgs/msg/Point'](1.0, 2.0, 3.0)
        return STORE.types[KINDS[topic]](
            header(t), STORE.types['geometry_msgs/msg/Pose'](point, quaternion))
    # Sensors in another order than ours, and an additional one.
    names = [*JOINT_NAMES[::-1], 'joint_of_another_device']
    return STORE.types[KINDS[topic]](
        header(t), names, np.array([*q[::-1], 9.0]), np.array([]), np.array([]))


def serialized(topic, row):
    return STORE.serialize_cdr(message(topic, row), KINDS[topic])


def write_bag(path, storage=StoragePlugin.MCAP, compression=CompressionMode.NONE, given=None):
    """Write a directory as `ros2 bag record` does."""
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {topic: writer.add_connection(topic, kind, typestore=STORE)
                       for topic, kind in KINDS.items()}
        for row in rows() if given is None else given:
            for topic, connection in connections.items():
                writer.write(connection, round(row[0] * 1e9), serialized(topic, row))
    return path


def check(path, expected=None):
    """Assert that all three topics are read as they were written."""
    expected = rows() if expected is None else expected
    found = (recordings.read_orientation(path, 'orientation'),
             recordings.read_joints(path, 'measured_js'),
             recordings.read_capture(path, 'platform/pose'))
    for track in found:
        np.testing.assert_array_equal(track.time, expected[:, 0])
        np.testing.assert_allclose(track.values, expected[:, 1:], atol=1e-15)


@pytest.mark.parametrize('numbers', [(5, 5), (6, 6), (4, 6)])
def test_five_and_six_sensors_are_read_and_not_mixed(tmp_path, numbers):
    path = tmp_path / 'bag'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(JOINTS, KINDS[JOINTS], typestore=STORE)
        for number in range(20):
            names = [*ALL_JOINT_NAMES[:numbers[number % 2]]]
            joints = STORE.types[KINDS[JOINTS]](
                header(1000.0 + number), names[::-1], np.arange(len(names))[::-1] + 0.5,
                np.array([]), np.array([]))
            writer.write(connection, number + 1, STORE.serialize_cdr(joints, KINDS[JOINTS]))
    if numbers == (4, 6):
        with pytest.raises(InputError, match='joint angles of 4 and of 6 sensors'):
            recordings.read_joints(path, 'measured_js')
        return
    track = recordings.read_joints(path, 'measured_js')
    np.testing.assert_array_equal(track.values, [np.arange(numbers[0]) + 0.5] * 20)


def test_a_message_without_a_joint_before_another_is_refused(tmp_path):
    """The readings of joint_3c are never taken for those of joint_3b."""
    path = tmp_path / 'bag'
    names = [*JOINT_NAMES, 'joint_3c']
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(JOINTS, KINDS[JOINTS], typestore=STORE)
        joints = STORE.types[KINDS[JOINTS]](
            header(1000.0), names, np.arange(5.0), np.array([]), np.array([]))
        writer.write(connection, 1, STORE.serialize_cdr(joints, KINDS[JOINTS]))
    with pytest.raises(InputError, match='message 1 on .*: not as expected: no joint_3b among'):
        recordings.read_joints(path, 'measured_js')


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_joints_without_a_reading_are_nan(tmp_path, sensors):
    """In each second message one is missing, in each fifth of five or six all but three are."""
    path = tmp_path / 'bag'
    names = [*ALL_JOINT_NAMES[:sensors]]
    rows = np.arange(sensors) + np.zeros((100, 1))
    rows[::2, -1] = np.nan
    rows[::5, 3:] = np.nan
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(JOINTS, KINDS[JOINTS], typestore=STORE)
        for number, row in enumerate(rows):
            joints = STORE.types[KINDS[JOINTS]](
                header(1000.0 + number), names, row, np.array([]), np.array([]))
            writer.write(connection, number + 1, STORE.serialize_cdr(joints, KINDS[JOINTS]))
    track = recordings.read_joints(path, 'measured_js')
    whole = np.isfinite(rows).sum(axis=1) >= 4
    np.testing.assert_array_equal(track.values, rows[whole])
    np.testing.assert_array_equal(track.time, 1000.0 + np.flatnonzero(whole))
    assert np.isnan(track.values).any() == (sensors > 4)


@pytest.fixture(params=[name for name in ('rosbag2_py', 'rosbags') if find_spec(name)])
def library(request, monkeypatch):
    """Read with each installed library: rosbag2_py comes with an installed ROS 2 only."""
    if request.param == 'rosbags':
        monkeypatch.setitem(sys.modules, 'rosbag2_py', None)


@pytest.mark.parametrize(('storage', 'compression'), [
    (storage, compression) for storage in StoragePlugin for compression in CompressionMode
    # sqlite3 has no compression of its own.
    if (storage, compression) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)])
def test_every_storage_and_compression(tmp_path, library, storage, compression):
    path = write_bag(tmp_path / 'session', storage, compression)
    check(path)
    (file,) = (each for each in path.iterdir() if each.name != 'metadata.yaml')
    if compression in (CompressionMode.NONE, CompressionMode.STORAGE):
        check(file)
    elif compression == CompressionMode.FILE:
        assert file.suffix == '.zstd'
        with pytest.raises(InputError, match='compressed as a whole; expected its directory'):
            recordings.read_orientation(file, 'orientation')


def write_mcap(path, given, compression=CompressionType.ZSTD, end=True):
    """Write a file of the orientations with another library."""
    with open(path, 'wb') as file:
        writer = McapWriter(file, compression=compression, chunk_size=600)
        text, _ = STORE.generate_msgdef(KINDS[ORIENTATION], ros_version=2)
        schema = writer.register_msgdef(KINDS[ORIENTATION], text)
        for t, x, y, z, w in given.tolist():
            sec, nanosec = divmod(round(t * 1e9), 1_000_000_000)
            writer.write_message(
                ORIENTATION, schema, log_time=round(t * 1e9), message={
                    'header': {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': ''},
                    'quaternion': {'x': x, 'y': y, 'z': z, 'w': w}})
        if end:
            writer.finish()
    return path


@pytest.mark.parametrize('compression', list(CompressionType))
def test_every_compression_of_chunks(tmp_path, library, compression):
    path = write_mcap(tmp_path / 'session_0.mcap', rows(), compression)
    track = recordings.read_orientation(path, 'orientation')
    np.testing.assert_array_equal(track.time, rows()[:, 0])
    np.testing.assert_allclose(track.values, rows()[:, 1:], atol=1e-15)


def parts(count=12):
    """Return the rows of the files of a split recording."""
    return [rows(5, 5 * number) for number in range(count)]


def describe(path, names, counts, **changes):
    """Write the metadata.yaml of a directory."""
    (path / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
        'version': 9, 'storage_identifier': 'mcap', 'relative_file_paths': names,
        'duration': {'nanoseconds': 10**11}, 'message_count': sum(counts.values()),
        'starting_time': {'nanoseconds_since_epoch': 10**12},
        'topics_with_message_count': [
            {'topic_metadata': {'name': topic, 'type': KINDS[topic], 'serialization_format': 'cdr',
                                'offered_qos_profiles': [], 'type_description_hash': ''},
             'message_count': count} for topic, count in counts.items()],
        'compression_format': '', 'compression_mode': '', 'files': [], 'custom_data': None,
        'ros_distro': 'jazzy', **changes}}))
    return path


def split_mcap(path):
    """Write twelve files of five orientations each; return their names in their order."""
    path.mkdir()
    names = [f'session_{number}.mcap' for number in range(12)]
    for name, part in zip(names, parts(), strict=True):
        write_mcap(path / name, part)
    return names


@pytest.mark.parametrize('listed', ['in order', 'as text', 'not at all'])
def test_a_split_recording_in_mcap(tmp_path, library, listed):
    path = tmp_path / 'session'
    names = split_mcap(path)
    assert sorted(names) != names
    if listed != 'not at all':
        describe(path, names if listed == 'in order' else sorted(names), {ORIENTATION: 60})
    np.testing.assert_array_equal(
        recordings.read_orientation(path, 'orientation').time, rows()[:, 0])


def test_a_split_recording_in_sqlite3(tmp_path, library):
    path = tmp_path / 'session'
    path.mkdir()
    names = []
    for number, part in enumerate(parts()):
        one = write_bag(tmp_path / f'one_{number}', StoragePlugin.SQLITE3, given=part)
        names.append(f'session_{number}.db3')
        (one / f'one_{number}.db3').rename(path / names[-1])
    describe(path, names, dict.fromkeys(KINDS, COUNT), storage_identifier='sqlite3')
    check(path)


def test_names_are_in_the_order_of_their_numbers():
    names = [f'bag_{number}.mcap' for number in range(12)]
    assert bags.natural_order(sorted(names)) == names
    assert bags.natural_order(['b_2', 'a', '3', 'a_10', 'a_9']) == ['3', 'a', 'a_9', 'a_10', 'b_2']


def refused(path, *words):
    with pytest.raises(InputError) as error:
        recordings.read_orientation(path, 'orientation')
    text = str(error.value)
    assert '\n' not in text
    for each in (str(path), *words):
        assert each in text


def test_a_recording_that_was_not_ended(tmp_path, library):
    """Its recorder was killed: without metadata.yaml, a last file without its end."""
    path = tmp_path / 'session'
    split_mcap(path)
    write_mcap(path / 'session_11.mcap', parts()[11], end=False)
    refused(path, 'session_11.mcap: its end is missing', '`ros2 bag reindex ' + str(path))
    refused(path / 'session_11.mcap', '`ros2 bag reindex ' + str(path))

    path = write_bag(tmp_path / 'other', StoragePlugin.SQLITE3)
    (path / 'metadata.yaml').unlink()
    refused(path, 'no metadata.yaml', '`ros2 bag reindex ' + str(path))


def test_rosbags_does_not_read_what_was_reindexed(tmp_path, monkeypatch):
    """`ros2 bag reindex` writes metadata.yaml; it gives no file its end."""
    monkeypatch.setitem(sys.modules, 'rosbag2_py', None)
    path = tmp_path / 'session'
    names = split_mcap(path)
    write_mcap(path / names[-1], parts()[11], end=False)
    describe(path, names, {ORIENTATION: 60})
    refused(path, 'a file has no end, which rosbag2_py of ROS 2 reads')


@contextmanager
def open_database(path):
    """Hold a database open that keeps its latest changes beside itself."""
    connection = sqlite3.connect(path)
    connection.execute('PRAGMA journal_mode=WAL')
    connection.execute('PRAGMA wal_autocheckpoint=0')
    connection.execute('DELETE FROM messages WHERE id > 100')
    connection.commit()
    yield
    connection.close()


def test_a_database_with_messages_beside_it(tmp_path, library):
    path = write_bag(tmp_path / 'session', StoragePlugin.SQLITE3)
    with open_database(path / 'session.db3'):
        refused(path, 'session.db3-wal holds messages', 'ros2 bag reindex')
        refused(path / 'session.db3', 'session.db3-wal holds messages', 'ros2 bag reindex')


def test_a_directory_that_is_not_complete(tmp_path, library):
    path = tmp_path / 'session'
    names = split_mcap(path)
    describe(path, names[:-1], {ORIENTATION: 55})
    refused(path, 'session_11.mcap not in metadata.yaml', 'ros2 bag reindex')
    describe(path, names, {ORIENTATION: 61})
    refused(path, '60 messages on /left/orientation, 61 according to metadata.yaml')
    (path / names[3]).unlink()
    refused(path, 'session_3.mcap is missing, of 12 files')
    (path / 'metadata.yaml').write_text('rosbag2_bagfile_information: 7')
    refused(path, 'metadata.yaml: cannot be read', 'ros2 bag reindex')


def test_a_file_that_is_no_recording(tmp_path, library):
    path = tmp_path / 'session.db3'
    path.write_bytes(b'no database ' * 1000)
    refused(path, 'cannot be read as rosbag2')
    path.write_bytes(b'')
    refused(path, 'cannot be read as rosbag2')


def test_two_arms_in_one_recording(tmp_path, library):
    path = tmp_path / 'session'
    with Writer(path, version=9) as writer:
        for topic in (ORIENTATION, '/right/orientation'):
            connection = writer.add_connection(topic, KINDS[ORIENTATION], typestore=STORE)
            for row in rows():
                writer.write(connection, round(row[0] * 1e9), serialized(ORIENTATION, row))
    refused(path, 'orientation is ambiguous: /left/orientation, /right/orientation; name one')
    assert len(recordings.read_orientation(path, 'right/orientation').time) == COUNT


def test_messages_that_are_not_what_they_are_called(tmp_path, library):
    path = tmp_path / 'session'
    with Writer(path, version=9) as writer:
        connection = writer.add_connection(ORIENTATION, KINDS[ORIENTATION], typestore=STORE)
        good = serialized(ORIENTATION, rows()[0])
        writer.write(connection, 0, good)
        writer.write(connection, 1, good[:-1])
    refused(path, 'message 2 on /left/orientation: not as expected')


def test_cdr_of_either_byte_order():
    """Aligned behind the encapsulation; texts end in a zero; other encapsulations are refused."""
    for code, order in ((b'\0\0', '>'), (b'\0\1', '<')):
        body = struct.pack(f'{order}iII2s2xI', 7, 500_000_000, 2, b'b\0', 3)
        cdr = Cdr(code + b'\0\0' + body)
        assert cdr.stamp() == 7.5
        assert cdr.count() == 3
        with pytest.raises(ValueError, match='20 bytes'):
            cdr.count()
    with pytest.raises(ValueError, match='encapsulation 0007; expected plain CDR'):
        Cdr(b'\0\7\0\0')
