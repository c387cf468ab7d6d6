# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From start to the first orientation, and nothing left behind however it is ended."""

import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import textwrap
import time

from geometry_msgs.msg import QuaternionStamped
from harness import environment, ROOT
import pytest

from spm_haptic_master.executables import PIPELINE

PROCESSES = ('master', *PIPELINE, 'recorder')
SHARED_MEMORY = re.compile(r'/dev/shm/\S*fast\S*')


def shared_memory(pid: int) -> set[str]:
    """Return the shared-memory files of Fast DDS that a process has mapped."""
    return set(SHARED_MEMORY.findall(Path(f'/proc/{pid}/maps').read_text()))


def left_behind(files: set[str]) -> list[str]:
    """Return those of the files that are there still, and that no other process uses."""
    used = set()
    for path in Path('/proc').glob('[0-9]*'):
        try:
            used |= shared_memory(int(path.name))
        except OSError:
            continue  # it has ended
    return [name for name in files - used if Path(name).exists()]


def children(pid: int) -> set[int]:
    """Return the processes whose parent is `pid`, and theirs."""
    found = set()
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            parent = int(path.read_text().rpartition(')')[2].split()[1])
        except (FileNotFoundError, ProcessLookupError):
            continue
        if parent == pid:
            child = int(path.parent.name)
            found |= {child} | children(child)
    return found


# Another participant on this host, coming or going just then, may hold one of the port files.
@pytest.mark.flaky(reruns=2)
@pytest.mark.parametrize('pause', [0.0, 0.002, 0.02, 0.1, 0.5])
def test_two_ctrl_c_leave_no_process_and_no_shared_memory(start, pause):
    # Nobody else is in the domain: an observer's own files would be among those mapped.
    master = start('master')
    deadline = time.monotonic() + 30.0
    while 'psi' not in master.stdout and time.monotonic() < deadline:
        time.sleep(0.05)
    mapped = shared_memory(master.pid)
    assert mapped
    for _ in range(2):
        if master.poll() is None:
            master.send_signal(signal.SIGINT)
        time.sleep(pause)
    assert master.wait() == 0
    assert master.stderr == ''
    assert left_behind(mapped) == []


@pytest.mark.flaky(reruns=2)
@pytest.mark.parametrize('times', [1, 3])
@pytest.mark.parametrize('delay', [0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0])
def test_ctrl_c_while_it_starts_leaves_nothing_behind(start, delay, times):
    master = start('master')
    time.sleep(delay)
    mapped = shared_memory(master.pid)
    for _ in range(times):
        if master.poll() is None:
            master.send_signal(signal.SIGINT)
        time.sleep(0.03)
    assert master.wait() in (0, -signal.SIGINT)
    assert left_behind(mapped) == []


def test_an_end_that_hangs_is_cut_short_and_tells_where():
    program = textwrap.dedent("""
        import time
        from rclpy.node import Node
        from spm_haptic_master.nodes import runner

        class Stuck(Node):
            def destroy_node(self):
                time.sleep(60.0)

        runner.END_TIMEOUT = 1.0
        runner.run('stuck', lambda done, add: done.set_result(add(Stuck('stuck')) and None), [])
        """)
    done = subprocess.run([sys.executable, '-c', program], cwd=ROOT, env=environment(),
                          capture_output=True, text=True, timeout=30.0)
    assert done.returncode == 1
    assert 'in destroy_node' in done.stderr


@pytest.mark.parametrize('name', PROCESSES)
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_process_that_hears_nothing_ends_too(start, observer, name, number):
    program = start(name)
    assert observer.spin_until(
        lambda: {name, 'fkm'} & set(observer.node.get_node_names()), 30.0)
    observer.spin(0.5)
    assert program.stop(number) == 0


@pytest.mark.skipif(Path(sys.prefix) != ROOT / '.venv', reason='not in the .venv of make')
def test_make_run_ends_with_all_its_processes(observer):
    """As from a terminal, where Ctrl-C reaches make and what it started alike."""
    arrived = observer.collect(QuaternionStamped, 'orientation')
    make = subprocess.Popen(
        ['make', '-s', 'run'], cwd=ROOT, env=environment(), stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        assert observer.spin_until(lambda: len(arrived) > 50, 30.0)
        started = children(make.pid)
        assert started
        os.killpg(make.pid, signal.SIGINT)
        time.sleep(0.05)
        os.killpg(make.pid, signal.SIGINT)
        make.wait(15.0)
    finally:
        if make.poll() is None:
            os.killpg(make.pid, signal.SIGKILL)
    assert 'Traceback' not in make.stderr.read()
    make.stderr.close()
    deadline = time.monotonic() + 5.0
    while any(Path(f'/proc/{pid}').exists() for pid in started) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not any(Path(f'/proc/{pid}').exists() for pid in started)
