# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The decoder alone: what it reports of silent encoders, error frames and emergencies."""

import sys
import threading

import can
from encoder_frames import answer, cycle, decoder, feed, PERIOD, sync, T0
import pytest
from spm_haptic_master.encoders import canopen

NOW = T0 + 1.0


def explained(taker, timeout=0.03, now=NOW):
    return taker.explain(taker.silent(now, timeout), now, timeout)


def test_silent_encoders_are_explained_by_what_is_known_of_each():
    taker = decoder()
    assert taker.silent(NOW, 0.03) == (0, 1, 2, 3)
    assert explained(taker) == 'all encoders silent (no frames)'
    feed(taker, [answer(0, NOW), answer(1, NOW - 0.029)])
    assert taker.silent(NOW, 0.03) == (2, 3)
    assert explained(taker) == 'joint_1c silent (no frames); joint_3a silent (no frames)'
    feed(taker, [answer(2, NOW - 0.02, data=bytes(3))])
    assert explained(taker) == ('joint_1c silent (frames rejected, 3 bytes instead of 4); '
                                'joint_3a silent (no frames)')
    # A rejection as old as the timeout explains nothing any more.
    assert explained(taker, 0.03, NOW + 0.02).startswith('joint_1b silent (no frames); '
                                                         'joint_1c silent (no frames)')
    heartbeat = canopen.frame(0x704, b'\x7f')
    heartbeat.timestamp = NOW
    feed(taker, [heartbeat])
    assert explained(taker).endswith('joint_3a silent (pre-operational)')


def test_encoders_heard_leave_the_assemblers_cause():
    taker = decoder()
    feed(taker, [sync(NOW - 2 * PERIOD), *(answer(index, NOW - 2 * PERIOD) for index in range(3)),
                 sync(NOW - PERIOD), answer(3, NOW - PERIOD)])
    assert explained(taker) == 'no answer from joint_3a'
    assert explained(decoder(can__protocol='raw')) == 'all encoders silent (no frames)'


def test_counters_are_read_while_another_thread_adds_new_ones():
    taker = decoder()
    ended = threading.Event()

    def count():
        while not ended.is_set():
            for number in range(400):
                taker.counters[f'a{number}'] += 1
                taker.assembler.counters[f'b{number}'] += 1
            taker.counters.clear()
            taker.assembler.counters.clear()

    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    counting = threading.Thread(target=count)
    counting.start()
    try:
        for _ in range(3000):
            assert all(number > 0 for number in taker.tally().values())
    finally:
        ended.set()
        counting.join()
        sys.setswitchinterval(before)


def test_an_answer_after_a_complete_set_is_a_caution_for_a_while():
    taker = decoder()
    surplus = 'two answers from joint_1c in one cycle'
    assert len(feed(taker, [*cycle(0), answer(2, T0 + 8e-4)])) == 1
    assert len(feed(taker, cycle(1))) == 1
    assert taker.caution(T0 + 1.9) == surplus
    assert taker.caution(T0 + 2.1) is None
    emergency = canopen.emcy(4, 0x5000, 1)
    emergency.timestamp = T0
    taker.feed(emergency)
    assert taker.caution(T0 + 0.1) == \
        f'joint_3a: EMCY 0x5000 device hardware, error register 0x01; {surplus}'
    # A late answer of a missing one is no surplus.
    late = decoder()
    feed(late, [*cycle(0)[:4], *cycle(1), answer(3, T0 + PERIOD + 8e-4)])
    assert late.caution(T0 + 0.01) is None


def test_error_frames_set_what_good_frames_clear():
    taker = decoder()

    def state(message):
        taker.feed(message)
        return taker.bus_error, taker.bus_off

    def error(identifier):
        return can.Message(arbitration_id=identifier, is_error_frame=True, timestamp=T0)

    assert (taker.bus_error, taker.bus_off) == (None, False)
    assert state(error(0x88)) == ('protocol violation, bus error', False)
    assert state(error(0x40)) == ('bus-off', True)
    assert state(error(0x100)) == ('controller restarted', True)
    # A rejected frame clears nothing, and is no sign of life.
    assert state(answer(0, T0, is_extended_id=True)) == ('controller restarted', True)
    encoder = taker.encoders[0]
    assert (encoder.heard, encoder.refused) == (None, (T0, 'identifier width'))
    assert state(answer(0, T0)) == (None, False)
    assert (encoder.heard, encoder.frames.count) == (T0, 1)


def test_the_window_without_sync_is_half_a_period_at_most():
    messages = [answer(index, T0 + at) for index, at in enumerate((0.0, 1e-4, 2e-4, 4.9e-4))]
    assert len(feed(decoder(encoders__sync_id=0), messages)) == 1
    messages[3].timestamp = T0 + 5.1e-4
    assert feed(decoder(encoders__sync_id=0), messages) == []
    narrow = decoder(encoders__sync_id=0, encoders__window=1.5e-4)
    feed(narrow, messages[:3])
    assert narrow.assembler.counters['cycles'] == 2


def test_statistics_have_rates_ages_missed_cycles_and_percentiles():
    """Sets whose last answer lags by 5, 10 .. 1000 us."""
    taker = decoder(encoders__window=5e-3, rate=100.0, can__protocol='raw')
    figures = taker.statistics(T0)
    assert figures['joint_1a age (ms)'] == 'never heard'
    assert not any(word in name for name in figures for word in ('skew', 'jitter', 'node'))
    for number in range(1, 201):
        at = T0 + 0.01 * number
        feed(taker, [sync(at), *(answer(index, at + 1e-3) for index in range(3)),
                     answer(3, at + 1e-3 + 5e-6 * number)])
    for number in range(300):
        feed(taker, [sync(T0 + 10.0 + 0.01 * number)])
    figures = taker.statistics(T0 + 13.0)
    for name, expected in (('skew', (505, 995, 1000)), ('SYNC jitter', (0, 0, 7990000))):
        words = figures[f'{name} p50 / p99 / max (us)'].split(' / ')
        assert [float(part) for part in words] == pytest.approx(expected, abs=1)
    assert (figures['sets'], figures['frames'], figures['cycles']) == (200, 1300, 500)
    assert figures['joint_3a missed cycles'] == 299
    assert figures['joint_3a age (ms)'] == pytest.approx(1e4 + 998.0)
    without_sync = decoder(encoders__sync_id=0)
    feed(without_sync, [message for number in range(3) for message in cycle(number)[1:]])
    figures = without_sync.statistics(T0)
    assert figures['cycle jitter p50 / p99 / max (us)'] == '0 / 0 / 0'
    assert figures['joint_1a node 1'] == 'unknown, no heartbeat yet'
