# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""recorder: what validate reads, from the running nodes."""

from math import nan
from pathlib import Path
import re
import time

from harness import SIM
import numpy as np
import pytest
from sensor_msgs.msg import JointState
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry, inverse, matrix_from_quaternion
from spm_haptic_master.simulation.rig_file import read_rig
from spm_haptic_master.validation import recordings

pytestmark = pytest.mark.process

# A line of its log.
LOGGED = re.compile(r'^\[INFO\] \[[\d.]+\] \[recorder\]: (.*)\n', re.MULTILINE)


def reported(recorder):
    """Return what a recorder that has ended logged; nothing of it is a warning or an error."""
    assert LOGGED.sub('', recorder.stderr) == ''
    return LOGGED.findall(recorder.stderr)


def check_report(recorder, directory, *names):
    """Check where it wrote, and how much: rows, seconds and bytes."""
    first, *tables = reported(recorder)
    assert first == f'writes into {directory}, until Ctrl-C'
    found = [re.fullmatch(r'(.*): (\d+) rows, ([\d.]+) s, (\d+) bytes', line) for line in tables]
    assert [each[1] for each in found] == [str(directory / name) for name in names]
    for each in found:
        path = Path(each[1])
        rows = path.read_text().splitlines()[1:]
        assert (int(each[2]), int(each[4])) == (len(rows), path.stat().st_size)
        times = [float(row.partition(',')[0]) for row in (rows[0], rows[-1])]
        assert float(each[3]) == pytest.approx(times[1] - times[0], abs=0.06)


def test_orientations_and_joint_angles_are_recorded(start, tmp_path):
    directory = tmp_path / 'new' / 'recording'
    recorder = start('recorder', parameters={'directory': directory})
    start('fkm')
    driver = start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    path = directory / 'orientation.csv'
    assert wait_until(lambda: path.exists() and path.stat().st_size > 20_000, 60.0)
    driver.stop()
    time.sleep(0.2)
    assert recorder.stop() == 0
    check_report(recorder, directory, 'orientation.csv', 'measured_js.csv', 'ground_truth.csv')

    orientations = recordings.read_orientation(path, '')
    joints = recordings.read_joints(directory / 'measured_js.csv', '')
    # Either topic may be heard a moment before the other.
    assert min(len(joints.time), len(orientations.time)) > 200
    # An orientation has the stamp of the angles it comes from.
    both = joints.time[joints.time >= orientations.time[0]]
    assert np.isin(both, orientations.time).mean() > 0.95
    assert np.abs(np.linalg.norm(orientations.values, axis=-1) - 1.0).max() < 1e-6


def test_joints_without_a_reading_are_recorded_as_such(start, observer, tmp_path):
    out = observer.node.create_publisher(JointState, 'measured_js', 100)
    recorder = start('recorder', parameters={'directory': tmp_path})
    assert observer.spin_until(out.get_subscription_count, 60.0)
    message = JointState(name=[*ALL_JOINT_NAMES])
    for number in range(40):
        message.header.stamp.sec = 1000 + number
        message.position = [0.1, 0.2, 0.3, 0.4, nan if number % 4 else 0.5, 0.6]
        out.publish(message)
    path = tmp_path / 'measured_js.csv'
    assert observer.spin_until(path.exists, 60.0)
    observer.spin(1.0)
    assert recorder.stop() == 0
    track = recordings.read_joints(path, '')
    assert track.time.tolist() == [1000.0 + number for number in range(40)]
    assert np.isnan(track.values[:, 4]).tolist() == [number % 4 > 0 for number in range(40)]
    assert np.isfinite(np.delete(track.values, 4, axis=1)).all()


def test_messages_without_a_joint_are_counted_and_not_written(start, observer, tmp_path):
    """Of another program: the driver names every joint."""
    out = observer.node.create_publisher(JointState, 'measured_js', 100)
    recorder = start('recorder', parameters={'directory': tmp_path})
    assert observer.spin_until(out.get_subscription_count, 60.0)
    for number in range(30):
        joints = 6 if number % 3 else 5
        message = JointState(name=[*ALL_JOINT_NAMES][:joints], position=[0.1] * joints)
        message.header.stamp.sec = 1001 + number
        if number:
            out.publish(message)
    path = tmp_path / 'measured_js.csv'
    assert observer.spin_until(path.exists, 60.0)
    observer.spin(1.0)
    assert recorder.stop() == 0
    assert '9 messages on measured_js without one of joint_1a, joint_1b, joint_1c, joint_3a, ' \
        'joint_3b, joint_3c: not written' in recorder.stderr
    assert len(path.read_text().splitlines()) == 21


def test_the_truth_of_a_simulation_is_recorded(start, tmp_path):
    """The orientation at each sample's stamp and the rig: together they give the readings."""
    recorder = start('recorder', parameters={'directory': tmp_path})
    driver = start('encoder_driver', parameters={
        **SIM, 'rate': 200.0, 'sim.rig_seed': 5, 'sim.trajectory': 'sweep'})
    path = tmp_path / 'ground_truth.csv'
    assert wait_until(lambda: path.exists() and path.stat().st_size > 40_000, 60.0)
    driver.stop()
    time.sleep(0.2)
    assert recorder.stop() == 0
    check_report(recorder, tmp_path, 'measured_js.csv', 'ground_truth.csv')
    truth = recordings.read_orientation(path, '')
    joints = recordings.read_joints(tmp_path / 'measured_js.csv', '')
    both, of_truth, of_joints = np.intersect1d(truth.time, joints.time, return_indices=True)
    assert len(both) > 300 and len(both) >= 0.95 * min(len(truth.time), len(joints.time))
    rig = read_rig(tmp_path / 'rig.json', Geometry(), 0.0)
    true = inverse(matrix_from_quaternion(truth.values[of_truth]), rig.geometry)
    expected = np.array([
        [sensor.with_harmonics(angle) for sensor, angle in zip(rig.sensors, row, strict=True)]
        for row in np.column_stack([true.theta1, true.theta3a])])
    error = np.degrees(joints.values[of_joints] - expected)
    np.testing.assert_allclose(error.std(0), 0.0405, rtol=0.15)
    np.testing.assert_allclose(error.mean(0), 0.0, atol=0.01)
    assert np.ptp(expected, axis=0).min() > 0.02


def test_a_directory_that_cannot_be_is_named(start, tmp_path):
    (tmp_path / 'file').write_text('')
    recorder = start('recorder', parameters={'directory': tmp_path / 'file' / 'below'})
    start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    assert recorder.wait(60.0) == 1
    last = recorder.stderr.splitlines()[-1]
    assert last.startswith('recorder: ') and 'cannot be written' in last


def test_an_earlier_recording_is_not_overwritten(start, tmp_path):
    (tmp_path / 'orientation.csv').write_text('precious')
    recorder = start('recorder', parameters={'directory': tmp_path})
    assert recorder.wait(60.0) == 1
    assert 'already exists' in recorder.stderr and recorder.stderr.count('\n') == 1
    assert (tmp_path / 'orientation.csv').read_text() == 'precious'


@pytest.mark.parametrize('name', ['ground_truth.csv', 'rig.json'])
def test_an_earlier_truth_is_not_overwritten(start, tmp_path, name):
    (tmp_path / name).write_text('precious')
    recorder = start('recorder', parameters={'directory': tmp_path})
    start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    assert recorder.wait(60.0) == 1
    assert f'{name}: already exists' in recorder.stderr.splitlines()[-1]
    assert (tmp_path / name).read_text() == 'precious'


def test_two_rigs_in_one_recording_are_refused(start, tmp_path):
    recorder = start('recorder', parameters={'directory': tmp_path})
    first = start('encoder_driver', parameters={**SIM, 'rate': 200.0})
    assert wait_until(lambda: (tmp_path / 'rig.json').exists(), 60.0)
    first.stop()
    start('encoder_driver', parameters={**SIM, 'rate': 200.0, 'sim.rig_seed': 1})
    assert recorder.wait(60.0) == 1
    assert 'another simulated rig than at the start' in recorder.stderr.splitlines()[-1]


def test_nothing_is_written_where_nothing_comes(start, observer, tmp_path):
    recorder = start('recorder', parameters={'directory': tmp_path / 'empty'})
    assert observer.spin_until(lambda: 'recorder' in observer.node.get_node_names(), 60.0)
    observer.spin(1.0)
    assert recorder.stop() == 0
    assert not (tmp_path / 'empty').exists()
    assert recorder.stderr.splitlines()[-1].endswith(
        '[recorder]: nothing was written: no message came on orientation or measured_js')
