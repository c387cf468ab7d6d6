# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frames in, sets out: what is not taken, and what is reported of encoders and nodes."""

from collections import Counter

from encoder_frames import answer, cycle, decoder, feed, LAYOUTS, PERIOD, sync, T0
from marked_cycles import angle, by_cycle, COUNTER, rig, STATUS
from marked_cycles import cycle as marked
import pytest
from spm_haptic_master.encoders import canopen

NOW = T0 + 1.0
EMERGENCY = 'EMCY 0x5000 device hardware, error register 0x01'


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
        stream[1].insert(place, answer(1, T0 + PERIOD + 1e-4 * place, **fields))
        assert by_cycle(feed(taker, sum(stream, []))) == {0: set(), 1: set(), 2: set()}
        assert taker.tally()[reason] == 1


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
        (canopen.frame(0x705, b'\x7f'), canopen.frame(0x705, b'\x05'), 'pre-operational'),
        (canopen.frame(0x705, b'\x04'), canopen.frame(0x705, b'\x05'), 'stopped'),
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
    assert found == {n: {4} if 10 <= n < 20 else set() for n in range(30)}
    assert taker.assembler.counters['sets at the end of the cycle'] == 0
    assert taker.caution(T0 + 30 * PERIOD) is None


def test_a_lost_heartbeat_takes_the_joint_away_until_it_comes_again():
    taker, layouts = rig(6, can__heartbeat_timeout=0.02)
    stream = [marked(layouts, number) for number in range(60)]
    for place in (0, 50):
        stream[place].insert(0, at(PERIOD * (place - 0.05), canopen.frame(0x705, b'\x05')))
    found = by_cycle(feed(taker, sum(stream[:50], [])))
    assert taker.caution(T0 + 49 * PERIOD) == 'joint_3b: heartbeat lost'
    assert all(found[n] == ({4} if n >= 20 else set()) for n in range(50))
    assert by_cycle(feed(taker, sum(stream[50:], []))) == {n: set() for n in range(50, 60)}


def test_a_node_that_has_booted_and_was_started_is_operational_until_its_heartbeat():
    """The first heartbeat comes later than the first answers; their counter begins anew."""
    taker, layouts = rig(6, COUNTER)
    answers = marked(layouts, 2)
    answers[5].data = layouts[4].data(angle(4, 2), 1)
    boot_up = at(1.9 * PERIOD, canopen.frame(0x705, b'\x00'))
    assert by_cycle(feed(taker, [*marked(layouts, 1), boot_up, *answers])) == {1: set(), 2: set()}


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_status_bits_take_their_joint_away(sensors):
    taker, layouts = rig(sensors, STATUS)
    bad = marked(layouts, 1)
    bad[4].data = layouts[3].data(angle(3, 1), healthy=False)
    found = by_cycle(feed(taker, [*marked(layouts, 0), *bad]))
    assert (
        taker.caution(T0 + 2 * PERIOD) == 'joint_3a: frames rejected, status bits report an error'
    )
    found |= by_cycle(feed(taker, marked(layouts, 2)))
    assert found == {0: set(), **({} if sensors == 4 else {1: {3}}), 2: set()}
    assert taker.tally()['dropped: joint_3a: status bits report an error'] == (sensors == 4)
    assert taker.tally()['joint_3a rejected: status bits report an error'] == 1


def test_too_many_nodes_that_are_not_well_are_all_named():
    taker, layouts = rig(6)
    for node_id in (1, 5, 6):
        taker.feed(at(0.0, canopen.emcy(node_id, 0x5000, 1)))
    assert feed(taker, marked(layouts, 0)) == []
    assert taker.explain(T0, 1.0) == '; '.join(
        f'{joint}: {EMERGENCY}' for joint in ('joint_1a', 'joint_3b', 'joint_3c')
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


def test_an_answer_too_many_spoils_its_cycle_or_after_the_set_is_a_caution_for_a_while():
    taker = decoder()
    surplus = 'two answers from joint_1c in one cycle'
    assert feed(taker, [*cycle(-1)[:4], answer(2, T0 - 2e-4), cycle(-1)[4]]) == []
    assert taker.assembler.cause == surplus
    assert taker.caution(T0) is None
    assert len(feed(taker, [*cycle(0), answer(2, T0 + 8e-4)])) == 1
    assert len(feed(taker, cycle(1))) == 1
    assert taker.tally()[f'rejected: {surplus}'] == 2 == taker.tally()[f'dropped: {surplus}'] + 1
    assert taker.caution(T0 + 1.9) == surplus
    assert taker.caution(T0 + 2.1) is None
    taker.feed(at(0.0, canopen.emcy(4, 0x5000, 1)))
    assert taker.caution(T0 + 0.1) == f'joint_3a: {EMERGENCY}; {surplus}'
    # A late answer of a missing one is no surplus.
    late = decoder()
    feed(late, [*cycle(0)[:4], *cycle(1), answer(3, T0 + PERIOD + 8e-4)])
    assert late.caution(T0 + 0.01) is None


def test_the_window_without_sync_is_half_a_period_at_most():
    messages = [answer(index, T0 + at) for index, at in enumerate((0.0, 1e-4, 2e-4, 4.9e-4))]
    assert len(feed(decoder(encoders__sync_id=0), messages)) == 1
    messages[3].timestamp = T0 + 5.1e-4
    assert feed(decoder(encoders__sync_id=0), messages) == []
    narrow = decoder(encoders__sync_id=0, encoders__window=1.5e-4)
    feed(narrow, messages[:3])
    assert narrow.assembler.counters['cycles'] == 2


def test_statistics_have_rates_ages_missed_cycles_and_percentiles(clock):
    """Sets whose last answer lags by 5, 10 .. 1000 us."""
    taker = decoder(
        encoders__window=5e-3,
        rate=100.0,
        can__protocol='raw',
    )
    figures = taker.statistics(T0)
    assert figures['joint_1a age (ms)'] == 'never heard'
    assert not any(word in name for name in figures for word in ('skew', 'jitter', 'node'))
    for number in range(1, 201):
        at = T0 + 0.01 * number
        feed(
            taker,
            [
                sync(at),
                *(answer(index, at + 1e-3) for index in range(3)),
                answer(3, at + 1e-3 + 5e-6 * number),
            ],
        )
    for number in range(300):
        feed(taker, [sync(T0 + 10.0 + 0.01 * number)])
    clock.now = 4.0
    figures = taker.statistics(T0 + 13.0)
    assert figures['joint_1a frame rate (Hz)'] == 50.0
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
