# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop between a bus and the simulated encoders: SYNC from the bus, SYNC by itself, news."""

import time

import can
from encoder_frames import LAYOUTS, values
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import BusRunner, SimulatedBus

SYNC = 0x80
TPDOS = [layout.can_id for layout in LAYOUTS]


@pytest.fixture
def rig():
    """Give a function that makes the encoders' runner, and the other end of its bus."""
    with can.Bus(interface='virtual', channel='runner') as bus, \
            can.Bus(interface='virtual', channel='runner') as master:
        def make(node_ids=None, grid=None, faults=(), record=None, sync_id=SYNC, **settings):
            encoders = SimulatedBus(LAYOUTS, node_ids, make_motion(values('sim', **settings)),
                                    tuple(map(parse_fault, faults)), 60.0, 1,
                                    synchronised=sync_id is not None)
            return BusRunner(bus, encoders, sync_id, grid, record), master
        yield make


def heard(master):
    """Return the identifiers that arrived."""
    return [message.arbitration_id for message in iter(lambda: master.recv(0.0), None)]


def test_each_sync_is_answered_by_all_encoders_as_soon_as_they_are_started(rig):
    runner, master = rig(node_ids=(1, 2, 3, 4))
    runner.boot()
    assert heard(master) == [canopen.HEARTBEAT_BASE + node_id for node_id in (1, 2, 3, 4)]
    for expected in (0, 3):
        for _ in range(3):
            master.send(canopen.frame(SYNC))
        runner.step()
        assert runner.cycles == expected
        assert [each for each in heard(master) if each < 0x700] == expected * TPDOS
        master.send(canopen.nmt(canopen.NMT_START, 0))
        runner.step()
        heard(master)


@pytest.mark.parametrize('sync_id', [SYNC, None])
def test_with_a_grid_it_sends_by_itself_and_answers_no_sync(sync_id, rig):
    runner, master = rig(grid=DeadlineGrid(0.001), sync_id=sync_id)
    master.send(canopen.frame(SYNC))
    for _ in range(5):
        runner.step()
    assert heard(master) == ([SYNC] * (sync_id is not None) + TPDOS) * runner.cycles
    assert runner.cycles > 0


def test_a_fault_at_zero_affects_the_first_answers_and_is_reported_once(rig):
    runner, master = rig(faults=('dropout:joint_1b@0+0.05',))
    master.send(canopen.frame(SYNC))
    assert runner.step() == ('dropout:joint_1b@0+0.05 begins',)
    assert heard(master) == [TPDOS[0], *TPDOS[2:]]
    assert runner.step() == ()
    time.sleep(0.06)
    assert runner.step() == ('dropout:joint_1b@0+0.05 ends',)


def test_frames_of_another_program_are_heard_before_the_encoders_boot(rig):
    runner, master = rig(node_ids=(1, 2, 3, 4))
    for message in (canopen.frame(SYNC), canopen.nmt(canopen.NMT_START, 0),
                    canopen.frame(TPDOS[0], b'1234'),
                    canopen.frame(canopen.HEARTBEAT_BASE + 2, b'\x05'),
                    can.Message(arbitration_id=TPDOS[1], is_extended_id=True),
                    can.Message(arbitration_id=TPDOS[2], is_extended_id=False,
                                is_error_frame=True)):
        master.send(message)
    assert runner.listen() == [TPDOS[0], canopen.HEARTBEAT_BASE + 2]
    assert runner.listen() == []


def test_the_recorded_truth_is_that_at_each_sync(rig):
    truth, stamps = [], []
    runner, master = rig(record=lambda *each: truth.append(each), sim__trajectory='sweep')
    for _ in range(50):
        sync = canopen.frame(SYNC)
        sync.timestamp = time.time()
        stamps.append(sync.timestamp)
        master.send(sync)
        time.sleep(0.002)
        runner.step()
    motion = make_motion(values('sim', sim__trajectory='sweep'))
    times = np.array([1e-9 * (stamp - truth[0][0]) for stamp, _ in truth])
    # Most of them: a busy machine may pause between two readings of its clocks.
    assert 0.0 <= np.median([1e-9 * stamp for stamp, _ in truth] - np.array(stamps)) < 1e-3
    off = np.array([q for _, q in truth]) - list(map(motion.orientation, times))
    assert len(off) == 50 and np.median(np.abs(off).max(axis=1)) < 1e-3
