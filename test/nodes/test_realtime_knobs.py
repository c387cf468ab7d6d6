# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig's knobs: what each does to the threads of a process."""

import os
from pathlib import Path
import platform
import re
import subprocess
import sys

from harness import SIM
import pytest
from spm_haptic_master.ros.realtime import time_slice

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Version of the kernel, and the first one with time slices.
KERNEL, FIRST_WITH_SLICES = tuple(map(int, platform.release().split('.')[:2])), (6, 12)
# Slice that nothing else has, and the error of a reading (s).
SLICE, SLICE_ERROR = 0.05, 1e-9
# A child of a process with less priority has less, too, and keeps the slice of the system.
HAS_SLICES = KERNEL >= FIRST_WITH_SLICES and os.getpriority(os.PRIO_PROCESS, 0) <= 0


def may(code: str) -> bool:
    """Return whether this user may do what some lines of Python do."""
    return subprocess.run([sys.executable, '-c', code], capture_output=True).returncode == 0


def test_knobs_are_those_of_every_thread_where_the_user_may_have_them(start, observer):
    core = max(os.sched_getaffinity(0))
    priority = 7 if may(
        'import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))') else 0
    locked = may('import ctypes, sys; sys.exit(ctypes.CDLL(None).mlockall(3) != 0)')
    knobs = {'cpus': f"'{core}'", 'priority': priority, 'lock_memory': locked,
             **({'slice': SLICE} if HAS_SLICES else {})}
    program = start('master', parameters=SIM | {
        f'realtime.{key}': value for key, value in knobs.items()})
    assert observer.spin_until(
        lambda: observer.node.count_publishers('measured_js') > 0, PATIENCE)
    observer.spin(1.0)
    threads = list(map(int, os.listdir(f'/proc/{program.pid}/task')))
    assert len(threads) > 5
    for tid in threads:
        assert os.sched_getaffinity(tid) == {core}
        assert os.sched_getscheduler(tid) == (os.SCHED_FIFO if priority else os.SCHED_OTHER)
        assert os.sched_getparam(tid).sched_priority == priority
    if HAS_SLICES and not priority:
        found = list(map(time_slice, threads))
        assert found == pytest.approx([SLICE] * len(found), abs=SLICE_ERROR)
    if locked:
        status = Path(f'/proc/{program.pid}/status').read_text()
        pinned, resident = (int(re.search(rf'^{key}:\s+(\d+) kB', status, re.MULTILINE)[1])
                            for key in ('VmLck', 'VmRSS'))
        assert pinned > 0.5 * resident
    assert program.stop() == 0
    assert 'realtime' not in program.stderr
