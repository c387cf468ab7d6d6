# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""`calibrate` in a jig: of four or six encoders with harmonics on a mechanism as built."""

from contextlib import closing, ExitStack
import io
from math import degrees, radians
import re
from types import SimpleNamespace

import can
from encoder_frames import cycle, values
import numpy as np
import pytest
from recording import LOG
from rig_as_built import calibration, mechanism
from spm_haptic_master.calibration.calibration_file import read_calibration
from spm_haptic_master.encoders import decoder_factory
from spm_haptic_master.kinematics import Geometry, measured_angles, zxz_rotation
from spm_haptic_master.parameters import geometry
from spm_haptic_master.parameters.resolver import read_parameters
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.simulation.source_factory import make_source
from spm_haptic_master.tools.calibrate import main

POSES = ((135.0, 54.7356, 0.0), (125.0, 50.0, 25.0))
ZEROS = [100, 5000, 9000, 16000, 300, 7000]
DIRECTIONS = [1, -1, 1, -1, -1, 1]
HARMONICS = {name: value for name, value in calibration().items() if 'harmonic' in name}


def record(
    path,
    pose,
    sensors=4,
    without=(),
    every=1,
    noise=0.04,
):
    """Write a log of the rig at rest in a pose, deg; some encoders miss some cycles."""
    built = geometry.geometry_from(complete(geometry.MECHANISM_SETTINGS, mechanism()))
    angles = measured_angles(
        zxz_rotation(*map(radians, pose)),
        built,
        (1, 1, 1),
        sensors,
    )
    if sensors == 4:
        harmonics = decoder_factory.make_harmonics(
            values(**{name.replace('.', '__'): tuple(value) for name, value in HARMONICS.items()})
        )
        angles = [each.readings(angle) for each, angle in zip(harmonics, angles, strict=True)]
    layouts = decoder_factory.make_layouts(
        values(
            sensors=sensors,
            encoders__zero_count=ZEROS[:sensors],
            encoders__direction=DIRECTIONS[:sensors],
        )
    )
    rows = np.random.default_rng(13).normal(0.0, radians(noise), (400, sensors)) + angles
    with can.CanutilsLogWriter(path) as log:
        for number, row in enumerate(rows.tolist()):
            for index, message in enumerate(cycle(number, row, layouts), start=-1):
                if index not in without or number % every:
                    log.on_message_received(message)
    return path


def run(capsys, *args):
    """Return exit code, stdout and the last line of stderr."""
    code = main(['calibrate', *map(str, args)])
    out, err = capsys.readouterr()
    return code, out, ['', *err.splitlines()][-1]


def at(
    log,
    output,
    pose,
    *args,
):
    """Return the arguments of a calibration from a log."""
    return (
        '-p',
        'source:=replay',
        '-p',
        f'replay.path:={log}',
        '-p',
        'replay.rate:=20.0',
        '--seconds',
        0.3,
        '-o',
        output,
        '--pose',
        *pose,
        *args,
    )


class JiggedRig:
    """A rig that is recorded in two poses of a jig, and its calibration from both."""

    def __init__(self, folder, sensors, capsys):
        self.sensors = sensors
        self.settings = mechanism() | (HARMONICS if sensors == 4 else {'sensors': 6})
        self.output = folder / 'calibration.yaml'
        self._capsys = capsys
        self._settings_file = folder / 'rig.yaml'
        lines = [f'    {name}: {value}\n' for name, value in self.settings.items()]
        self._settings_file.write_text('/**:\n  ros__parameters:\n' + ''.join(lines))
        self.logs = [
            record(folder / f'{number}.log', pose, sensors) for number, pose in enumerate(POSES)
        ]

    def first(self):
        """Calibrate from the first pose; return exit code, stdout and the last line of stderr."""
        given = ('--params-file', self._settings_file)
        return run(self._capsys, *at(self.logs[0], self.output, POSES[0], *given))

    def second(self, *given):
        """Complete it by the second pose; the mechanism is taken from the file of the first."""
        return run(self._capsys, *at(self.logs[1], self.output, POSES[1], *given))

    def completed(self):
        """Return what is printed as the file is completed."""
        assert self.first()[0] == 0
        code, out, err = self.second('--force', '--jig-error', 0.1)
        assert (code, err) == (0, '')
        return out


@pytest.fixture(params=[4, 6])
def jigged(request, tmp_path, capsys):
    """Return a rig of four sensors with harmonics, and one of six."""
    return JiggedRig(tmp_path, request.param, capsys)


def test_one_pose_gives_zeros_and_unverified_directions(jigged):
    code, out, err = jigged.first()
    assert (code, err) == (0, '')
    assert f'{jigged.output}: written' in out
    assert out.count('direction +1 (NOT verified)') == jigged.sensors
    assert 'The driver refuses directions that are not verified' in out
    bias = read_calibration(jigged.output).bias
    assert bias == pytest.approx([radians(0.05)] * jigged.sensors)


def test_a_second_pose_needs_force_and_the_same_resolution(jigged):
    jigged.first()
    written = jigged.output.read_text()
    code, _, err = jigged.second()
    assert code == 1
    assert 'already exists; expected --force' in err
    other = [8192] * jigged.sensors
    code, _, err = jigged.second('--force', '-p', f'encoders.counts_per_turn:={other}')
    assert code == 1
    assert f'counts per turn, the encoders have {other}' in err
    assert jigged.output.read_text() == written


def test_two_poses_give_zeros_and_directions(jigged):
    out = jigged.completed()
    assert 'overwritten (it held the calibration of' in out
    assert 'The driver refuses' not in out
    found = read_calibration(jigged.output)
    for index, sign in enumerate(DIRECTIONS[: jigged.sensors]):
        sigma = degrees(found.sigma[index])
        bias = degrees(found.bias[index])
        assert 0.03 < sigma < 0.05
        assert 0.1 < bias < 1.0
        assert (
            f': zero count {found.zero_count[index]}, sigma {sigma:.4f} deg, bias {bias:.4f} '
            f'deg, direction {sign:+d} (verified)\n' in out
        )
    # Noise of a count, averaged over 400.
    np.testing.assert_allclose(found.zero_count, ZEROS[: jigged.sensors], atol=1)


def test_the_file_of_two_poses_is_all_that_the_nodes_need(jigged):
    jigged.completed()
    parameters = read_parameters(jigged.output)
    for name, value in jigged.settings.items():
        assert parameters[name] == pytest.approx(value, abs=1e-12), name
    needless = ('alpha_deg', 'working_mode')
    assert not any('table' in name or name.endswith(needless) for name in parameters)
    encoders = {
        name.replace('.', '__'): tuple(value)
        for name, value in parameters.items()
        if name.startswith('encoders')
    }
    settings = values(sensors=jigged.sensors, **encoders)
    assert decoder_factory.unverified_joints(settings) == ()


@pytest.mark.parametrize('sensors', [4, 6])
def test_the_file_of_a_nominal_rig_has_neither_mechanism_nor_harmonics(sensors, capsys, tmp_path):
    log = record(tmp_path / 'pose.log', POSES[0], sensors)
    output = tmp_path / 'nominal.yaml'
    code, _, _ = run(capsys, *at(log, output, POSES[0], '-p', f'sensors:={sensors}'))
    assert code == 0
    of_a_rig = ('geometry', 'encoders.harmonic', 'encoders.table')
    assert not any(name.startswith(of_a_rig) for name in read_parameters(output))


def test_a_live_device_is_asked_for_each_pose_and_the_driver_runs_on_the_file(
    capsys,
    monkeypatch,
    tmp_path,
    channel,
    encoders,
):
    """Someone brings it to the next pose each time, and presses Enter."""
    rig = {'encoders__zero_count': ZEROS[:4], 'encoders__direction': DIRECTIONS[:4]}
    bus = {'can.interface': 'virtual', 'can.channel': channel, 'rate': 250.0}
    poses = iter(POSES)
    path = tmp_path / 'rig.yaml'

    def bring():
        held.close()
        held.enter_context(encoders(sync=0.004, pose=next(poses), **rig))
        return '\n'

    monkeypatch.setattr('sys.stdin', SimpleNamespace(readline=bring))
    monkeypatch.setattr('spm_haptic_master.calibration.jig.SETS_MINIMUM', 20)
    with ExitStack() as held:
        assert (
            main(
                [
                    'calibrate',
                    '-o',
                    str(path),
                    '--seconds',
                    '0.2',
                    *(word for name, value in bus.items() for word in ('-p', f'{name}:={value}')),
                    *(str(word) for pose in POSES for word in ('--pose', *pose)),
                ]
            )
            == 0
        )
    out, err = capsys.readouterr()
    assert out.count('(verified)') == 4
    assert 'pose 2 of 2: hold the device at psi theta phi 125 50 25 deg, then press Enter\n' in err
    pose = (140.0, 60.0, 20.0)
    file = {
        name.replace('.', '__'): value
        for name, value in read_parameters(path).items()
        if name.startswith('encoders')
    }
    with (
        encoders(sync=0.004, pose=pose, **rig),
        closing(
            make_source(
                'can',
                values(**file, **{name.replace('.', '__'): value for name, value in bus.items()}),
            )
        ) as source,
    ):
        sample = source.read(2.0)
    assert sample.angles == pytest.approx(
        measured_angles(zxz_rotation(*map(radians, pose)), Geometry(), (1, 1, 1), 4), abs=4e-3
    )


@pytest.mark.parametrize(
    ('args', 'words'),
    [
        ((), 'calibrate: no -o FILE; expected the parameter file to write'),
        (('--check', 'c.yaml'), '--check c.yaml without --motion, --insertion or --gripper'),
        (('-o', 'rig.yaml', '-p', 'source:=sim'), "'source' is 'sim'; expected can or replay"),
        (('-o', 'rig.yaml', '--pose', 0, 0, 0), '--pose 0 0 0: out of reach of the manipulator'),
        (
            ('-o', 'rig.yaml', '--pose', 135, 54, 0, '--pose', 130, 50, 10),
            'standard input has ended; expected Enter for each of 2 poses',
        ),
        (
            (
                '-o',
                'rig.yaml',
                '-p',
                'source:=replay',
                '-p',
                f'replay.path:={LOG}',
                '--pose',
                135,
                54,
                0,
                '--pose',
                130,
                50,
                10,
            ),
            '--pose is given 2 times; expected once for a recording',
        ),
        (
            (
                '-o',
                'rig.yaml',
                '-p',
                'source:=replay',
                '-p',
                f'replay.path:={LOG}',
                '-p',
                'replay.rate:=100.0',
                '--seconds',
                0.02,
            ),
            'the device moved: joint_',
        ),
    ],
)
def test_without_a_device_at_rest_nothing_is_written(
    capsys,
    monkeypatch,
    tmp_path,
    args,
    words,
):
    monkeypatch.setattr('sys.stdin', io.StringIO())
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *args)
    assert (code, out) == (1, '')
    assert words in err
    assert not list(tmp_path.iterdir())


def test_a_noisy_encoder_is_refused_below_the_limit_given(capsys, tmp_path):
    noisy = record(
        tmp_path / 'noisy.log',
        POSES[0],
        6,
        without={4},
        every=20,
        noise=0.2,
    )
    args = at(noisy, tmp_path / 'c.yaml', POSES[0], '-p', 'sensors:=6')
    code, _, err = run(capsys, *args)
    assert code == 1 and re.search(r'joint_1a .* limit 0\.1', err), err
    code, _, err = run(capsys, *args, '--noise-limit', 0.3)
    assert code == 0
    assert re.match(r'calibrate: joint_3b has no reading in \d+ of \d+ sets; these are', err), err


@pytest.mark.parametrize(
    'arguments',
    [
        ('--pose', *POSES[0], '--jig-error', 0.1, '-p', 'replay.rate:=20.0'),
        ('--motion',),
    ],
)
def test_a_calibration_of_six_with_one_missing_names_it(
    tmp_path,
    capsys,
    arguments,
):
    log = record(tmp_path / 'five.log', POSES[0], 6, without={4})
    code, _, err = run(
        capsys,
        '-p',
        'source:=replay',
        '-p',
        f'replay.path:={log}',
        '-p',
        'sensors:=6',
        '-o',
        tmp_path / 'calibration.yaml',
        *arguments,
    )
    assert code == 1
    assert 'joint_3b has no reading in ' in err
    assert 'check the encoder, or give `sensors`' in err
    assert not (tmp_path / 'calibration.yaml').exists()
