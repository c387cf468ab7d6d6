# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated encoders: their answers to a master, what each fault does, and their loop on a bus."""

from dataclasses import replace
import time

import can
from encoder_frames import LAYOUTS, values
import numpy as np
import pytest
from spm_haptic_master.encoders import canopen
from spm_haptic_master.simulation.bus_runner import BusRunner
from spm_haptic_master.simulation.fault_injection import parse_fault
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.timing import DeadlineGrid

START = canopen.nmt(canopen.NMT_START, 0)
SYNC = 0x80
TPDOS = [layout.can_id for layout in LAYOUTS]
# Heartbeats of the encoders (s), and times between frames that differ from it.
HEARTBEAT = 0.05


def bus_of(*faults, node_ids=(1, 2, 3, 4), layouts=LAYOUTS, factory=False):
    """Return encoders that are switched on, at rest, without noise."""
    motion = make_motion(values('sim', sim__noise_deg=0.0, sim__trajectory='fixed'))
    bus = SimulatedBus(layouts, node_ids, motion, tuple(map(parse_fault, faults)), HEARTBEAT, 1,
                       factory=factory)
    bus.boot()
    return bus


def text(message):
    return f'{message.arbitration_id:X}#{message.data.hex().upper()}'


def request(row):
    identifier, _, data = row.partition('#')
    return can.Message(arbitration_id=int(identifier, 16), data=bytes.fromhex(data),
                       is_extended_id=False)


def started(*faults):
    """Return encoders that have answered once, at 10 s."""
    bus = bus_of(*faults)
    bus.receive(START)
    bus.cycle(10.0)
    return bus


def angles(messages):
    """Return the angles of TPDOs by encoder, rad."""
    found = {message.arbitration_id - 0x181: message for message in messages
             if 0x181 <= message.arbitration_id <= 0x184}
    return {index: LAYOUTS[index].angle(LAYOUTS[index].counts(bytes(message.data)))
            for index, message in found.items()}


TRUE = angles(started().cycle(11.0))
ALL = dict.fromkeys(range(4))


@pytest.mark.parametrize(('fault', 'during', 'after'), [
    ('dropout:joint_1b@1+1', {1: None}, {}), ('unplug:joint_1b@1+1', {1: None}, {}),
    ('silence@1+1', ALL, {}), ('busoff@1+1', ALL, {}), ('loss:joint_1a@1+1=100', {0: None}, {}),
    ('late:joint_3a@1+1=3', {3: None}, {}), ('offset:joint_3a@1+1=2', {3: 2.0}, {}),
    ('jump:joint_1a@1+1=-5', {0: -5.0}, {}), ('reboot:joint_1c@1+1', {2: None}, {2: None})])
def test_a_fault_does_what_it_says_and_ends(fault, during, after):
    bus = started(fault)
    for t, expected, news in ((10.5, {}, []), (11.0, during, ['begins']), (12.0, after, ['ends'])):
        bus.tend(t)
        assert angles(bus.cycle(t)) == pytest.approx(
            {index: angle + np.radians(expected.get(index, 0.0)) for index, angle in TRUE.items()
             if expected.get(index, 0.0) is not None}, abs=4e-4)
        assert bus.faults.take_news() == tuple(f'{fault} {word}' for word in news)
    bus.receive(START)
    assert len(bus.cycle(12.1)) == 4


def test_faults_of_a_kind_that_lasts():
    bus = started('jump:joint_1a@1=5', 'stuck:joint_1b@1+1', 'offset:joint_1b@2+1=2',
                  'noise:joint_1c@1=1', 'loss:joint_3a@1=25')
    found = []
    for t in np.arange(11.0, 14.0, 0.01):
        bus.tend(t)
        found.append(angles(bus.cycle(t)))
    # A jump is one answer; what is stuck repeats its angle until the end.
    off = np.array([[each[index] - TRUE[index] for index in range(3)] for each in found])
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
        for message in (*bus.tend(t), *(bus.cycle(t) if k % 2 == 0 else ())):
            arrived += [k] * (message.arbitration_id == 0x181)
    assert arrived[:3] == [1003, 1005, 1007]
    assert arrived.count(2000) == 2 and len(arrived) == 505


def test_emergencies_boot_ups_and_error_frames_are_sent_once():
    bus = started('emcy:joint_1b@1+1=0x8130', 'reboot:joint_3a@3+1', 'busoff@6+1',
                  'unplug:joint_1a@9+1')
    came = [(t, message) for t in np.arange(10.0, 21.0, 0.02) for message in bus.tend(t)]
    sent = [message for _, message in came]
    others = [message for message in sent if message.arbitration_id < 0x700
              or bytes(message.data) == b'\0']
    assert [text(each) for each in others if not each.is_error_frame] == [
        '82#3081010000000000', '82#0000000000000000', '704#00']
    assert [(each.arbitration_id, each.is_extended_id, each.dlc)
            for each in others if each.is_error_frame] == [(0x40, False, 8), (0x100, False, 8)]
    (booted,) = [t for t, message in came if text(message) == '704#00']
    assert booted == pytest.approx(14.0, abs=0.03)
    beats = [sum(text(each) == f'70{node}#05' for each in sent) for node in (1, 2, 3)]
    # Every 0.05 s, on a grid of 0.02 s; none for the time of bus-off, of one none when unplugged.
    assert beats == pytest.approx([180.0, 200.0, 200.0], abs=3.0)


def test_a_stuck_counter_repeats_its_value():
    counted = tuple(replace(layout, counter_byte=3, counter_mask=0xF0) for layout in LAYOUTS)
    bus = bus_of('counter:joint_1a@1', node_ids=None, layouts=counted)
    bus.cycle(10.0)
    bus.tend(11.0)
    found = [[counted[0].counter(bytes(each.data)) for each in bus.cycle(11.0)[:2]]
             for _ in range(3)]
    assert found == [[1, 2], [1, 3], [1, 4]]


# Objects of encoders from their maker.
FACTORY = """
601#4000180100000000 -> 581#4300180181010040
603#4000180200000000 -> 583#4F001802FE000000
602#40001A0000000000 -> 582#4F001A0002000000
602#40001A0100000000 -> 582#43001A0120000460
602#40001A0200000000 -> 582#43001A0210013060
602#40001A0400000000 -> 582#43001A0400000000
602#40001A0500000000 -> 582#80001A0511000906
602#4001600000000000 -> 582#4301600000000100
602#4000600000000000 -> 582#4B00600000000000
602#4017100000000000 -> 582#4B17100000000000
000#0100 ->
80# ->"""
# Objects by SDO, NMT and SYNC of encoders that are set up; `tend`: what they send by themselves.
CONFIGURED = """
601#4000100000000000 -> 581#4300100096010100
609#4018100400000000 ->
601#4000200000000000 -> 581#8000200000000206
601#4018100900000000 -> 581#8018100911000906
601#2304600001000000 -> 581#8004600002000106
601#2318100105000000 -> 581#8018100102000106
602#2B171000C8000000 -> 582#6017100000000000
602#2310100173617665 -> 582#6010100100000000
602#2B17100001000000 -> 582#6017100000000000
000#8102 -> 702#00
602#4017100000000000 -> 582#4B171000C8000000
602#2300180182010040 -> 582#6000180100000000
602#2300180183010040 -> 582#8000180122000008
602#23001A0210003060 -> 582#80001A0222000008
602#23001801820100C0 -> 582#6000180100000000
602#2F001A0005000000 -> 582#80001A0030000906
602#2F001A0000000000 -> 582#60001A0000000000
602#23001A0210003060 -> 582#60001A0200000000
602#2F001A0002000000 -> 582#60001A0000000000
602#2300180182010040 -> 582#6000180100000000
80# ->
000#0100 ->
80# -> 181#6B100000 182#B80900000000 183#89130000 184#6A0C0000
602#2301600000000000 -> 582#8001600030000906
602#2301600000200000 -> 582#6001600000000000
603#2B00600000000000 -> 583#6000600000000000
604#2F001802FE000000 -> 584#6000180200000000
80# -> 181#6B100000 182#DC0400000000 183#244E0000
000#0203 ->
603#4000100000000000 ->
000#8002 ->
80# -> 181#6B100000
tend -> 701#05 702#7F 703#04 704#05"""


@pytest.mark.parametrize(('rows', 'factory'), [(CONFIGURED, False), (FACTORY, True)])
def test_a_conversation_as_cia_301_has_it(rows, factory):
    """Rows of requests, each with all answers."""
    bus = bus_of(factory=factory)
    for row in rows.splitlines()[1:]:
        asked, _, answers = row.partition(' ->')
        found = bus.cycle(10.0) if asked == '80#' else bus.tend(10.0) if asked == 'tend' \
            else bus.receive(request(asked))
        assert [text(message) for message in found] == answers.split(), row


def test_what_is_not_for_the_encoders_is_ignored():
    bus = bus_of()
    for changes in ({'is_extended_id': True}, {'is_remote_frame': True}, {'is_error_frame': True}):
        message = can.Message(**{'arbitration_id': 0, 'is_extended_id': False,
                                 'data': b'\1\0', **changes})
        assert bus.receive(message) == []
    assert bus.cycle(10.0) == []
    assert bus_of(node_ids=None).receive(request('601#4000100000000000')) == []
    assert bus.identifiers() == [*((False, 0x180 + node) for node in (1, 2, 3, 4)),
                                 *((False, 0x700 + node) for node in (1, 2, 3, 4))]


@pytest.fixture
def rig():
    """Give a function that makes the encoders' runner, and the other end of its bus."""
    with can.Bus(interface='virtual', channel='runner') as bus, \
            can.Bus(interface='virtual', channel='runner') as master:
        def make(node_ids=None, grid=None, faults=(), sync_id=SYNC, record=None):
            encoders = SimulatedBus(LAYOUTS, node_ids, make_motion(values('sim')),
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
    runner, master = rig(faults=('dropout:joint_1b@0',))
    master.send(canopen.frame(SYNC))
    assert runner.step() == ('dropout:joint_1b@0 begins',)
    assert heard(master) == [TPDOS[0], *TPDOS[2:]]
    assert runner.step() == ()


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
