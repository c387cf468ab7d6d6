# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop between a bus and the simulated encoders: SYNC from the bus, SYNC by itself, news."""

import time

import can
from encoder_frames import LAYOUTS, values
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.simulation.bus_runner import BusRunner
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.settings import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus

SYNC = 0x80
TPDOS = {layout.can_id for layout in LAYOUTS}


@pytest.fixture
def rig():
    """Give a function that makes the encoders' runner, and the other end of its bus."""
    with can.Bus(interface='virtual', channel='runner') as bus, \
            can.Bus(interface='virtual', channel='runner') as master:
        def make(node_ids=None, grid=None, faults=()):
            encoders = SimulatedBus(LAYOUTS, node_ids, make_motion(values('sim')),
                                    tuple(map(parse_fault, faults)), 60.0, 1)
            return BusRunner(bus, encoders, SYNC, grid), master
        yield make


def heard(master):
    """Return the identifiers that arrived."""
    found = []
    while (message := master.recv(0.0)) is not None:
        found.append(message.arbitration_id)
    return found


def test_each_sync_is_answered_by_all_encoders(rig):
    runner, master = rig()
    for _ in range(3):
        master.send(canopen.frame(SYNC))
    assert runner.step() == ()
    assert runner.cycles == 3
    found = heard(master)
    assert len(found) == 12 and set(found) == TPDOS


def test_nodes_boot_and_wait_for_their_start(rig):
    runner, master = rig(node_ids=(1, 2, 3, 4))
    runner.boot()
    assert heard(master) == [canopen.HEARTBEAT_BASE + node_id for node_id in (1, 2, 3, 4)]
    master.send(canopen.frame(SYNC))
    runner.step()
    assert runner.cycles == 0
    heard(master)
    master.send(canopen.nmt(canopen.NMT_START, 0))
    master.send(canopen.frame(SYNC))
    runner.step()
    assert runner.cycles == 1
    assert TPDOS <= set(heard(master))


def test_with_a_grid_it_sends_sync_and_answers_no_other(rig):
    runner, master = rig(grid=DeadlineGrid(0.001))
    master.send(canopen.frame(SYNC))
    for _ in range(5):
        runner.step()
    found = heard(master)
    assert found.count(SYNC) == runner.cycles
    assert len(found) == 5 * runner.cycles


def test_faults_are_reported_once_when_they_begin_and_end(rig):
    runner, master = rig(faults=('dropout:joint_1b@0+0.05',))
    master.send(canopen.frame(SYNC))
    assert runner.step() == ('dropout:joint_1b@0+0.05 begins',)
    assert runner.step() == ()
    time.sleep(0.06)
    assert runner.step() == ('dropout:joint_1b@0+0.05 ends',)


def test_a_fault_at_zero_affects_the_first_answers(rig):
    runner, master = rig(faults=('dropout:joint_1b@0',))
    master.send(canopen.frame(SYNC))
    runner.step()
    assert sorted(heard(master)) == [LAYOUTS[0].can_id, LAYOUTS[2].can_id, LAYOUTS[3].can_id]


def test_frames_of_another_program_are_heard_before_the_encoders_boot(rig):
    runner, master = rig(node_ids=(1, 2, 3, 4))
    for message in (canopen.frame(SYNC), canopen.nmt(canopen.NMT_START, 0),
                    canopen.frame(LAYOUTS[0].can_id, b'1234'),
                    canopen.frame(canopen.HEARTBEAT_BASE + 2, b'\x05'),
                    can.Message(arbitration_id=LAYOUTS[1].can_id, is_extended_id=True)):
        master.send(message)
    assert runner.listen() == [LAYOUTS[0].can_id, canopen.HEARTBEAT_BASE + 2]
    assert runner.listen() == []
