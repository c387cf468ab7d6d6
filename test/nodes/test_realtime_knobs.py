# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A rig's knobs: what each does to the process, and what it says without the privilege."""

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import time

from geometry_msgs.msg import QuaternionStamped
from harness import environment, ROOT
import pytest

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.executables import PIPELINE
from spm_haptic_master.nodes.realtime import agreed, check_cpus

PROCESSES = ('master', *PIPELINE)
OFF = {'realtime.priority': 0, 'realtime.cpus': '', 'realtime.lock_memory': False,
       'realtime.gc': 'normal'}
# `setpriv` of util-linux gives privileges away; so does nobody without any.
UNPRIVILEGED = ['setpriv', '--bounding-set=-all', '--inh-caps=-all', '--no-new-privs']


def may_schedule() -> bool:
    """Tell whether this user may use SCHED_FIFO."""
    return subprocess.run([sys.executable, '-c', 'import os; os.sched_setscheduler('
                           '0, os.SCHED_FIFO, os.sched_param(1))'],
                          capture_output=True).returncode == 0


def may_lock() -> bool:
    """Tell whether this user may lock all memory."""
    return subprocess.run([sys.executable, '-c', 'import ctypes, sys; '
                           'sys.exit(ctypes.CDLL(None).mlockall(3) != 0)'],
                          capture_output=True).returncode == 0


def run_to_the_first_second(start, observer, name, **parameters):
    """Start a process with knobs and let it settle; return it."""
    program = start(name, parameters={'realtime.' + key: value
                                      for key, value in parameters.items()})
    deadline = time.monotonic() + 20.0
    while name not in observer.node.get_node_names() + ['master'] \
            and time.monotonic() < deadline:
        observer.spin(0.1)
    if name == 'master':
        assert observer.spin_until(
            lambda: observer.node.count_publishers('measured_js') > 0, 20.0)
    observer.spin(1.0)
    return program


def threads(program):
    return [int(tid) for tid in os.listdir(f'/proc/{program.pid}/task')]


@pytest.mark.skipif(not may_schedule(), reason='this user may not use SCHED_FIFO')
@pytest.mark.parametrize('name', PROCESSES)
def test_priority_reaches_every_thread(start, observer, name):
    program = run_to_the_first_second(start, observer, name, priority=7)
    for tid in threads(program):
        assert os.sched_getscheduler(tid) == os.SCHED_FIFO
        assert os.sched_getparam(tid).sched_priority == 7
    assert program.stop() == 0
    assert 'realtime' not in program.stderr


@pytest.mark.parametrize('name', PROCESSES)
def test_cores_of_every_thread(start, observer, name):
    core = max(os.sched_getaffinity(0))
    program = run_to_the_first_second(start, observer, name, cpus=f"'{core}'")
    assert all(os.sched_getaffinity(tid) == {core} for tid in threads(program))
    assert program.stop() == 0


@pytest.mark.skipif(not may_lock(), reason='this user may not lock all memory')
def test_memory_is_locked(start, observer):
    program = run_to_the_first_second(start, observer, 'master', lock_memory=True)
    status = Path(f'/proc/{program.pid}/status').read_text()
    locked, resident = (int(re.search(rf'^{key}:\s+(\d+) kB', status, re.MULTILINE).group(1))
                        for key in ('VmLck', 'VmRSS'))
    assert locked > 0.5 * resident
    assert program.stop() == 0


def test_off_by_default(start, observer):
    program = run_to_the_first_second(start, observer, 'master')
    assert all(os.sched_getscheduler(tid) == os.SCHED_OTHER for tid in threads(program))
    assert all(os.sched_getaffinity(tid) == os.sched_getaffinity(0) for tid in threads(program))
    assert 'VmLck:\t       0 kB' in Path(f'/proc/{program.pid}/status').read_text()
    assert program.stop() == 0


@pytest.mark.skipif(shutil.which('setpriv') is None, reason='there is no setpriv here')
def test_without_the_privilege_a_warning_and_the_work_goes_on(observer):
    arrived = observer.collect(QuaternionStamped, 'orientation')
    master = subprocess.Popen(
        [*(UNPRIVILEGED if os.getuid() == 0 else []), sys.executable, '-m', 'spm_haptic_master',
         'master', '--ros-args', '-p', 'realtime.priority:=80', '-p', 'realtime.lock_memory:=true'],
        cwd=ROOT, env=environment(), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        assert observer.spin_until(lambda: len(arrived) > 200, 30.0)
    finally:
        master.terminate()
        said = master.communicate(timeout=15.0)[1]
    assert master.returncode == 0
    assert said.count('WARN') == 2
    assert 'realtime.priority 80 not set' in said and 'CAP_SYS_NICE' in said
    assert 'realtime.lock_memory not set' in said and 'CAP_IPC_LOCK' in said


@pytest.mark.parametrize(('text', 'cores'), [('0', {0}), ('0,1', {0, 1}), ('0-1', {0, 1})])
def test_list_of_cores(monkeypatch, text, cores):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1, 2, 3})
    assert check_cpus(text) == cores


@pytest.mark.parametrize('text', ['x', '-1', '1-0', '0,', '4', '0-4', '0;1'])
def test_no_list_of_cores(monkeypatch, text):
    monkeypatch.setattr(os, 'sched_getaffinity', lambda _: {0, 1, 2, 3})
    with pytest.raises(SettingError, match='realtime.cpus'):
        check_cpus(text)


def test_nodes_of_one_process_agree():
    assert agreed([OFF, OFF]) == OFF
    assert agreed([OFF, {**OFF, 'realtime.priority': 80}])['realtime.priority'] == 80
    with pytest.raises(SettingError, match='the same on every node of one process'):
        agreed([{**OFF, 'realtime.gc': 'disable'}, {**OFF, 'realtime.gc': 'freeze'}])
