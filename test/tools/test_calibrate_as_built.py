# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate` in a jig: of a mechanism as built, with encoders that have harmonics."""

import io
from math import radians

import can
from encoder_frames import sync, T0, values
import numpy as np
import pytest
from recording import LOG
from rig_as_built import calibration, mechanism
from spm_haptic_master.calibration.calibration_file import read_calibration
from spm_haptic_master.encoders.decoder_factory import make_harmonics, make_layouts
from spm_haptic_master.kinematics import measured_angles, zxz_rotation
from spm_haptic_master.parameters.geometry import (
    geometry_from,
    GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.tools.calibrate import main

POSES = ((135.0, 54.7356, 0.0), (125.0, 50.0, 25.0))
HARMONICS = {name: value for name, value in calibration().items() if 'harmonic' in name}
ENCODERS = {'encoders.zero_count': [100, 5000, 9000, 16000],
            'encoders.direction': [1, -1, 1, -1]}


def record(path, pose):
    """Write a log of the rig at rest in a pose, with noise of a count."""
    geometry = geometry_from(complete((*GEOMETRY_SETTINGS, WORKING_MODE_SETTING), mechanism()))
    angles = measured_angles(zxz_rotation(*map(radians, pose)), geometry, (1, 1, 1), 4)
    as_built, ideal = (
        values(**{name.replace('.', '__'): tuple(value) for name, value in parameters.items()})
        for parameters in (HARMONICS | ENCODERS, ENCODERS))
    readings = [each.readings(angle) for each, angle in zip(
        make_harmonics(as_built), angles, strict=True)]
    layouts = make_layouts(ideal)
    noise = np.random.default_rng(13).normal(0.0, radians(0.04), (200, 4))
    with can.CanutilsLogWriter(path) as log:
        for number, row in enumerate(noise + readings):
            at = T0 + 1e-3 * number
            log.on_message_received(sync(at))
            for index, (layout, angle) in enumerate(zip(layouts, row, strict=True)):
                log.on_message_received(can.Message(
                    arbitration_id=layout.can_id, is_extended_id=False,
                    data=layout.data(float(angle)), timestamp=at + 1.5e-4 * (index + 1)))
    return path


def run(capsys, *args):
    """Return exit code, stdout and the last line of stderr, but for progress."""
    code = main(['calibrate', *map(str, args)])
    out, err = capsys.readouterr()
    return code, out, ['', *(line for line in err.splitlines() if ' sets' not in line)][-1]


def at(log, output, pose, *args):
    """Return the arguments of a calibration from a log."""
    return ('-p', 'source:=replay', '-p', f'replay.path:={log}', '--seconds', 0.15, '-o', output,
            '--pose', *pose, *args)


def test_the_file_is_all_that_the_nodes_need(capsys, tmp_path):
    rig_file, output = tmp_path / 'rig.yaml', tmp_path / 'calibration.yaml'
    rig_file.write_text('/**:\n  ros__parameters:\n' + ''.join(
        f'    {name}: {value}\n' for name, value in (mechanism() | HARMONICS).items()))
    first, second = (record(tmp_path / f'{number}.log', pose)
                     for number, pose in enumerate(POSES))
    code, out, err = run(capsys, *at(first, output, POSES[0], '--params-file', rig_file))
    assert (code, err) == (0, '') and f'{output}: written' in out
    assert out.count('direction +1 (NOT verified)') == 4
    assert 'The driver refuses directions that are not verified' in out
    written = output.read_text()
    code, out, err = run(capsys, *at(second, output, POSES[1]))
    assert code == 1 and 'already exists; expected --force' in err
    assert output.read_text() == written
    # The second run takes the mechanism from the file that it completes.
    code, out, err = run(capsys, *at(second, output, POSES[1], '--force'))
    assert (code, err) == (0, '') and 'overwritten (it held the calibration of' in out
    found = read_calibration(output)
    assert found.direction == tuple(ENCODERS['encoders.direction'])
    assert all(found.direction_verified)
    # Noise of a count, averaged over 150.
    np.testing.assert_allclose(found.zero_count, ENCODERS['encoders.zero_count'], atol=1)
    parameters = read_parameters(output)
    for name, value in (mechanism() | HARMONICS).items():
        assert parameters[name] == pytest.approx(value, abs=1e-12), name
    assert not any('table' in name or name.endswith(('alpha_deg', 'working_mode'))
                   for name in parameters)
    # The file of a nominal rig has none.
    assert run(capsys, *at(first, tmp_path / 'nominal.yaml', POSES[0]))[0] == 0
    assert not any(name.startswith(('geometry', 'encoders.harmonic', 'encoders.table'))
                   for name in read_parameters(tmp_path / 'nominal.yaml'))


@pytest.mark.parametrize(('args', 'words'), [
    (('--pose', 135, 54, 0, '--pose', 130, 50, 10),
     'standard input has ended; expected Enter for each of 2 poses'),
    (('-p', 'source:=replay', '-p', f'replay.path:={LOG}', '--pose', 135, 54, 0, '--pose', 130, 50,
      10), '--pose is given 2 times; expected once for a recording'),
    (('-p', 'source:=replay', '-p', f'replay.path:={LOG}', '-p', 'replay.rate:=10.0',
      '--seconds', 0.5), 'the device moved: joint_1a by')])
def test_without_a_device_at_rest_nothing_is_written(capsys, monkeypatch, tmp_path, args, words):
    monkeypatch.setattr('sys.stdin', io.StringIO())
    code, _, err = run(capsys, '-o', tmp_path / 'rig.yaml', *args)
    assert code == 1 and words in err
    assert not (tmp_path / 'rig.yaml').exists()
