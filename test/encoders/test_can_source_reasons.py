# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A bus by the script, on a clock that only this test moves: reasons, retries and restarts."""

import logging

import can
from encoder_frames import answer, sync, T0, values
import pytest
from spm_haptic_master.encoders import can_source, canopen
from spm_haptic_master.encoders.can_source import open_bus
from spm_haptic_master.meters import LatencyMeter
from spm_haptic_master.source_factory import make_source

# What a user is promised, s: first and last time between attempts to open a bus, silence after
# which it is reopened, polls, the time that a reason holds, the longest wait to send.
REOPEN_FIRST, REOPEN_LAST, REOPEN_SILENT = 0.1, 2.0, 2.0
POLL_PERIOD, REASON_HOLD, SEND_TIMEOUT = 0.02, 0.5, 0.01
# s that a wait takes at least: a clock that stood still would never end one of no length.
TICK = 1e-6


class Clock:
    """Time that passes only where the source waits."""

    def __init__(self):
        self.now = 0.0

    def monotonic(self):
        return 0.5 + self.now

    def time(self):
        return T0 + self.now

    def sleep(self, seconds):
        assert seconds >= 0.0
        self.now += max(seconds, TICK)


class ScriptedBus:
    """
    A bus on which frames come at the times of a script.

    An exception in the script is raised instead. Sending raises `refusal` where there is one.
    """

    def __init__(self, clock, script=()):
        self.clock = clock
        self.script = sorted(script, key=lambda entry: entry[0])
        self.sent = []
        self.refusal = None
        self.shut = 0
        self.waits = []

    def recv(self, timeout):
        assert timeout >= 0.0
        self.waits.append(timeout)
        if not self.script or self.script[0][0] > self.clock.now + timeout:
            self.clock.now += max(timeout, TICK)
            return None
        at, what = self.script.pop(0)
        self.clock.now = max(self.clock.now, at)
        if isinstance(what, Exception):
            raise what
        return what

    def send(self, message, timeout=None):
        assert timeout == SEND_TIMEOUT
        if self.refusal is not None:
            raise self.refusal
        self.sent.append((self.clock.now, message))

    def shutdown(self):
        self.shut += 1

    def starts(self):
        """Return when which node was started, s."""
        return [(pytest.approx(at, abs=1e-9), message.data[1]) for at, message in self.sent
                if message.arbitration_id == canopen.NMT_ID
                and message.data[0] == canopen.NMT_START]


@pytest.fixture
def rig(monkeypatch):
    """Make a source on scripted buses, one for each time that it opens one."""
    clock = Clock()
    monkeypatch.setattr(can_source, 'time', clock)

    def make(*buses, **overrides):
        """`buses` are scripts, or exceptions that opening raises; the last one stays."""
        scripted = [bus if isinstance(bus, Exception) else ScriptedBus(clock, bus)
                    for bus in buses]
        opened = []

        def opening(interface, channel, bitrate, own=False):
            bus = scripted[min(len(opened), len(scripted) - 1)]
            opened.append((clock.now, interface, channel, bitrate, own))
            if isinstance(bus, Exception):
                raise bus
            return bus

        monkeypatch.setattr(can_source, 'open_bus', opening)
        source = make_source('can', values(
            can__interface='virtual', can__channel='can7', **overrides))
        source.opened, source.buses, source.clock = opened, scripted, clock
        return source

    return make


def cycles(begin, count, without=(), period=0.01):
    """Return a script of SYNC and answers, the first at `begin` s."""
    script = []
    for number in range(count):
        at = begin + number * period
        script.append((at, sync(T0 + at)))
        script += [(at + 1e-4 * (index + 1), answer(index, T0 + at + 1e-4 * (index + 1)))
                   for index in range(4) if index not in without]
    return script


def error_frame(at, identifier, data=bytes(8)):
    return (at, can.Message(arbitration_id=identifier, is_error_frame=True, is_extended_id=False,
                            timestamp=T0 + at, data=data))


def node_frame(at, identifier, data):
    message = canopen.frame(identifier, data)
    message.timestamp = T0 + at
    return (at, message)


def run(source, until):
    """Read until a time; return the sets."""
    got = []
    while source.clock.now < until - 1e-9:
        sample = source.read(until - source.clock.now)
        if sample is not None:
            got.append(sample)
    return got


def test_sets_arrive_with_syncs_receive_time(rig):
    driver = rig(cycles(0.05, 3))
    assert driver.fault == 'virtual can7: not opened yet'
    got = run(driver, 0.1)
    assert [sample.stamp for sample in got] == [
        pytest.approx((T0 + at) * 1e9, abs=1000) for at in (0.05, 0.06, 0.07)]
    assert driver.fault is None
    assert driver.caution is None
    figures = driver.statistics()
    assert figures['bus'] == 'virtual can7'
    assert figures['bus opened'] == 1
    assert 'last send refused' not in figures
    assert 'SYNC sent' not in figures


def test_a_read_ends_at_its_timeout_and_polls_in_between(rig):
    driver = rig(())
    assert driver.read(0.05) is None
    assert driver.clock.now == pytest.approx(0.05, abs=1e-5)
    waits = driver.buses[0].waits
    assert max(waits) <= POLL_PERIOD + 1e-9
    assert len(waits) <= 5


def test_frames_without_times_get_those_of_arrival(rig):
    script = cycles(0.01, 1)
    for _, message in script:
        message.timestamp = 0.0
    (sample,) = run(rig(script), 0.05)
    assert sample.stamp == pytest.approx((T0 + 0.01) * 1e9, abs=1000)


def test_opening_is_tried_again_with_back_off(rig):
    driver = rig(can.CanInitializationError('no such device\nTraceback ...'))
    assert run(driver, 10.0) == []
    times = [at for at, *_ in driver.opened]
    assert times[0] == 0.0
    waits = [after - before for before, after in zip(times, times[1:], strict=False)]
    assert waits[0] == pytest.approx(REOPEN_FIRST)
    for before, after in zip(waits, waits[1:], strict=False):
        assert after == pytest.approx(min(2.0 * before, REOPEN_LAST))
    assert waits[-1] == pytest.approx(REOPEN_LAST)
    # In one line, whatever python-can's error has.
    assert driver.fault == 'virtual can7: no such device'
    assert driver.statistics()['bus opened'] == 0


@pytest.mark.parametrize('error', [
    can.CanOperationError(''), OSError('Network is down'), ValueError('bad'), ImportError('no x')])
def test_each_kind_of_bus_error_is_survived(rig, error):
    driver = rig([(0.01, error)], cycles(0.2, 5))
    assert run(driver, 0.05) == []
    assert driver.fault == f'virtual can7: {str(error) or "CanOperationError"}'
    assert driver.buses[0].shut == 1
    assert len(run(driver, 0.25)) == 5
    assert driver.fault is None
    assert [at for at, *_ in driver.opened] == pytest.approx([0.0, 0.01 + REOPEN_FIRST])
    assert driver.statistics()['bus opened'] == 2


def test_a_frame_ends_the_back_off(rig):
    """Each time that the bus had frames before it broke, the first retry comes soon."""
    broken = OSError('gone')
    driver = rig(broken, broken, [*cycles(0.4, 1), (0.5, broken)], cycles(0.9, 2))
    run(driver, 1.0)
    assert [at for at, *_ in driver.opened] == pytest.approx(
        [0.0, REOPEN_FIRST, 3.0 * REOPEN_FIRST, 0.5 + REOPEN_FIRST])


def test_a_broken_bus_may_fail_to_shut_down(rig, monkeypatch):
    driver = rig([(0.01, OSError('gone'))], cycles(0.2, 2))

    def shutdown():
        raise OSError('gone for good')

    driver.buses[0].shutdown = shutdown
    assert len(run(driver, 0.3)) == 2


def test_a_bus_that_dies_without_a_word_is_opened_again(rig):
    """An interface that went and came back leaves its old socket silent for ever."""
    driver = rig(cycles(0.01, 2), cycles(4.0, 2))
    assert len(run(driver, 3.9)) == 2
    assert driver.fault == 'no frames on virtual can7'
    reopened = driver.opened[1][0]
    assert 0.02 + REOPEN_SILENT < reopened < 0.02 + REOPEN_SILENT + 2 * POLL_PERIOD
    assert driver.buses[0].shut == 1
    assert len(run(driver, 4.1)) == 2
    # A bus silent from the start is opened as often.
    silent = rig(())
    begin = silent.clock.now
    run(silent, begin + 7.0)
    assert len(silent.opened) == 4


def test_a_reopened_bus_starts_a_new_cycle_and_a_new_clock(rig):
    """Answers to a SYNC from before the break never join those after; nor does its offset."""
    first = list(cycles(0.01, 1))[:3]
    second = list(cycles(0.01, 1))[3:]
    second = [(0.2 + number * 1e-4, message) for number, (_, message) in enumerate(second)]
    for _, message in second:
        message.timestamp = T0 + 0.2
    driver = rig([*first, (0.05, OSError('gone'))], [*second, *cycles(0.3, 1)])
    assert len(run(driver, 0.4)) == 1
    assert driver.statistics()['rejected: before the first SYNC'] == 2


def test_a_reopened_bus_may_count_from_another_start(rig):
    """A device that was switched off and on: the offset of its old times no longer holds."""
    first, second = cycles(0.01, 1), cycles(0.2, 1)
    for script, start in ((first, 5000.0), (second, 1.0)):
        for _, message in script:
            message.timestamp += start - T0
    driver = rig([*first, (0.05, OSError('gone'))], second)
    got = run(driver, 0.3)
    assert [sample.stamp for sample in got] == [
        pytest.approx((T0 + at) * 1e9, abs=1000) for at in (0.01, 0.2)]


def test_a_reason_is_held_before_another_takes_its_place(rig):
    script = [*cycles(0.01, 1), *cycles(0.02, 200, without=(2,))]
    driver = rig(script, can__timeout=0.05)
    run(driver, 0.1)
    assert driver.fault == 'joint_1c silent (no frames)'
    run(driver, 2.02 + 0.06)
    # The bus is silent, and the reason is not yet replaced: it was read at 0.1 s, long ago.
    assert driver.fault == 'no frames on virtual can7'
    bus = driver.buses[0]
    now = driver.clock.now
    bus.script = cycles(now, 400, without=(1,))
    run(driver, now + 0.5 * REASON_HOLD)
    assert driver.fault == 'no frames on virtual can7'
    run(driver, now + REASON_HOLD + 0.01)
    assert driver.fault == 'joint_1b silent (no frames)'
    # Sets end it at once, and the next reason is new at once.
    now = driver.clock.now
    bus.script = [*cycles(now, 5), *cycles(now + 0.05, 30, without=(3,))]
    run(driver, now + 0.05)
    assert driver.fault is None
    run(driver, now + 0.3)
    assert driver.fault == 'joint_3a silent (no frames)'


def test_no_sync_is_explained(rig):
    driver = rig([node_frame(0.01 * n, 0x701, b'\x05') for n in range(1, 9)])
    run(driver, 0.08)
    assert driver.fault == ('no SYNC 0x80 on virtual can7: no other master makes it, '
                            'and can.sync is consume')
    run(driver, 0.08 + REASON_HOLD + 0.1)
    assert driver.fault == 'no frames on virtual can7'


def test_without_sync_on_the_bus_none_is_missed(rig):
    script = [entry for entry in cycles(0.01, 20, without=(3,)) if entry[1].arbitration_id != 0x80]
    driver = rig(script, encoders__sync_id=0)
    run(driver, 0.2)
    assert driver.fault == 'joint_3a silent (no frames)'


def test_error_frames_explain_a_bus_without_encoders(rig):
    driver = rig([error_frame(0.01 * n, 0x20) for n in range(1, 9)])
    run(driver, 0.085)
    assert driver.fault == 'virtual can7: no acknowledge (is any other node on the bus?)'
    assert driver.statistics()['rejected: error frame'] == 8


def test_bus_off_is_the_reason_until_an_encoder_is_heard(rig):
    driver = rig([*cycles(0.01, 1), error_frame(0.02, 0x40), error_frame(0.03, 0x100),
                  *cycles(0.2, 1, without=(0, 1))])
    run(driver, 0.19)
    assert driver.fault == 'virtual can7: bus-off'
    run(driver, 0.2 + REASON_HOLD)
    assert driver.fault == 'no frames on virtual can7'


def test_an_error_frame_explains_nothing_while_encoders_are_heard(rig):
    driver = rig([*cycles(0.01, 10, without=(2,)), error_frame(0.1011, 0x88)])
    run(driver, 0.11)
    assert driver.fault == 'joint_1c silent (no frames)'


def test_all_encoders_silent_is_one_reason(rig):
    driver = rig(cycles(0.01, 20, without=range(4)))
    run(driver, 0.2)
    assert driver.fault == 'all encoders silent (no frames)'


def test_emergencies_are_the_reason_where_they_stop_the_sets(rig):
    emergency = canopen.emcy(4, 0x5000, 1)
    emergency.timestamp = T0 + 0.02
    for stops in (True, False):
        driver = rig([(0.02, emergency)], can__emcy_stops=stops)
        begin = driver.clock.now
        driver.buses[0].script = [*cycles(begin + 0.01, 1), (begin + 0.02, emergency),
                                  *cycles(begin + 0.03, 8)]
        got = run(driver, begin + 0.11)
        words = 'joint_3a: EMCY 0x5000 device hardware, error register 0x01'
        assert driver.fault == (words if stops else None)
        assert driver.caution == words
        assert len(got) == (1 if stops else 9)
        assert driver.statistics().get('dropped: emergency', 0) == (8 if stops else 0)


def test_sets_that_never_complete_are_explained(rig):
    """Every encoder is heard, but never all four in a window: the assembler's cause."""
    script = [(at, message) for at, message in cycles(0.01, 20)
              if message.arbitration_id != 0x184]
    script += [(0.0199 + 0.01 * number, answer(3, T0 + 0.0199 + 0.01 * number))
               for number in range(20)]
    driver = rig(script)
    run(driver, 0.2)
    assert driver.fault == 'answer from joint_3a outside the window'


def test_without_sync_frames_too_far_apart_are_no_set(rig):
    driver = rig([(0.01 + 0.002 * number, answer(number % 4, T0 + 0.01 + 0.002 * number))
                  for number in range(40)], encoders__sync_id=0, rate=500.0)
    run(driver, 0.09)
    assert driver.fault == 'no answer from joint_1a, joint_1b, joint_3a'


def test_encoders_heard_without_any_set_are_named(rig):
    driver = rig([*((0.001, answer(index, T0 + 0.001)) for index in range(4)),
                  (0.002, sync(T0 + 0.002))])
    run(driver, 0.01)
    assert driver.fault == 'frames on virtual can7, but no set of four encoders'


def test_silent_nodes_are_started_and_booting_ones_at_once(rig):
    driver = rig([*cycles(0.005, 120, without=(1,)), node_frame(0.3011, 0x703, b'\x00')])
    run(driver, 1.19)
    starts = driver.buses[0].starts()
    # All four before any was heard; node 2 every half second; node 3 as soon as it booted.
    assert starts[:4] == [(0.0, 1), (0.0, 2), (0.0, 3), (0.0, 4)]
    assert [node for _, node in starts[4:]] == [3, 2, 2]
    assert starts[4][0] == pytest.approx(0.3011, abs=1e-6)
    for place, expected in ((5, 0.5), (6, 1.0)):
        assert -1e-6 < starts[place][0].expected - expected < 3 * POLL_PERIOD


def test_raw_encoders_are_never_started(rig):
    driver = rig((), can__protocol='raw')
    run(driver, 1.0)
    assert driver.buses[0].sent == []
    assert driver.caution is None


def test_a_refused_start_is_reported_and_not_fatal(rig):
    driver = rig(())
    driver.buses[0].refusal = can.CanOperationError('Transmit buffer full\nmore')
    run(driver, 0.1)
    assert driver.fault == 'no frames on virtual can7 (sending: Transmit buffer full)'
    assert driver.statistics()['last send refused'] == 'Transmit buffer full'
    driver.buses[0].refusal = None
    run(driver, 0.7)
    assert driver.fault == 'no frames on virtual can7'
    assert 'last send refused' not in driver.statistics()


@pytest.mark.parametrize('stop', [True, False])
def test_closing_stops_the_nodes_where_configured(rig, stop):
    driver = rig(cycles(0.01, 1), can__nmt_stop=stop)
    driver.close()
    assert driver.opened == []
    run(driver, 0.05)
    bus = driver.buses[0]
    bus.sent.clear()
    driver.close()
    driver.close()
    assert bus.shut == 1
    assert [tuple(message.data) for _, message in bus.sent] == [
        (canopen.NMT_STOP, node_id) for node_id in (1, 2, 3, 4) if stop]


def test_a_lost_heartbeat_is_a_caution(rig):
    driver = rig([*cycles(0.005, 90), *(node_frame(0.0011 + 0.1 * n, 0x702, b'\x05')
                                        for n in range(3))], can__heartbeat_timeout=0.25)
    run(driver, 0.44)
    assert driver.caution is None
    run(driver, 0.48)
    assert driver.caution == 'joint_1b: heartbeat lost'


class ScriptedProducer:
    """Stand in for SyncProducer: what it was asked, and what the test makes it answer."""

    def __init__(self, send, sync_id, period):
        self.send, self.sync_id, self.period = send, sync_id, period
        self.producing = self.yielding = False
        self.sent, self.failed, self.missed, self.foreign = 12, 3, 4, 5
        self.lateness = LatencyMeter()
        self.calls = []
        self.opening = []

    def start(self):
        self.calls.append('start')

    def stop(self):
        self.calls.append('stop')

    def heard(self, stamp):
        self.calls.append(('heard', stamp))

    def openings(self, stamp):
        self.calls.append(('openings', stamp))
        taken, self.opening = self.opening, []
        return taken


@pytest.fixture
def producing(rig, monkeypatch):
    """Make a source on a scripted bus, with a scripted producer of SYNC."""
    monkeypatch.setattr(can_source, 'SyncProducer', ScriptedProducer)

    def make(*buses, **overrides):
        driver = rig(*buses, can__sync='produce', **overrides)
        return driver, driver._sync

    return make


def test_a_producer_gets_its_period_and_starts_with_each_bus(producing):
    driver, producer = producing([(0.05, OSError('gone'))], ())
    assert (producer.sync_id, producer.period) == (0x80, 1e-3)
    assert producer.calls == []
    run(driver, 0.3)
    assert producer.calls == ['start', 'stop', 'start']
    driver.close()
    assert producer.calls[-1] == 'stop'
    # Its own frames are asked for, where the interface can.
    assert [own for *_, own in driver.opened] == [True, True]


def test_a_producer_learns_of_a_refused_send(producing):
    driver, producer = producing(())
    run(driver, 0.01)
    message = canopen.frame(0x80)
    producer.send(message)
    assert driver.buses[0].sent[-1][1] is message
    driver.buses[0].refusal = can.CanOperationError('full')
    with pytest.raises(can.CanOperationError, match='full'):
        producer.send(message)


def test_a_producer_hears_syncs_and_opens_cycles_before_other_frames(producing):
    answers = [answer(index, T0 + 0.0105) for index in range(4)]
    driver, producer = producing([(0.005, sync(T0 + 0.005)),
                                  *((0.0105, message) for message in answers)])
    producer.opening = [T0 + 0.0102]
    (sample,) = run(driver, 0.02)
    assert sample.stamp == pytest.approx((T0 + 0.0102) * 1e9, abs=1000)
    assert producer.calls[:3] == ['start', ('heard', T0 + 0.005), ('openings', T0 + 0.0105)]


def test_a_missing_sync_of_our_own_is_explained(producing):
    driver, producer = producing([node_frame(0.002 * n, 0x701, b'\x05') for n in range(1, 800)])
    run(driver, 0.1)
    missing = 'no SYNC 0x80 on virtual can7: '
    assert driver.fault == missing + 'listening for another master first'
    producer.producing = True
    run(driver, 0.1 + REASON_HOLD + 0.01)
    assert driver.fault == missing + 'this machine is too busy to make it in time'
    driver.buses[0].refusal = can.CanOperationError('full')
    run(driver, 0.1 + 2.0 * REASON_HOLD + 0.05)
    assert driver.fault == missing + 'sending: full'


def test_another_master_is_a_caution(producing):
    driver, producer = producing(())
    assert driver.caution is None
    producer.yielding = True
    assert driver.caution == 'another master makes SYNC: this driver follows it and makes none'


def test_a_producers_figures_are_in_the_statistics(producing):
    driver, producer = producing(())
    figures = driver.statistics()
    assert {name: value for name, value in figures.items() if 'SYNC' in name} == {
        'SYNC sent': 12, 'SYNC not sent': 3, 'SYNC deadlines missed': 4,
        "another master's SYNC": 5}
    for lateness in range(1, 101):
        producer.lateness.add(lateness * 1000)
    assert driver.statistics()['SYNC sent late p50 / p99 / max (us)'] == '51 / 100 / 100'


class Refusing:
    """Stand in for can.Bus: an interface that takes only some settings."""

    def __init__(self, *refused):
        self.refused = refused
        self.calls = []

    def __call__(self, **settings):
        self.calls.append(settings)
        if set(settings) & set(self.refused):
            raise NotImplementedError
        return 'bus'


@pytest.mark.parametrize(('refused', 'own', 'bitrate', 'calls'), [
    ((), False, 0, [{}]), ((), False, 500_000, [{'bitrate': 500_000}]),
    ((), True, 0, [{'receive_own_messages': True}]),
    (('receive_own_messages',), True, 125_000,
     [{'bitrate': 125_000, 'receive_own_messages': True}, {'bitrate': 125_000}]),
])
def test_a_bus_is_opened_with_what_its_interface_takes(
        monkeypatch, refused, own, bitrate, calls):
    stand_in = Refusing(*refused)
    monkeypatch.setattr(can, 'Bus', stand_in)
    assert open_bus('virtual', 'can7', bitrate, own) == 'bus'
    assert stand_in.calls == [{'interface': 'virtual', 'channel': 'can7', **call}
                              for call in calls]


def test_a_bus_opened_for_listening_has_no_own_frames_and_no_log(monkeypatch):
    stand_in = Refusing()
    monkeypatch.setattr(can, 'Bus', stand_in)
    logging.getLogger('can').setLevel(logging.NOTSET)
    open_bus('virtual', 'can7', 0)
    assert stand_in.calls == [{'interface': 'virtual', 'channel': 'can7'}]
    # python-can would log what it also raises.
    assert logging.getLogger('can').level == logging.CRITICAL
