# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Nothing is left behind however a process is ended, and nothing waits for a reader of stderr."""

import os
from pathlib import Path
import re
import signal
import sys
import time

from benchmarks.pipeline.child_process import Program, wait_until
from benchmarks.pipeline.run import all_processes, TICK
from diagnostic_msgs.msg import DiagnosticArray
from disturbance import BESIDE_OTHERS, descendants, Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import complaints, full_pipe, ROOT, SIM, start_command
import pytest
from rcl_interfaces.msg import Log
from spm_haptic_master.executables import PIPELINE
from std_msgs.msg import String

pytestmark = pytest.mark.process

PROCESSES = ('master', *PIPELINE, 'recorder', 'teleop', 'presence', 'sim_slave')
# Time for what a busy machine does late (s).
PATIENCE = 60.0


def shared_memory(pid: int) -> set[str]:
    """Return the shared-memory files of Fast DDS that a process has mapped."""
    return set(re.findall(r'/dev/shm/\S*fast\S*', Path(f'/proc/{pid}/maps').read_text()))


def interrupted(start, is_due, times: int) -> Program:
    """Return a master that has ended by so many Ctrl-C, and had no shared memory."""
    master = start('master', parameters=SIM)
    end = time.monotonic() + PATIENCE
    while not is_due(master) and time.monotonic() < end:
        time.sleep(0.005)
    assert not shared_memory(master.pid)
    for _ in range(times):
        master.send_signal(signal.SIGINT)
        time.sleep(0.03)
    master.wait()
    return master


def test_two_ctrl_c_leave_no_process_and_no_shared_memory(start):
    with Disturbance(BESIDE_OTHERS) as machine:
        master = interrupted(start, lambda master: 'psi' in master.stdout, 2)
    # An end that takes longer than its limit is reported as such.
    machine.expect((master.wait(), complaints(master)) == (0, ''), (master.wait(), master.stderr))


# In CPU time, so that a busy machine interrupts the same steps of the start.
@pytest.mark.parametrize(('used', 'times'), [(0.2, 3), (0.6, 1)])
def test_ctrl_c_while_it_starts_leaves_nothing_behind(start, used, times):
    master = interrupted(
        start, lambda master: all_processes()[master.pid][1] * TICK >= used, times
    )
    # Before the package's first line runs, Python itself may end with its own message.
    assert master.wait() in (0, -signal.SIGINT) or 'init_import_site' in master.stderr, (
        master.stderr
    )
    # `start` has given SIGINT its default action in time.
    assert 'in start\n' not in master.stderr


STUCK = """
import time

import rclpy.utilities
from spm_haptic_master.nodes import master

rclpy.utilities.try_shutdown = lambda: time.sleep(600.0)
master.main(['master', '--ros-args', '-p', 'source:=sim'])
"""


def test_an_end_without_a_reader_takes_five_seconds_from_the_signal_on():
    """The kernel ends the process, which cannot say that it is stuck."""
    with full_pipe() as (_, writing):
        program = start_command([sys.executable, '-c', STUCK], error_to=writing)
        assert wait_until(lambda: 'psi' in program.stdout, PATIENCE)
        program.send_signal(signal.SIGINT)
        assert program.wait(PATIENCE) == -signal.SIGALRM


def test_a_process_that_receives_nothing_ends_too(start, observer):
    # In a namespace each: nobody publishes what another one of them subscribes to.
    programs = {
        name: start(name, '--ros-args', '-r', f'__ns:=/alone_{name}', parameters=SIM)
        for name in PROCESSES
    }
    assert observer.spin_until(
        lambda: (
            {f'/alone_{name}' for name in PROCESSES}
            <= {namespace for _, namespace in observer.node.get_node_names_and_namespaces()}
        ),
        PATIENCE,
    )
    observer.spin(0.5)
    assert {
        name: program.stop(signal.SIGTERM) for name, program in programs.items()
    } == dict.fromkeys(PROCESSES, 0)


@pytest.mark.skipif(Path(sys.prefix) != ROOT / '.venv', reason='not in the .venv of make')
def test_make_run_ends_with_all_its_processes(observer):
    """As from a terminal, where Ctrl-C reaches make and what it started alike."""
    arrived = observer.collect(QuaternionStamped, 'orientation')
    make = start_command(['make', '-s', 'run'], new_session=True)
    try:
        assert observer.spin_until(lambda: len(arrived) > 50, PATIENCE)
        started = descendants(make.pid)
        assert started
        os.killpg(make.pid, signal.SIGINT)
        time.sleep(0.05)
        os.killpg(make.pid, signal.SIGINT)
        make.wait()
    finally:
        if make.poll() is None:
            os.killpg(make.pid, signal.SIGKILL)
    assert 'Traceback' not in make.stderr
    assert wait_until(lambda: not any(Path(f'/proc/{pid}').exists() for pid in started), PATIENCE)


def test_a_full_pipe_delays_neither_samples_nor_reasons_nor_the_end(start, observer):
    orientations = observer.collect(QuaternionStamped, 'orientation')
    entries = observer.collect(DiagnosticArray, '/diagnostics')
    log = observer.collect(Log, '/rosout')
    faults = observer.node.create_publisher(String, 'simulation/fault', 1)
    with full_pipe() as (_, writing):
        program = start('master', parameters=SIM, error_to=writing)
        assert observer.spin_until(
            lambda: faults.get_subscription_count() and len(orientations) > 100, PATIENCE
        )
        # A line of the log that nobody reads: rclpy's own log would stop the process.
        faults.publish(String(data='dropout:joint_3a'))
        assert observer.spin_until(
            lambda: any(line.level == Log.ERROR for _, line in log), PATIENCE
        )
        assert observer.spin_until(
            lambda: any(
                entry.message == 'silent: no joint samples'
                for _, array in entries
                for entry in array.status
                if entry.name == 'fkm: orientation'
            ),
            PATIENCE,
        )
        del orientations[:]
        faults.publish(String())
        assert observer.spin_until(lambda: len(orientations) > 1000, PATIENCE)
        with Disturbance(BESIDE_OTHERS) as machine:
            code = program.stop(signal.SIGINT)
        # A process that gets no time in END_TIMEOUT is ended by the kernel.
        machine.expect(code == 0, code)


def test_the_last_line_does_not_wait_for_a_reader():
    with full_pipe() as (_, writing):
        program = start_command(
            [sys.executable, '-m', 'spm_haptic_master', 'fkm', '--ros-args', '-p', 'rate:=0'],
            error_to=writing,
        )
        assert program.wait(PATIENCE) == 1
