# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: their answers to a master, what each fault does, and their loop on a bus."""

from dataclasses import replace
import time

import can
from encoder_frames import LAYOUTS, values
from harness import DATA
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.bus_runner import BusRunner
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_nodes import NodeOptions
from spm_haptic_master.timing import DeadlineGrid

START = canopen.nmt(canopen.NMT_START, 0)
SYNC = 0x80
TPDOS = [layout.can_id for layout in LAYOUTS]
# Heartbeats of the encoders (s), and times between frames that differ from it.
HEARTBEAT = 0.05


def bus_of(*faults, node_ids=(1, 2, 3, 4), layouts=LAYOUTS, factory=False):
    """Return encoders that are switched on, at rest, without noise."""
    motion = make_motion(values('sim', sim__noise_deg=0.0, sim__trajectory='fixed'))
    options = NodeOptions(factory=factory, heartbeat=HEARTBEAT)
    bus = SimulatedBus(
        layouts,
        node_ids,
        motion,
        tuple(map(parse_fault, faults)),
        1,
        options,
    )
    bus.boot()
    return bus


def text(message):
    kind = 'error ' if message.is_error_frame else ''
    return f'{kind}{message.arbitration_id:X}#{message.data.hex().upper()}'


def request(row):
    identifier, _, data = row.partition('#')
    return canopen.frame(int(identifier, 16), bytes.fromhex(data))


def started(*faults):
    """Return encoders that have answered once, at 10 s."""
    bus = bus_of(*faults)
    bus.receive(START)
    bus.cycle(10.0)
    return bus


def angles(messages):
    """Return the angles of TPDOs by encoder, rad."""
    found = {
        message.arbitration_id - 0x181: message
        for message in messages
        if 0x181 <= message.arbitration_id <= 0x184
    }
    return {
        index: LAYOUTS[index].angle(LAYOUTS[index].counts(bytes(message.data)))
        for index, message in found.items()
    }


TRUE = angles(started().cycle(11.0))
ALL = dict.fromkeys(range(4))


def off_by(changes):
    """Return the true angles with some off, deg; one that is off by None does not come."""
    expected = {}
    for index, angle in TRUE.items():
        off = changes.get(index, 0.0)
        if off is not None:
            expected[index] = angle + np.radians(off)
    return pytest.approx(expected, abs=4e-4)


@pytest.mark.parametrize(
    ('fault', 'during', 'after'),
    [
        ('dropout:joint_1b@1+1', {1: None}, {}),
        ('unplug:joint_1b@1+1', {1: None}, {}),
        ('silence@1+1', ALL, {}),
        ('busoff@1+1', ALL, {}),
        ('loss:joint_1a@1+1=100', {0: None}, {}),
        ('late:joint_3a@1+1=3', {3: None}, {}),
        ('offset:joint_3a@1+1=2', {3: 2.0}, {}),
        ('jump:joint_1a@1+1=-5', {0: -5.0}, {}),
        ('reboot:joint_1c@1+1', {2: None}, {2: None}),
    ],
)
def test_a_fault_does_what_it_says_and_ends(fault, during, after):
    bus = started(fault)
    bus.tend(10.5)
    assert angles(bus.cycle(10.5)) == off_by({})
    assert bus.faults.take_news() == ()
    bus.tend(11.0)
    assert angles(bus.cycle(11.0)) == off_by(during)
    assert bus.faults.take_news() == (f'{fault} begins',)
    bus.tend(12.0)
    assert angles(bus.cycle(12.0)) == off_by(after)
    assert bus.faults.take_news() == (f'{fault} ends',)
    bus.receive(START)
    assert len(bus.cycle(12.1)) == 4


def test_faults_of_a_kind_that_lasts():
    bus = started(
        'jump:joint_1a@1=5',
        'stuck:joint_1b@1+1',
        'offset:joint_1b@2+1=2',
        'noise:joint_1c@1=1',
        'loss:joint_3a@1=25',
    )
    found = []
    for t in np.arange(11.0, 14.0, 0.01):
        bus.tend(t)
        found.append(angles(bus.cycle(t)))
    # A jump is one answer; what is stuck repeats its angle until the end.
    true = [TRUE[index] for index in range(3)]
    off = np.array([[each[index] for index in range(3)] for each in found]) - true
    assert np.degrees(off[0, 0]) == pytest.approx(5.0, abs=0.03)
    assert np.abs(off[1:, 0]).max() < 4e-4
    assert np.abs(off[:98, 1]).max() < 4e-4
    assert np.degrees(off[102:198, 1]) == pytest.approx(2.0, abs=0.03)
    assert np.degrees(off[:, 2].std()) == pytest.approx(1.0, rel=0.15)
    assert sum(3 not in each for each in found) == pytest.approx(75, abs=25)


def test_late_answers_come_in_their_order_and_all_at_the_end():
    """Also between two cycles."""
    bus = started('late:joint_1a@1+1=0.0025')
    arrived = []
    for k in range(1000, 2010):
        t = 10.0 + 0.001 * k
        messages = list(bus.tend(t))
        if k % 2 == 0:
            messages += bus.cycle(t)
        for message in messages:
            if message.arbitration_id == 0x181:
                arrived.append(k)
    assert arrived[:3] == [1003, 1005, 1007]
    assert arrived.count(2000) == 2
    assert len(arrived) == 505


def test_emergencies_boot_ups_and_error_frames_are_sent_once():
    bus = started(
        'emcy:joint_1b@1+1=0x8130', 'reboot:joint_3a@3+1', 'busoff@6+1', 'unplug:joint_1a@9+1'
    )
    sent = []
    for t in np.arange(10.0, 21.0, 0.02):
        sent += [(t, text(message)) for message in bus.tend(t)]
    others = [(t, frame) for t, frame in sent if not frame.endswith(('#05', '#7F'))]
    assert [frame for _, frame in others] == [
        '82#3081010000000000',
        '82#0000000000000000',
        '704#00',
        f'error 40#{8 * "00"}',
        f'error 100#{8 * "00"}',
    ]
    assert [t for t, _ in others] == pytest.approx([11.0, 12.0, 14.0, 16.0, 17.0], abs=0.03)
    beats = [sum(frame == f'70{node}#05' for _, frame in sent) for node in (1, 2, 3)]
    # Every 0.05 s, on a grid of 0.02 s; none for the time of bus-off, of one none when unplugged.
    assert beats == pytest.approx([180.0, 200.0, 200.0], abs=3.0)


def test_a_stuck_counter_repeats_its_value_in_the_second_pdo():
    layouts = tuple(
        replace(
            layout,
            can_id=layout.can_id + 0x100,
            counter_byte=3,
            counter_mask=0xF0,
        )
        for layout in LAYOUTS
    )
    bus = bus_of('counter:joint_1a@1', layouts=layouts)
    (answer,) = bus.receive(request('601#4001180100000000'))
    assert text(answer) == '581#4301180181020040'
    bus.receive(START)
    bus.cycle(10.0)
    bus.tend(11.0)
    found = []
    for _ in range(3):
        first, second, *_ = bus.cycle(11.0)
        found.append([layouts[0].counter(bytes(each.data)) for each in (first, second)])
    assert found == [[1, 2], [1, 3], [1, 4]]


@pytest.mark.parametrize('name', ['encoders_set_up', 'encoders_of_their_maker'])
def test_a_conversation_as_cia_301_has_it(name):
    """Rows of requests, each with all answers; `tend`: what they send by themselves."""
    bus = bus_of(factory=name != 'encoders_set_up')
    for row in (DATA / 'simulation' / f'{name}.txt').read_text().splitlines():
        asked, _, answers = row.partition(' ->')
        if asked == '80#':
            found = bus.cycle(10.0)
        elif asked == 'tend':
            found = bus.tend(10.0)
        else:
            found = bus.receive(request(asked))
        assert [text(message) for message in found] == answers.split(), row


def test_what_is_not_for_the_encoders_is_ignored():
    bus = bus_of()
    for changes in ({'is_extended_id': True}, {'is_remote_frame': True}, {'is_error_frame': True}):
        message = can.Message(
            **{
                'arbitration_id': 0,
                'is_extended_id': False,
                'data': b'\1\0',
                **changes,
            }
        )
        assert bus.receive(message) == []
    assert bus.cycle(10.0) == []
    assert bus_of(node_ids=None).receive(request('601#4000100000000000')) == []
    assert bus.identifiers() == [
        *((False, 0x180 + node) for node in (1, 2, 3, 4)),
        *((False, 0x700 + node) for node in (1, 2, 3, 4)),
    ]


@pytest.fixture
def rig():
    """Give a function that makes the encoders' runner, and the other end of its bus."""
    with (
        can.Bus(interface='virtual', channel='runner') as bus,
        can.Bus(interface='virtual', channel='runner') as master,
    ):

        def make(node_ids=None, grid=None, faults=(), sync_id=SYNC, record=None):
            encoders = SimulatedBus(
                LAYOUTS,
                node_ids,
                make_motion(values('sim')),
                tuple(map(parse_fault, faults)),
                1,
                NodeOptions(synchronised=sync_id is not None, heartbeat=60.0),
            )
            return BusRunner(bus, encoders, sync_id, grid, record), master

        yield make


def heard(master):
    """Return the identifiers that arrived."""
    return [message.arbitration_id for message in iter(lambda: master.recv(0.0), None)]


def test_frames_of_these_encoders_from_another_program_are_heard_before_they_boot(rig):
    runner, master = rig(node_ids=(1, 2, 3, 4))
    for identifier in (0x702, TPDOS[0], 0x705):
        master.send(canopen.frame(identifier))
    assert runner.listen() == [TPDOS[0], 0x702]


def test_each_sync_is_answered_by_all_encoders_as_soon_as_they_are_started(rig):
    """But for faults; one at 0 s is present in the first answers, and reported once."""
    runner, master = rig(node_ids=(1, 2, 3, 4), faults=('dropout:joint_1b@0',))
    runner.boot()
    assert heard(master) == [canopen.HEARTBEAT_BASE + node_id for node_id in (1, 2, 3, 4)]
    for expected, news in ((0, ()), (3, ('dropout:joint_1b@0 begins',))):
        for _ in range(3):
            master.send(canopen.frame(SYNC))
        assert (runner.step(), runner.cycles) == (news, expected)
        assert [each for each in heard(master) if each < 0x700] == expected * [
            TPDOS[0],
            *TPDOS[2:],
        ]
        master.send(canopen.nmt(canopen.NMT_START, 0))
        assert runner.step() == ()
        heard(master)


@pytest.mark.parametrize('sync_id', [SYNC, None])
def test_with_a_grid_it_sends_by_itself_and_answers_no_sync(sync_id, rig):
    runner, master = rig(grid=DeadlineGrid(0.001), sync_id=sync_id)
    master.send(canopen.frame(SYNC))
    for _ in range(5):
        runner.step()
    assert heard(master) == ([SYNC] * (sync_id is not None) + TPDOS) * runner.cycles
    assert runner.cycles > 0


def test_encoders_sample_when_sync_comes_unless_its_clock_has_another_epoch(rig, monkeypatch):
    """What is recorded is the time of the sample."""
    found = []
    runner, _ = rig(record=lambda stamp, _: found.append(time.time() - 1e-9 * stamp))
    for age in (0.05, 1e6, -5.0):
        sync = canopen.frame(SYNC)
        sync.timestamp = time.time() - age
        frames = iter((sync, None))
        monkeypatch.setattr(runner._bus, 'recv', lambda timeout, frames=frames: next(frames))
        runner.step()
    assert found == pytest.approx([0.05, 0.1, 0.0], abs=0.04)
