# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A stderr that nobody reads, as a held terminal: samples, reasons and the end go on."""

import signal
import sys
import textwrap
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import full_pipe, SIMULATED, start_command
import pytest
from rcl_interfaces.msg import Log
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.executables import PIPELINE

pytestmark = pytest.mark.process

# Time that a busy machine may need for a program (s).
PATIENCE = 60.0
# Orientations at 1 kHz on a bus that is silent for 0.4 s of each second, and the longest time for
# them (s): three times as long as it would take.
ENOUGH, LONGEST_WAIT = 2000, 10.0
# Longest end of a process after a signal (s).
LONGEST_END = 2.0
# The bus fails again and again, as one with a bad contact, for as long as a busy machine needs.
FLAPPING = [option for number in range(2, 60)
            for option in ('--fault', f'silence@{number}+0.4')]


@pytest.mark.alone
@pytest.mark.parametrize('names', [('master',), PIPELINE], ids=['master', 'three processes'])
def test_a_full_pipe_delays_neither_samples_nor_reasons_nor_the_end(
        start, observer, bus_channel, names):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    entries = observer.collect(DiagnosticArray, '/diagnostics')
    log = observer.collect(Log, '/rosout')
    with full_pipe() as (_, writing):
        programs = [start(name, *(
            (*bus, '-p', 'source:=can', *SIMULATED) if name in ('master', 'encoder_driver')
            else ()), error_to=writing) for name in reversed(names)]
        simulated = start('sim_bus', *bus, '--sync', *FLAPPING)

        def reasons(name):
            return {entry.message for _, array in entries for entry in array.status
                    if entry.name == name and entry.level == DiagnosticStatus.ERROR}

        def logged(node, severity):
            return [line.msg for _, line in log
                    if line.name.endswith(node) and line.level == severity]

        # Each node has logged an error and its end: lines that nobody read. rclpy's own log would
        # have stopped the process at the first one.
        assert observer.spin_until(
            lambda: logged('encoder_driver', Log.ERROR) and logged('fkm', Log.ERROR)
            and logged('fkm', Log.INFO), PATIENCE), (simulated.stdout, simulated.stderr)
        before = len(orientations)
        with Disturbance() as machine:
            began = time.monotonic()
            assert observer.spin_until(lambda: len(orientations) > before + ENOUGH, PATIENCE)
            took = time.monotonic() - began
        machine.expect(took < LONGEST_WAIT, took)
        found = reasons('encoder_driver: encoders')
        assert any('no frames' in reason for reason in found), found
        assert 'silent: no joint samples' in reasons('fkm: orientation')
        with Disturbance() as machine:
            began = time.monotonic()
            for program in programs:
                program.send_signal(signal.SIGINT)
            codes = [program.wait(PATIENCE) for program in programs]
            took = time.monotonic() - began
        # A process that gets no time in END_TIMEOUT is ended by the kernel.
        machine.expect(codes == [0] * len(programs), codes)
        machine.expect(took < LONGEST_END, took)


def test_a_line_that_comes_again_is_counted(start, observer, bus_channel):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}')
    master = start('master', *bus, '-p', 'source:=can', *SIMULATED)
    simulated = start('sim_bus', *bus, '--sync', *FLAPPING)
    assert wait_until(lambda: simulated.stdout.count('ends') >= 5, PATIENCE), simulated.stderr
    assert master.stop(signal.SIGINT) == 0
    lines = [line.partition(']: ')[2] for line in master.stderr.splitlines()]
    assert lines.count('silent: no joint samples') == 1
    assert any(line.startswith('silent: no joint samples (') and ' more time' in line
               for line in lines)


def test_an_end_that_hangs_ends_without_a_reader():
    """The report of where it hangs waits for a reader: the kernel ends the process."""
    with full_pipe() as (_, writing):
        program = start_command([sys.executable, '-c', textwrap.dedent("""
            import time
            from spm_haptic_master.ros import runner
            from spm_haptic_master.ros.parameters import ParameterNode

            class Stuck(ParameterNode):
                def __init__(self, parameters):
                    super().__init__('stuck', parameters)

                def destroy_node(self):
                    time.sleep(600.0)

            runner.END_TIMEOUT = 1.0
            runner.run('stuck', lambda done, add: done.set_result(add(Stuck) and None),
                       [])
            """)], error_to=writing)
        assert program.wait(PATIENCE) == -signal.SIGALRM


def test_the_last_line_does_not_wait_for_a_reader():
    with full_pipe() as (_, writing):
        program = start_command(
            [sys.executable, '-m', 'spm_haptic_master', 'fkm', '--ros-args', '-p', 'rate:=0'],
            error_to=writing)
        assert program.wait(PATIENCE) == 1
