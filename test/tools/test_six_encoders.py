# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The programs with six encoders: calibrate and supervise."""

from math import degrees, radians

import can
from encoder_frames import cycle, decoder, values
import numpy as np
import pytest
from spm_haptic_master.calibration.calibration_file import read_calibration
from spm_haptic_master.encoders.decoder_factory import unverified_joints
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.files import config_directory, simulated_rig
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.tools import calibrate, supervise

POSES = ((135.0, 54.7356, 0.0), (125.0, 50.0, 25.0))
SIX = ('--params-file', str(config_directory() / 'simulated_rig_six.yaml'))


def record(path, rows, without=()):
    """Write a log of angles, rad, one row of six a cycle; some encoders do not answer."""
    layouts = decoder(sensors=6).layouts
    with can.CanutilsLogWriter(path) as log:
        for number, row in enumerate(rows):
            for index, message in enumerate(cycle(number, map(float, row), layouts), start=-1):
                if index not in without:
                    log.on_message_received(message)
    return path


def at_rest(pose):
    """Return 400 noisy readings of six sensors at rest in a pose, rad."""
    joints = inverse(matrix_from_zxz(*map(radians, pose)))
    noise = np.random.default_rng(13).normal(0.0, radians(0.04), (400, 6))
    return noise + [*joints.theta1, joints.theta3a, joints.theta3b, joints.theta3c]


def test_a_jigs_poses_calibrate_six(tmp_path, capsys):
    output = tmp_path / 'calibration.yaml'
    for pose, more in zip(POSES, (('-p', 'sensors:=6'), ('--force',)), strict=True):
        log = record(tmp_path / f'{pose[2]:g}.log', at_rest(pose))
        code = calibrate.main([
            'calibrate', '-p', 'source:=replay', '-p', f'replay.path:={log}', '--seconds', '0.3',
            '-o', str(output), '--jig-error', '0.1', '--pose', *map(str, pose), *more])
        assert code == 0, capsys.readouterr().err
    found, rig = read_calibration(output), simulated_rig(6)
    np.testing.assert_allclose(found.zero_count, rig['encoders.zero_count'], atol=1)
    assert list(found.direction) == rig['encoders.direction']
    assert len(found.bias) == 6 and max(map(degrees, found.bias)) < 1.0
    # The file is all that the driver needs.
    parameters = read_parameters(output)
    assert parameters['sensors'] == 6 and len(parameters['sigma_deg']) == 6
    assert unverified_joints(values(**{
        name.replace('.', '__'): tuple(value) if isinstance(value, list) else value
        for name, value in parameters.items() if name.startswith('encoders')}, sensors=6)) == ()


@pytest.mark.parametrize('arguments', [
    ('--pose', *map(str, POSES[0]), '--jig-error', '0.1', '--seconds', '0.3'), ('--motion',)])
def test_a_calibration_of_six_with_one_missing_names_it(tmp_path, capsys, arguments):
    log = record(tmp_path / 'five.log', at_rest(POSES[0]), without={4})
    code = calibrate.main([
        'calibrate', '-p', 'source:=replay', '-p', f'replay.path:={log}', '-p', 'sensors:=6',
        '-o', str(tmp_path / 'calibration.yaml'), *arguments])
    err = capsys.readouterr().err
    assert code == 1
    assert 'joint_3b has no reading in ' in err and 'check the encoder, or give `sensors`' in err
    assert not (tmp_path / 'calibration.yaml').exists()


@pytest.fixture(scope='module')
def motion():
    """0.4 s of the paper's motion, readings in rad, (400, 6)."""
    simulated = make_motion(values('sim', sensors=6))
    return np.array([simulated.angles(1e-3 * number) for number in range(400)])


def run(tmp_path, capsys, *args):
    code = supervise.main(['supervise', '-o', str(tmp_path), *map(str, args)])
    return (code, *capsys.readouterr())


@pytest.mark.parametrize(('without', 'published'), [((), 396), ({5}, None)])
def test_a_log_of_six_encoders_is_supervised(motion, tmp_path, capsys, without, published):
    log = record(tmp_path / 'six.log', motion, without)
    code, out, err = run(tmp_path, capsys, log, *SIX)
    assert code == 0, err
    assert '400 samples in 0.4 s' in out
    if published:
        assert f'{published} orientations published' in out
        assert 'joint_3c: unchecked for ' in out
        assert len(out.partition('sigma_deg: [')[2].partition(']')[0].split(',')) == 6


def test_a_table_of_five_sensors_is_supervised(motion, tmp_path, capsys):
    path = tmp_path / 'five.csv'
    time = 1_760_000_000.0 + 1e-3 * np.arange(len(motion))
    np.savetxt(path, np.column_stack([time, motion[:, :5]]), delimiter=',', comments='',
               header=','.join(['time', *ALL_JOINT_NAMES[:5]]), fmt='%.9f')
    code, out, err = run(tmp_path, capsys, path)
    assert code == 0, err
    assert '396 orientations published' in out and 'joint_3b: unchecked for ' in out
    code, _, err = run(tmp_path, capsys, path, '-p', 'sensors:=6')
    assert code == 1 and "'sensors' is 6; expected 5, as" in err
