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
def test_a_zero_that_slipped_and_a_reversed_direction_are_named(capsys, tmp_path):
    zero, direction = ([*calibration()[f'encoders.{name}']]
                       for name in ('zero_count', 'direction'))
    zero[3] += SLIP
    path = write(tmp_path / 'calibration.yaml', encoders__zero_count=zero)
    code, out, err = run(capsys, '--check', path, *REPLAY)
    assert code == 1 and 'does not hold; 20000 sets' in out
    found = re.fullmatch(rf'calibrate: {re.escape(str(path))} does not hold: joint_3a slipped by '
                         r'([-+.\d]+) deg \(\+- 0.0\d\)', err)
    assert float(found[1]) == pytest.approx(-direction[3] * 0.11, abs=0.03)
    direction[2] *= -1
    path = write(tmp_path / 'calibration.yaml', encoders__direction=direction)
    assert run(capsys, '--check', path, *REPLAY)[::2] == (
        1, f'calibrate: {path} does not hold: joint_1c turns with the other direction')


def test_what_is_no_calibration_or_no_motion_is_refused_in_one_line(capsys, tmp_path):
    path = write(tmp_path / 'calibration.yaml')
    text, short = tmp_path / 'text.yaml', tmp_path / 'short.log'
    text.write_text('a: b: c\n')
    with gzip.open(LOG, 'rt') as log:
        short.write_text(''.join(next(log) for _ in range(2000)))
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
             r'/nowhere.log'),
            (('--check', path, '-p', 'source:=replay', '-p', f'replay.path:={short}'),
             r'\d+ sets of four encoders in 0\.\d s; a motion needs at least 200 sets and 2 s')):
        code = main(['calibrate', '--motion', *map(str, args)])
        out, err = capsys.readouterr()
        assert (code, out) == (1, '') and len(err.splitlines()) == 1, err
        assert re.match(f'calibrate: .*{words}', err), err
    assert not (tmp_path / 'out.yaml').exists()
    assert main(['calibrate', '--check', str(path), *REPLAY]) == 1
    assert 'without --motion; expected both' in capsys.readouterr().err
