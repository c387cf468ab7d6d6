# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How programs end that are given what they cannot use: in one line, and at once."""

import re
import signal
import time

from disturbance import BESIDE_OTHERS, Disturbance
from harness import SIM, SIMULATED, start_command, start_program
import pytest
from spm_haptic_master.benchmark.child_process import executable, wait_until

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# What a recorder logs when it begins.
BEGUN = r'\[INFO\] \[[\d.]+\] \[recorder\]: writes into .*, until Ctrl-C\n'
# A cycle of the encoders, and a heartbeat, as candump writes them.
CYCLE = ('080#', '181#00000000', '182#00000000', '183#00000000', '184#00000000')
HEARTBEAT = '701#05'


def run(name, *args):
    """Return exit code, stdout and stderr of a program that ends by itself."""
    program = start_program(name, *map(str, args))
    return program.wait(PATIENCE), program.stdout, program.stderr


def recorded(path, stamps, frames):
    """Write a log: some frames at each of the stamps."""
    with open(path, 'w', encoding='utf-8') as file:
        for stamp in stamps:
            file.writelines(f'({stamp}) can0 {frame}\n' for frame in frames)
    return path


# The driver waits 5 s for a subscriber before it reads: one stamp for it, all for `calibrate`.
@pytest.mark.parametrize(('name', 'stamp', 'words'), [
    ('encoder_driver', 'nan', 'the stamp of frame 1 is nan s; expected 0 to 4294967296 s'),
    ('calibrate', 'nan', 'the stamp of frame 1 is nan s; expected 0 to 4294967296 s'),
    ('calibrate', 'inf', 'the stamp of frame 1 is inf s'),
    ('calibrate', '1e300', 'the stamp of frame 1 is 1e+300 s'),
    ('calibrate', '-1', 'the stamp of frame 1 is -1 s'),
    ('calibrate', '0', 'has no times: its first 3 sets all have the stamp 0 s')])
def test_a_log_without_times_is_refused(name, stamp, words, tmp_path):
    path = recorded(tmp_path / 'a.log', [stamp] * 200, CYCLE)
    args = ('-p', 'source:=replay', '-p', f'replay.path:={path}', *SIMULATED)
    code, _, err = run(name, *(('--ros-args',) if name == 'encoder_driver' else (
        '-o', tmp_path / 'a.yaml')), *args)
    assert code == 1
    line = err.splitlines()[-1]
    assert line.startswith(f'{name}: {path}')
    assert words in line
    assert 'Traceback' not in err


@pytest.fixture(scope='module')
def long_log(tmp_path_factory):
    """Return a log without a set that takes a minute and more to read."""
    return recorded(tmp_path_factory.mktemp('log') / 'a.log',
                    (f'{0.001 * step:.6f}' for step in range(3_000_000)), (HEARTBEAT,))


@pytest.mark.parametrize('number', [
    signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.evidence)])
def test_a_long_log_without_sets_ends_at_a_signal(number, long_log):
    """At once, without being read to its end."""
    program = start_program('encoder_driver', '--ros-args', '-p', 'source:=replay', '-p',
                            f'replay.path:={long_log}', *SIMULATED)
    try:
        # Once it reads, its entry names the frames without a set.
        assert wait_until(lambda: re.search(r'no set of four encoders in \d+ frames',
                                            program.stderr), PATIENCE), program.stderr
        with Disturbance(BESIDE_OTHERS) as machine:
            began = time.monotonic()
            assert program.stop(number, PATIENCE) == 0, program.stderr[-600:]
            took = time.monotonic() - began
        machine.expect(took < 9.0, took)
    finally:
        program.kill()


def test_a_recording_on_a_full_disk_ends_in_one_line(start, tmp_path):
    """As on a full disk, files cannot grow any more: not when written, nor when closed."""
    command = executable('recorder', parameters={'directory': str(tmp_path)})
    recorder = start_command(['bash', '-c', 'ulimit -f 128; exec "$@"', 'bash', *command])
    try:
        start('master', parameters=SIM)
        assert recorder.wait(2.0 * PATIENCE) == 1
        # Without figures of a table that is not as it says.
        assert re.fullmatch(BEGUN + rf'recorder: {tmp_path}/\w+.csv: cannot be written: '
                            r'\[Errno 27\] File too large\n', recorder.stderr), recorder.stderr
    finally:
        recorder.kill()


def test_a_directory_that_cannot_be_made_is_one_line(start):
    start('master', parameters={**SIM, 'rate': 100.0})
    code, _, err = run('recorder', '--ros-args', '-p', 'directory:=/dev/full/recording')
    assert code == 1
    assert re.fullmatch(BEGUN + 'recorder: /dev/full/recording/.*\n', err), err
