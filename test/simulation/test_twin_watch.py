# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A second simulated bus is noticed, an echo of the own frames is not taken for one."""

import json
import os
import re

import can
import pytest
from spm_haptic_master.benchmark.child_process import wait_until
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.twin_watch import TwinWatch

PATIENCE = 60.0
MINE = [(False, 0x181), (True, 0x181), (False, 0x701)]


def windows(echoes, sent, received, count=3):
    """Return what is reported at the end of each window of frames."""
    watch = TwinWatch(MINE, echoes)
    watch.poll(0.0)
    found = []
    for number in range(1, count + 1):
        for counter, messages in ((watch.sent, sent), (watch.received, received)):
            for message, times in messages:
                for _ in range(times):
                    counter(message)
        assert watch.poll(number - 0.1) == []
        found.append(watch.poll(1.01 * number))
    return found


ANSWER, HEARTBEAT = canopen.frame(0x181, b'1234'), canopen.frame(0x701, b'\x05')


@pytest.mark.parametrize(('echoes', 'sent', 'received', 'expected'), [
    (True, [(ANSWER, 1000)], [(ANSWER, 1003)], []),
    (True, [(ANSWER, 1000)], [(ANSWER, 2000)], [0x181]),
    (True, [], [(ANSWER, 1000), (HEARTBEAT, 10)], [0x181, 0x701]),
    (False, [(ANSWER, 1000)], [], []),
    (False, [(ANSWER, 1000)], [(ANSWER, 1000)], [0x181]),
    (False, [(HEARTBEAT, 10)], [(HEARTBEAT, 10)], [0x701]),
    (False, [(HEARTBEAT, 10)], [(HEARTBEAT, 3)], []),
    # SYNC, NMT and others are not the encoders' own.
    (True, [], [(canopen.frame(0x80), 1000), (canopen.frame(0), 10)], []),
    # An interface that marks its own frames.
    (False, [(ANSWER, 1000)], [(can.Message(arbitration_id=0x181, is_extended_id=False,
                                            is_rx=False), 1000)], []),
])
def test_frames_beyond_the_own_are_reported_once(echoes, sent, received, expected):
    assert windows(echoes, sent, received) == [expected, [], []]


def test_a_twin_that_came_back_is_reported_again():
    watch = TwinWatch(MINE, False)
    found = []
    for number, frames in enumerate((0, 10, 10, 0, 10)):
        for _ in range(frames):
            watch.received(ANSWER)
        found.append(watch.poll(1.01 * number))
    assert found == [[], [0x181], [], [], [0x181]]


@pytest.fixture
def sim_bus(start, bus_channel):
    """Start a simulated bus and wait until it is up."""
    def begin(channel=bus_channel, **environment):
        program = start('sim_bus', '--sync', '-p', 'can.interface:=udp_multicast',
                        '-p', f'can.channel:={channel}', '-p', 'rate:=50.0', **environment)
        assert wait_until(lambda: 'four encoders' in program.stdout, PATIENCE), program.stderr
        return program
    return begin


@pytest.mark.process
def test_two_simulated_buses_hear_each_other(sim_bus, bus_channel):
    """On another group of the same port, too; both report it, with the cure."""
    first = sim_bus()
    second = sim_bus(channel=bus_channel.replace('239.74', '239.75'))
    for program, channel in ((first, '239.74'), (second, '239.75')):
        assert wait_until(lambda p=program: '\n' in p.stderr, PATIENCE)
        # The window in which the other began may show some of the four only.
        assert re.match(r'sim_bus: another program sends 0x70[1-4](, 0x70[1-4])* on '
                        rf'udp_multicast {channel}\.0\.\d+ port \d+, too: a second sim_bus, or '
                        r'encoders',
                        program.stderr), program.stderr
        assert 'CAN_CONFIG=\'{"port": 43114}\'' in program.stderr
        assert program.stderr.count('\n') == 1


@pytest.mark.process
def test_two_simulated_buses_on_two_ports_do_not(sim_bus):
    port = json.loads(os.environ['CAN_CONFIG'])['port']
    programs = [sim_bus(), sim_bus(CAN_CONFIG=json.dumps({'port': port + 5000}))]
    assert not wait_until(lambda: any(program.stderr for program in programs), 4.0)
