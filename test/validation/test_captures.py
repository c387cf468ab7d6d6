# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Motion captures as their systems write them, with the faults that their users report."""

import math
import re

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.tools import validate
from spm_haptic_master.validation import alignment, comparison, recordings
from spm_haptic_master.validation.recordings import Track

FRAME = kinematics.matrix_from_zxz(0.8, 1.1, -2.0)
BODY = kinematics.matrix_from_zxz(-2.4, 0.7, 0.3)
# Markers A and B on Z_E, C and D beside it, mm in the platform's frame. As they are usually
# fastened: C and D are no mirror images of each other.
POINTS = np.array(
    [
        [0.0, 0.0, 40.0],
        [0.0, 0.0, 120.0],
        [60.0, 0.0, 80.0],
        [-60.0, 0.0, 80.0],
    ]
)
AZIMUTHS = 0.0, math.pi
RECORDED = np.arange(0.0, 40.0, 0.005)
CAPTURED = np.arange(1.0, 39.0, 0.01)
# deg, of a pose; mm, of a marker.
NOISE_DEG = 0.02
NOISE_MM = 0.05
# Markers exchange their names, or one is at the origin, in these rows of the capture.
PLACE = slice(1500, 1650)


def motion(t, seed=3):
    """Return orientations of a hand's motion, (n, 3, 3)."""
    random = np.random.default_rng(seed)
    waves = [
        sum(
            np.sin(2.0 * np.pi * t / period + random.uniform(0.0, 6.0))
            for period in random.uniform(1.5, 7.0, 5)
        )
        / 2.5
        for _ in range(3)
    ]
    return kinematics.workspace_pose(
        0.25 * np.tanh(np.hypot(waves[0], waves[1])),
        np.arctan2(waves[1], waves[0]),
        0.8 + 0.6 * waves[2],
    )


def quaternions(rotations, seed=1):
    """Return noisy quaternions, of steady sign."""
    random = np.random.default_rng(seed)
    noise = np.radians(NOISE_DEG) * random.normal(size=(len(rotations), 3))
    found = kinematics.quaternion_from_matrix(
        rotations @ kinematics.matrix_from_zxz(0.0 * noise[:, 0], noise[:, 0], noise[:, 1])
    )
    flips = np.sum(found[1:] * found[:-1], axis=1) < 0.0
    turned = np.concatenate([[0], np.cumsum(flips)]) % 2
    return found * np.where(turned, -1.0, 1.0)[:, None]


@pytest.fixture(scope='module')
def recorded():
    return Track(RECORDED, quaternions(motion(RECORDED)))


@pytest.fixture
def poses():
    return quaternions(FRAME @ motion(CAPTURED) @ BODY, 2)


@pytest.fixture
def markers():
    points = np.einsum('nij,kj->nki', FRAME @ motion(CAPTURED), POINTS)
    points += NOISE_MM * np.random.default_rng(2).normal(size=points.shape)
    return points.reshape(len(points), -1) + np.tile([300.0, -20.0, 900.0], 4)


def compared(
    recorded,
    values,
    time=CAPTURED,
):
    return comparison.compare(
        recorded,
        Track(time + 50.0, values),
        None,
        kinematics.Geometry(),
        AZIMUTHS,
    )


def largest(found):
    """Return the largest error of the recorded orientations, deg."""
    turned = found.models['improved'] @ found.captured.swapaxes(1, 2)
    angles = np.linalg.norm(alignment.rotation_vectors(turned), axis=1)
    return float(np.degrees(angles.max()))


def exchanged(
    values,
    rows,
    first=2,
    second=3,
):
    points = values.reshape(len(values), 4, 3).copy()
    points[rows, first], points[rows, second] = (
        points[rows, second].copy(),
        points[rows, first].copy(),
    )
    return points.reshape(len(values), 12)


@pytest.mark.parametrize('rows', [[1900], slice(1900, 1930)])
@pytest.mark.parametrize(
    ('first', 'second'),
    [
        (2, 3),
        (0, 1),
        (1, 2),
    ],
)
def test_M1_exchanged_markers_are_left_out_and_counted(
    recorded,
    markers,
    rows,
    first,
    second,
):
    """C and D are as far from A and B as each other: only their turn of half a turn shows it."""
    found = compared(recorded, exchanged(markers, rows, first, second))
    assert found.alignment.offset == pytest.approx(-50.0, abs=2e-3)
    assert largest(found) < 0.6
    if isinstance(rows, slice):
        number = len(range(*rows.indices(4000)))
    else:
        number = 1
    assert sum(found.left_out.values()) == number
    assert set(found.left_out) <= {'that no hand can give', 'that no rigid body can give'}


def test_M1_a_marker_at_the_origin_is_not_one(
    recorded,
    markers,
    tmp_path,
):
    """A system that lost it writes 0, 0, 0: a fault that a table of ours has as well."""
    points = markers.reshape(-1, 4, 3).copy()
    points[PLACE, 2] = 0.0
    found = compared(recorded, points.reshape(-1, 12))
    assert largest(found) < 0.6
    assert sum(found.left_out.values()) == 150


@pytest.mark.parametrize('kind', ['held', 'filled in'])
@pytest.mark.parametrize('of', ['poses', 'markers'])
def test_M2_what_was_held_or_filled_in_is_left_out(
    recorded,
    request,
    kind,
    of,
):
    values = request.getfixturevalue(of).copy()
    count = PLACE.stop - PLACE.start
    first = values[PLACE.start]
    last = values[PLACE.stop]
    if kind == 'filled in':
        part = np.linspace(0.0, 1.0, count)[:, None]
    else:
        part = np.zeros((count, 1))
    values[PLACE] = first + part * (last - first)
    if of == 'poses':
        values[PLACE] /= np.linalg.norm(values[PLACE], axis=1, keepdims=True)
    found = compared(recorded, values)
    assert largest(found) < 0.6
    assert found.left_out['held or filled in by the capture'] >= count - 4


def test_M2_a_clock_that_is_fast_is_fitted(recorded, poses):
    """120 Hz that are called 119.88."""
    found = compared(recorded, poses, CAPTURED * 1.001)
    assert found.alignment.rate == pytest.approx(-0.001, abs=2e-5)
    assert largest(found) < 0.3
    assert compared(recorded, poses).alignment.rate == 0.0


@pytest.mark.parametrize(
    'change',
    [
        lambda q: q * [-1.0, -1.0, -1.0, 1.0],
        lambda q: np.roll(q, 1, axis=1),
    ],
)
def test_M2_the_inverse_and_another_order_of_quaternions_are_named(
    recorded,
    poses,
    change,
):
    with pytest.raises(
        InputError,
        match=r'^the captured orientations are inverted \(of the world in the body\), or their '
        r'quaternions are in the order w, x, y, z: so they fit the recording to 0\.0\d deg rms, '
        r'as they are to \d',
    ):
        compared(recorded, change(poses))


def test_the_mirror_image_of_a_body_is_the_body_in_other_frames(recorded, poses):
    assert largest(compared(recorded, poses * [1.0, -1.0, -1.0, 1.0])) < 0.3


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (lambda points: points * [1.0, 1.0, -1.0], 'the markers are a mirror image'),
        (lambda points: points[:, [1, 0, 2, 3]], 'the markers A and B are exchanged'),
        (
            lambda points: points[:, [0, 1, 3, 2]],
            'the markers C and D are turned by -?180 deg about Z_E: exchanged, or expected at',
        ),
    ],
)
def test_M2_mirrored_markers_and_markers_of_other_names_are_named(
    recorded,
    markers,
    change,
    words,
):
    with pytest.raises(InputError, match=f'^{words}.* they fit the recording to 0'):
        compared(recorded, change(markers.reshape(-1, 4, 3)).reshape(-1, 12))


def test_M2_milliseconds_for_seconds_are_named(recorded, poses):
    with pytest.raises(InputError, match='lasts 37990 s .* expected times in s, not in ms'):
        compared(recorded, poses, CAPTURED * 1e3)


def test_without_a_correlation_of_nine_tenths_there_is_no_result(recorded):
    others = quaternions(FRAME @ motion(CAPTURED, seed=8) @ BODY)
    with pytest.raises(InputError, match='do not move alike: .* expected 0.9 or more'):
        compared(recorded, others)


def motive(rotations, kind='Quaternion'):
    """Return what Motive 3 exports of a rigid body with its markers."""
    lines = [
        'Format Version,1.23,Take Name,Take 2026-03-01,Capture Frame Rate,100.000000,Export Frame '
        f'Rate,100.000000,Total Exported Frames,{len(rotations)},Rotation Type,{kind},'
        'Length Units,Millimeters,Coordinate Space,Global',
        '',
        ',Type,' + ','.join(['Rigid Body'] * 8 + ['Rigid Body Marker'] * 3),
        ',Name,' + ','.join(['Handle'] * 8 + ['Handle:Marker1'] * 3),
        ',ID,' + ','.join(['9C00F1'] * 8 + ['9C00F2'] * 3),
        ',,'
        + ','.join(['Rotation'] * 4 + ['Position'] * 3 + ['Mean Marker Error'] + ['Position'] * 3),
        'Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,,X,Y,Z',
    ]
    found = quaternions(rotations, 2)
    for number, q in enumerate(found):
        values = ','.join(f'{each:.6f}' for each in q)
        lines.append(f'{number},{0.01 * number:.6f},{values},1.5,2.5,3.5,0.000213,1.0,2.0,3.0')
    lines[20] = f'{13},{0.13:.6f}' + ',' * 11
    return '\n'.join(lines) + '\n'


def motive_2(rotations):
    """Return the same of Motive 2, which does not say in the second field what a row is."""
    return motive(rotations).replace(',Type,', ',,').replace(',Name,', ',,').replace(',ID,', ',,')


def helical_degrees(rotations):
    """Return rotation vectors, deg, (n, 3)."""
    q = kinematics.quaternion_from_matrix(rotations)
    size = np.linalg.norm(q[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(size, q[:, 3:])
    return np.degrees(angle * q[:, :3] / size)


def vicon(rotations):
    """Return what Vicon Nexus exports of two segments: helical angles."""
    lines = [
        'Segments',
        '100',
        ',,Handle:Handle,,,,,,Base:Base,,,,,',
        'Frame,Sub Frame,RX,RY,RZ,TX,TY,TZ,RX,RY,RZ,TX,TY,TZ',
        ',,deg,deg,deg,mm,mm,mm,deg,deg,deg,mm,mm,mm',
    ]
    for number, vector in enumerate(helical_degrees(rotations), 1):
        angles = ','.join(f'{each:.6f}' for each in vector)
        lines.append(f'{number},0,{angles},1.0,2.0,3.0,0,0,0,0,0,0')
    return '\n'.join([*lines, '', 'Trajectories', '100', ',,A', 'Frame,Sub Frame,X,Y,Z']) + '\n'


def qualisys(rotations):
    """Return what QTM exports of a 6DOF body, with time and column header; 0 where it is lost."""
    columns = ['X', 'Y', 'Z', 'Roll', 'Pitch', 'Yaw', 'Residual', *(f'Rot[{n}]' for n in range(9))]
    lines = [
        f'NO_OF_FRAMES\t{len(rotations)}',
        'NO_OF_CAMERAS\t8',
        'NO_OF_BODIES\t1',
        'FREQUENCY\t100',
        'NO_OF_ANALOG\t0',
        'TIME_STAMP\t2026-03-01, 10:11:12.345\t1234.5',
        'DATA_INCLUDED\t6D',
        'BODY_NAMES\tHandle',
        'Frame\tTime\t' + '\t'.join(['Handle ' + columns[0], *columns[1:]]),
    ]
    for number, matrix in enumerate(rotations):
        if number == 13:
            values = np.zeros(16)
        else:
            values = [0] * 7 + matrix.T.ravel().tolist()
        numbers = '\t'.join(f'{each:.6f}' for each in values)
        lines.append(f'{number + 1}\t{0.01 * number:.5f}\t{numbers}')
    return '\n'.join(lines) + '\n'


def qualisys_markers(rotations):
    points = np.einsum('nij,kj->nki', rotations, POINTS).reshape(len(rotations), -1)
    lines = [
        f'NO_OF_FRAMES\t{len(rotations)}',
        'NO_OF_MARKERS\t4',
        'FREQUENCY\t100',
        'DATA_INCLUDED\t3D',
        'MARKER_NAMES\tHandle_A\tHandle_B\tHandle_C\tHandle_D',
        'Frame\tTime\t' + '\t'.join(f'Handle_{m} {a}' for m in 'ABCD' for a in 'XYZ'),
    ]
    for number, row in enumerate(points):
        row[:3] *= number != 13
        lines.append(f'{number + 1}\t{0.01 * number:.5f}\t' + '\t'.join(f'{x:.3f}' for x in row))
    return '\n'.join(lines) + '\n'


@pytest.mark.parametrize(
    ('write', 'name', 'body', 'left_out'),
    [
        (motive, 'take.csv', None, 1),
        (motive_2, 'take.csv', None, 1),
        (vicon, 'trial.csv', 'Handle:Handle', 0),
        (qualisys, 'measurement.tsv', None, 1),
    ],
)
def test_a_rigid_body_of_each_system_is_read_by_its_header(
    tmp_path,
    write,
    name,
    body,
    left_out,
):
    rotations = FRAME @ motion(CAPTURED[:400]) @ BODY
    path = tmp_path / name
    path.write_text(write(rotations))
    track = recordings.read_capture(path, body)
    assert track.left_out == left_out
    assert len(track.time) == 400 - left_out
    kept = np.arange(400) != (13 if left_out else -1)
    np.testing.assert_allclose(
        track.time - track.time[0],
        (CAPTURED[:400] - CAPTURED[0])[kept],
        atol=1e-5,
    )
    off = kinematics.matrix_from_quaternion(track.values) @ rotations[kept].swapaxes(1, 2)
    angles = np.linalg.norm(alignment.rotation_vectors(off), axis=1)
    assert np.degrees(angles).max() < 0.2


def test_markers_of_qtm_are_read_by_their_names(tmp_path):
    path = tmp_path / 'm.tsv'
    rotations = FRAME @ motion(CAPTURED[:400])
    path.write_text(qualisys_markers(rotations))
    track = recordings.read_capture(path, None)
    assert track.left_out == 1
    assert track.values.shape == (399, 12)
    found = comparison.orientation_of_markers(track.values, AZIMUTHS)
    np.testing.assert_allclose(found, rotations[np.arange(400) != 13], atol=1e-3)


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        (motive(motion(CAPTURED[:20]), 'XYZ'), 'Rotation Type is XYZ; expected Quaternion'),
        *(
            (
                motive(motion(CAPTURED[:20])).replace(whole, broken),
                'a CSV file of Motive without its rows Type, Name and Frame',
            )
            for whole, broken in ((',Name,', ',,'), (',Type,', ',Kind,'), ('Frame,Time', 'F,T'))
        ),
        (vicon(motion(CAPTURED[:20])), 'rigid bodies Handle:Handle, Base:Base; name one by'),
        (
            qualisys_markers(motion(CAPTURED[:20])).replace('Handle_D', 'lamp'),
            'no rigid body, and no marker D among Handle_A, Handle_B, Handle_C, lamp',
        ),
        (
            qualisys(motion(CAPTURED[:20])).replace('Frame\tTime\t', 'Frame\tTrial\t'),
            'without the columns Frame and Time; export it again',
        ),
    ],
)
def test_what_an_export_lacks_is_named(
    tmp_path,
    text,
    words,
):
    path = tmp_path / 'export.csv'
    path.write_text(text)
    with pytest.raises(InputError, match=re.escape(words)):
        recordings.read_capture(path, None)


def test_validate_begins_with_a_verdict_and_counts_what_it_left_out(
    tmp_path,
    recorded,
    capsys,
    monkeypatch,
):
    monkeypatch.setattr('spm_haptic_master.validation.plot_style.draw_comparison', lambda *_: None)
    path = tmp_path / 'orientation.csv'
    np.savetxt(
        path,
        np.column_stack([recorded.time, recorded.values]),
        delimiter=',',
        comments='',
        header='time,qx,qy,qz,qw',
    )
    take = tmp_path / 'take.csv'
    take.write_text(motive(FRAME @ motion(CAPTURED) @ BODY))
    assert validate.main(['validate', str(path), str(take), '-o', str(tmp_path / 'out')]) == 0
    first, *lines = capsys.readouterr().out.splitlines()
    assert re.match(
        r'The recorded orientations are 0\.0\d\d deg rms off the motion capture, 0\.\d+ deg at '
        r'most, at \d+ moments; captured rows left out: 1$',
        first,
    )
    assert '  1 captured rows left out: without a value' in lines
