# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""recorder: what validate reads, from the running nodes."""

from contextlib import contextmanager
from math import nan

from geometry_msgs.msg import QuaternionStamped
from in_process import hosted
import numpy as np
import pytest
from rclpy.task import Future
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.recorder import Recorder
from spm_haptic_master.ros import node_log
from spm_haptic_master.validation import recordings
from std_msgs.msg import String


class Session:
    """A recorder of this process."""

    def __init__(self, host, done, logged):
        self._host = host
        self.done = done
        self.logged = logged

    def joints(self, second, position, names=ALL_JOINT_NAMES):
        message = JointState(name=[*names], position=position)
        message.header.stamp.sec = second
        self._host.give('measured_js', message)

    def orientation(self, second, topic='orientation'):
        message = QuaternionStamped()
        message.header.stamp.sec = second
        message.header.stamp.nanosec = 250_000_000
        message.quaternion.y = 0.6
        message.quaternion.w = 0.8
        self._host.give(topic, message)

    def rig(self, text):
        self._host.give('ground_truth/rig', String(data=text))

    @property
    def error(self):
        """Return the words of the error that ends the process; empty if none does."""
        return str(self.done.result()) if self.done.done() else ''


@pytest.fixture
def record(monkeypatch):
    """Record into a directory in a `with` block."""
    logged = []
    for level in ('info', 'warning'):
        monkeypatch.setattr(node_log, level, lambda _, text: logged.append(text))

    @contextmanager
    def record(directory):
        done = Future()
        with hosted(lambda given: Recorder(given, done), f'directory:={directory}') as host:
            yield Session(host, done, logged)

    return record


def test_joints_without_a_reading_are_recorded_and_messages_without_a_joint_are_counted(
    record, tmp_path
):
    """A message without one of the first message's joints is of another program."""
    has_reading = np.arange(40) % 4 == 0
    with record(tmp_path) as session:
        for number in range(40):
            fifth = 0.5 if has_reading[number] else nan
            session.joints(1000 + number, [0.1, 0.2, 0.3, 0.4, fifth, 0.6])
            if not has_reading[number]:
                session.joints(1000 + number, [0.1] * 5, ALL_JOINT_NAMES[:5])
    track = recordings.read_joints(tmp_path / 'measured_js.csv', '')
    np.testing.assert_array_equal(track.time, 1000.0 + np.arange(40))
    np.testing.assert_array_equal(np.isnan(track.values[:, 4]), ~has_reading)
    others = np.delete(track.values, 4, axis=1)
    assert (others == [0.1, 0.2, 0.3, 0.4, 0.6]).all()
    assert session.logged[0] == (
        '30 messages on measured_js without one of joint_1a, joint_1b, joint_1c, joint_3a, '
        'joint_3b, joint_3c: not written'
    )
    assert session.error == ''


def test_each_file_is_logged_with_its_size(record, tmp_path):
    with record(tmp_path) as session:
        for number in range(40):
            session.orientation(2000 + number)
            session.orientation(3000 + number, 'ground_truth/orientation')
            session.joints(1000 + number, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    expected = []
    for name in ('orientation.csv', 'measured_js.csv', 'ground_truth.csv'):
        path = tmp_path / name
        expected.append(f'{path}: 40 rows, 39.0 s, {path.stat().st_size} bytes')
    assert session.logged == expected
    assert session.error == ''
    for name, first in (('orientation.csv', 2000.25), ('ground_truth.csv', 3000.25)):
        orientations = recordings.read_orientation(tmp_path / name, '')
        np.testing.assert_array_equal(orientations.time, first + np.arange(40))
        assert (orientations.values == [0.0, 0.6, 0.0, 0.8]).all()


def test_a_directory_that_cannot_be_is_named_and_nothing_more_is_written(record, tmp_path):
    (tmp_path / 'file').write_text('')
    with record(tmp_path / 'file' / 'below') as session:
        for second in (1, 2):
            session.orientation(second)
            assert 'cannot be written' in session.error
    assert session.logged == []


@pytest.mark.parametrize(
    'name', ['orientation.csv', 'ground_truth.csv', 'rig.json', 'measured_js.csv']
)
def test_an_earlier_file_is_not_overwritten(record, tmp_path, name):
    (tmp_path / name).write_text('precious')
    error = ''
    try:
        with record(tmp_path) as session:
            session.orientation(1, 'ground_truth/orientation')
            session.rig('{}')
            error = session.error
    except InputError as refusal:
        error = str(refusal)
    assert f'{name}: already exists' in error
    assert (tmp_path / name).read_text() == 'precious'


def test_two_rigs_in_one_recording_are_refused(record, tmp_path):
    with record(tmp_path) as session:
        for text in ('{}', '{}'):
            session.rig(text)
            assert session.error == ''
        session.rig('{"other": 1}')
    assert 'another simulated rig than at the start' in session.error
    assert (tmp_path / 'rig.json').read_text() == '{}'


def test_nothing_is_written_where_nothing_comes(record, tmp_path):
    with record(tmp_path / 'empty') as session:
        pass
    assert not (tmp_path / 'empty').exists()
    assert session.logged == ['nothing was written: no message came on orientation or measured_js']
