# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate --motion` from the log of a rig that is not perfect: what its file is worth."""

import re

import numpy as np
import pytest
from rig_as_built import errors_deg, truth
from spm_haptic_master.calibration.calibration_file import read_calibration
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.kinematics import matrix_from_quaternion
from spm_haptic_master.parameters.encoders import LAYOUT_SETTINGS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.simulation.source_factory import make_replay
from spm_haptic_master.supervision import supervise
from spm_haptic_master.tools import command_line
from spm_haptic_master.tools.calibrate import main
from spm_haptic_master.tools.calibrate_motion import kept_settings

MOTION = ('-p', 'source:=replay', '-p', 'replay.path:=test/data/rig/dev_motion.log.gz')
CHECK = ('-p', 'source:=replay', '-p', 'replay.path:=test/data/rig/dev_check.log.gz')


def run(*args):
    """Return the exit code."""
    return main(['calibrate', '--motion', *map(str, args)])


@pytest.fixture(scope='module')
def path(tmp_path_factory):
    """Return the file of a calibration from the motion."""
    found = tmp_path_factory.mktemp('motion') / 'calibration.yaml'
    assert run(*MOTION, '-o', found) == 0
    return found


@pytest.mark.slow
def test_another_log_of_the_rig_becomes_right_orientations(path):
    """At least 99.9 % of them, 0.06 deg rms, 0.3 at most, through the supervision of fkm."""
    given = read_parameters(path)
    values = command_line.checked(
        given | {'replay.path': CHECK[-1].removeprefix('replay.path:=')},
        SOURCE_SETTINGS['replay'], 'replay')
    samples = list(make_replay(values).recorded())
    names = {setting.name for setting in FKM_SETTINGS}
    stamps = np.array([sample.stamp for sample in samples])
    found = supervise(stamps, np.array([sample.angles for sample in samples]), **{
        name.replace('.', '__'): value for name, value in given.items() if name in names})
    assert found.published.mean() >= 0.999
    assert [text for _, text in found.state] == ['starting', 'healthy']
    times, true = truth()
    rows = np.searchsorted(stamps, np.round((times - times[0]) * 1e9) + stamps[0] - 300_000)
    known = found.published[rows]
    errors = errors_deg(matrix_from_quaternion(found.quaternion[rows[known]]), true[known])
    rms = np.sqrt((errors ** 2).mean())
    print(f'{known.sum()} orientations, rms {rms:.4f} deg, largest {errors.max():.3f} deg')
    assert rms <= 0.06 and errors.max() <= 0.3
    assert (errors < found.protection_level[rows[known]]).all()


@pytest.mark.slow
def test_the_file_is_reported_checked_and_not_overwritten(path, capsys):
    assert run('--check', path, *CHECK) == 0
    assert f'{path}: holds' in capsys.readouterr().out
    text = path.with_suffix('.md').read_text()
    assert 'dev_motion.log.gz' in text and text.startswith('# Good for an alert limit of ')
    assert read_calibration(path).direction == (1, 1, 1, -1)
    before = path.read_bytes()
    assert run(*MOTION, '-o', path) == 1
    assert f'-o: {path} already exists; expected --force' in capsys.readouterr().err
    assert path.read_bytes() == before


@pytest.mark.slow
def test_a_motion_is_refused_or_said_to_need_a_limit_above_that_of_fkm(tmp_path, capsys):
    """The file does not set it: it is the task's, in rig.yaml."""
    short = (*MOTION, '--seconds', '12', '-o', tmp_path / 'c.yaml')
    assert run(*short) == 1
    out, err = capsys.readouterr()
    assert not out and 'does not support alert_limit_deg 1: ' in err.splitlines()[-1]
    assert not list(tmp_path.iterdir())
    assert run(*short, '-p', 'alert_limit_deg:=30.0') == 0
    *_, needed, _, verdict = capsys.readouterr().out.splitlines()
    limit = float(re.search(r'alert limit of ([\d.]+) deg', verdict)[1])
    assert limit > 1.0 and needed.startswith(f'fkm needs alert_limit_deg {limit:g} or more')
    assert 'alert_limit_deg' not in read_parameters(tmp_path / 'c.yaml')


@pytest.mark.parametrize('args, text', (
    ((), 'no -o FILE; expected the parameter file to write'),
    (('-o', '/proc/c.yaml'), '-o: /proc/c.yaml cannot be written'),
    (('-o', '/no/such/directory/c.yaml'), 'expected a file in an existing directory'),
    (('-o', 'c.yaml', '--pose', '1', '2', '3', '--capture', 'a.csv'),
     '--pose and --capture; expected one of the two'),
    (('-o', 'c.yaml', *MOTION, '--pose', '1', '2', '3'),
     '--pose is given 1 times and --pose-recording 0 times; expected as many'),
    (('-o', 'c.yaml', '--pose-recording', 'a.log'),
     "--pose-recording with source 'can'; expected it with replay"),
))
def test_arguments_that_lead_to_nothing_are_refused_in_one_line(
        tmp_path, monkeypatch, capsys, args, text):
    monkeypatch.chdir(tmp_path)
    assert run(*args) == 1
    err = capsys.readouterr().err
    assert text in err and err.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_the_file_has_the_bus_as_given_and_the_layout():
    """A driver that takes nothing but the file is on the same bus at the same rate."""
    given = {'source': 'can', 'can.channel': 'can1', 'can.sync': 'produce', 'rate': 250.0,
             'encoders.id': [0x281, 0x282, 0x283, 0x284], 'encoders.direction': [1, 1, 1, -1],
             'geometry.alpha_deg': 40.0}
    values = command_line.checked(raw_counts(4) | given | {
        'encoders.direction_verified': [True] * 4}, SOURCE_SETTINGS['can'], 'can')
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    kept = kept_settings('can', given, values, mechanism)
    # The whole layout: who edits it in another file is told.
    layout = {setting.name: values[setting.name] for setting in LAYOUT_SETTINGS} \
        | {'encoders.id': (0x281, 0x282, 0x283, 0x284)}
    for measured in ('direction', 'zero_count', 'counts_per_turn'):
        del layout[f'encoders.{measured}']
    assert kept == layout | {
        'source': 'can', 'can.channel': 'can1', 'can.sync': 'produce', 'rate': 250.0}
