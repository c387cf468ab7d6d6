# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames in, sets out: what is not taken, and what is reported of encoders and nodes."""

from collections import Counter

from encoder_frames import answer, cycle, decoder, feed, LAYOUTS, PERIOD, sync, T0
from marked_cycles import angle, by_cycle, COUNTER, rig, sets_of, STATUS
from marked_cycles import cycle as marked
import pytest
from spm_haptic_master.encoders import canopen

NOW = T0 + 1.0
EMERGENCY = 'EMCY 0x5000 device hardware, error register 0x01'
# Heartbeats of node 5, the encoder of joint_3b.
BOOT_UP = canopen.frame(0x705, b'\x00')
STOPPED = canopen.frame(0x705, b'\x04')
OPERATIONAL = canopen.frame(0x705, b'\x05')
PRE_OPERATIONAL = canopen.frame(0x705, b'\x7f')


def at(when, message):
    message.timestamp = T0 + when
    return message


@pytest.mark.parametrize(
    ('fields', 'reason'),
    [
        ({'is_error_frame': True}, 'rejected: error frame'),
        ({'is_remote_frame': True, 'data': b'', 'dlc': 4}, 'rejected: remote frame'),
        ({'is_extended_id': True}, 'joint_1b rejected: identifier width'),
        ({'is_fd': True}, 'rejected: CAN FD frame'),
        ({'data': bytes(3)}, 'joint_1b rejected: 3 bytes instead of 4'),
        ({'data': b'\xff' * 4}, 'joint_1b rejected: counts beyond a turn'),
        ({'arbitration_id': 0x185}, 'rejected: foreign identifier'),
        ({'arbitration_id': 0x80, 'data': bytes(2)}, 'rejected: SYNC of wrong length'),
        (
            {'arbitration_id': 0x80, 'is_extended_id': True, 'data': b''},
            'rejected: foreign identifier',
        ),
        (
            {'arbitration_id': 0x80, 'is_error_frame': True, 'data': bytes(8)},
            'rejected: error frame',
        ),
        (
            {'arbitration_id': 0x701, 'data': bytes(2)},
            'rejected: joint_1a heartbeat of wrong length',
        ),
        ({'arbitration_id': 0x81, 'data': bytes(2)}, 'rejected: joint_1a EMCY of wrong length'),
    ],
)
def test_a_frame_of_another_kind_changes_nothing(fields, reason):
    for place in range(6):
        taker = decoder()
        stream = [marked(LAYOUTS, number) for number in range(3)]
        other = answer(1, T0 + PERIOD + 1e-4 * place, **fields)
        stream[1].insert(place, other)
        assert by_cycle(feed(taker, sum(stream, []))) == sets_of(range(3))
        assert taker.tally()[reason] == 1


def test_a_bus_error_is_over_with_the_next_answer():
    taker = decoder()
    error = {'is_error_frame': True, 'arbitration_id': 0x40, 'data': bytes(8)}
    taker.feed(answer(1, T0, **error))
    assert taker.bus_error == 'bus-off'
    assert taker.bus_off
    # A frame that is none of the encoder's shows nothing.
    taker.feed(answer(1, T0, data=bytes(3)))
    assert taker.bus_off
    taker.feed(answer(1, T0))
    assert taker.bus_error is None
    assert not taker.bus_off


def test_a_frame_of_29_bits_is_an_answer_where_it_is_configured():
    taker = decoder(
        encoders__id=(0x181, 0x18FF1234, 0x183, 0x184),
        encoders__extended=(False, True, False, False),
    )
    (sample,) = feed(taker, cycle(0, layouts=taker.layouts))
    assert sample.angles == pytest.approx((0.1, 0.2, 0.3, 0.4), abs=4e-4)


@pytest.mark.parametrize('sensors', [5, 6])
@pytest.mark.parametrize(
    ('begin', 'end', 'reason'),
    [
        (canopen.emcy(5, 0x5000, 1), canopen.emcy(5, 0, 0), EMERGENCY),
        (PRE_OPERATIONAL, OPERATIONAL, 'pre-operational'),
        (STOPPED, OPERATIONAL, 'stopped'),
    ],
)
def test_a_node_that_is_not_well_takes_its_joint_away_and_no_set(sensors, begin, end, reason):
    taker, layouts = rig(sensors)
    stream = [marked(layouts, number) for number in range(30)]
    # Between SYNC and the answers: it counts for the answer behind it.
    stream[10].insert(1, at(10.01 * PERIOD, begin))
    stream[20].insert(1, at(20.01 * PERIOD, end))
    found = by_cycle(feed(taker, sum(stream[:20], [])))
    assert taker.caution(T0 + 20 * PERIOD) == f'joint_3b: {reason}'
    found |= by_cycle(feed(taker, sum(stream[20:], [])))
    assert found == sets_of(range(30), {4}, when=range(10, 20))
    assert taker.assembler.counters['sets at the end of the cycle'] == 0
    assert taker.caution(T0 + 30 * PERIOD) is None


def test_a_lost_heartbeat_takes_the_joint_away_until_it_comes_again():
    taker, layouts = rig(6, can__heartbeat_timeout=0.02)
    stream = [marked(layouts, number) for number in range(60)]
    for place in (0, 50):
        heartbeat = canopen.frame(0x705, b'\x05')
        stream[place].insert(0, at(PERIOD * (place - 0.05), heartbeat))
    found = by_cycle(feed(taker, sum(stream[:50], [])))
    assert taker.caution(T0 + 49 * PERIOD) == 'joint_3b: heartbeat lost'
    assert found == sets_of(range(50), {4}, when=range(20, 50))
    found = by_cycle(feed(taker, sum(stream[50:], [])))
    assert found == sets_of(range(50, 60))


def test_a_node_that_has_booted_and_was_started_is_operational_until_its_heartbeat():
    """The first heartbeat comes later than the first answers; their counter begins anew."""
    taker, layouts = rig(6, COUNTER)
    answers = marked(layouts, 2)
    answers[5].data = layouts[4].data(angle(4, 2), 1)
    boot_up = at(1.9 * PERIOD, BOOT_UP)
    found = by_cycle(feed(taker, [*marked(layouts, 1), boot_up, *answers]))
    assert found == sets_of([1, 2])


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_status_bits_take_their_joint_away(sensors):
    taker, layouts = rig(sensors, STATUS)
    bad = marked(layouts, 1)
    bad[4].data = layouts[3].data(angle(3, 1), healthy=False)
    found = by_cycle(feed(taker, [*marked(layouts, 0), *bad]))
    caution = taker.caution(T0 + 2 * PERIOD)
    assert caution == 'joint_3a: frames rejected, status bits report an error'
    found |= by_cycle(feed(taker, marked(layouts, 2)))
    expected = sets_of(range(3), {3}, when=[1])
    if sensors == 4:
        del expected[1]
    assert found == expected
    tally = taker.tally()
    assert tally['dropped: joint_3a: status bits report an error'] == (sensors == 4)
    assert tally['joint_3a rejected: status bits report an error'] == 1


def test_too_many_nodes_that_are_not_well_are_all_named():
    taker, layouts = rig(6)
    for node_id in (1, 5, 6):
        taker.feed(at(0.0, canopen.emcy(node_id, 0x5000, 1)))
    assert feed(taker, marked(layouts, 0)) == []
    assert taker.explain(T0, 1.0) == (
        f'joint_1a: {EMERGENCY}; joint_3b: {EMERGENCY}; joint_3c: {EMERGENCY}'
    )


def test_silent_encoders_are_explained_by_what_is_known_of_each():
    taker = decoder()
    assert taker.silent(NOW, 0.03) == (0, 1, 2, 3)
    assert taker.explain(NOW, 0.03) == 'all encoders silent (no frames)'
    feed(taker, [answer(0, NOW), answer(1, NOW - 0.029)])
    assert taker.silent(NOW, 0.03) == (2, 3)
    assert taker.explain(NOW, 0.03) == 'joint_1c silent (no frames); joint_3a silent (no frames)'
    feed(taker, [answer(2, NOW - 0.02, data=bytes(3))])
    assert taker.explain(NOW, 0.03) == (
        'joint_1c silent (frames rejected, 3 bytes instead of 4); joint_3a silent (no frames)'
    )
    # A rejection as old as the timeout explains nothing any more.
    assert taker.explain(NOW + 0.02, 0.03).startswith(
        'joint_1b silent (no frames); joint_1c silent (no frames)'
    )
    feed(taker, [at(1.0, canopen.frame(0x704, b'\x7f'))])
    assert taker.explain(NOW, 0.03).endswith('joint_3a silent (pre-operational)')
    # It is the same rule for four, five and six.
    assert taker.caution(NOW) == 'joint_3a: pre-operational'


def test_counters_are_read_in_one_step_since_another_thread_adds_new_ones():
    class Growing(Counter):
        def items(self):
            raise RuntimeError('dictionary changed size during iteration')

    taker = decoder()
    taker.counters = Growing(frames=2)
    taker.assembler.counters = Growing(sets=1)
    taker.encoders[3].rejects = Growing(late=1)
    assert taker.tally() == {'frames': 2, 'sets': 1, 'joint_3a rejected: late': 1}


SURPLUS = 'two answers from joint_1c in one cycle'


def test_an_answer_too_many_spoils_its_cycle():
    taker = decoder()
    *first, last = cycle(0)
    assert feed(taker, [*first, answer(2, T0 + 8e-4), last]) == []
    assert taker.assembler.cause == SURPLUS
    assert taker.caution(T0 + PERIOD) is None
    assert taker.tally()[f'rejected: {SURPLUS}'] == 1
    assert taker.tally()[f'dropped: {SURPLUS}'] == 1


def test_an_answer_too_many_after_the_set_is_a_caution_for_a_while():
    taker = decoder()
    assert len(feed(taker, [*cycle(0), answer(2, T0 + 8e-4)])) == 1
    assert len(feed(taker, cycle(1))) == 1
    assert taker.tally()[f'rejected: {SURPLUS}'] == 1
    assert f'dropped: {SURPLUS}' not in taker.tally()
    assert taker.caution(T0 + 1.9) == SURPLUS
    assert taker.caution(T0 + 2.1) is None
    taker.feed(at(0.0, canopen.emcy(4, 0x5000, 1)))
    assert taker.caution(T0 + 0.1) == f'joint_3a: {EMERGENCY}; {SURPLUS}'


def test_a_late_answer_of_a_missing_one_is_not_one_too_many():
    taker = decoder()
    late = answer(3, T0 + PERIOD + 8e-4)
    feed(taker, [*cycle(0)[:4], *cycle(1), late])
    assert taker.caution(T0 + 0.01) is None


def test_the_window_without_sync_is_half_a_period_at_most():
    messages = [
        answer(0, T0),
        answer(1, T0 + 1e-4),
        answer(2, T0 + 2e-4),
        answer(3, T0 + 4.9e-4),
    ]
    assert len(feed(decoder(encoders__sync_id=0), messages)) == 1
    messages[3].timestamp = T0 + 5.1e-4
    assert feed(decoder(encoders__sync_id=0), messages) == []
    narrow = decoder(encoders__sync_id=0, encoders__window=1.5e-4)
    feed(narrow, messages[:3])
    assert narrow.assembler.counters['cycles'] == 2


RAW = {
    'encoders__window': 5e-3,
    'rate': 100.0,
    'can__protocol': 'raw',
}


def test_statistics_of_encoders_that_were_never_heard():
    figures = decoder(**RAW).statistics(T0)
    assert figures['joint_1a age (ms)'] == 'never heard'
    names = ' '.join(figures)
    assert 'skew' not in names
    assert 'jitter' not in names
    assert 'node' not in names


def percentiles(figures, name):
    """Return p50, p99 and the maximum of a figure, us."""
    words = figures[f'{name} p50 / p99 / max (us)'].split(' / ')
    return [float(part) for part in words]


def test_statistics_have_rates_ages_missed_cycles_and_percentiles(clock):
    """Sets whose last answer lags by 5, 10 .. 1000 us."""
    taker = decoder(**RAW)
    taker.statistics(T0)
    for number in range(1, 201):
        at = T0 + 0.01 * number
        taker.feed(sync(at))
        for index in range(3):
            taker.feed(answer(index, at + 1e-3))
        taker.feed(answer(3, at + 1e-3 + 5e-6 * number))
    for number in range(300):
        taker.feed(sync(T0 + 10.0 + 0.01 * number))
    clock.now = 4.0
    figures = taker.statistics(T0 + 13.0)
    assert figures['joint_1a frame rate (Hz)'] == 50.0
    assert percentiles(figures, 'skew') == pytest.approx([505, 995, 1000], abs=1)
    assert percentiles(figures, 'SYNC jitter') == pytest.approx([0, 0, 7990000], abs=1)
    assert figures['sets'] == 200
    assert figures['frames'] == 1300
    assert figures['cycles'] == 500
    assert figures['joint_3a missed cycles'] == 299
    assert figures['joint_3a age (ms)'] == pytest.approx(1e4 + 998.0)


def test_statistics_without_sync():
    without_sync = decoder(encoders__sync_id=0)
    for number in range(3):
        feed(without_sync, cycle(number)[1:])
    figures = without_sync.statistics(T0)
    assert figures['cycle jitter p50 / p99 / max (us)'] == '0 / 0 / 0'
    assert figures['joint_1a node 1'] == 'unknown, no heartbeat yet'
