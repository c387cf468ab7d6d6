# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How programs end, show progress, and open the bus; and those whose rooms test the rest."""

from importlib import import_module
import io
import os
from pathlib import Path
import re
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_text import assert_recorded
from recording import recorded_angles, truth
from spm_haptic_master import kinematics
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.files import source_defaults
from spm_haptic_master.tools import command_line, urdf, validate


def interrupted(number):
    """Return a program that gets a signal, and at its end a second one."""

    def program(words):
        os.kill(os.getpid(), number)
        return 0

    return program


def refused(words):
    raise InputError(f'no {words}')


def broken(error):
    """Return a program whose output cannot be written."""

    def program(words):
        raise error

    return program


@pytest.mark.process
def test_the_tools_need_no_ros(start_python):
    """Neither is rclpy imported, nor anything that imports it."""
    program = start_python(
        '-c',
        'import sys\nfrom spm_haptic_master.tools import can_scan, '
        'calibrate, sim_bus\nprint({name.split(".")[0] for name in sys.modules}'
        ' & {"rclpy", "sensor_msgs"})',
    )
    assert program.wait(60.0) == 0 and program.stdout == 'set()\n', program.stderr


@pytest.mark.parametrize(
    ('program', 'code', 'err'),
    [
        (len, 2, ''),
        (interrupted(signal.SIGINT), 130, ''),
        (interrupted(signal.SIGTERM), 130, ''),
        (refused, 1, "name: no ['a', 'b']\n"),
        (broken(OSError(28, 'No space')), 1, 'name: [Errno 28] No space\n'),
        (broken(BrokenPipeError()), 1, ''),
    ],
)
def test_a_program_ends_with_a_code_and_at_most_one_line(
    monkeypatch,
    capsys,
    program,
    code,
    err,
):
    monkeypatch.setattr(command_line, 'discard', lambda stream: None)
    assert command_line.program('name')(program)(['name', 'a', 'b']) == code
    assert capsys.readouterr() == ('', err)


class Terminal(io.StringIO):
    """A text that passes for a terminal."""

    def isatty(self):
        return True


@pytest.mark.parametrize(
    ('stream', 'expected'),
    [
        (io.StringIO(), 'p: b\np: d\np:  50 %, stage\n'),
        (
            Terminal(),
            '\r[' + '#' * 15 + '.' * 15 + '] b\x1b[K\r[' + '#' * 30 + '] d\x1b[K'
            '\re\x1b[K\r[' + '#' * 15 + '.' * 15 + '] st\x1b[K\n',
        ),
    ],
)
def test_progress_is_a_bar_or_a_line_a_second(
    monkeypatch,
    stream,
    expected,
):
    now = [100.0]
    monkeypatch.setattr('sys.stderr', stream)
    monkeypatch.setattr(command_line, 'time', SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(
        command_line,
        'shutil',
        SimpleNamespace(get_terminal_size=lambda: SimpleNamespace(columns=36)),
    )
    with command_line.ProgressBar('p') as bar:
        for elapsed, text, share in (
            (0.9, 'a', 0.1),
            (1.0, 'b', 0.5),
            (1.05, 'c', 0.6),
            (2.0, 'd', 1.7),
            (2.5, 'e', None),
        ):
            now[0] = 100.0 + elapsed
            bar.show(text, share)
        now[0] += 0.5
        bar.stage('stage', 0.5)
    assert stream.getvalue() == expected


def test_what_fails_on_an_open_bus_is_named_with_the_bus():
    values = source_defaults('can') | {'can.interface': 'virtual', 'can.channel': 'x'}
    with pytest.raises(InputError, match='^virtual x: gone$'), command_line.bus_of(values):
        raise OSError('gone\nfar')
    with pytest.raises(InputError, match='^mine$'), command_line.bus_of(values):
        raise InputError('mine')


def test_the_urdf_of_given_parameters_is_written_where_it_is_wanted(
    tmp_path,
    monkeypatch,
    capsys,
):
    monkeypatch.chdir(tmp_path)
    for args, mesh in (
        ((), tmp_path.as_uri() + '/urdf/meshes/'),
        (
            ('-o', 'b', '--prefix', 'package://p', '-p', 'geometry.alpha_deg:=45.0'),
            'package://p/meshes/',
        ),
    ):
        assert urdf.main(['urdf', *args]) == 0
        path = tmp_path / capsys.readouterr().out.rstrip('\n')
        assert f'filename="{mesh}' in path.read_text()
    assert path == tmp_path / 'b' / 'spm.urdf'
    assert path.read_text().replace(mesh, '') != (
        tmp_path / 'urdf' / 'spm.urdf'
    ).read_text().replace(f'{tmp_path.as_uri()}/urdf/meshes/', '')


def test_a_validation_prints_alignment_and_errors(
    tmp_path,
    monkeypatch,
    capsys,
):
    """The capture is the recording on another clock, in another frame, with noise of its own."""
    monkeypatch.chdir(tmp_path)
    drawn = []
    monkeypatch.setattr(
        'spm_haptic_master.validation.plot_style.draw_comparison',
        lambda comparison, directory: drawn.append(str(directory)),
    )
    stamps, quaternions = (each[10000:16000:20] for each in truth())
    noise = np.random.default_rng(3).normal(0.0, 1e-4, quaternions.shape)
    noisy = quaternions + noise
    captured = kinematics.quaternion_from_matrix(
        kinematics.matrix_from_zxz(0.3, 0.2, 0.1)
        @ kinematics.matrix_from_quaternion(noisy / np.linalg.norm(noisy, axis=1, keepdims=True))
    )
    angles = recorded_angles()[10000:16000:20]
    for name, ahead, rows, columns in (
        ('orientation', 0.0, quaternions, 'qx,qy,qz,qw'),
        ('capture', 0.3, captured, 'qx,qy,qz,qw'),
        ('joints', 0.0, angles, ','.join(JOINT_NAMES)),
    ):
        np.savetxt(
            f'{name}.csv',
            np.column_stack([stamps * 1e-9 + ahead, rows]),
            delimiter=',',
            comments='',
            header=f'time,{columns}',
            fmt='%.9f',
        )
    assert (
        validate.main(['validate', 'orientation.csv', 'capture.csv', '--joints', 'joints.csv'])
        == 0
    )
    assert_recorded('validation/printed.txt', capsys.readouterr().out)
    assert {each.name for each in (tmp_path / 'validation').iterdir()} == {
        'aligned.csv',
        'errors.csv',
    }
    assert drawn == ['validation']
    assert validate.main(['validate', 'orientation.csv', 'capture.csv', '-o', '/dev/null/x']) == 1
    assert re.search('^validate: /dev/null/x: cannot be written: ', capsys.readouterr().err)


@pytest.mark.parametrize(
    'tool',
    ['calibrate', 'can_setup', 'force_check', 'sim_bus', 'supervise', 'validate'],
)
def test_the_defaults_of_a_program_are_those_of_its_help(tool):
    parser = import_module(f'spm_haptic_master.tools.{tool}')._parser()
    named = 0
    for action in parser._actions:
        stated = re.search(r'\(default:? ([\w.]+)\)', (action.help or '') % vars(action))
        if stated and action.default is not None:  # None: it depends on the arguments
            named += 1
            assert action.default in (
                stated[1],
                float(stated[1]) if stated[1][0].isdigit() else Path(stated[1]),
            ), action.dest
    assert named
