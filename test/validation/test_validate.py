# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""validate: known offsets and frames are found, bad files are reported in one line."""

import csv
import gzip
import math
import re
import sys

from bag_writer import JOINTS, ORIENTATION, POSE, write_bag
import numpy as np
import pytest
from recorded_text import assert_recorded
from rig_as_built import mechanism
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.geometry import geometry_from, GEOMETRY_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.tools import validate
from spm_haptic_master.validation import alignment, comparison, plot_style, recordings

OFFSET = 37.4215  # s; captured clock ahead of the recording's
FRAME = kinematics.matrix_from_zxz(0.8, 1.1, -2.0)
BODY = kinematics.matrix_from_zxz(-2.4, 0.7, 0.3)
NOISE = math.radians(0.04)
# Markers A and B on Z_E, C and D beside it, mm in the platform's frame.
POINTS = np.array([[0.0, 0.0, 40.0], [0.0, 0.0, 120.0], [60.0, 0.0, 80.0], [-60.0, 0.0, 80.0]])
AZIMUTHS = 0.0, math.pi
QUATERNION_HEADER = ('time', 'qx', 'qy', 'qz', 'qw')
POINT_HEADER = ('time', *(f'{marker}{axis}' for marker in 'abcd' for axis in 'xyz'))
RECORDED = np.arange(0.0, 10.0, 0.01)
CAPTURED = np.arange(1.0, 9.0, 0.02)


def motion(t):
    """Orientations of a motion about all axes that does not repeat, (n, 3, 3)."""
    phi = np.radians(30.0 + 6.0 * np.sin(1.3 * t) + 4.0 * np.sin(2.9 * t + 0.4 * t * t / 10.0))
    return kinematics.matrix_from_zxz(
        trajectories.CENTRE_PSI + 0.15 * np.sin(0.9 * t + 0.2),
        trajectories.CENTRE_THETA + 0.1 * np.sin(1.7 * t),
        phi,
    )


def joint_angles(geometry=None):
    """Return the angles of six sensors during the motion, (n, 6)."""
    found = kinematics.inverse(motion(RECORDED), geometry or kinematics.Geometry())
    return np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])


def write_csv(path, header, *columns):
    with open(path, 'w', newline='') as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(np.column_stack(columns).tolist())
    return path


@pytest.fixture
def recording(tmp_path):
    """Orientations at 250 Hz for 10 s, with the sensors' noise."""
    t = np.arange(0.0, 10.0, 0.004)
    rng = np.random.default_rng(1)
    q = kinematics.quaternion_from_matrix(motion(t)) + 0.3 * NOISE * rng.normal(size=(len(t), 4))
    q /= np.linalg.norm(q, axis=-1, keepdims=True)
    # Of either sign, as any source may send them.
    q[::3] *= -1.0
    return write_csv(tmp_path / 'orientation.csv', QUATERNION_HEADER, t, q)


def captured_markers(noise=0.0):
    """Markers, (n, 12), in the capture's frame."""
    points = np.einsum('nij,kj->nki', FRAME @ motion(CAPTURED), POINTS)
    points += noise * np.random.default_rng(2).normal(size=points.shape)
    return points.reshape(len(points), -1) + np.tile([300.0, -20.0, 900.0], 4)


def write_markers(tmp_path, coordinates):
    return write_csv(
        tmp_path / 'markers.csv',
        POINT_HEADER,
        CAPTURED[: len(coordinates)] + OFFSET,
        coordinates,
    )


def run(capsys, *args):
    code = validate.main(['validate', *map(str, args)])
    return code, *capsys.readouterr()


def errors(directory):
    with open(directory / 'errors.csv', newline='') as file:
        return {(row['model'], row['quantity']): row for row in csv.DictReader(file)}


def titles_and_labels(figure):
    """Return title and labels of each of the axes of a picture, and check its legend."""
    shown = {line.get_label() for axes in figure.axes for line in axes.lines}
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    named = {text.get_text() for legend in legends if legend for text in legend.texts}
    assert named == shown
    colours = {(line.get_label(), line.get_color()) for axes in figure.axes for line in axes.lines}
    assert len({colour for _, colour in colours}) == len(colours) == len(shown)
    return [(axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) for axes in figure.axes]


def test_a_recorders_directory_with_markers_of_another_clock_and_frame(
    tmp_path,
    recording,
    capsys,
    monkeypatch,
):
    drawn = {}
    monkeypatch.setattr(
        'spm_haptic_master.validation.plot_style.save',
        lambda figure, path: drawn.update({path.name: figure}),
    )
    capture = write_markers(tmp_path, captured_markers(noise=0.1))
    joints = joint_angles()[:, :4]
    joints[::50, 3] = np.nan
    write_csv(
        tmp_path / 'measured_js.csv',
        ('time', *JOINT_NAMES),
        RECORDED,
        joints,
    )
    code, out, err = run(
        capsys,
        tmp_path,
        capture,
        '-o',
        tmp_path / 'out',
    )
    assert (code, err) == (0, '')
    # 0.1 mm across 80 mm, of two markers: see errors.txt.
    text = (tmp_path / 'out' / 'errors.csv').read_text()
    assert_recorded('validation/errors.txt', out.replace(str(tmp_path), '') + text)
    assert float(re.search(r'clock is ([-+.\d]+) s off', out)[1]) == pytest.approx(
        OFFSET, abs=2e-4
    )
    aligned = np.genfromtxt(tmp_path / 'out' / 'aligned.csv', delimiter=',', names=True)
    np.testing.assert_allclose(aligned['capture_time'], CAPTURED + OFFSET, atol=1e-5)
    np.testing.assert_allclose(aligned['time'], CAPTURED, atol=2e-4)
    true = np.degrees(kinematics.zxz_from_matrix(motion(CAPTURED)))
    for name, angle in zip(comparison.ANGLES, true, strict=True):
        for model in ('captured', 'improved', 'classic'):
            np.testing.assert_allclose(aligned[f'{model}_{name}_deg'], angle, atol=1.0)
    # What is drawn is what is written, over the time from the first moment on.
    models = {
        'classic FKM (3 sensors)': 'classic',
        'improved FKM (4 sensors)': 'improved',
        'motion capture': 'captured',
    }
    assert {name: titles_and_labels(figure) for name, figure in drawn.items()} == {
        'fig32.png': [
            ('Orientation of the platform by the forward models', '', 'ψ, deg'),
            ('', '', 'θ, deg'),
            ('', 'time, s', 'φ, deg'),
        ],
        'fig33.png': [('Self-rotation by the forward models', 'time, s', 'self-rotation φ, deg')],
        'fig34.png': [
            (
                'Self-rotation: forward models and motion capture',
                'time, s',
                'self-rotation φ, deg',
            )
        ],
    }
    for name, angles, shown in (
        ('fig32.png', comparison.ANGLES, 2),
        ('fig33.png', ['phi'], 2),
        ('fig34.png', ['phi'], 3),
    ):
        for axes, angle in zip(drawn[name].axes, angles, strict=True):
            assert len(axes.lines) == shown
            for line in axes.lines:
                np.testing.assert_allclose(
                    line.get_xydata().T,
                    [
                        aligned['time'] - aligned['time'][0],
                        aligned[f'{models[line.get_label()]}_{angle}_deg'],
                    ],
                    atol=2e-6,
                )


def test_rosbag2_with_everything_in_it(tmp_path, capsys):
    path = write_bag(
        tmp_path / 'bag',
        {
            topic: np.column_stack([time, kinematics.quaternion_from_matrix(rotations)])
            for topic, time, rotations in (
                (ORIENTATION, RECORDED, motion(RECORDED)),
                (POSE, CAPTURED + OFFSET, FRAME @ motion(CAPTURED) @ BODY),
            )
        }
        | {JOINTS: np.column_stack([RECORDED, joint_angles()[:, :4]])},
    )
    code, out, err = run(
        capsys,
        path,
        path,
        '--capture-topic',
        'platform/pose',
        '-o',
        tmp_path / 'out',
    )
    assert (code, err) == (0, '')
    for name in ('fig32.png', 'fig33.png', 'fig34.png'):
        assert (tmp_path / 'out' / name).read_bytes().startswith(b'\x89PNG')
    table = errors(tmp_path / 'out')
    assert float(table['improved', 'rotation']['max_deg']) < 0.02
    assert float(table['classic', 'phi']['rms_deg']) < 0.02
    fails(
        capsys,
        'nothing on topic pose_of_mine; it has /left/measured_js',
        path,
        path,
        '--capture-topic',
        'pose_of_mine',
    )
    fails(capsys, 'give the topic', path, path)
    fails(
        capsys,
        'measured_js is of type sensor_msgs/msg/JointState; expected geometry_msgs',
        path,
        path,
        '--capture-topic',
        'measured_js',
    )


@pytest.mark.parametrize(('time', 'compressed'), [('time', False), ('stamp', True)])
def test_a_truth_of_the_package_is_a_capture(
    tmp_path,
    time,
    compressed,
):
    """Of ten rows, the least number, with quaternions that are nearly of length 1."""
    truth = kinematics.quaternion_from_matrix(motion(CAPTURED[:10]))
    path = write_csv(
        tmp_path / 'truth.csv',
        (time, *QUATERNION_HEADER[1:]),
        CAPTURED[:10],
        np.linspace(0.992, 1.008, 10)[:, None] * truth,
    )
    if compressed:
        path = tmp_path / 'truth.csv.gz'
        path.write_bytes(gzip.compress((tmp_path / 'truth.csv').read_bytes()))
    track = recordings.read_capture(path, None)
    np.testing.assert_array_equal(track.time, CAPTURED[:10])
    np.testing.assert_allclose(
        track.values,
        truth,
        rtol=0.0,
        atol=1e-12,
    )


def test_moments_without_markers_or_pose_are_left_out(tmp_path):
    coordinates = captured_markers().astype(object)
    coordinates[200:220, 7] = ''
    q = kinematics.quaternion_from_matrix(motion(CAPTURED))
    q[200:220] = 0.0
    for path in (
        write_markers(tmp_path, coordinates),
        write_csv(tmp_path / 'pose.csv', QUATERNION_HEADER, CAPTURED, q),
    ):
        track = recordings.read_capture(path, None)
        assert (len(track.time), track.left_out) == (len(CAPTURED) - 20, 20)


def test_self_rotation_is_the_average_of_both_projections():
    true = comparison.orientation_of_markers(captured_markers(), AZIMUTHS)
    np.testing.assert_allclose(true, FRAME @ motion(CAPTURED), atol=1e-9)
    # One of the two turned by 2 deg about the axis: half of it is left.
    turned = kinematics.matrix_from_zxz(0.0, 0.0, math.radians(2.0)) @ POINTS[2]
    points = captured_markers().reshape(-1, 4, 3)
    points[:, 2] += np.einsum('nij,j->ni', FRAME @ motion(CAPTURED), turned - POINTS[2])
    np.testing.assert_allclose(
        comparison.orientation_of_markers(points.reshape(len(points), -1), AZIMUTHS),
        true @ kinematics.matrix_from_zxz(0.0, 0.0, math.radians(1.0)),
        atol=1e-9,
    )


def test_the_classic_model_is_of_the_joint_angles_nearest_in_time():
    """From the first to the last, but for gaps beyond 0.1 s and where one of three is missing."""
    rows = np.array([row for row in range(100, 900, 6) if not 400 < row < 430])
    recorded, captured = (
        recordings.Track(times, kinematics.quaternion_from_matrix(motion(times)))
        for times in (RECORDED, CAPTURED)
    )
    joints = recordings.Track(RECORDED[rows], joint_angles()[rows])
    joints.values[20:30, 1] = joints.values[:, 5] = np.nan
    found = comparison.compare(
        recorded,
        captured,
        joints,
        kinematics.Geometry(),
        AZIMUTHS,
    )
    apart = np.abs(found.time[:, None] - joints.time)
    assert 0 < (apart.min(axis=1) > 0.1).sum() < 10
    assert found.time[0] < 1.03
    known = (apart.min(axis=1) < 0.1) & np.isfinite(joints.values[apart.argmin(axis=1), 1])
    (row,) = (row for row in comparison.error_table(found) if row[:2] == ('classic', 'phi'))
    assert (row.samples, row.missing) == (known.sum(), (~known).sum())
    assert row.figures_deg[1] < 1.0
    assert found.time[-1] > joints.time[-1] - 0.03
    expected = motion(joints.time[apart.argmin(axis=1)])
    expected[~known] = np.nan
    np.testing.assert_allclose(found.models['classic'], expected, atol=1e-4)


@pytest.mark.parametrize('left', [(0, 1, 2, 3, 5), (0, 1, 2, 4, 5)])
def test_a_joint_is_not_taken_for_the_one_before_it(tmp_path, left):
    """A column that is not there moves none of the others."""
    names = [ALL_JOINT_NAMES[index] for index in left]
    path = write_csv(tmp_path / 'joints.csv', ('time', *names), np.full((20, 6), 0.1))
    absent = ALL_JOINT_NAMES[min(set(range(6)) - set(left))]
    with pytest.raises(InputError, match=f'joints.csv: no {absent} among time, .*; expected'):
        recordings.read_joints(path, '')


def fails(capsys, expected, *args):
    code, _, err = run(capsys, *args)
    assert code == 1
    assert err.startswith('validate: ') and err.count('\n') == 1, err
    assert re.search(expected, err), err


def test_the_classic_model_is_of_the_mechanism_as_built_and_mounted(
    tmp_path,
    capsys,
    monkeypatch,
):
    monkeypatch.setattr('spm_haptic_master.validation.plot_style.draw_comparison', lambda *_: None)
    base = [20.0, 30.0, -40.0]
    handle = [0.0, 0.0, 25.0]
    left, right = (kinematics.matrix_from_zxz(*np.radians(angles)) for angles in (base, handle))
    recorded = kinematics.quaternion_from_matrix(left @ motion(RECORDED) @ right)
    joints = joint_angles(geometry_from(complete(GEOMETRY_SETTINGS, mechanism())))
    files = (
        write_csv(tmp_path / 'r.csv', QUATERNION_HEADER, RECORDED, recorded),
        write_csv(
            tmp_path / 'c.csv',
            QUATERNION_HEADER,
            RECORDED[:500:5],
            recorded[:500:5],
        ),
        '--joints',
        write_csv(
            tmp_path / 'j.csv',
            ('time', *ALL_JOINT_NAMES),
            RECORDED,
            joints,
        ),
    )

    def rms(values):
        given = [each for name, value in values.items() for each in ('-p', f'{name}:={value}')]
        assert (
            run(
                capsys,
                *files,
                '-o',
                tmp_path,
                *given,
            )[0]
            == 0
        )
        return float(errors(tmp_path)['classic', 'rotation']['rms_deg'])

    mounted = {'mounting.base_zxz_deg': base, 'mounting.handle_zxz_deg': handle}
    assert rms(mechanism() | mounted) < 0.1
    # Neither the mechanism nor the mounting can be left out.
    assert rms(mounted) > 0.2
    assert rms(mechanism()) > 5.0


HEADER = 'time,qx,qy,qz,qw\n'


@pytest.mark.parametrize(
    ('content', 'expected'),
    [
        (HEADER + '0.0,0,0,zero,1\n', 'line 2: not numbers'),
        ('t,x,y,z,w\n0,0,0,0,1\n', 'no column time, qx'),
        (HEADER + '0.0,0,0,0,1\n' * 20, 'time does not increase'),
        (HEADER + ''.join(f'{i},0,0,0,2\n' for i in range(20)), 'norm 2; expected 1'),
        (HEADER + '0.0,0,0,0,1\n', '1 complete rows'),
        (HEADER + ''.join(f'{i},0,0,0,inf\n' for i in range(20)), 'a value is not finite'),
        (b'\xff\xfe\x00\x80', 'no column time, qx'),
        (None, 'cannot be read.*No such file'),
        (gzip.compress(HEADER.encode() * 1000, mtime=0)[:40], 'text.csv.gz: cannot be read'),
        (gzip.compress(b'', mtime=0), 'no column time, qx'),
    ],
)
def test_a_bad_table_gets_one_clear_line(
    tmp_path,
    capsys,
    content,
    expected,
):
    path = tmp_path / (
        'text.csv.gz' if isinstance(content, bytes) and content[:2] == b'\x1f\x8b' else 'text.csv'
    )
    if content is not None:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    fails(capsys, expected, path, path)


@pytest.mark.parametrize(
    ('change', 'expected'),
    [
        (lambda points: np.broadcast_to(points[0], points.shape), 'do not move alike'),
        (lambda points: points[:30], 'too short'),
        (lambda points: points[:, [0, 1, 2, 0, 1, 2, *range(6, 12)]], 'A and B coincide'),
        (lambda points: points[:, [*range(6), 3, 4, 5, *range(9, 12)]], 'C lies on the axis'),
        (lambda points: points, 'of another time'),
    ],
)
def test_recordings_that_do_not_belong_together(
    tmp_path,
    recording,
    capsys,
    change,
    expected,
):
    joints = write_csv(
        tmp_path / 'joints.csv',
        ('time', *ALL_JOINT_NAMES),
        RECORDED + 100.0,
        joint_angles(),
    )
    fails(
        capsys,
        expected,
        recording,
        write_markers(tmp_path, change(captured_markers())),
        '--joints',
        joints,
    )


def test_a_motion_that_repeats_itself_is_not_taken_for_another_period():
    def repeated(t):
        return kinematics.quaternion_from_matrix(
            kinematics.matrix_from_zxz(*np.array([trajectories.fig9(each) for each in t]).T)
        )

    recorded = np.arange(2.0, 40.0, 0.01)
    captured = np.arange(0.0, 45.0, 0.01)
    found = alignment.align(
        recorded + 1.7e9,
        repeated(recorded),
        captured,
        repeated(captured),
        body_known=False,
    )
    assert found.offset == pytest.approx(1.7e9, abs=1e-3)


def test_orientations_are_interpolated_within_the_recording_and_short_gaps_alone():
    time = np.array([1.0, 1.09, 1.15, 1.3])
    signs = np.array([[1.0], [-1.0], [-1.0], [1.0]])
    at = np.array([0.999, 1.0, 1.04, 1.09, 1.125, 1.15, 1.2, 1.2999, 1.3, 1.301])
    quaternions = signs * kinematics.quaternion_from_matrix(motion(time))
    found = alignment.interpolate(time, quaternions, at)
    known = [1, 2, 3, 4, 5]
    assert np.flatnonzero(np.isfinite(found[:, 0])).tolist() == known
    np.testing.assert_allclose(np.linalg.norm(found[known], axis=1), 1.0)
    assert np.isfinite(alignment.interpolate(time[:3], found[[1, 3, 5]], time[:3])).all()
    off = alignment.rotation_vectors(
        kinematics.matrix_from_quaternion(found[known]) @ motion(at[known]).swapaxes(1, 2)
    )
    assert np.abs(off).max() < 1e-3
    assert np.abs(off[[0, 2, 4]]).max() < 1e-12


def test_the_speed_of_a_steady_turn_is_constant_and_equal_periods_are_not_shifted():
    half = 0.35 * RECORDED
    turning = np.column_stack([0.0 * half, 0.0 * half, np.sin(half), np.cos(half)])
    np.testing.assert_allclose(alignment.angular_speed(RECORDED, turning)[1], 0.7, rtol=1e-3)
    with pytest.raises(InputError, match='too short') as error:
        alignment.angular_speed(RECORDED[:9], turning[:9])
    enough = RECORDED <= float(re.search(r'expected ([\d.]+) s', str(error.value))[1]) + 1e-9
    assert len(alignment.angular_speed(RECORDED[enough], turning[enough])[1])
    periodic = 1.0 + np.sin(np.arange(2000) * math.tau / 50)
    assert alignment.coarse_offset((5.0, periodic), (3.0, periodic)) == pytest.approx((2.0, 1.0))


@pytest.mark.parametrize('body', [BODY, np.eye(3)])
def test_constant_frames_are_those_of_the_orientations(body):
    recorded = motion(RECORDED)
    found = alignment.constant_frames(FRAME @ recorded @ body, recorded, body is not BODY)
    # Of the body approximately: the motion tilts the platform by some degrees only.
    np.testing.assert_allclose(found[0] @ recorded @ found[1], FRAME @ recorded @ body, atol=0.01)


def test_pieces_of_which_neither_contains_the_other_are_aligned():
    first = np.arange(0.0, 7.0, 0.005)
    second = np.arange(2.0037, 9.0, 0.008)
    recorded, captured = map(
        kinematics.quaternion_from_matrix, (motion(first), FRAME @ motion(second))
    )
    found = alignment.align(
        first,
        recorded,
        second - 100.0,
        captured,
        body_known=True,
    )
    assert found.offset == pytest.approx(100.0, abs=1e-5)
    np.testing.assert_allclose(found.frame, FRAME, atol=1e-5)


def test_a_picture_has_no_jumps_and_magnifies_no_angle_that_hardly_moves(tmp_path, monkeypatch):
    time = np.arange(50.0)
    psi = np.linspace(170.0, 190.0, 50)
    drawn = []
    rotations = kinematics.matrix_from_zxz(
        np.radians(psi),
        0.9 + 1e-3 * np.sin(time),
        0.0 * psi,
    )
    with monkeypatch.context() as patch:
        patch.setattr(plot_style, 'save', lambda figure, path: drawn.append(figure))
        plot_style.draw_comparison(
            comparison.Comparison(
                time,
                time,
                rotations,
                {'improved': rotations},
                None,
                {},
            ),
            tmp_path,
        )
    moving, still, _ = drawn[0].axes
    np.testing.assert_allclose(moving.lines[0].get_ydata(), psi)
    np.testing.assert_allclose(
        still.get_ylim(),
        math.degrees(0.9) + np.array([-1, 1]),
        atol=0.01,
    )
    with pytest.raises(InputError, match='missing/a.png: cannot be written: '):
        plot_style.save(plot_style.new_figure(), tmp_path / 'missing' / 'a.png')


@pytest.mark.parametrize('names', [['matplotlib.figure'], ['rosbags.rosbag2']])
def test_what_is_not_installed_is_named(
    tmp_path,
    capsys,
    monkeypatch,
    names,
):
    for name in names:
        monkeypatch.setitem(sys.modules, name, None)
    for loaded in ('plot_style', 'figures'):
        monkeypatch.delitem(sys.modules, f'spm_haptic_master.validation.{loaded}', raising=False)
        monkeypatch.delattr(f'spm_haptic_master.validation.{loaded}', raising=False)
    (tmp_path / 'bag.db3').touch()
    fails(
        capsys,
        'needs .*pip install',
        tmp_path / 'bag.db3',
        tmp_path / 'bag.db3',
    )
