# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate --motion --check`: the log of a rig with ordinary tolerances against its file."""

import gzip
import re

import pytest
from rig_as_built import calibration, LOG, mechanism
from spm_haptic_master.tools.calibrate import main

REPLAY = ('-p', 'source:=replay', '-p', f'replay.path:={LOG}')
# Counts that are 0.11 deg.
SLIP = 5


def write(path, **changes):
    """Write the rig's calibration, without the second harmonics, that no model knows."""
    values = calibration() | mechanism() | {
        'sigma_deg': [0.0405] * 4, 'bias_deg': [0.07] * 4} | {
        name.replace('__', '.'): value for name, value in changes.items()}
    path.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n'.replace('True', 'true') for name, value in values.items()
        if value is not None))
    return path


def run(capsys, *args):
    """Return exit code, stdout and the last line of stderr."""
    code = main(['calibrate', '--motion', *map(str, args)])
    out, err = capsys.readouterr()
    return code, out, err.strip().splitlines()[-1]


@pytest.mark.process
def test_the_healthy_rig_holds(start, tmp_path):
    path = write(tmp_path / 'calibration.yaml')
    before = path.read_bytes()
    program = start('calibrate', '--motion', '--check', str(path), *REPLAY)
    assert program.wait(120.0) == 0, program.stderr
    assert f'{path}: holds; 20000 sets in 20.0 s' in program.stdout
    merit = float(re.search(r'figure of merit ([\d.]+)', program.stdout)[1])
    assert 0.0 < merit < 1.0
    for joint in ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a'):
        slip = re.search(rf'{joint}: if it alone slipped ([-+.\d]+) deg', program.stdout)
        assert abs(float(slip[1])) < 0.05
    assert path.read_bytes() == before and [*tmp_path.iterdir()] == [path]


@pytest.mark.slow
@pytest.mark.parametrize('sensor, joint', [(1, 'joint_1b'), (3, 'joint_3a')])
def test_a_zero_that_slipped_is_named(capsys, tmp_path, sensor, joint):
    zero = calibration()['encoders.zero_count']
    zero = [each + SLIP * (index == sensor) for index, each in enumerate(zero)]
    path = write(tmp_path / 'calibration.yaml', encoders__zero_count=zero)
    code, out, err = run(capsys, '--check', path, *REPLAY)
    assert code == 1
    sign = -calibration()['encoders.direction'][sensor]
    found = re.fullmatch(rf'calibrate: {re.escape(str(path))} does not hold: {joint} slipped by '
                         r'([-+.\d]+) deg \(\+- 0.0\d\)', err)
    assert found, err
    assert float(found[1]) == pytest.approx(sign * 0.11, abs=0.03)
    assert 'does not hold; 20000 sets' in out


@pytest.mark.slow
def test_a_direction_that_is_reversed_is_named(capsys, tmp_path):
    direction = calibration()['encoders.direction']
    path = write(tmp_path / 'calibration.yaml', encoders__direction=[
        direction[0], direction[1], -direction[2], direction[3]])
    code, _, err = run(capsys, '--check', path, *REPLAY)
    assert code == 1
    assert err == (f'calibrate: {path} does not hold: joint_1c turns with the other direction')


def test_what_is_no_calibration_is_refused_in_one_line(capsys, tmp_path):
    path = write(tmp_path / 'calibration.yaml')
    text = tmp_path / 'text.yaml'
    text.write_text('a: b: c\n')
    for args, words in (
            (('--check', tmp_path / 'none.yaml', *REPLAY), r'none.yaml: cannot be read: '),
            (('--check', tmp_path, *REPLAY), 'cannot be read: '),
            (('--check', text, *REPLAY), r'text.yaml:1: not valid YAML: '),
            (('--check', write(tmp_path / 'part.yaml', sigma_deg=None), *REPLAY),
             r'part.yaml: it has no sigma_deg; expected a file that calibrate wrote'),
            (('--check', path, '-o', tmp_path / 'out.yaml', *REPLAY),
             r'-o .*out.yaml with --check .*; expected one of them'),
            (('--check', path, '-p', 'source:=sim'), "'source' is 'sim'; expected can or replay"),
            (('--check', path, '-p', 'source:=replay', '-p', 'replay.path:=/nowhere.log'),
             r'/nowhere.log')):
        code = main(['calibrate', '--motion', *map(str, args)])
        out, err = capsys.readouterr()
        assert (code, out) == (1, '') and len(err.splitlines()) == 1, err
        assert re.match(f'calibrate: .*{words}', err), err
    assert not (tmp_path / 'out.yaml').exists()


def test_a_check_without_motion_is_refused(capsys, tmp_path):
    assert main(['calibrate', '--check', str(write(tmp_path / 'c.yaml')), *REPLAY]) == 1
    assert 'without --motion; expected both' in capsys.readouterr().err


def test_a_log_that_is_too_short_is_refused(capsys, tmp_path):
    with gzip.open(LOG, 'rt') as log:
        lines = [next(log) for _ in range(2000)]
    short = tmp_path / 'short.log'
    short.write_text(''.join(lines))
    code, out, err = run(capsys, '--check', write(tmp_path / 'c.yaml'), '-p', 'source:=replay',
                         '-p', f'replay.path:={short}')
    assert (code, out) == (1, '')
    assert re.search(r'\d+ sets of four encoders in 0\.\d s; a motion needs at least 200 sets and '
                     r'2 s: 2 s at these \d+ Hz', err), err
