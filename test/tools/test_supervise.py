# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `supervise` on the recorded session, as a log and as a table."""

import gzip
from itertools import islice
import re

from harness import SIMULATED
import numpy as np
import pytest
from recording import LOG, recorded_angles, truth
from spm_haptic_master.kinematics import inverse, matrix_from_quaternion
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.tools.supervise import main, proposed_bias


@pytest.fixture(scope='module')
def table(tmp_path_factory):
    """Write 0.8 s of the session as a table of joint angles, beginning at 12.5 s."""
    path = tmp_path_factory.mktemp('session') / 'measured_js.csv'
    rows = np.column_stack([truth()[0] * 1e-9, recorded_angles()])[12_500:13_300]
    np.savetxt(path, rows, delimiter=',', comments='', header=','.join(['time', *JOINT_NAMES]),
               fmt='%.9f')
    return path


def run(capsys, *args):
    """Return exit code, stdout and stderr."""
    code = main(['supervise', *map(str, args)])
    return (code, *capsys.readouterr())


@pytest.fixture
def supervise(capsys, tmp_path):
    """Return what supervises a recording, which has to succeed, and returns what is printed."""
    def supervise(*args):
        code, out, err = run(capsys, *args, '-o', tmp_path)
        assert code == 0, err
        return out
    return supervise


def listed(name, out):
    """Return the numbers of a proposed parameter."""
    return [float(each) for each in re.search(rf'{name}: \[(.*?)\]', out)[1].split(',')]


@pytest.mark.slow
def test_a_log_of_the_bus(supervise, tmp_path):
    out = supervise(LOG, *SIMULATED)
    published = re.search(r'20000 samples in 20.0 s; (\d+) orientations published', out)
    assert int(published[1]) >= 19_990
    assert listed('sigma_deg', out) == pytest.approx([0.0405] * 4, abs=0.0015)
    # The default: the recording shows less, and proves less.
    assert listed('bias_deg', out) == [0.05] * 4
    assert 'joint_3a: never checked' in out
    assert (tmp_path / 'supervise.png').stat().st_size > 20_000
    assert (tmp_path / 'regions.csv').read_text().count('\n') == 3


def test_a_directory_of_recorder_with_parameters(supervise, tmp_path, table):
    path = tmp_path / 'rig.yaml'
    path.write_text('/**:\n  ros__parameters:\n    sigma_deg: [0.05, 0.04, 0.04, 0.04]\n'
                    '    encoders:\n      zero_count: [1, 2, 3, 4]\n    dexterity_rate: 20.0\n')
    out = supervise(table.parent, '--params-file', path, '-p', 'unchecked_limit:=0.5')
    assert '800 samples in' in out and '# now [0.05, 0.04, 0.04, 0.04]' in out
    # It rests: no motion confirms the solution, so that no sensor counts as checked.
    assert 'withheld: joint_1a unchecked for too long' in out
    assert 's: silent: joint_1a unchecked for too long' in out


def test_no_bias_below_the_calibrations_is_proposed(supervise, table):
    out = supervise(table, '-p', 'bias_deg:=[0.14, 0.02, 0.0, 0.3]')
    parity = float(re.search(r'largest mean parity ([\d.]+) deg', out)[1])
    seen = np.ceil(parity / 0.01) * 0.01
    assert listed('bias_deg', out) == pytest.approx([0.14, 0.02, seen, 0.3])
    assert 'not below the bias_deg in use: a recording shows one combination of the errors' in out
    assert proposed_bias(0.121, [0.14, 0.05, 0.0, 0.12]) == [0.14, 0.13, 0.13, 0.13]
    assert proposed_bias(0.13, [0.05] * 4) == [0.13] * 4


@pytest.mark.slow
def test_another_rigs_calibration_is_suspected(supervise, tmp_path):
    other, log = tmp_path / 'other.yaml', tmp_path / 'short.log'
    other.write_text('/**:\n  ros__parameters:\n    encoders:\n'
                     '      zero_count: [9123, 4011, 13000, 2345]\n'
                     '      direction: [1, 1, 1, -1]\n'
                     '      direction_verified: [true, true, true, true]\n')
    with gzip.open(LOG, 'rt') as file:
        log.write_text(''.join(islice(file, 5 * 1000)))
    assert re.search("[0-9]+ withheld: no orientation fits: the calibration may be another rig's, "
                     'or no longer hold: calibrate --motion --check calibration.yaml\n',
                     supervise(log, '--params-file', other))


@pytest.mark.parametrize(('recording', 'args', 'words'), [
    (None, ('-p', 'sigma:=1'), "'sigma'"), (None, ('-p', 'sigma_deg:=[1, 2]'), 'sigma_deg'),
    (None, ('-o', '/dev/null/x'), '/dev/null/x: cannot be written'),
    *((name, SIMULATED, name) for name in ('none.log', 'none.csv', 'none.mcap'))])
def test_what_is_wrong_is_named_in_one_line(capsys, tmp_path, table, recording, args, words):
    code, _, err = run(capsys, tmp_path / recording if recording else table, '-o', tmp_path, *args)
    assert code == 1
    assert words in err.splitlines()[-1]


@pytest.fixture(scope='module')
def six(tmp_path_factory):
    """Write 0.8 s of six sensors: th3B never read, th1A not in each tenth sample."""
    stamps, quaternions = truth()
    stamps, chosen = stamps[12_500:13_300], quaternions[12_500:13_300]
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


def test_joints_without_a_reading_are_counted_and_cost_the_others_nothing(
        supervise, tmp_path, six):
    out = supervise(six)
    assert '8 rows with fewer than 4 readings left out' in out
    assert '  joint_1a has no reading in 80 samples' in out
    assert '  joint_3b has no reading in 792 samples' in out
    assert '  80 samples without parity, which needs joint_1a, joint_1b, joint_1c, ' in out
    found = re.search(r'sigma_deg: \[(.*?)\].*as it is for joint_3b, which lack', out)
    noise = [float(each) for each in found[1].split(',')]
    assert noise == pytest.approx([0.04] * 6, abs=0.004)
    assert noise[4] == 0.04
    regions = np.genfromtxt(tmp_path / 'regions.csv', delimiter=',', names=True)
    assert regions['samples'].sum() == 712


@pytest.mark.slow
def test_without_a_sensor_of_the_parity_there_are_no_regions(supervise, tmp_path, six):
    rows = np.genfromtxt(six, delimiter=',', names=True)
    rows['joint_3a'] = np.nan
    rows['joint_3b'] = 0.1
    path = tmp_path / 'measured_js.csv'
    np.savetxt(path, np.array(rows.tolist()), delimiter=',', comments='',
               header=','.join(rows.dtype.names), fmt='%.9f')
    out = supervise(path)
    assert '792 samples without parity' in out and 'no bias_deg: no region has' in out
