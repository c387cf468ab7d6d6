# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets of one cycle: whole ones, ones without a joint, or none; never of two cycles."""

import random

from encoder_frames import decoder, feed, LAYOUTS, PERIOD, sync, T0
from marked_cycles import angle, by_cycle, COUNT, cycle, rig, sets_of, stream_of
import pytest
from spm_haptic_master.encoders.set_assembler import SetAssembler
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Cycles without an answer after which a joint is not waited for.
SILENT = 3
SYNC_ID = 0x80
# Period and window of the assembler alone, s.
ALONE = 1.0
WINDOW = 0.5
GOOD = pytest.approx((0.0, 0.1, 0.2, 0.3))


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_set_is_one_answer_of_each_encoder_in_any_order(sensors):
    taker, layouts = rig(sensors)
    opening, *answers, last = cycle(layouts, 0)
    # SYNC may have a counter.
    assert feed(taker, [sync(T0, counter=7), *reversed(answers)]) == []
    (sample,) = feed(taker, [last])
    assert sample.stamp == round(T0 * 1e9)
    expected = [angle(index, 0) for index in range(sensors)]
    assert sample.angles == pytest.approx(expected, abs=COUNT)


@pytest.mark.parametrize('index', range(4))
@pytest.mark.parametrize('late_by', [1, 2, 3])
@pytest.mark.parametrize('first', [True, False])
def test_a_late_answer_never_completes_a_later_cycle(index, late_by, first):
    """It comes before the other answers of that cycle, or in its usual place."""
    stream = [cycle(LAYOUTS, number) for number in range(12)]
    late = stream[3].pop(1 + index)
    place = 1 if first else 1 + index
    late.timestamp = stream[3 + late_by][place].timestamp - 1e-5
    stream[3 + late_by].insert(place, late)
    taker = decoder()
    found = by_cycle(feed(taker, sum(stream, [])))
    assert found == sets_of([*range(3), *range(4, 12)])
    assert taker.tally()[f'rejected: late answer from {JOINT_NAMES[index]}'] == 1


@pytest.mark.parametrize('stall', [1, 2, 3, 6])
@pytest.mark.parametrize('at_once', [1, 2, 3, 4, 5, 7, 9, 16])
@pytest.mark.parametrize('answered', range(4))
def test_answers_that_pile_up_are_never_taken_for_fresh(stall, at_once, answered):
    """All encoders hang for some cycles, then answer every SYNC, a few frames a cycle at first."""

    def able_to_send(number, waiting):
        if number < 10 or number >= 20:
            return waiting
        if number == 10:
            return answered
        if number < 10 + stall:
            return 0
        if number < 12 + stall:
            return at_once
        # Four a cycle is what comes in: the backlog of less than five would stay for good.
        return max(at_once, 5)

    queue = []
    got = []
    taker = decoder()
    for number in range(40):
        opening, *answers = cycle(LAYOUTS, number)
        got += feed(taker, [opening])
        queue += answers
        able = able_to_send(number, len(queue))
        for message in queue[:able]:
            message.timestamp = T0 + PERIOD * number + 1e-4
            got += feed(taker, [message])
        del queue[:able]
    numbers = [*by_cycle(got)]
    assert numbers[:10] == [*range(10)]
    assert numbers[-10:] == [*range(30, 40)]


@pytest.mark.parametrize(
    ('sensors', 'gone'),
    [
        (5, {4}),
        (5, {0}),
        (6, {4}),
        (6, {5}),
        (6, {0, 1}),
        (6, {3, 4}),
    ],
)
def test_the_sets_go_on_without_a_silent_sensor_and_do_not_wait_for_it(sensors, gone):
    taker, layouts = rig(sensors)
    found = by_cycle(feed(taker, stream_of(layouts, range(10))))
    held = 0
    for number in range(10, 60):
        opening, *answers = cycle(layouts, number, gone)
        at_sync = feed(taker, [opening])
        at_answers = feed(taker, answers)
        held += len(at_sync)
        found |= by_cycle(at_sync + at_answers)
        # It goes out with its last answer.
        assert len(at_answers) == (number >= 10 + SILENT)
    counters = taker.assembler.counters
    assert found == sets_of(range(60), gone, when=range(10, 60))
    assert held == SILENT
    assert counters['sets at the end of the cycle'] == SILENT
    assert counters['sets with a joint missing'] == 50
    reasons = [f'{ALL_JOINT_NAMES[index]}: no frames' for index in sorted(gone)]
    assert taker.caution(T0 + 60 * PERIOD) == '; '.join(reasons)


@pytest.mark.parametrize(
    ('sensors', 'gone'),
    [
        (4, {3}),
        (4, {0}),
        (5, {0, 4}),
        (6, {0, 3, 5}),
    ],
)
def test_fewer_than_four_readings_are_no_set(sensors, gone):
    taker, layouts = rig(sensors)
    feed(taker, cycle(layouts, 0))
    assert feed(taker, stream_of(layouts, range(1, 30), gone, when=range(1, 30))) == []
    names = ', '.join(ALL_JOINT_NAMES[index] for index in sorted(gone))
    assert taker.assembler.cause == f'no answer from {names}'
    # The 29th is not over.
    assert taker.assembler.counters['dropped sets'] == 29


def check_silence(sensors, index, silent, lost):
    """Check which readings are missing where a sensor does not answer some cycles."""
    taker, layouts = rig(sensors)
    back = 10 + silent
    numbers = range(back + 20)
    frames = stream_of(layouts, numbers, {index}, when=range(10, back))
    found = by_cycle(feed(taker, frames))
    expected = sets_of(numbers, {index}, when=lost)
    if sensors == 4:
        expected = {number: gone for number, gone in expected.items() if not gone}
    assert found == expected
    missed = [0] * sensors
    missed[index] = silent
    assert taker.assembler.missed == missed


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_one_lost_frame_costs_one_reading_or_of_four_one_set(sensors):
    for index in range(sensors):
        check_silence(sensors, index, silent=1, lost=[10])


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('silent', [2, 3, 4, 20])
def test_a_sensor_is_taken_again_when_it_answers_again(sensors, silent):
    """Until its late answers would have come, what comes may be one of them."""
    check_silence(sensors, 3, silent, lost=range(10, 10 + silent + 3))


@pytest.mark.parametrize(('sensors', 'share'), [(4, 0.94), (6, 0.999)])
def test_one_per_cent_of_lost_frames(sensors, share):
    """Where no two joints are lost together, four sensors give 96 % of the sets."""
    rng = random.Random(25)
    taker, layouts = rig(sensors)
    cycles = 1500
    stream = []
    for number in range(cycles):
        lost = {index for index in range(sensors) if rng.random() < 0.01}
        stream += cycle(layouts, number, lost)
    found = by_cycle(feed(taker, stream))
    missing = sum(map(len, found.values()))
    assert len(found) > share * cycles
    assert missing < 0.02 * sensors * cycles


@pytest.mark.parametrize(
    ('sensors', 'gone'),
    [
        (4, {2}),
        (5, {4}),
        (6, {0}),
        (6, {2, 3}),
    ],
)
def test_without_sync_a_silent_sensor_is_not_waited_for_either(sensors, gone):
    taker, layouts = rig(sensors, encoders__sync_id=0)
    silent = range(10, 30)
    frames = stream_of(layouts, range(40), gone, when=silent)
    answers = [message for message in frames if message.arbitration_id != SYNC_ID]
    found = by_cycle(feed(taker, answers))
    assert taker.assembler.counters['sets at the end of the cycle'] <= SILENT + 1
    if sensors == 4:
        assert len(found) == 20 - 1 + (0 in gone)
        return
    # When it is back, its first frame may come after the set.
    assert found.pop(30) <= gone
    expected = sets_of(range(40), gone, when=silent)
    del expected[30]
    assert found == expected


def assembler(synchronised=True, window=WINDOW):
    return SetAssembler(JOINT_NAMES, synchronised, window, ALONE)


def answer_all(taker, stamp, without=()):
    """Answer for the joints in order, from `stamp`; return the set, if any."""
    found = None
    for index in range(4):
        if index not in without:
            sample = taker.answer(index, 0.1 * index, stamp + 0.1 * index)
            found = sample if found is None else found
    return found


@pytest.mark.parametrize(
    ('window', 'at', 'good'),
    [
        (0.5, 0.0, True),
        (0.5, 0.5, True),
        (0.5, 0.501, False),
        (0.5, -0.001, False),
        (3.5, 1.5, True),
        (3.5, 3.501, False),
    ],
)
def test_an_answer_counts_within_the_window(window, at, good):
    taker = assembler(window=window)
    taker.begin(64.0)
    for index in (0, 1, 2):
        taker.answer(index, 0.1, 64.0)
    assert (taker.answer(3, 0.1, 64.0 + at) is not None) == good
    if not good:
        reason = 'answer from joint_3a outside the window'
        assert taker.cause == reason
        assert taker.counters[f'rejected: {reason}'] == 1
        assert taker.counters[f'dropped: {reason}'] == 1


def test_two_refused_answers_are_counted_as_one_reason_in_any_order():
    """Else /diagnostics has a key for each order in which they came."""
    taker = assembler(window=0.5)
    for begin, refused in ((64.0, (1, 3)), (164.0, (3, 1))):
        taker.begin(begin)
        for index in (0, 2):
            taker.answer(index, 0.1, begin)
        for index in refused:
            taker.answer(index, 0.1, begin + 0.9)
    dropped = {key: count for key, count in taker.counters.items() if key.startswith('dropped: ')}
    assert dropped == {
        'dropped: answer from joint_1b outside the window; '
        'answer from joint_3a outside the window': 2
    }


@pytest.mark.parametrize(('window', 'doubt'), [(0.5, 1.5), (3.5, 3.5)])
@pytest.mark.parametrize('beyond', [False, True])
def test_doubt_lasts_for_the_window_and_at_least_one_and_a_half_periods(window, doubt, beyond):
    taker = assembler(window=window)
    taker.begin(64.0)
    answer_all(taker, 64.0, without=(1,))
    stamp = 64.0 + doubt + (0.001 if beyond else 0.0)
    taker.begin(stamp)
    assert (answer_all(taker, stamp) is not None) == beyond
    assert taker.counters['overdue cycles'] == (stamp > 64.0 + 1.5 * ALONE)


def test_joints_that_miss_a_cycle_together_are_not_taken_until_their_answers_have_come():
    taker = assembler(window=10.0)
    taker.begin(100.0)
    answer_all(taker, 100.0, without=(1, 2))
    for number, late in enumerate((1, 2)):
        taker.begin(101.0 + number)
        assert answer_all(taker, 101.0 + number) is None
        # The one that was missing comes after that of this cycle: this was the late one.
        taker.answer(late, 0.9, 101.5 + number)
    assert taker.begin(103.0) is None
    assert answer_all(taker, 103.0).angles == GOOD
    assert taker.counters['dropped: may contain an answer to an earlier SYNC'] == 2
    assert taker.counters['rejected: late answer from joint_1b'] == 1
    assert taker.counters['rejected: late answer from joint_1c'] == 1


def test_more_answers_than_are_owed_spoil_their_cycle():
    taker = assembler()
    taker.begin(100.0)
    answer_all(taker, 100.0, without=(1,))
    taker.begin(101.0)
    answer_all(taker, 101.0)
    for at in (101.4, 101.45):
        taker.answer(1, 0.1, at)
    assert taker.begin(102.0) is None
    assert taker.counters['rejected: late answer from joint_1b'] == 1
    assert taker.cause == 'two answers from joint_1b in one cycle'


@pytest.mark.parametrize(
    ('index', 'at', 'same'),
    [
        (3, WINDOW, True),
        (3, WINDOW + 0.01, False),
        (3, -0.01, False),
        (0, 0.1, False),
    ],
)
def test_without_sync_a_frame_beyond_the_window_or_a_second_one_opens_a_cycle(index, at, same):
    taker = assembler(synchronised=False)
    for other in range(3):
        taker.answer(other, 0.1, 64.0)
    found = taker.answer(index, 0.2, 64.0 + at)
    assert (found is not None) == same
    assert taker.cause == (None if same else 'no answer from joint_3a')
    assert taker.counters['cycles'] == (1 if same else 2)
    if not same:
        sample = answer_all(taker, 64.0 + at, without=(index,))
        assert sample.stamp == round((64.0 + at) * 1e9)
        assert sample.angles[index] == 0.2


@pytest.mark.parametrize(
    'phases',
    [
        (0.0, 0.3, 0.6, 0.8),
        (0.2, 0.9, 0.0, 0.5),
    ],
)
def test_E6_encoders_without_sync_at_other_phases_are_named_by_their_phase(phases):
    """Free-running timers: no half of a period has all four."""
    taker = assembler(synchronised=False, window=0.5)
    for number in range(20):
        for index in sorted(range(4), key=phases.__getitem__):
            taker.answer(index, 0.1, 64.0 + number + phases[index])
    reason = 'dropped: frames further apart than the window'
    assert taker.counters['sets'] == 0
    assert taker.counters[reason] >= 19
    assert taker.cause.startswith('without SYNC joint_')
    assert 'a set needs all frames within 500 ms: SYNC is needed' in taker.cause


def test_E6_the_skew_of_encoders_without_sync_is_that_of_their_frames():
    taker = assembler(synchronised=False, window=0.5)
    answer_all(taker, 64.0)
    for number in range(1, 20):
        assert answer_all(taker, 64.0 + number) is not None
    assert taker.skew.percentiles(0.5)[0] == pytest.approx(3e5, rel=1e-3)
