# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The start of the executables: closed streams, missing libraries, Ctrl-C at once."""

import signal
import sys

from benchmarks.pipeline.child_process import executable
from geometry_msgs.msg import QuaternionStamped
from harness import complaints, SIM, start_command
import pytest
from spm_haptic_master import __main__ as start_module
from spm_haptic_master.executables import EXECUTABLES, PIPELINE

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Streams that are closed, as a shell closes them: stdout, stderr, all three.
CLOSED = ('>&-', '2>&-', '<&- >&- 2>&-')


def test_every_executable_is_an_entry_point():
    assert all(callable(getattr(start_module, name)) for name in EXECUTABLES)
    with pytest.raises(AttributeError, match='no attribute .relay.'):
        getattr(start_module, 'relay')  # noqa: B009


@pytest.mark.process
@pytest.mark.parametrize('names', [('master',), PIPELINE])
def test_closed_streams_change_nothing(observer, stack, names):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    programs = [
        stack.enter_context(
            start_command(
                [
                    'sh',
                    '-c',
                    f'exec "$@" {CLOSED[-1]}',
                    'sh',
                    *executable(
                        name,
                        parameters={
                            'rate': 200.0,
                            **(SIM if name in ('master', 'encoder_driver') else {}),
                        },
                    ),
                ]
            )
        )
        for name in reversed(names)
    ]
    assert observer.spin_until(lambda: len(orientations) > 200, PATIENCE), [
        program.stderr for program in programs
    ]
    assert [program.stop(signal.SIGINT, PATIENCE) for program in programs] == [0] * len(programs)
    assert [complaints(program) for program in programs] == [''] * len(programs)


@pytest.mark.process
@pytest.mark.parametrize('closed', CLOSED)
def test_a_tool_does_its_work_or_ends_with_closed_streams(closed, tmp_path):
    output = '-o', str(tmp_path / 'written')
    for code, name, *args in (
        (1, 'calibrate', '--seconds', '0', *output, '-p', 'source:=sim'),
        (0, 'urdf', *output),
    ):
        program = start_command(
            ['sh', '-c', f'exec "$@" {closed}', 'sh', *executable(name, *args)]
        )
        assert program.wait(PATIENCE) == code, program.stderr
        assert 'Traceback' not in program.stderr
    assert (tmp_path / 'written' / 'spm.urdf').read_text().rstrip().endswith('</robot>')


@pytest.mark.process
@pytest.mark.parametrize('redirected', ['> /dev/full', '| true'])
def test_output_that_cannot_be_written_is_no_traceback(redirected):
    program = start_command(
        [
            'bash',
            '-c',
            f'set -o pipefail; "$@" {redirected}',
            'bash',
            *executable('calibrate', '--help'),
        ]
    )
    assert program.wait(PATIENCE) in (0, 1)
    assert program.stderr in ('', 'calibrate: [Errno 28] No space left on device\n')


@pytest.mark.process
@pytest.mark.parametrize(
    ('name', 'missing', 'words'),
    [
        ('master', 'rclpy', ['the Python module rclpy is missing', 'ros-jazzy-ros-base']),
        ('fkm', 'sensor_msgs', ['the Python module sensor_msgs', 'ros-jazzy-ros-base']),
        ('master', 'rclpy.experimental', ['rclpy 7.', 'is too old: 7.1.4 or newer is needed']),
        ('can_scan', 'can', ['the Python module can is missing: sudo apt install python3-can']),
        ('fkm', 'spm_haptic_master.nodes.fkm', ['Traceback']),
    ],
)
def test_a_missing_library_is_one_line_and_a_missing_module_a_traceback(name, missing, words):
    program = start_command(
        [
            sys.executable,
            '-c',
            f'import sys; sys.modules[{missing!r}] = None; '
            f'from spm_haptic_master.__main__ import {name}; sys.exit({name}())',
        ]
    )
    assert program.wait(PATIENCE) == 1
    assert all(word in program.stderr for word in words), program.stderr
    # A module of the package that is missing is a bug.
    assert 'Traceback' in words or (
        program.stderr.startswith(f'{name}: ') and program.stderr.count('\n') == 1
    )
