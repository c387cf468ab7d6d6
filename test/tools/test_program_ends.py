# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How programs end that are given what they cannot use: in one line, and at once."""

import re
import signal
import time

from disturbance import BESIDE_OTHERS, Disturbance
from harness import SIM, SIMULATED, start_command
import pytest
from spm_haptic_master.benchmark.child_process import executable, wait_until

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# What a recorder logs when it begins.
BEGUN = r'\[INFO\] \[[\d.]+\] \[recorder\]: writes into .*, until Ctrl-C\n'


def test_a_long_log_without_sets_ends_at_a_signal(start, tmp_path):
    """At once, without being read to its end, which takes a minute and more."""
    path = tmp_path / 'a.log'
    with open(path, 'w', encoding='utf-8') as file:
        file.writelines(f'({0.001 * step:.6f}) can0 701#05\n' for step in range(3_000_000))
    program = start('encoder_driver', '-p', 'source:=replay', '-p', f'replay.path:={path}',
                    *SIMULATED)
    # Once it reads, its entry names the frames without a set.
    assert wait_until(lambda: re.search(r'no set of four encoders in \d+ frames',
                                        program.stderr), PATIENCE), program.stderr
    with Disturbance(BESIDE_OTHERS) as machine:
        began = time.monotonic()
        assert program.stop(signal.SIGINT, PATIENCE) == 0, program.stderr[-600:]
        took = time.monotonic() - began
    machine.expect(took < 9.0, took)


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
    recorder = start('recorder', '-p', 'directory:=/dev/full/recording')
    assert recorder.wait(PATIENCE) == 1
    assert re.fullmatch(BEGUN + 'recorder: /dev/full/recording/.*\n', recorder.stderr), \
        recorder.stderr
