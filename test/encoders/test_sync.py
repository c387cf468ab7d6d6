# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""SYNC on its grid, which cycles the SYNCs sent here open, and a SYNC of another rate."""

import threading

import can
from encoder_frames import T0
import numpy as np
import pytest
from spm_haptic_master.encoders.sync import LISTEN, PROBE, QUIET, SyncProducer, SyncRate

PERIOD = 0.01


class OnClock(threading.Event):
    """An event that is set from `end` s on; waiting takes its time on the test's clock."""

    def __init__(self, clock, end=float('inf'), meanwhile=None):
        super().__init__()
        self.clock = clock
        self.end = end
        self.meanwhile = meanwhile

    def is_set(self):
        return super().is_set() or self.clock.now >= self.end

    def wait(self, timeout):
        if self.meanwhile:
            self.meanwhile()
        else:
            self.clock.now += timeout
        return self.is_set()


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
        made._stop = OnClock(clock, end)
        made._echoed = OnClock(clock, meanwhile=echo and (lambda: echo(made)))
        made.times = lambda: [at for at, _ in sent]
        made.messages = sent
        return made

    return make


def test_it_listens_then_probes_then_keeps_its_grid(producer):
    states = []
    made = producer(0.495, lambda number: states.append(made.producing))
    made._run()
    assert made.times() == pytest.approx(
        [LISTEN, *(LISTEN + PROBE + PERIOD * number for number in range(36))]
    )
    assert states == [False] + [True] * 36
    assert not made.producing
    assert made.statistics() == {
        'SYNC sent': 37,
        'SYNC not sent': 0,
        'SYNC deadlines missed': 0,
        'SYNC left out': 0,
        "another master's SYNC": 0,
        'SYNC sent late p50 / p99 / max (us)': '0 / 0 / 0',
    }
    _, message = made.messages[0]
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (
        0x80,
        b'',
        False,
    )


# In half a second: lateness of each wait, s; deadlines missed; s lost, more than a period late.
@pytest.mark.parametrize(
    ('late', 'missed', 'lost'),
    [
        (0.0, 0, 0.0),
        (0.002, 0, 0.0),
        (0.0099, 0, 0.0),
        (0.012, 18, 0.216),
        (0.0305, 27, 0.2745),
    ],
)
def test_the_grid_keeps_its_phase_and_what_is_late_missed_or_lost_is_measured(
    producer, clock, late, missed, lost
):
    made = producer(0.5)
    clock.late = late
    made._run()
    assert made.lateness.percentiles(1.0) == pytest.approx((1e6 * late,), abs=1.0)
    assert made.statistics()['SYNC deadlines missed'] == missed
    assert made.lost == pytest.approx(lost)
    begin, *times = made.times()[1:]
    assert (np.array(times) - late - begin) / PERIOD == pytest.approx(
        1 + np.arange(len(times)) * (1 + int(late / PERIOD)), abs=1e-6
    )


def test_one_sync_is_left_out_on_request_while_it_produces(producer):
    made = producer(0.5, lambda number: number in (1, 10) and made.skip())
    made._run()
    times = made.times()
    assert made.skipped == 1
    assert times[10] - times[9] == pytest.approx(2.0 * PERIOD)
    assert times[11] - times[10] == times[9] - times[8] == pytest.approx(PERIOD)


@pytest.mark.parametrize('number', [0, 10])
def test_another_master_keeps_it_quiet_for_the_pause_and_it_resumes(producer, clock, number):
    """One that is there from the start, and one that begins later."""

    def on_send(sent):
        if sent == number:
            # Also while a SYNC sent here, of which no frame has come since, waits for its cycle.
            made.heard(T0 + clock.now - 0.1)

    made = producer(3.0, on_send)
    on_send(0)
    made._run()
    heard, resumed = [0.0, *made.times()][number : number + 2]
    assert heard + QUIET - 1e-6 < resumed < heard + QUIET + LISTEN + 2.0 * PERIOD
    assert (made.foreign, made.lost, made.statistics()['SYNC deadlines missed']) == (1, 0.0, 0)
    # What was sent before is no more taken for one of these.
    made.heard(T0 + 100.0)
    assert made.foreign == 2


def test_a_refused_send_is_counted_and_the_grid_goes_on(producer, clock):
    refusals = [
        can.CanOperationError('full'),
        OSError('down'),
        ValueError('too long'),
        ImportError('no back end'),
    ]

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

    def on_send(number):
        if number == 1:
            assert made.openings(T0 + 10.0) == []  # the probe opens none
        else:
            opened.extend(made.openings(T0 + clock.now - 1e-6))

    made = producer(0.3, on_send)
    # Echoes of an earlier bus do not count.
    made._echoed.set()
    made._run()
    expected = [T0 + at for at in made.times()[1:-1]]
    assert opened == pytest.approx(expected, abs=1e-7)


def test_where_there_are_echoes_they_open_the_cycles(producer, clock):
    def probed(made):
        clock.now += 0.001
        made.heard(T0 + clock.now)

    def on_send(number):
        if number > 1:
            assert made.openings(T0 + clock.now + 1.0) == []
            made.heard(T0 + clock.now)

    made = producer(0.3, on_send, probed)
    made._run()
    assert made.foreign == 0
    assert made.sent > 10
    # The probe's echo ends the wait for it.
    assert made.times()[1] == pytest.approx(LISTEN + 0.001)


def test_the_thread_starts_and_ends_again_and_again():
    made = SyncProducer(lambda message: None, 0x80, 0.001)
    made.stop()
    for _ in range(2):
        made.start()
        thread = made._thread
        assert thread.daemon
        assert thread.is_alive()
        made.stop()
        assert not thread.is_alive()


STEADY = np.arange(0.0, 5.0, 1e-3)
RNG = np.random.default_rng(5)


@pytest.mark.parametrize(
    ('stamps', 'measured'),
    [
        *((np.arange(0.0, 3.0, 1.0 / bus), bus) for bus in (100.0, 200.0, 500.0, 2000.0, 30.0)),
        # A busy machine: two of three are lost, or late by up to two periods.
        (STEADY, None),
        (STEADY[RNG.random(5000) < 1.0 / 3.0], None),
        (np.sort(STEADY + RNG.uniform(0.0, 2e-3, 5000)), None),
        # The cause begins, or has ended; a gap, or a clock set back, is no rate.
        ([*STEADY, *np.arange(5.0, 7.0, 5e-3)], 200.0),
        ([*np.arange(0.0, 2.0, 5e-3), *np.arange(2.0, 4.0, 1e-3)], None),
        ([0.0, 0.001, 3.0, 3.001, 9.0, *np.arange(7.0, 9.0, 1e-3)], None),
        ([], None),
    ],
)
def test_another_rate_of_sync_is_reported_with_the_cure(stamps, measured):
    found = SyncRate(1e-3)
    for stamp in stamps:
        found.heard(stamp)
    assert found.measured == (measured and pytest.approx(measured, rel=0.02))
    assert found.text() == (
        measured
        and (
            f'SYNC comes at {measured:.0f} Hz, rate is 1000 Hz: give rate, as it is on the '
            'bus, to '
            'all nodes (can_scan prints it)'
        )
    )


def stamps_of(*parts):
    """Return the times of SYNCs; each part is a number of steps and their length, s."""
    stamps = [0.0]
    for count, step in parts:
        for _ in range(count):
            stamps.append(stamps[-1] + step)
    return stamps


@pytest.mark.parametrize(
    ('parts', 'is_other'),
    [
        # A quarter of a period beside it is still one; more is another rate.
        ([(1400, 0.76e-3)], False),
        ([(1400, 0.74e-3)], True),
        ([(900, 1.24e-3)], False),
        ([(900, 1.26e-3)], True),
        # A tenth of them one period apart: SYNCs are lost; fewer: another rate.
        ([(44, 1e-3), (320, 3e-3)], False),
        ([(36, 1e-3), (324, 2.976e-3)], False),
        ([(28, 1e-3), (325, 3e-3)], True),
        # Ten of them show a rate, nine do not; and it takes a second.
        ([(10, 0.11)], True),
        ([(9, 0.12)], False),
        ([(330, 3e-3)], False),
        ([(336, 3e-3)], True),
        # A pause of more than a second begins anew.
        ([(300, 3e-3), (1, 1.1), (300, 3e-3)], False),
        ([(300, 3e-3), (1, 0.9)], True),
    ],
)
def test_a_rate_of_sync_is_another_one_beyond_a_quarter_of_a_period(parts, is_other):
    found = SyncRate(1e-3)
    for stamp in stamps_of(*parts):
        found.heard(stamp)
    assert (found.measured is not None) is is_other


def test_only_the_syncs_up_to_a_frame_open_their_cycles(producer):
    made = producer(1.0)
    made.producing = True
    made._waiting.extend([T0, T0 + 0.01, T0 + 0.02])
    assert made.openings(T0 - 0.001) == []
    assert made.openings(T0 + 0.01) == [T0, T0 + 0.01]
    assert made.openings(T0 + 0.015) == []
    assert made.openings(T0 + 0.03) == [T0 + 0.02]


def test_no_sync_is_left_out_while_it_does_not_produce(producer):
    made = producer(1.0)
    assert made.skip() is False
    made.producing = True
    assert made.skip() is True
