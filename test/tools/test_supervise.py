# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The program `supervise` on the recorded session, as a log and as a table."""

import gzip
from itertools import islice
import re

from encoder_frames import T0
from harness import SIMULATED
from matplotlib.patches import Polygon, Rectangle
import numpy as np
from picture_text import in_words
import pytest
from recorded_text import assert_recorded
from recording import LOG, recorded_angles, truth
from spm_haptic_master.kinematics import inverse, matrix_from_quaternion
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.tools.supervise import longest_unchecked, main, proposed_bias
from spm_haptic_master.validation import plot_style

# Rows of the session that rest: the first of them, and the one after the last.
PART = slice(12_500, 13_300)


def write(path, angles):
    """Write a table of joint angles at the times of the part."""
    np.savetxt(
        path,
        np.column_stack([truth()[0][PART] * 1e-9, angles]),
        delimiter=',',
        comments='',
        fmt='%.9f',
        header=','.join(['time', *ALL_JOINT_NAMES[: angles.shape[1]]]),
    )
    return path


@pytest.fixture(scope='module')
def table(tmp_path_factory):
    """Write 0.8 s of the session as a table of joint angles."""
    return write(tmp_path_factory.mktemp('session') / 'measured_js.csv', recorded_angles()[PART])


@pytest.fixture(scope='module')
def six(tmp_path_factory):
    """Write 0.8 s of six sensors: th3B never read, th1A not in each tenth sample."""
    found = inverse(matrix_from_quaternion(truth()[1][PART]))
    angles = np.column_stack([found.theta1, found.theta3a, found.theta3b, found.theta3c])
    angles += np.radians(np.random.default_rng(8).normal(0.0, 0.04, angles.shape))
    angles[:, 4] = np.nan
    angles[::10, 0] = np.nan
    angles[5::100, 2:] = np.nan
    return write(tmp_path_factory.mktemp('six') / 'measured_js.csv', angles)


@pytest.fixture(autouse=True)
def figures(monkeypatch):
    """Collect the pictures that would be written: a PNG takes seconds."""
    drawn = []
    monkeypatch.setattr(plot_style, 'save', lambda figure, path: drawn.append(figure))
    return drawn


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
        return out.replace(str(tmp_path), 'directory')

    return supervise


def listed(name, out):
    """Return the numbers of a proposed parameter."""
    return [float(each) for each in re.search(rf'{name}: \[(.*?)\]', out)[1].split(',')]


def test_a_short_log_and_another_rigs_calibration(supervise, tmp_path):
    other = tmp_path / 'other.yaml'
    log = tmp_path / 'short.log'
    other.write_text(
        '/**:\n  ros__parameters:\n    encoders:\n'
        '      zero_count: [9123, 4011, 13000, 2345]\n'
        '      direction: [1, 1, 1, -1]\n'
        '      direction_verified: [true, true, true, true]\n'
    )
    with gzip.open(LOG, 'rt') as file:
        log.write_text(''.join(islice(file, 5 * 400)))
    assert_recorded('supervision/log.txt', supervise(log, *SIMULATED))
    assert re.search(
        "[0-9]+ withheld: no orientation fits: the calibration may be another rig's, "
        'or no longer hold: calibrate --motion --check calibration.yaml\n',
        supervise(log, '--params-file', other),
    )


def test_a_directory_of_recorder_with_parameters(
    supervise,
    tmp_path,
    table,
    figures,
):
    """It rests: a sensor counts as checked where no other orientation explains it by a fault."""
    path = tmp_path / 'rig.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    sigma_deg: [0.05, 0.04, 0.04, 0.04]\n'
        '    encoders:\n      zero_count: [1, 2, 3, 4]\n    dexterity_rate: 20.0\n'
    )
    assert_recorded(
        'supervision/table.txt',
        supervise(
            table.parent,
            '--params-file',
            path,
            '-p',
            'unchecked_limit:=0.5',
            '-p',
            'bias_deg:=[0.14, 0.02, 0.0, 0.3]',
        ),
    )
    # The start and the end of the session are shaded, in which nothing is published.
    parity, level, exposure, *_ = figures[0].axes
    for axes in (parity, level, exposure):
        shaded = [
            each.get_extents().transformed(axes.transData.inverted())
            for each in axes.patches
            if isinstance(each, (Polygon, Rectangle))
        ]
        assert [(each.x0, each.x1) for each in shaded] == [
            pytest.approx((0.0, 0.004), abs=1e-4),
            pytest.approx((0.501, 0.799), abs=5e-4),
        ]
        assert axes.get_xlim() == pytest.approx((0.0, 0.799), abs=5e-4)
    assert_recorded('supervision/picture.txt', in_words(figures[0]))
    assert all(len(line.get_xdata()) == 800 for line in (*parity.lines, *exposure.lines))
    assert level.lines[1].get_ydata()[0] == 1.0
    assert level.get_ylim()[0] == 0.0
    # joint_3a has a rival at rest.
    np.testing.assert_allclose(
        exposure.lines[3].get_ydata(),
        np.arange(800) * 1e-3,
        atol=1e-4,
    )


def test_L3_cycles_without_a_set_count_and_are_named(supervise, tmp_path):
    """A fifth of the answers of joint_3a are lost: no more than 80 % can be published."""
    log = tmp_path / 'lossy.log'
    with gzip.open(LOG, 'rt') as file:
        lines = [*islice(file, 5 * 500)]
    kept = [line for number, line in enumerate(lines) if ' 184#' not in line or number // 5 % 5]
    log.write_text(''.join(kept))
    out = supervise(log, *SIMULATED)
    share, cycles = re.match(r'([\d.]+) % of (\d+) cycles of the bus published', out).groups()
    assert 78.0 < float(share) <= 80.5
    assert 490 <= int(cycles) <= 500
    dropped = int(re.search(r'\n +(\d+) dropped: no answer from joint_3a\n', out)[1])
    assert 95 <= dropped <= 101


def test_a_pause_does_not_count_as_time_without_a_check():
    """40.7: the first sample after a pause of 300 s begins anew."""
    seconds = np.concatenate([np.arange(0.0, 10.0, 0.1), np.arange(310.0, 320.0, 0.1)])
    unchecked = np.zeros((200, 4))
    unchecked[:20, 0] = np.inf
    unchecked[100:130, 1] = np.inf
    unchecked[:, 2] = np.inf
    unchecked[50, 3] = 7.0
    longest = longest_unchecked(seconds, unchecked)
    assert longest['joint_1a'] == pytest.approx(1.9)
    assert longest['joint_1b'] == pytest.approx(2.9)
    assert longest['joint_1c'] is None
    assert longest['joint_3a'] == 7.0


def test_no_bias_below_the_calibrations_is_proposed():
    assert proposed_bias(0.121, [0.14, 0.05, 0.0, 0.12]) == [0.14, 0.13, 0.13, 0.13]
    assert proposed_bias(0.13, [0.05] * 4) == [0.13] * 4


def test_joints_without_a_reading_are_counted_and_cost_the_others_nothing(
    supervise,
    tmp_path,
    six,
):
    out = supervise(six)
    assert_recorded('supervision/six.txt', out)
    assert listed('sigma_deg', out) == pytest.approx([0.04] * 6, abs=0.004)
    regions = np.genfromtxt(tmp_path / 'regions.csv', delimiter=',', names=True)
    assert regions['samples'].sum() == 712


def test_without_a_sensor_of_the_parity_there_are_no_regions(
    supervise,
    tmp_path,
    six,
):
    rows = np.genfromtxt(six, delimiter=',', skip_header=1)[:300, 1:]
    rows[:, 3], rows[:, 4] = np.nan, 0.1
    path = tmp_path / 'measured_js.csv'
    np.savetxt(
        path,
        np.column_stack([T0 + 1e-3 * np.arange(300), rows]),
        delimiter=',',
        comments='',
        header=','.join(['time', *ALL_JOINT_NAMES]),
        fmt='%.9f',
    )
    out = supervise(path)
    assert '297 samples without parity' in out
    assert 'no bias_deg: no region has' in out


def slide_at(time, counts=1000):
    """Return the line of a frame of the slide."""
    return f'({time:.6f}) can0 185#{counts.to_bytes(4, "little").hex().upper()}\n'


def test_a_log_with_a_slide_has_its_share_and_gaps(supervise, tmp_path):
    """500 cycles, of which the slide misses 100 in a row."""
    log = tmp_path / 'slide.log'
    with gzip.open(LOG, 'rt') as file:
        lines = [*islice(file, 5 * 500)]
    with_slide = []
    cycles = 0
    for line in lines:
        with_slide.append(line)
        if ' 184#' in line:
            cycles += 1
            if not 200 < cycles <= 300:
                with_slide.append(slide_at(float(line[1 : line.index(')')]) + 5e-5))
    log.write_text(''.join(with_slide))
    out = supervise(log, *SIMULATED, '-p', 'insertion.id:=0x185')
    found = re.search(
        r'\n  insertion: ([\d.]+) % of (\d+) readings, 1 gap of more than 3 periods, the longest '
        r'([\d.]+) s at ([\d.]+) s\n',
        out,
    )
    share, readings, longest, at = map(float, found.groups())
    cycles = int(re.match(r'[\d.]+ % of (\d+) cycles', out)[1])
    assert 79.0 < share < 81.0
    assert readings == pytest.approx(cycles, abs=2)
    assert longest == pytest.approx(0.101, abs=0.002)
    assert at == pytest.approx(0.2, abs=0.003)
    assert 'gripper' not in out
    # The same sets, and the same verdict, as without the slide.
    without = supervise(log, *SIMULATED)
    assert out.partition('\n')[0] == without.partition('\n')[0]
    assert 'insertion' not in without


def test_a_directory_of_recorder_with_a_gripper(
    supervise,
    tmp_path,
    table,
):
    session = tmp_path / 'session'
    session.mkdir()
    (session / 'measured_js.csv').write_bytes(table.read_bytes())
    begin = truth()[0][PART][0] * 1e-9
    rows = [f'{begin + 5e-3 * number:.9f},0.5' for number in range(160)]
    (session / 'gripper.csv').write_text('\n'.join(['time,gripper', *rows]))
    assert '\n  gripper: 100.00 % of 160 readings, no gap\n' in supervise(session)


@pytest.mark.parametrize(
    ('recording', 'args', 'words'),
    [
        (None, ('-p', 'sigma:=1'), "'sigma'"),
        (None, ('-p', 'sigma_deg:=[1, 2]'), 'sigma_deg'),
        (None, ('-p', 'sensors:=6'), "'sensors' is 6; expected 4, as"),
        (None, ('-o', '/dev/null/x'), '/dev/null/x: cannot be written'),
        *((name, SIMULATED, name) for name in ('none.log', 'none.csv', 'none.mcap')),
    ],
)
def test_what_is_wrong_is_named_in_one_line(
    capsys,
    tmp_path,
    table,
    recording,
    args,
    words,
):
    code, _, err = run(capsys, tmp_path / recording if recording else table, '-o', tmp_path, *args)
    assert code == 1
    assert words in err.splitlines()[-1]
