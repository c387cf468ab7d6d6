# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `supervise` on the recorded session, as a log and as a table."""

from pathlib import Path
import re

import numpy as np
import pytest
from recording import LOG, recorded_angles, truth
from spm_haptic_master.joints import JOINT_NAMES
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


def test_a_log_of_the_bus(capsys, tmp_path):
    code, out, err = run(capsys, LOG, *ENCODERS, '-o', tmp_path)
    assert code == 0, err
    published = re.search(r'20000 samples in 20.0 s; (\d+) orientations published', out)
    assert int(published[1]) >= 19_990
    noise = [float(each) for each in re.search(r'sigma_deg: \[(.*?)\]', out)[1].split(',')]
    assert noise == pytest.approx([0.0405] * 4, abs=0.0015)
    bias = [float(each) for each in re.search(r'bias_deg: \[(.*?)\]', out)[1].split(',')]
    assert bias == [0.05] * 4  # the default: the recording shows less, and proves less
    assert 'joint_3a: unchecked for 13' in out
    assert (tmp_path / 'supervise.png').stat().st_size > 20_000
    assert (tmp_path / 'regions.csv').read_text().count('\n') == 3


def test_a_table_of_joint_angles_and_parameters(capsys, tmp_path, table):
    code, out, err = run(capsys, table, '-o', tmp_path, '-p', 'unchecked_limit:=0.5')
    assert code == 0, err
    assert 'withheld: joint_3a unchecked for too long' in out
    assert 's: silent: joint_3a unchecked for too long' in out


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
    assert proposed_bias(0.121, [0.14, 0.05, 0.0, 0.12]) \
        == ([0.14, 0.13, 0.13, 0.13], [0.14, 0.05, 0.0, 0.12])
    assert proposed_bias(0.13, [0.05] * 4)[0] == [0.13] * 4


def test_a_directory_of_recorder(capsys, tmp_path, table):
    code, out, err = run(capsys, table.parent, '-o', tmp_path)
    assert code == 0, err
    assert '2000 samples in' in out


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
