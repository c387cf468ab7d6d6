# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate --motion` from the log of a rig that is not perfect: what its file is worth."""

from contextlib import contextmanager
from functools import cache, partial
from math import inf, radians
from pathlib import Path
import re

from encoder_frames import cycle, make_layouts, record, values
from harness import DATA, ROOT
import numpy as np
import pytest
from recorded_text import assert_recorded
from rig_as_built import errors_deg, rig, truth
from spm_haptic_master import kinematics
from spm_haptic_master.calibration import recording
from spm_haptic_master.calibration.motion.free_motion import Guidance
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.parameters.encoders import LAYOUT_SETTINGS
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.geometry import MECHANISM_SETTINGS
from spm_haptic_master.parameters.nodes import SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.simulation.source_factory import make_replay
from spm_haptic_master.supervision import supervise
from spm_haptic_master.tools import calibrate_motion, command_line, motion_source
from spm_haptic_master.tools.calibrate import main
import yaml

# Layouts whose angles are counts.
RAW = make_layouts(values(encoders__zero_count=[0] * 4, encoders__direction=[1] * 4))
MOTION = ('-p', 'source:=replay', '-p', f'replay.path:={DATA}/rig/dev_motion.log.gz')


def run(*args):
    """Return the exit code."""
    return main(['calibrate', '--motion', *map(str, args)])


class Rig:
    """The rig of two logs, its encoders read at a rate, and its calibration by the book."""

    def __init__(self, folder, motion, check):
        self.motion = motion
        self.check = check
        self.calibration = folder / 'calibration.yaml'
        assert run(*motion, '-o', self.calibration) == 0
        self.samples = cache(self._samples)

    def _samples(self, log):
        """Return the stamps and the angles of a log with the calibration."""
        replay = read_parameters(self.calibration)
        replay['replay.path'] = log[3].removeprefix('replay.path:=')
        settings = command_line.checked(replay, SOURCE_SETTINGS['replay'], 'replay')
        samples = list(make_replay(settings).recorded())
        stamps = np.array([sample.stamp for sample in samples])
        return stamps, np.array([sample.angles for sample in samples])

    def supervised(self, log, **changes):
        """Return stamps, and what fkm makes of a log with the calibration and other parameters."""
        names = {setting.name for setting in FKM_SETTINGS}
        given = read_parameters(self.calibration)
        of_fkm = {name: value for name, value in given.items() if name in names} | changes
        stamps, angles = self.samples(log)
        parameters = {name.replace('.', '__'): value for name, value in of_fkm.items()}
        return stamps, supervise(stamps, angles, **parameters)


@pytest.fixture(
    scope='module',
    params=[
        pytest.param(5, id='200 Hz'),
        pytest.param(1, id='1 kHz', marks=pytest.mark.evidence),
    ],
)
def by_the_book(request, motion_log, tmp_path_factory):
    """Return the rig, calibrated from the whole motion: from one set of some."""
    motion, check = (motion_log(name, request.param, inf) for name in ('dev_motion', 'dev_check'))
    return Rig(tmp_path_factory.mktemp('book'), motion, check)


@pytest.mark.slow
def test_another_log_of_the_rig_becomes_right_orientations(by_the_book):
    """At least 99.9 % of them, 0.06 deg rms, 0.3 at most, through the supervision of fkm."""
    stamps, found = by_the_book.supervised(by_the_book.check)
    assert found.published.mean() >= 0.999
    assert [text for _, text in found.state] == ['starting', 'healthy']
    times, true = truth()
    rows = np.searchsorted(stamps, np.round((times - times[0]) * 1e9) + stamps[0] - 300_000)
    known = found.published[rows]
    orientations = kinematics.matrix_from_quaternion(found.quaternion[rows[known]])
    errors = errors_deg(orientations, true[known])
    rms = np.sqrt((errors**2).mean())
    print(f'{known.sum()} orientations, rms {rms:.4f} deg, largest {errors.max():.3f} deg')
    assert rms <= 0.06
    assert errors.max() <= 0.3
    assert (errors < found.protection_level[rows[known]]).all()
    calibration = by_the_book.calibration
    assert calibration.with_suffix('.md').read_text().startswith('# Good for an alert limit of ')
    assert run('--check', calibration, *by_the_book.check) == 0


def columns_of_bringup():
    """Return the parameters of fkm in each column of the table of limits, by its name."""
    rows = [
        [cell.strip().strip('`') for cell in line.strip('|').split('|')]
        for line in (ROOT / 'docs/bringup.md').read_text().splitlines()
        if line.startswith('| ')
    ]
    (header,) = (row for row in rows if row[0] == 'parameter')
    names = {setting.name for setting in FKM_SETTINGS}
    return {
        column: {row[0]: yaml.safe_load(row[place]) for row in rows if row[0] in names}
        for place, column in enumerate(header)
        if column not in ('parameter', 'why')
    }


@pytest.mark.slow
@pytest.mark.parametrize('column', ['demonstration', 'phantom', 'patient'])
def test_a_rig_calibrated_by_the_book_can_run_each_column_of_bringup(by_the_book, column):
    """The motion itself, from a cold start: nearly all of it, and each sensor checked in it."""
    limits = columns_of_bringup()[column]
    assert {'alert_limit_deg', 'unchecked_limit', 'start_checked'} <= limits.keys()
    _, found = by_the_book.supervised(by_the_book.motion, **limits)
    longest = np.where(np.isinf(found.unchecked), 0.0, found.unchecked).max(axis=0)
    print(f'{100.0 * found.published.mean():.2f} % published, unchecked for {longest} s at most')
    assert found.published.mean() >= 0.95
    assert np.isfinite(found.unchecked[-1]).all()
    assert (longest < 10.0).all()


@pytest.mark.slow
def test_every_sensor_is_checked_at_an_alert_limit_of_one_degree(by_the_book):
    """The bound of the parity is a tenth of what those of the sensors add up to."""
    _, found = by_the_book.supervised(by_the_book.motion, alert_limit_deg=0.8)
    assert np.isfinite(found.unchecked[-1]).all()
    given = read_parameters(by_the_book.calibration)
    assert given['parity_bias_deg'] < 0.25 * max(given['bias_deg'])


def test_the_motion_is_summed_up_and_its_file_has_what_it_determined(
    calibrated,
    motion,
    capsys,
):
    path, printed, verdict = calibrated
    assert_recorded('calibration/motion_printed.txt', printed.replace(str(path), 'c.yaml'))
    found = read_parameters(path)
    assert found['encoders.direction'] == rig()['direction']
    assert found['sigma_deg'] == pytest.approx([0.0405] * 4, rel=0.06)
    # The limit is the task's, in rig.yaml.
    assert 'alert_limit_deg' not in found
    assert 'mounting.base_zxz_deg' not in found
    assert verdict.origin.recording == 'dev_motion.log'
    assert len(verdict.origin.checksum) == 64
    assert verdict.alert_limit_deg > 1.0
    assert verdict.published > 0.99
    before = path.read_bytes()
    assert run(*motion, '-o', path) == 1
    assert f'-o: {path} already exists; expected --force' in capsys.readouterr().err
    assert path.read_bytes() == before


# How a handle is mounted at both ends, which no motion shows, ZXZ, deg.
BASE_DEG = (20.0, 30.0, 40.0)
HANDLE_DEG = (-50.0, 25.0, 10.0)


class MountedMotion:
    """The calibration's own motion, turned at both ends."""

    def __init__(self, calibration):
        base = kinematics.matrix_from_zxz(*np.radians(BASE_DEG))
        handle = kinematics.matrix_from_zxz(*np.radians(HANDLE_DEG))
        known = np.isfinite(calibration.rotation).all(axis=(1, 2))
        self.readings = calibration.readings.readings[known]
        self.seconds = calibration.readings.seconds[known]
        self.rotations = base @ calibration.rotation[known] @ handle

    def write_capture(self, path):
        """Write it as a capture on another clock."""
        quaternions = kinematics.quaternion_from_matrix(self.rotations)
        np.savetxt(
            path,
            np.column_stack([self.seconds + 7.3, quaternions]),
            delimiter=',',
            comments='',
            header='time,qx,qy,qz,qw',
            fmt='%.9f',
        )
        return path


@pytest.fixture
def mounting(
    calibrated,
    motion,
    tmp_path,
    monkeypatch,
):
    """Return the motion as mounted, and what finds its mounting: nothing else is computed."""
    calibration = calibrated[2].calibration
    for name, result in (
        ('calibrate_motion', calibration),
        ('published_share', 1.0),
        ('write_report', ''),
    ):
        monkeypatch.setattr(calibrate_motion, name, lambda *_, result=result, **__: result)
    monkeypatch.setattr(calibrate_motion, 'supported', lambda found, _: (found, 30.0))
    output = tmp_path / 'c.yaml'

    def found(*args):
        """Return the mounting of base and handle, ZXZ, deg, or the exit code."""
        given = (*motion, '-p', 'alert_limit_deg:=30.0', '-o', output, '--force', *args)
        if code := run(*given):
            return code
        parameters = read_parameters(output)
        return parameters['mounting.base_zxz_deg'], parameters['mounting.handle_zxz_deg']

    return MountedMotion(calibration), found


def test_a_capture_gives_the_mounting_of_both_ends(
    mounting,
    tmp_path,
    capsys,
):
    mounted, find = mounting
    base, handle = find('--capture', mounted.write_capture(tmp_path / 'capture.csv'))
    assert base == pytest.approx(BASE_DEG, abs=0.05)
    assert handle == pytest.approx(HANDLE_DEG, abs=0.05)
    figures = r'standard deviations 0\.\d+ 0\.\d+ 0\.\d+ deg\n'
    out, err = capsys.readouterr()
    assert re.search(
        rf'\n  mounting of the base: {figures}  mounting of the handle: {figures}'
        r'  residual of the orientations from outside: 0\.000 deg rms\n$',
        out,
    )
    assert 'left out' not in err


@pytest.mark.parametrize('count', [1, 12])
def test_M1_mislabelled_rows_of_a_capture_do_not_turn_the_mounting(
    mounting,
    tmp_path,
    capsys,
    count,
):
    """Markers that exchange their names turn the body by half a turn at once, and back."""
    mounted, find = mounting
    half_a_turn = np.diag([-1.0, -1.0, 1.0])
    mounted.rotations[700 : 700 + count] = mounted.rotations[700 : 700 + count] @ half_a_turn
    path = mounted.write_capture(tmp_path / 'capture.csv')
    base, handle = find('--capture', path)
    assert base == pytest.approx(BASE_DEG, abs=0.05)
    assert handle == pytest.approx(HANDLE_DEG, abs=0.05)
    out, err = capsys.readouterr()
    assert f'calibrate: {path}: {count} captured rows left out: that no hand can give\n' in err
    assert re.search(r'residual of the orientations from outside: 0\.00\d deg rms', out)


def test_M2_what_a_capture_held_is_left_out(
    mounting,
    tmp_path,
    capsys,
):
    """Tracking that is lost writes the last row again, which is no orientation of the handle."""
    mounted, find = mounting
    mounted.rotations[700:900] = mounted.rotations[700]
    base, handle = find('--capture', mounted.write_capture(tmp_path / 'capture.csv'))
    assert base == pytest.approx(BASE_DEG, abs=0.05)
    assert handle == pytest.approx(HANDLE_DEG, abs=0.05)
    count = re.search(
        r'(\d+) captured rows left out: held or filled in by the capture',
        capsys.readouterr().err,
    )[1]
    assert int(count) >= 198


def test_poses_of_a_jig_give_the_mounting_of_both_ends(mounting, tmp_path):
    mounted, find = mounting
    poses = []
    for row in range(0, len(mounted.seconds), 500):
        cycles = [cycle(number, mounted.readings[row], RAW) for number in range(150)]
        log = record(tmp_path / f'{row}.log', [message for each in cycles for message in each])
        pose = np.degrees(kinematics.zxz_from_matrix(mounted.rotations[row]))
        poses += ['--pose', *pose, '--pose-recording', log]
    base, handle = find('-p', 'replay.rate:=20.0', *poses)
    assert base == pytest.approx(BASE_DEG, abs=0.3)
    assert handle == pytest.approx(HANDLE_DEG, abs=0.3)


def test_a_capture_of_markers_is_refused(
    mounting,
    tmp_path,
    capsys,
):
    path = tmp_path / 'capture.csv'
    path.write_text(
        'time,ax,ay,az,bx,by,bz,cx,cy,cz,dx,dy,dz\n'
        + ''.join(f'{time},0,0,0,0,0,1,1,0,0,0,1,0\n' for time in range(20))
    )
    assert mounting[1]('--capture', path) == 1
    assert 'markers; expected the pose of a body' in capsys.readouterr().err


class LiveMotion:
    """What a calibration from a live motion guides, publishes and keeps, of a device at rest."""

    def __init__(self, folder, monkeypatch):
        self.folder = folder
        self.kept = folder / 'c_motion_2.log'
        self.published = []
        # Sets at each evaluation by the guide.
        self.sets = []
        self._errors = iter((None, 0.08, 0.04))
        monkeypatch.setattr(calibrate_motion, 'Guide', lambda _: self)
        monkeypatch.setattr('spm_haptic_master.nodes.guidance_publisher.published', self._topic)
        monkeypatch.setattr(motion_source, 'record', partial(recording.record, period=0.1))

    def evaluate(self, stamps, angles):
        """Return the guidance: the third one is that the motion is enough."""
        self.sets.append(len(stamps))
        # All but what came last is in the file already.
        assert self.kept.read_text().count(' 080#') > len(stamps) - 10
        error = next(self._errors)
        return Guidance(
            error=error and radians(error),
            text='turn it',
            covered={'joint_1a': 0.5},
        )

    @contextmanager
    def _topic(self, remaps):
        self.published.append(remaps)
        yield lambda *state: self.published.append(state)

    def calibrate(self, channel):
        """Calibrate on a bus; return the exit code."""
        bus = ('-p', 'can.interface:=virtual', '-p', f'can.channel:={channel}')
        output = ('-o', self.folder / 'c.yaml')
        return run(*bus, '-p', 'rate:=100.0', *output, '--ros-args', '-r', '__ns:=/a')

    def calibrate_again(self):
        """Calibrate from what was kept; return the exit code."""
        replay = ('-p', 'source:=replay', '-p', f'replay.path:={self.kept}')
        return run(*replay, '-p', 'rate:=100.0', '-o', self.folder / 'd.yaml')


@pytest.fixture
def live(tmp_path, monkeypatch):
    (tmp_path / 'c_motion.log').write_text('mine')
    return LiveMotion(tmp_path, monkeypatch)


def test_a_live_motion_is_guided_until_it_is_enough(live, encoders, channel, capsys):
    with encoders(sync=0.01):
        live.calibrate(channel)
    remaps, *states = live.published
    assert remaps == ['__ns:=/a']
    assert [covered for _, covered in states] == [
        {'precision': pytest.approx(share), 'joint_1a': 0.5} for share in (0.0, 0.25, 1.0)
    ]
    text, _ = states[-1]
    assert f' s, {live.sets[2]} sets: turn it' in text
    error = capsys.readouterr().err
    assert 'calibrate: move the handle through its whole workspace' in error


def test_a_live_motion_is_kept_and_can_be_used_again(live, encoders, channel, capsys):
    """At rest, so that it is refused afterwards; a program that is killed leaves the file."""
    refused = re.compile(r'calibrate: (the motion lasts|joint_1a moved by|\d+ sets of four) .*')
    with encoders(sync=0.01):
        assert live.calibrate(channel) == 1
    error = capsys.readouterr().err
    assert f'the motion is kept in {live.kept}; from it again: -p source:=replay' in error
    assert (live.folder / 'c_motion.log').read_text() == 'mine'
    assert refused.fullmatch(error.splitlines()[-1])
    assert live.calibrate_again() == 1
    assert refused.fullmatch(capsys.readouterr().err.splitlines()[-1])


@pytest.mark.parametrize(
    'args, text',
    (
        ((), 'no -o FILE; expected the parameter file to write'),
        (('-o', '/proc/c.yaml'), '-o: /proc/c.yaml cannot be written'),
        (('-o', '/no/such/directory/c.yaml'), 'expected a file in an existing directory'),
        (
            ('-o', 'c.yaml', '--pose', '1', '2', '3', '--capture', 'a.csv'),
            '--pose and --capture; expected one of the two',
        ),
        (
            ('-o', 'c.yaml', *MOTION, '--pose', '1', '2', '3'),
            '--pose is given 1 times and --pose-recording 0 times; expected as many',
        ),
        (
            ('-o', 'c.yaml', '--pose-recording', 'a.log'),
            "--pose-recording with source 'can'; expected it with replay",
        ),
        (('-o', 'c.yaml', '-p', 'source:=sim'), "'source' is 'sim'; expected can or replay"),
    ),
)
def test_arguments_that_lead_to_nothing_are_refused_in_one_line(
    tmp_path,
    monkeypatch,
    capsys,
    args,
    text,
):
    monkeypatch.chdir(tmp_path)
    assert run(*args) == 1
    err = capsys.readouterr().err
    assert text in err
    assert err.count('\n') == 1
    assert not list(tmp_path.iterdir())


def test_the_file_has_the_bus_as_given_and_the_layout():
    """A driver that takes nothing but the file is on the same bus at the same rate."""
    given = {
        'source': 'can',
        'can.channel': 'can1',
        'can.sync': 'produce',
        'rate': 250.0,
        'encoders.id': [0x281, 0x282, 0x283, 0x284],
        'encoders.direction': [1, 1, 1, -1],
        'geometry.alpha_deg': 40.0,
    }
    values = command_line.checked(
        recording.raw_counts(4) | given | {'encoders.direction_verified': [True] * 4},
        SOURCE_SETTINGS['can'],
        'can',
    )
    mechanism = command_line.checked(given, MECHANISM_SETTINGS)
    kept_settings = calibrate_motion.kept_settings
    kept = kept_settings('can', given, values, mechanism)
    # The whole layout: who edits it in another file is told.
    layout = {setting.name: values[setting.name] for setting in LAYOUT_SETTINGS} | {
        'encoders.id': (0x281, 0x282, 0x283, 0x284)
    }
    for measured in ('direction', 'zero_count', 'counts_per_turn'):
        del layout[f'encoders.{measured}']
    assert kept == layout | {
        'source': 'can',
        'can.channel': 'can1',
        'can.sync': 'produce',
        'rate': 250.0,
    }
    assert kept_settings(
        'replay',
        {},
        values,
        mechanism | {'working_mode': (1, -1, 1)},
    ) == layout | {'working_mode': (1, -1, 1)}


def test_recordings_of_two_motions_are_joined(
    motion_log,
    tmp_path,
    monkeypatch,
    capsys,
):
    """One after the other, whenever they were recorded; the file names both."""
    first, second = (
        Path(motion_log(name)[3].removeprefix('replay.path:='))
        for name in ('dev_motion', 'dev_check')
    )
    taken = {}

    def stop(stamps, readings, **_):
        taken.update(stamps=stamps, angles=readings)
        raise CalibrationError('stop')

    monkeypatch.setattr(calibrate_motion, 'calibrate_motion', stop)
    rate = ('-p', 'rate:=100.0', '-o', tmp_path / 'c.yaml')
    for logs in ([first], [second], [second, first], [first, second]):
        assert run(*logs, *rate) == 1
        if len(logs) == 1:
            taken[logs[0]] = taken['angles']
    assert 'calibrate: stop' in capsys.readouterr().err
    assert (np.diff(taken['stamps']) > 0).all()
    np.testing.assert_array_equal(taken['angles'], np.concatenate([taken[first], taken[second]]))


def test_joined_recordings_follow_each_other_by_a_second():
    early = np.arange(5) * 10
    late = np.arange(5) * 10 + 10**12
    angles = np.zeros((5, 4))
    stamps, _ = motion_source.joined([(late, angles), (early, angles)])
    assert stamps[5] - stamps[4] == 10**9
    assert np.diff(stamps)[5:].tolist() == [10] * 4
    stamps, _ = motion_source.joined([(early, angles), (late, angles)])
    np.testing.assert_array_equal(stamps, np.concatenate([early, late]))
