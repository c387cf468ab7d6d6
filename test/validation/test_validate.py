# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""validate: known offsets and frames are found, bad files are reported in one line."""

import csv
import gzip
import math
import re
import sys

from mcap_ros2.writer import Writer
import numpy as np
import pytest
from rig_as_built import mechanism
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics import (
    inverse,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_from_matrix,
)
from spm_haptic_master.parameters.geometry import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.tools import validate
from spm_haptic_master.validation import recordings
from spm_haptic_master.validation.alignment import align, constant_frames
from spm_haptic_master.validation.markers import self_rotation

OFFSET = 37.4215  # s; captured clock ahead of the recording's
FRAME = matrix_from_zxz(0.8, 1.1, -2.0)
BODY = matrix_from_zxz(-2.4, 0.7, 0.3)
NOISE = math.radians(0.04)
# Markers A and B on Z_E, C and D beside it, mm in the platform's frame.
POINTS = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 120.0], [60.0, 0.0, 80.0], [-60.0, 0.0, 80.0]])
QUATERNION_HEADER = ('time', 'qx', 'qy', 'qz', 'qw')
POINT_HEADER = ('time', *(f'{marker}{axis}' for marker in 'abcd' for axis in 'xyz'))


def motion(t):
    """Orientations of a motion about all axes that does not repeat, (n, 3, 3)."""
    t = np.asarray(t)
    phi = np.radians(30.0 + 6.0 * np.sin(1.3 * t) + 4.0 * np.sin(2.9 * t + 0.4 * t * t / 10.0))
    return matrix_from_zxz(
        trajectories.CENTRE_PSI + 0.15 * np.sin(0.9 * t + 0.2),
        trajectories.CENTRE_THETA + 0.1 * np.sin(1.7 * t), phi)


def write_csv(path, header, rows):
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path


@pytest.fixture
def recording(tmp_path):
    """Orientations at 250 Hz for 10 s, with the sensors' noise."""
    t = np.arange(0.0, 10.0, 0.004)
    rng = np.random.default_rng(1)
    q = quaternion_from_matrix(motion(t)) + 0.3 * NOISE * rng.normal(size=(len(t), 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    # Of either sign, as any source may send them.
    q[::3] *= -1.0
    return write_csv(tmp_path / 'orientation.csv', QUATERNION_HEADER, np.column_stack([t, q]))


def captured_times():
    return np.arange(1.0, 9.0, 0.01)


def captured_markers(noise=0.0, seed=2):
    """Markers, (n, 12), in the capture's frame."""
    points = np.einsum('nij,kj->nki', FRAME @ motion(captured_times()), POINTS)
    points += noise * np.random.default_rng(seed).normal(size=points.shape)
    return points.reshape(len(points), -1) + np.tile([300.0, -20.0, 900.0], 4)


def write_markers(tmp_path, coordinates):
    return write_csv(tmp_path / 'markers.csv', POINT_HEADER,
                     np.column_stack([captured_times() + OFFSET, coordinates]))


def run(capsys, *args):
    code = validate.main(['validate', *map(str, args)])
    return code, *capsys.readouterr()


def found_offset(out):
    return float(re.search(r'clock is ([-+.\d]+) s off', out)[1])


def errors(directory):
    with open(directory / 'errors.csv', newline='') as file:
        return {(row['model'], row['quantity']): row for row in csv.DictReader(file)}


def test_markers_with_another_clock_and_frame(tmp_path, recording, capsys):
    capture = write_markers(tmp_path, captured_markers(noise=0.1))
    code, out, err = run(capsys, recording, capture, '-o', tmp_path / 'out')
    assert (code, err) == (0, '')
    assert found_offset(out) == pytest.approx(OFFSET, abs=2e-4)
    table = errors(tmp_path / 'out')
    assert float(table['improved', 'phi']['rms_deg']) < 0.15
    # 0.1 mm across 80 mm, of two markers.
    assert 0.02 < float(table['improved', 'rotation']['rms_deg']) < 0.25
    for name in ('fig32.png', 'fig33.png', 'fig34.png', 'aligned.csv'):
        assert (tmp_path / 'out' / name).stat().st_size > 1000


def test_pose_of_a_body_in_any_orientation(tmp_path, recording, capsys):
    q = quaternion_from_matrix(FRAME @ motion(captured_times()) @ BODY)
    q[100] = 0.0  # lost for a moment
    capture = write_csv(tmp_path / 'pose.csv', QUATERNION_HEADER,
                        np.column_stack([captured_times() - OFFSET, q]))
    code, out, _ = run(capsys, recording, capture, '-o', tmp_path / 'out')
    assert code == 0
    assert found_offset(out) == pytest.approx(-OFFSET, abs=2e-4)
    assert float(errors(tmp_path / 'out')['improved', 'rotation']['max_deg']) < 0.2
    assert float(errors(tmp_path / 'out')['improved', 'rotation']['rms_deg']) < 0.06


@pytest.mark.parametrize('name', ['truth.csv', 'truth.csv.gz'])
def test_a_truth_of_the_package_is_a_capture(tmp_path, recording, capsys, name):
    """As of test/data: its times are called stamp, and it may be compressed."""
    plain = write_csv(tmp_path / 'truth.csv', ('stamp', *QUATERNION_HEADER[1:]), np.column_stack(
        [captured_times(), quaternion_from_matrix(motion(captured_times()))]))
    (tmp_path / 'truth.csv.gz').write_bytes(gzip.compress(plain.read_bytes()))
    for given in (recording, recording.parent):  # a table, and the directory of recorder
        code, out, err = run(capsys, given, tmp_path / name, '-o', tmp_path / 'out')
        assert (code, err) == (0, '')
        assert found_offset(out) == pytest.approx(0.0, abs=2e-4)


def test_the_joint_angles_of_a_recorders_directory_are_taken(tmp_path, recording, capsys):
    seconds = np.arange(0.0, 10.0, 0.02)
    joints = inverse(motion(seconds))
    write_csv(tmp_path / 'measured_js.csv', ('time', *JOINT_NAMES), np.column_stack(
        [seconds, joints.theta1, joints.theta3a]))
    capture = write_markers(tmp_path, captured_markers())
    code, _, err = run(capsys, tmp_path, capture, '-o', tmp_path / 'out')
    assert (code, err) == (0, '')
    assert ('classic', 'phi') in errors(tmp_path / 'out')


def test_a_broken_compressed_table_is_one_line(tmp_path, recording, capsys):
    broken = tmp_path / 'truth.csv.gz'
    broken.write_bytes(gzip.compress(b'time,qx,qy,qz,qw\n' * 1000)[:40])
    fails(capsys, 'truth.csv.gz: cannot be read', recording, broken)


def test_frames_are_found():
    recorded = motion(captured_times())
    frame, body = constant_frames(FRAME @ recorded @ BODY, recorded, body_known=False)
    np.testing.assert_allclose(frame, FRAME, atol=0.05)
    np.testing.assert_allclose(body, BODY, atol=0.05)
    frame, _ = constant_frames(FRAME @ recorded, recorded, body_known=True)
    np.testing.assert_allclose(frame, FRAME, atol=1e-12)


def test_self_rotation_is_the_average_of_both_projections():
    azimuths = (0.0, math.pi)
    psi, theta, phi = self_rotation(captured_markers(), azimuths, FRAME)
    truth = zxz_from_matrix(motion(captured_times()))
    np.testing.assert_allclose((psi, theta, phi), truth, atol=1e-9)
    # One of the two turned by 2 deg about the axis: half of it is left.
    turned = matrix_from_zxz(0.0, 0.0, math.radians(2.0)) @ POINTS[2]
    points = captured_markers().reshape(-1, 4, 3)
    points[:, 2] += np.einsum('nij,j->ni', FRAME @ motion(captured_times()), turned - POINTS[2])
    _, _, shifted = self_rotation(points.reshape(len(points), -1), azimuths, FRAME)
    np.testing.assert_allclose(shifted - phi, math.radians(1.0), atol=1e-9)


def test_hidden_markers_are_skipped(tmp_path, recording, capsys):
    rows = [[f'{value}' for value in row] for row in captured_markers()]
    for row in rows[200:220]:
        row[7] = ''
    capture = write_markers(tmp_path, rows)
    code, out, _ = run(capsys, recording, capture, '-o', tmp_path / 'out')
    assert code == 0
    assert out.startswith(f'{len(rows) - 20} captured orientations')


def test_classic_model_from_joint_angles(tmp_path, recording, capsys):
    t = np.arange(0.0, 10.0, 0.01)
    joints = inverse(motion(t))
    path = write_csv(
        tmp_path / 'joints.csv', ('time', *JOINT_NAMES),
        np.column_stack([t, joints.theta1, joints.theta3a]))
    capture = write_markers(tmp_path, captured_markers())
    code, out, _ = run(capsys, recording, capture, '--joints', path, '-o', tmp_path / 'out')
    assert code == 0
    row = errors(tmp_path / 'out')['classic', 'phi']
    # From the sample nearest to each captured moment: up to 5 ms away.
    assert float(row['rms_deg']) < 0.1 and row['missing'] == '0'


@pytest.mark.parametrize('nothing', ['', 'nan'])
def test_joints_without_a_reading_cost_the_classic_model_their_time_alone(
        tmp_path, recording, capsys, nothing):
    """th1B is missing for a tenth of the time; th3C for good, which that model does not use."""
    t = np.arange(0.0, 10.0, 0.01)
    joints = inverse(motion(t))
    rows = np.column_stack(
        [t, joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c]).tolist()
    for number, row in enumerate(rows):
        row[6] = nothing
        if 400 <= number < 500:
            row[2] = nothing
    path = write_csv(tmp_path / 'joints.csv', ('time', *ALL_JOINT_NAMES), rows)
    assert np.isnan(recordings.read_joints(path, '').values).sum(axis=0).tolist() \
        == [0, 100, 0, 0, 0, len(t)]
    capture = write_markers(tmp_path, captured_markers())
    code, out, err = run(capsys, recording, capture, '--joints', path, '-o', tmp_path / 'out')
    assert code == 0, err
    row = errors(tmp_path / 'out')['classic', 'phi']
    assert float(row['rms_deg']) < 0.1
    assert int(row['missing']) == pytest.approx(0.1 * len(captured_times()), rel=0.3)


def test_rows_with_too_few_joint_angles_are_counted(tmp_path, recording, capsys):
    t = np.arange(0.0, 10.0, 0.01)
    joints = inverse(motion(t))
    rows = np.column_stack([t, joints.theta1, joints.theta3a])
    rows[::50, 4] = np.nan
    path = write_csv(tmp_path / 'joints.csv', ('time', *JOINT_NAMES), rows.tolist())
    assert recordings.read_joints(path, '').left_out == 20
    capture = write_markers(tmp_path, captured_markers())
    code, out, err = run(capsys, recording, capture, '--joints', path, '-o', tmp_path / 'out')
    assert code == 0, err
    assert '20 rows with fewer than 4 joint angles left out' in out


@pytest.mark.parametrize('left', [(0, 1, 2, 3, 5), (0, 1, 2, 4, 5)])
def test_a_joint_is_not_taken_for_the_one_before_it(tmp_path, left):
    """A column that is not there moves none of the others."""
    names = [ALL_JOINT_NAMES[index] for index in left]
    path = write_csv(tmp_path / 'joints.csv', ('time', *names), [[0.1] * 6] * 20)
    absent = ALL_JOINT_NAMES[min(set(range(6)) - set(left))]
    with pytest.raises(InputError, match=f'joints.csv: no {absent} among time, .*; expected'):
        recordings.read_joints(path, '')


def test_the_classic_model_of_a_mechanism_as_built_and_mounted(tmp_path, capsys):
    rig = tmp_path / 'rig.yaml'
    given = {**mechanism(), 'mounting.base_zxz_deg': [20.0, 30.0, -40.0],
             'mounting.handle_zxz_deg': [0.0, 0.0, 25.0]}
    rig.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n' for name, value in given.items()))
    table, handle = (matrix_from_zxz(*np.radians(given[f'mounting.{part}_zxz_deg']))
                     for part in ('base', 'handle'))
    built = geometry_from(complete(GEOMETRY_SETTINGS, mechanism()))
    t = np.arange(0.0, 10.0, 0.01)
    joints = inverse(motion(t), built)
    path = write_csv(tmp_path / 'joints.csv', ('time', *JOINT_NAMES),
                     np.column_stack([t, joints.theta1, joints.theta3a]))
    mounted = quaternion_from_matrix(table @ motion(t) @ handle)
    recorded = write_csv(tmp_path / 'orientation.csv', QUATERNION_HEADER,
                         np.column_stack([t, mounted]))
    seen = quaternion_from_matrix(FRAME @ table @ motion(captured_times()) @ handle @ BODY)
    capture = write_csv(tmp_path / 'pose.csv', QUATERNION_HEADER,
                        np.column_stack([captured_times() + OFFSET, seen]))

    def rms(*args):
        code, _, err = run(capsys, recorded, capture, '--joints', path, '-o', tmp_path / 'out',
                           *args)
        assert code == 0, err
        return float(errors(tmp_path / 'out')['classic', 'rotation']['rms_deg'])

    assert rms('--params-file', rig) < 0.1
    # Neither the mechanism nor the mounting can be left out.
    assert rms(*(f'-p{name}:={given[name]}' for name in given if 'mounting' in name)) > 0.2
    assert rms(*(f'-p{name}:={given[name]}' for name in mechanism())) > 5.0


def test_the_option_of_nominal_angles_does_not_contradict_the_parameters(
        tmp_path, recording, capsys):
    capture = write_markers(tmp_path, captured_markers())
    code, _, err = run(capsys, recording, capture, '--geometry', 39.3, 34.1, 18.2,
                       '-p', 'geometry.beta_deg:=35.0')
    assert code == 1
    assert err == 'validate: --geometry has 34.1 for geometry.beta_deg, the parameters have ' \
        '35.0; expected one of the two\n'


STAMPED = """std_msgs/Header header
{field}
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
QUATERNION = """================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
POSE = """================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
""" + QUATERNION
DEFINITIONS = {
    'geometry_msgs/msg/QuaternionStamped':
        STAMPED.format(field='geometry_msgs/Quaternion quaternion') + QUATERNION,
    'geometry_msgs/msg/PoseStamped': STAMPED.format(field='geometry_msgs/Pose pose') + POSE,
    'sensor_msgs/msg/JointState': STAMPED.format(
        field='string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort'),
}


def header(t):
    sec, nanosec = divmod(round(t * 1e9), 1_000_000_000)
    return {'stamp': {'sec': sec, 'nanosec': nanosec}, 'frame_id': 'spm_base'}


def write_bag(path):
    """Orientations, joint angles and a captured pose, as `ros2 bag record` stores them."""
    recorded = np.arange(0.0, 10.0, 0.01)
    joints = inverse(motion(recorded))
    with open(path, 'wb') as file:
        writer = Writer(file)
        schemas = {name: writer.register_msgdef(name, text) for name, text in DEFINITIONS.items()}

        def write(topic, kind, t, **fields):
            writer.write_message(topic, schemas[kind], {'header': header(t), **fields},
                                 log_time=round(t * 1e9))

        def named(q):
            return dict(zip('xyzw', q.tolist(), strict=True))

        for t, q, th1, th3a in zip(recorded, quaternion_from_matrix(motion(recorded)),
                                   joints.theta1, joints.theta3a, strict=True):
            write('/left/orientation', 'geometry_msgs/msg/QuaternionStamped', t,
                  quaternion=named(q))
            write('/left/measured_js', 'sensor_msgs/msg/JointState', t,
                  name=[JOINT_NAMES[3], *JOINT_NAMES[:3]],
                  position=[float(th3a), *th1.tolist()], velocity=[], effort=[])
        captured = quaternion_from_matrix(FRAME @ motion(captured_times()) @ BODY)
        for t, q in zip(captured_times() + OFFSET, captured, strict=True):
            write('/vicon/platform/pose', 'geometry_msgs/msg/PoseStamped', t, pose={
                'position': {'x': 0.0, 'y': 0.0, 'z': 0.0}, 'orientation': named(q)})
        writer.finish()
    return path


def test_a_directory_of_rosbag2_is_read_as_its_file(tmp_path):
    (tmp_path / 'bag').mkdir()
    path = write_bag(tmp_path / 'bag' / 'bag_0.mcap')
    for read, topic in ((recordings.read_orientation, 'orientation'),
                        (recordings.read_joints, 'measured_js'),
                        (recordings.read_capture, 'platform/pose')):
        np.testing.assert_array_equal(read(path.parent, topic).values, read(path, topic).values)


@pytest.mark.slow
def test_rosbag2_with_everything_in_it(tmp_path, capsys):
    path = write_bag(tmp_path / 'bag.mcap')
    code, out, err = run(capsys, path, path, '--capture-topic', 'platform/pose',
                         '-o', tmp_path / 'out')
    assert (code, err) == (0, '')
    assert found_offset(out) == pytest.approx(OFFSET, abs=1e-4)
    table = errors(tmp_path / 'out')
    assert float(table['improved', 'rotation']['max_deg']) < 0.02
    assert float(table['classic', 'phi']['rms_deg']) < 0.02


def fails(capsys, expected, *args):
    code, _, err = run(capsys, *args)
    assert code == 1
    assert err.startswith('validate: ') and err.count('\n') == 1, err
    assert re.search(expected, err), err


def test_bad_files_get_one_clear_line(tmp_path, recording, capsys):
    capture = write_markers(tmp_path, captured_markers())
    text = tmp_path / 'text.csv'
    text.write_text('time,qx,qy,qz,qw\n0.0,0,0,zero,1\n')
    fails(capsys, 'line 2: not numbers', text, capture)
    text.write_text('t,x,y,z,w\n0,0,0,0,1\n')
    fails(capsys, 'no column time, qx', text, capture)
    text.write_text('')
    fails(capsys, 'expected time and either', recording, text)
    text.write_text('time,qx,qy,qz,qw\n' + '0.0,0,0,0,1\n' * 20)
    fails(capsys, 'time does not increase', text, capture)
    text.write_text('time,qx,qy,qz,qw\n' + ''.join(f'{i},0,0,0,2\n' for i in range(20)))
    fails(capsys, 'norm 2; expected 1', text, capture)
    text.write_text('time,qx,qy,qz,qw\n0.0,0,0,0,1\n')
    fails(capsys, '1 complete rows', text, capture)
    text.write_bytes(b'\xff\xfe\x00\x80')
    fails(capsys, 'no column time, qx', text, capture)
    fails(capsys, 'cannot be read.*No such file', tmp_path / 'none.csv', capture)
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(b'\x89MCAP0\r\n and nothing else')
    fails(capsys, 'its end is missing.*ros2 bag reindex', cut, capture)
    cut.write_bytes(b'no MCAP at all')
    fails(capsys, 'cannot be read as rosbag2: ReaderError: File magic', cut, capture)
    (tmp_path / 'empty').mkdir()
    fails(capsys, 'neither metadata.yaml nor', tmp_path / 'empty', capture)
    bag = write_bag(tmp_path / 'whole.mcap')
    fails(capsys, 'nothing on topic pose_of_mine; it has /left/measured_js', bag, bag,
          '--capture-topic', 'pose_of_mine')
    fails(capsys, 'give the topic', bag, bag)
    fails(capsys, 'measured_js is of type sensor_msgs/msg/JointState; expected geometry_msgs',
          bag, bag, '--capture-topic', 'measured_js')
    cut.write_bytes(bag.read_bytes()[:50_000])
    fails(capsys, 'its end is missing.*ros2 bag reindex', cut, capture)


def test_recordings_that_do_not_belong_together(tmp_path, recording, capsys):
    coordinates = captured_markers()
    still = np.broadcast_to(coordinates[0], coordinates.shape)
    fails(capsys, 'do not move alike', recording, write_markers(tmp_path, still))
    fails(capsys, 'too short', recording, write_csv(
        tmp_path / 'short.csv', POINT_HEADER,
        np.column_stack([captured_times(), coordinates])[:30]))
    heaped = coordinates.copy()
    heaped[:, 3:6] = heaped[:, :3]
    fails(capsys, 'A and B coincide', recording, write_markers(tmp_path, heaped))
    on_axis = coordinates.copy()
    on_axis[:, 6:9] = 0.5 * (on_axis[:, :3] + on_axis[:, 3:6])
    fails(capsys, 'C lies on the axis', recording, write_markers(tmp_path, on_axis))


def test_a_motion_that_repeats_itself_is_not_taken_for_another_period():
    def repeated(t):
        return quaternion_from_matrix(
            matrix_from_zxz(*np.array([trajectories.fig9(each) for each in t]).T))

    recorded, captured = np.arange(2.0, 40.0, 0.01), np.arange(0.0, 45.0, 0.01)
    alignment = align(recorded + 1.7e9, repeated(recorded), captured, repeated(captured),
                      body_known=False)
    assert alignment.offset == pytest.approx(1.7e9, abs=1e-3)


def test_joint_angles_of_another_time(tmp_path, recording, capsys):
    joints = inverse(motion(captured_times()))
    path = write_csv(
        tmp_path / 'joints.csv', ('time', *JOINT_NAMES),
        np.column_stack([captured_times() + 100.0, joints.theta1, joints.theta3a]))
    fails(capsys, 'of another time', recording, write_markers(tmp_path, captured_markers()),
          '--joints', path)


def test_alignment_of_shifted_pieces():
    """The offset is right also where neither recording contains the other."""
    first, second = np.arange(0.0, 7.0, 0.005), np.arange(3.0, 10.0, 0.008)
    alignment = align(first, quaternion_from_matrix(motion(first)), second - 100.0,
                      quaternion_from_matrix(FRAME @ motion(second)), body_known=True)
    assert alignment.offset == pytest.approx(100.0, abs=1e-4)
    np.testing.assert_allclose(alignment.frame, FRAME, atol=1e-5)


@pytest.mark.parametrize('names', [['matplotlib.figure'], ['rosbag2_py', 'rosbags.rosbag2']])
def test_what_is_not_installed_is_named(tmp_path, recording, capsys, monkeypatch, names):
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)
    for loaded in ('plot_style', 'figures'):
        monkeypatch.delitem(sys.modules, f'spm_haptic_master.validation.{loaded}', raising=False)
        monkeypatch.delattr(f'spm_haptic_master.validation.{loaded}', raising=False)
    fails(capsys, 'needs .*pip install', write_bag(tmp_path / 'bag.mcap'),
          write_markers(tmp_path, captured_markers()))
