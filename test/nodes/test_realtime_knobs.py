# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig's knobs: what each does to the process, and the warning without the privilege."""

import os
from pathlib import Path
import platform
import re
import shutil
import subprocess
import sys

from geometry_msgs.msg import QuaternionStamped
from harness import SIM, start_command
import pytest
from spm_haptic_master.benchmark.child_process import executable
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.ros.realtime import time_slice

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
PROCESSES = ('master', *PIPELINE)
# Version of the kernel, and the first one with time slices.
KERNEL, FIRST_WITH_SLICES = tuple(map(int, platform.release().split('.')[:2])), (6, 12)
# Slice that every process asks for, one that nothing else has, and the error of a reading (s).
SLICE, OWN_SLICE, SLICE_ERROR = 1e-4, 0.05, 1e-9
# `setpriv` of util-linux gives privileges away; so does nobody without any.
UNPRIVILEGED = ['setpriv', '--bounding-set=-all', '--inh-caps=-all', '--no-new-privs']


def needs_slices(test):
    """Skip a test whose programs have no slices of their own."""
    # A child of a process with less priority has less, too, and keeps the slice of the system.
    nice = os.getpriority(os.PRIO_PROCESS, 0) > 0
    test = pytest.mark.skipif(nice, reason='this process has less priority')(test)
    return pytest.mark.skipif(
        KERNEL < FIRST_WITH_SLICES, reason='Linux before 6.12 has no time slices')(test)


def may_schedule() -> bool:
    """Return whether this user may use SCHED_FIFO."""
    return subprocess.run([sys.executable, '-c', 'import os; os.sched_setscheduler('
                           '0, os.SCHED_FIFO, os.sched_param(1))'],
                          capture_output=True).returncode == 0


def may_lock() -> bool:
    """Return whether this user may lock all memory."""
    return subprocess.run([sys.executable, '-c', 'import ctypes, sys; '
                           'sys.exit(ctypes.CDLL(None).mlockall(3) != 0)'],
                          capture_output=True).returncode == 0


def settled(start, observer, *names, **knobs):
    """Start processes with knobs, each in a namespace of its own, and let them settle."""
    parameters = SIM | {f'realtime.{key}': value for key, value in knobs.items()}
    programs = [start(name, '--ros-args', '-r', f'__ns:=/alone_{name}', parameters=parameters)
                for name in names]
    assert observer.spin_until(
        lambda: {f'/alone_{name}' for name in names} <= {
            namespace for _, namespace in observer.node.get_node_names_and_namespaces()},
        PATIENCE)
    if 'master' in names:
        assert observer.spin_until(
            lambda: observer.node.count_publishers('/alone_master/measured_js') > 0, PATIENCE)
    observer.spin(1.0)
    return programs


def threads(program):
    return [int(tid) for tid in os.listdir(f'/proc/{program.pid}/task')]


@pytest.mark.process
def test_cores_and_where_it_may_be_set_priority_of_every_thread(start, observer):
    core, priority = max(os.sched_getaffinity(0)), 7 if may_schedule() else 0
    for program in settled(start, observer, *PROCESSES, cpus=f"'{core}'", priority=priority):
        for tid in threads(program):
            assert os.sched_getaffinity(tid) == {core}
            assert os.sched_getscheduler(tid) == (
                os.SCHED_FIFO if priority else os.SCHED_OTHER)
            assert os.sched_getparam(tid).sched_priority == priority
        assert program.stop() == 0
        assert 'realtime' not in program.stderr


@pytest.mark.process
@pytest.mark.skipif(not may_lock(), reason='this user may not lock all memory')
def test_memory_is_locked(start, observer):
    program, = settled(start, observer, 'master', lock_memory=True)
    status = Path(f'/proc/{program.pid}/status').read_text()
    locked, resident = (int(re.search(rf'^{key}:\s+(\d+) kB', status, re.MULTILINE).group(1))
                        for key in ('VmLck', 'VmRSS'))
    assert locked > 0.5 * resident
    assert program.stop() == 0


@pytest.mark.process
@needs_slices
def test_slice_of_every_thread(start, observer):
    before = time_slice(0)
    for given, expected in (
            ({}, SLICE), ({'slice': OWN_SLICE}, OWN_SLICE), ({'slice': 0.0}, before)):
        program, = settled(start, observer, 'master', **given)
        found = {tid: time_slice(tid) for tid in threads(program)}
        assert len(found) > 5
        assert found == pytest.approx(dict.fromkeys(found, expected), abs=SLICE_ERROR)
        assert program.stop() == 0
        assert 'realtime' not in program.stderr


@pytest.mark.process
@pytest.mark.skipif(KERNEL < FIRST_WITH_SLICES, reason='Linux before 6.12 has no time slices')
def test_a_slice_leaves_niceness_and_other_scheduling_as_they_are():
    code = ('import os, sys; from spm_haptic_master.ros.realtime import *; nice = os.nice(1); '
            'set_time_slice(0, 0.0002); assert abs(time_slice(0) - 0.0002) < 1e-9; '
            'assert os.getpriority(os.PRIO_PROCESS, 0) == nice; '
            'os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0)); '
            'set_time_slice(0, 0.01); assert os.sched_getscheduler(0) == os.SCHED_BATCH')
    subprocess.run([sys.executable, '-c', code], check=True)


@pytest.mark.process
def test_the_rest_is_off_by_default(start, observer):
    program, = settled(start, observer, 'master')
    assert all(os.sched_getscheduler(tid) == os.SCHED_OTHER for tid in threads(program))
    assert all(os.sched_getaffinity(tid) == os.sched_getaffinity(0) for tid in threads(program))
    assert 'VmLck:\t       0 kB' in Path(f'/proc/{program.pid}/status').read_text()
    assert program.stop() == 0


@pytest.mark.process
@pytest.mark.skipif(shutil.which('setpriv') is None, reason='setpriv is not installed')
def test_without_the_privilege_a_warning_and_the_work_goes_on(observer):
    arrived = observer.collect(QuaternionStamped, 'orientation')
    with start_command([
            *(UNPRIVILEGED if os.getuid() == 0 else []),
            *executable('master', parameters={
                **SIM, 'realtime.priority': 80, 'realtime.lock_memory': True})]) as master:
        assert observer.spin_until(lambda: len(arrived) > 200, PATIENCE)
        assert master.stop() == 0
    assert master.stderr.count('WARN') == 2
    assert 'realtime.priority 80 not set' in master.stderr and 'CAP_SYS_NICE' in master.stderr
    assert 'realtime.lock_memory not set' in master.stderr and 'CAP_IPC_LOCK' in master.stderr
