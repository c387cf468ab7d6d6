# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A simulated bus that is started beside another one reports it."""

import json
import os
import re

import pytest
from spm_haptic_master.benchmark.child_process import wait_until

PATIENCE = 60.0


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
def test_a_second_simulated_bus_hears_the_first(sim_bus, bus_channel):
    """On another group of the same port, too; it reports it, with the cure."""
    sim_bus()
    second = sim_bus(channel=bus_channel.replace('239.74', '239.75'))
    assert re.match(r'sim_bus: another program sends 0x70[1-4](, 0x70[1-4])* on '
                    r'udp_multicast 239\.75\.0\.\d+ port \d+, too: a second sim_bus, or encoders',
                    second.stderr), second.stderr
    assert 'CAN_CONFIG=\'{"port": 43114}\'' in second.stderr
    assert second.stderr.count('\n') == 1


@pytest.mark.process
def test_one_on_another_port_hears_nothing(sim_bus):
    port = json.loads(os.environ['CAN_CONFIG'])['port']
    programs = [sim_bus(), sim_bus(CAN_CONFIG=json.dumps({'port': port + 5000}))]
    assert [program.stderr for program in programs] == ['', '']
