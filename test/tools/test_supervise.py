# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `supervise` on the recorded session, as a log and as a table."""

from pathlib import Path
import re

import numpy as np
import pytest
from recording import LOG, recorded_angles, truth
from spm_haptic_master.kinematics import inverse, matrix_from_quaternion
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.tools.supervise import main, proposed_bias

ROOT = Path(__file__).resolve().parents[2]
ENCODERS = ('--params-file', ROOT / 'config' / 'simulated_rig.yaml')


@pytest.fixture(scope='module')
def table(tmp_path_factory):
    """Write two seconds of the session as a table of joint angles, beginning at 12 s."""
    path = tmp_path_factory.mktemp('session') / 'measured_js.csv'
    rows = np.column_stack([truth()[0] * 1e-9, recorded_angles()])[12_500:14_500]
    np.savetxt(path, rows, delimiter=',', comments='', header=','.join(['time', *JOINT_NAMES]),
               fmt='%.9f')
    return path


def run(capsys, *args):
    """Return exit code, stdout and stderr."""
    code = main(['supervise', *map(str, args)])
    return (code, *capsys.readouterr())


@pytest.mark.slow
def test_a_log_of_the_bus(capsys, tmp_path):
    code, out, err = run(capsys, LOG, *ENCODERS, '-o', tmp_path)
    assert code == 0, err
    published = re.search(r'20000 samples in 20.0 s; (\d+) orientations published', out)
    assert int(published[1]) >= 19_990
    noise = [float(each) for each in re.search(r'sigma_deg: \[(.*?)\]', out)[1].split(',')]
    assert noise == pytest.approx([0.0405] * 4, abs=0.0015)
    bias = [float(each) for each in re.search(r'bias_deg: \[(.*?)\]', out)[1].split(',')]
    assert bias == [0.05] * 4  # the default: the recording shows less, and proves less
    assert 'joint_3a: never checked' in out
    assert (tmp_path / 'supervise.png').stat().st_size > 20_000
    assert (tmp_path / 'regions.csv').read_text().count('\n') == 3


def test_a_table_of_joint_angles_and_parameters(capsys, tmp_path, table):
    code, out, err = run(capsys, table, '-o', tmp_path, '-p', 'unchecked_limit:=0.5')
    assert code == 0, err
    # It rests: no motion confirms the solution, so that no sensor counts as checked.
    assert 'withheld: joint_1a unchecked for too long' in out
    assert 's: silent: joint_1a unchecked for too long' in out


def test_a_parameter_file_of_all_nodes(capsys, tmp_path, table):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**:\n  ros__parameters:\n    sigma_deg: [0.05, 0.04, 0.04, 0.04]\n'
                    '    encoders:\n      zero_count: [1, 2, 3, 4]\n    dexterity_rate: 20.0\n')
    code, out, err = run(capsys, table, '-o', tmp_path, '--params-file', path)
    assert code == 0, err
    assert '# now [0.05, 0.04, 0.04, 0.04]' in out


def test_no_bias_below_the_calibrations_is_proposed(capsys, tmp_path, table):
    code, out, err = run(capsys, table, '-o', tmp_path, '-p', 'bias_deg:=[0.14, 0.02, 0.0, 0.3]')
    assert code == 0, err
    parity = float(re.search(r'largest mean parity ([\d.]+) deg', out)[1])
    seen = np.ceil(parity / 0.01) * 0.01
    proposed = [float(each) for each in re.search(r'bias_deg: \[(.*?)\]', out)[1].split(',')]
    assert proposed == pytest.approx([0.14, 0.02, seen, 0.3])
    assert 'not below the bias_deg in use: a recording shows one combination of the errors' in out


def test_a_parity_above_the_bias_in_use_raises_it():
    assert proposed_bias(0.121, [0.14, 0.05, 0.0, 0.12]) == [0.14, 0.13, 0.13, 0.13]
    assert proposed_bias(0.13, [0.05] * 4) == [0.13] * 4


def test_a_directory_of_recorder(capsys, tmp_path, table):
    code, out, err = run(capsys, table.parent, '-o', tmp_path)
    assert code == 0, err
    assert '2000 samples in' in out


@pytest.mark.slow
def test_another_rigs_calibration_is_suspected(capsys, tmp_path):
    other = tmp_path / 'other.yaml'
    other.write_text('/**:\n  ros__parameters:\n    encoders:\n'
                     '      zero_count: [9123, 4011, 13000, 2345]\n'
                     '      direction: [1, 1, 1, -1]\n'
                     '      direction_verified: [true, true, true, true]\n')
    code, out, err = run(capsys, LOG, '--params-file', other, '-o', tmp_path)
    assert code == 0, err
    assert ("20000 withheld: no orientation fits: the calibration may be another rig's, or no "
            'longer hold: calibrate --motion --check calibration.yaml\n') in out


@pytest.mark.parametrize(('args', 'words'), [
    (('-p', 'sigma:=1'), "'sigma'"),
    (('-p', 'sigma_deg:=[1, 2]'), 'sigma_deg'),
    (('-o', '/dev/null/x'), '/dev/null/x: cannot be written'),
])
def test_what_is_wrong_is_named_in_one_line(capsys, tmp_path, table, args, words):
    code, _, err = run(capsys, table, '-o', tmp_path, *args)
    assert code == 1
    assert words in err.splitlines()[-1]


def test_a_recording_that_does_not_exist(capsys, tmp_path):
    for name in ('none.log', 'none.csv', 'none.mcap'):
        code, _, err = run(capsys, tmp_path / name, *ENCODERS, '-o', tmp_path)
        assert code == 1
        assert name in err.splitlines()[-1]


@pytest.fixture(scope='module')
def six(tmp_path_factory):
    """Write two seconds of six sensors: th3B never read, th1A not in each tenth sample."""
    stamps, quaternions = truth()
    stamps, chosen = stamps[12_500:14_500], quaternions[12_500:14_500]
    found = inverse(matrix_from_quaternion(chosen))
    angles = np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])
    angles += np.radians(np.random.default_rng(8).normal(0.0, 0.04, angles.shape))
    angles[:, 4] = np.nan
    angles[::10, 0] = np.nan
    angles[5::100, 2:] = np.nan
    path = tmp_path_factory.mktemp('six') / 'measured_js.csv'
    np.savetxt(path, np.column_stack([stamps * 1e-9, angles]), delimiter=',', comments='',
               header=','.join(['time', *ALL_JOINT_NAMES]), fmt='%.9f')
    return path


def test_joints_without_a_reading_are_counted_and_cost_the_others_nothing(capsys, tmp_path, six):
    code, out, err = run(capsys, six, '-o', tmp_path)
    assert code == 0, err
    assert '20 rows with fewer than 4 readings left out' in out
    assert '  joint_1a has no reading in 200 samples' in out
    assert '  joint_3b has no reading in 1980 samples' in out
    assert '  200 samples without parity, which needs joint_1a, joint_1b, joint_1c, ' in out
    found = re.search(r'sigma_deg: \[(.*?)\].*as it is for joint_3b, which lack', out)
    noise = [float(each) for each in found[1].split(',')]
    assert noise == pytest.approx([0.04] * 6, abs=0.004)
    assert noise[4] == 0.04
    regions = np.genfromtxt(tmp_path / 'regions.csv', delimiter=',', names=True)
    assert regions['samples'].sum() == 1780


@pytest.mark.slow
def test_without_a_sensor_of_the_parity_there_are_no_regions(capsys, tmp_path, six):
    rows = np.genfromtxt(six, delimiter=',', names=True)
    rows['joint_3a'] = np.nan
    rows['joint_3b'] = 0.1
    path = tmp_path / 'measured_js.csv'
    np.savetxt(path, np.array(rows.tolist()), delimiter=',', comments='',
               header=','.join(rows.dtype.names), fmt='%.9f')
    code, out, err = run(capsys, path, '-o', tmp_path)
    assert code == 0, err
    assert '1980 samples without parity' in out and 'no bias_deg: no region has' in out
