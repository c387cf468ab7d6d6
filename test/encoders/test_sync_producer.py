# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""SYNC's grid, and which cycles the SYNCs sent here open; on a clock that only the test moves."""

import threading

import can
from encoder_frames import T0
import pytest
from spm_haptic_master.encoders import deadline_grid, sync_producer
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.encoders.sync_producer import SyncProducer

PERIOD = 0.01
# What a user is promised, s: listening, wait for an echo, pause after another master's SYNC; and
# the longest sleep.
LISTEN, PROBE, QUIET, NAP = 0.1, 0.05, 1.0, 0.05


class Clock:
    """Time that passes only in sleep; each sleep ends `late` s late."""

    def __init__(self):
        self.now = 0.0
        self.late = 0.0
        self.slept = []

    def monotonic(self):
        return 1000.0 + self.now

    def time(self):
        return T0 + self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += seconds + self.late


@pytest.fixture
def clock(monkeypatch):
    """Put the grid and the producer on a clock of the test's own."""
    clock = Clock()
    monkeypatch.setattr(deadline_grid, 'time', clock)
    monkeypatch.setattr(sync_producer, 'time', clock)
    return clock


def test_the_grid_begins_with_the_first_wait_and_keeps_its_phase(clock):
    clock.now = 0.0123
    grid = DeadlineGrid(PERIOD)
    assert (grid.lateness, grid.missed) == (0.0, 0)
    assert grid.wait(1.0)
    assert clock.slept == []
    for number in range(1, 5):
        clock.late = 1e-3 * number
        assert grid.wait(1.0)
        assert grid.lateness == pytest.approx(clock.late, abs=1e-9)
        assert clock.now == pytest.approx(0.0123 + number * PERIOD + clock.late, abs=1e-9)
    assert grid.missed == 0


@pytest.mark.parametrize(('late', 'missed'), [(0.009, 0), (0.0105, 1), (0.0305, 3)])
def test_deadlines_that_passed_are_counted_and_left_out(clock, late, missed):
    grid = DeadlineGrid(PERIOD)
    grid.wait(1.0)
    clock.late = late
    grid.wait(1.0)
    assert grid.missed == missed
    assert grid.lateness == pytest.approx(late, abs=1e-9)
    clock.late = 0.0
    grid.wait(1.0)
    assert clock.now == pytest.approx((2 + missed) * PERIOD, abs=1e-9)
    assert grid.missed == missed


def test_a_late_caller_does_not_sleep(clock):
    grid = DeadlineGrid(PERIOD)
    grid.wait(1.0)
    clock.now += 0.015
    assert grid.wait(1.0)
    assert clock.slept == []
    assert grid.lateness == pytest.approx(0.005, abs=1e-9)


def test_a_far_deadline_costs_the_timeout_only(clock):
    grid = DeadlineGrid(PERIOD)
    grid.wait(1.0)
    assert not grid.wait(0.004)
    assert clock.slept == [0.004]
    assert grid.wait(0.0061)
    assert clock.now == pytest.approx(PERIOD, abs=1e-9)


def test_a_deadline_at_the_timeout_is_waited_for(clock):
    grid = DeadlineGrid(0.25)
    grid.wait(1.0)
    assert grid.wait(0.25)
    assert clock.now == 0.25


def test_a_restarted_grid_begins_at_once(clock):
    grid = DeadlineGrid(PERIOD)
    grid.wait(1.0)
    clock.now += 0.0034
    grid.restart()
    assert grid.wait(0.0)
    assert grid.missed == 0
    assert grid.lateness == 0.0
    grid.wait(1.0)
    assert clock.now == pytest.approx(0.0134, abs=1e-9)


class Stop:
    """Stand in for the thread's event: waits on the test's clock, and is set after `end` s."""

    def __init__(self, clock, end):
        self.clock, self.end = clock, end
        self.waits = []

    def is_set(self):
        return self.clock.now >= self.end

    def wait(self, timeout):
        self.waits.append(timeout)
        self.clock.now += timeout
        return self.is_set()


class Echo(threading.Event):
    """The event of an echo; waiting calls `when_probed`, or passes the time on the clock."""

    def __init__(self, clock, when_probed=None):
        super().__init__()
        self.clock, self.when_probed = clock, when_probed
        self.waits = []

    def wait(self, timeout):
        self.waits.append(timeout)
        if self.when_probed:
            self.when_probed()
        else:
            self.clock.now += timeout


@pytest.fixture
def producer(clock):
    """Make a producer that runs for some seconds, in the test's thread."""
    def make(end, on_send=None, echo=None):
        sent = []

        def send(message):
            sent.append((clock.now, message))
            if on_send:
                on_send(len(sent))

        made = SyncProducer(send, 0x80, PERIOD)
        made._stop = Stop(clock, end)
        made._echoed = Echo(clock, echo and (lambda: echo(made)))
        made.times = lambda: [at for at, _ in sent]
        made.messages = lambda: [message for _, message in sent]
        return made
    return make


def test_it_listens_then_probes_then_keeps_its_grid(producer):
    made = producer(0.495)
    states = []
    made._send_before = made._send

    def send(message):
        states.append(made.producing)
        made._send_before(message)

    made._send = send
    made._run()
    times = made.times()
    assert times[0] == pytest.approx(LISTEN)
    assert times[1] == pytest.approx(LISTEN + PROBE)
    gaps = [after - before for before, after in zip(times[1:], times[2:], strict=False)]
    assert gaps == pytest.approx([PERIOD] * len(gaps))
    assert len(times) == made.sent == 37
    assert states == [False] + [True] * (len(times) - 1)
    assert not made.producing
    assert made.statistics() == {
        'SYNC sent': 37, 'SYNC not sent': 0, 'SYNC deadlines missed': 0, 'SYNC left out': 0,
        "another master's SYNC": 0, 'SYNC sent late p50 / p99 / max (us)': '0 / 0 / 0'}
    assert made.lateness.count == len(times) - 1
    message = made.messages()[0]
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) \
        == (0x80, b'', False)


def test_a_long_period_is_slept_in_naps(producer, clock):
    made = SyncProducer(lambda message: None, 0x80, 1.0)
    made._stop, made._echoed = Stop(clock, 0.6), Echo(clock)
    made._run()
    assert max(clock.slept) == NAP
    assert made.sent == 2


def test_lateness_and_misses_are_measured(producer, clock):
    made = producer(0.5)
    clock.late = 0.002
    made._run()
    assert made.lateness.percentiles(0.5) == pytest.approx((2000.0,), abs=1.0)
    other = producer(clock.now + 0.5)
    clock.late = 0.012
    other._run()
    assert other.statistics()['SYNC deadlines missed'] > 10


def test_another_master_keeps_it_quiet(producer, clock):
    made = producer(3.0)
    clock.now = 0.05
    assert not made.yielding
    made.heard(T0 + 0.05)
    assert made.yielding
    assert made.foreign == 1
    made._run()
    times = made.times()
    assert 0.05 + QUIET - 1e-6 < times[0] < 0.05 + QUIET + LISTEN + 1e-6
    assert made._stop.waits[:2] == [LISTEN, LISTEN]


def test_a_second_master_stops_it_and_it_resumes(producer, clock):
    holder = {}

    def on_send(number):
        if number == 10:
            holder['made']._waiting.clear()
            holder['made'].heard(T0 + clock.now)

    made = holder['made'] = producer(2.0, on_send)
    made._run()
    times = made.times()
    assert times[10] - times[9] >= QUIET
    assert made.foreign == 1
    # What was sent before is not opened any more.
    assert made.openings(T0 + 100.0) == []


def test_a_refused_send_is_counted_and_the_grid_goes_on(producer, clock):
    refusals = [can.CanOperationError('full'), OSError('down'), ValueError('too long'),
                ImportError('no back end')]

    def on_send(number):
        if 3 <= number < 3 + len(refusals):
            raise refusals[number - 3]

    made = producer(0.5, on_send)
    made._run()
    assert made.failed == len(refusals)
    assert made.sent == len(made.times()) - len(refusals)
    gaps = [b - a for a, b in zip(made.times()[1:], made.times()[2:], strict=False)]
    assert gaps == pytest.approx([PERIOD] * len(gaps))


def test_without_echo_the_time_of_sending_opens_the_cycle(producer, clock):
    opened = []
    holder = {}

    def on_send(number):
        if number == 1:
            assert holder['made'].openings(T0 + 10.0) == []  # the probe opens none
        else:
            opened.extend(holder['made'].openings(T0 + clock.now - 1e-6))

    made = holder['made'] = producer(0.3, on_send)
    made._run()
    expected = [T0 + at for at in made.times()[1:-1]]
    assert opened == pytest.approx(expected, abs=1e-7)


def test_where_there_are_echoes_they_open_the_cycles(producer, clock):
    holder = {}

    def probed(made):
        clock.now += 0.001
        made.heard(T0 + clock.now)

    def on_send(number):
        made = holder['made']
        if number > 1:
            assert made.openings(T0 + clock.now + 1.0) == []
            made.heard(T0 + clock.now)

    made = holder['made'] = producer(0.3, on_send, probed)
    made._run()
    assert made.foreign == 0
    assert made.sent > 10
    # The probe's echo ends the wait for it.
    assert made.times()[1] == pytest.approx(LISTEN + 0.001)
    assert made._echoed.waits == [PROBE]


def test_echoes_of_an_earlier_bus_do_not_count(producer, clock):
    opened = []
    holder = {}
    made = holder['made'] = producer(
        0.3, lambda number: opened.extend(holder['made'].openings(T0 + clock.now - 1e-6)))
    made._echoed.set()
    made._run()
    assert made._echoed.waits == [PROBE]
    assert made.times()[1] == pytest.approx(LISTEN + PROBE)
    assert len(opened) > 10


def test_a_sync_that_none_sent_here_explains_is_foreign(producer, clock):
    made = producer(1.0)
    made._emit()
    # Received before it was sent: another's.
    made.heard(T0 + clock.now - 1e-3)
    assert made.foreign == 1
    made.heard(T0 + clock.now)
    assert made.foreign == 1
    assert made._echoed.is_set()
    clock.now += QUIET - 0.01
    assert made.yielding
    clock.now += 0.02
    assert not made.yielding


def test_another_masters_sync_counts_for_exactly_the_pause(producer, clock):
    made = producer(1.0)
    made.heard(T0)
    clock.now = QUIET
    assert not made.yielding


def test_the_thread_starts_and_ends():
    sent = []
    made = SyncProducer(sent.append, 0x80, 0.001)
    made.stop()
    made.start()
    thread = made._thread
    assert thread.daemon
    assert thread.name == 'SYNC'
    made.stop()
    assert not thread.is_alive()
    made.start()
    assert made._thread is not thread
    made.stop()
    made.stop()


def test_a_second_of_syncs_waits_for_its_cycles(clock):
    made = SyncProducer(lambda message: None, 0x80, 1e-3)
    made.producing = True
    for number in range(1200):
        clock.now = 1e-3 * number
        made._emit()
    assert made.openings(T0 + 2.0) == pytest.approx([T0 + 1e-3 * n for n in range(200, 1200)])
