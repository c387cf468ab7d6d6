# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A stderr that nobody reads, as a held terminal: samples, reasons and the end go on."""

import signal
import sys
import time

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from disturbance import Disturbance
from geometry_msgs.msg import QuaternionStamped
from harness import full_pipe, SIMULATED, start_command
import pytest
from rcl_interfaces.msg import Log

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
def test_a_full_pipe_delays_neither_samples_nor_reasons_nor_the_end(start, observer, bus_channel):
    bus = ('-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel}')
    orientations = observer.collect(QuaternionStamped, 'orientation')
    entries = observer.collect(DiagnosticArray, '/diagnostics')
    log = observer.collect(Log, '/rosout')
    with full_pipe() as (_, writing):
        program = start('master', *bus, '-p', 'source:=can', *SIMULATED, error_to=writing)
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
            program.send_signal(signal.SIGINT)
            code, took = program.wait(PATIENCE), time.monotonic() - began
        # A process that gets no time in END_TIMEOUT is ended by the kernel.
        machine.expect(code == 0, code)
        machine.expect(took < LONGEST_END, took)


def test_the_last_line_does_not_wait_for_a_reader():
    with full_pipe() as (_, writing):
        program = start_command(
            [sys.executable, '-m', 'spm_haptic_master', 'fkm', '--ros-args', '-p', 'rate:=0'],
            error_to=writing)
        assert program.wait(PATIENCE) == 1
