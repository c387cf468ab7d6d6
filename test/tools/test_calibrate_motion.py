# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate --motion` from the log of a rig that is not perfect: what its file is worth."""

import re

from harness import DATA
import numpy as np
import pytest
from recorded_text import assert_recorded
from rig_as_built import errors_deg, rig, truth
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.kinematics import (
    matrix_from_quaternion,
    matrix_from_zxz,
    quaternion_from_matrix,
    zxz_from_matrix,
)
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

MOTION, CHECK = (('-p', 'source:=replay', '-p', f'replay.path:={DATA}/rig/{name}.log.gz')
                 for name in ('dev_motion', 'dev_check'))


def run(*args):
    """Return the exit code."""
    return main(['calibrate', '--motion', *map(str, args)])


@pytest.mark.slow
def test_another_log_of_the_rig_becomes_right_orientations(tmp_path):
    """At least 99.9 % of them, 0.06 deg rms, 0.3 at most, through the supervision of fkm."""
    path = tmp_path / 'calibration.yaml'
    assert run(*MOTION, '-o', path) == 0
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
    assert path.with_suffix('.md').read_text().startswith('# Good for an alert limit of ')
    assert run('--check', path, *CHECK) == 0


def test_the_motion_is_summed_up_and_its_file_has_what_it_determined(calibrated, motion, capsys):
    path, printed, verdict = calibrated
    assert_recorded('calibration/motion_printed.txt', printed.replace(str(path), 'c.yaml'))
    found = read_parameters(path)
    assert found['encoders.direction'] == rig()['direction']
    assert found['sigma_deg'] == pytest.approx([0.0405] * 4, rel=0.06)
    # The limit is the task's, in rig.yaml.
    assert 'alert_limit_deg' not in found and 'mounting.base_zxz_deg' not in found
    assert verdict.origin.recording == 'dev_motion.log' and len(verdict.origin.checksum) == 64
    assert verdict.alert_limit_deg > 1.0 and verdict.published > 0.99
    before = path.read_bytes()
    assert run(*motion, '-o', path) == 1
    assert f'-o: {path} already exists; expected --force' in capsys.readouterr().err
    assert path.read_bytes() == before


def test_a_captured_motion_gives_the_mounting_of_both_ends(
        calibrated, motion, tmp_path, monkeypatch, capsys):
    """The capture is the calibration's own motion, turned at both ends, on another clock."""
    calibration = calibrated[2].calibration
    base, handle = (matrix_from_zxz(*np.radians(each)) for each in ((20, 30, 40), (-50, 25, 10)))
    known = np.isfinite(calibration.rotation).all(axis=(1, 2))
    turned = base @ calibration.rotation[known] @ handle
    capture, output = tmp_path / 'capture.csv', tmp_path / 'c.yaml'
    np.savetxt(capture, np.column_stack([
        calibration.readings.seconds[known] + 7.3, quaternion_from_matrix(turned)]),
        delimiter=',', comments='', header='time,qx,qy,qz,qw', fmt='%.9f')
    monkeypatch.setattr('spm_haptic_master.tools.calibrate_motion.calibrate_motion',
                        lambda *_: calibration)
    monkeypatch.setattr('spm_haptic_master.tools.calibrate_motion.write_report', lambda *_: '')
    args = (*motion, '-p', 'alert_limit_deg:=30.0', '-o', output, '--capture', capture)
    assert run(*args) == 0, capsys.readouterr().err
    figures = r'standard deviations 0\.\d+ 0\.\d+ 0\.\d+ deg\n'
    assert re.search(rf'\n  mounting of the base: {figures}  mounting of the handle: {figures}'
                     r'  left of the orientations from outside: 0\.000 deg rms\n$',
                     capsys.readouterr().out)
    found = read_parameters(output)
    for name, rotation in (('base', base), ('handle', handle)):
        expected = np.degrees(zxz_from_matrix(rotation))
        assert found[f'mounting.{name}_zxz_deg'] == pytest.approx(expected, abs=0.05)
    capture.write_text('time,ax,ay,az,bx,by,bz,cx,cy,cz,dx,dy,dz\n' + ''.join(
        f'{time},0,0,0,0,0,1,1,0,0,0,1,0\n' for time in range(20)))
    assert run(*args, '--force') == 1
    assert 'markers; expected the pose of a body' in capsys.readouterr().err


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
    (('-o', 'c.yaml', '-p', 'source:=sim'), "'source' is 'sim'; expected can or replay")))
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
    assert kept_settings('replay', {}, values, mechanism | {'working_mode': (1, -1, 1)}) \
        == layout | {'working_mode': (1, -1, 1)}
