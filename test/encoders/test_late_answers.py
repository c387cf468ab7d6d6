# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Encoders that answer late by whole cycles: what can be known, and what cannot.

A rolling counter shows it from the first late answer on. Without one, a cycle of two periods shows
it: the driver leaves SYNC out where it makes SYNC itself; else the bus has to pause by chance.
"""

from encoder_frames import feed, PERIOD, sync, T0
from marked_cycles import by_cycle, COUNTER, cycle, frame, rig
import pytest
from scripted_bus import cycles, opening_of, run
from spm_haptic_master.encoders.late_answers import LONGEST_QUEUE

LATE = 'answers late by whole cycles'


def late_stream(layouts, late, by, begin, count, gaps=()):
    """
    Return cycles of which joint `late` answers `by` periods late from cycle `begin` on.

    In a gap there is no SYNC, but answers to earlier ones still come.
    """
    stream = []
    queue = []
    for number in range(count):
        if number not in gaps:
            stream += cycle(layouts, number, {late})
            queue.append((number + (by if number >= begin else 0), number))
        while queue and queue[0][0] <= number:
            stream.append(frame(layouts, late, number, queue.pop(0)[1]))
    return stream


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('late', [0, 3])
@pytest.mark.parametrize('by', [1, 2, 3])
def test_a_rolling_counter_shows_a_late_encoder_from_its_first_late_answer(sensors, late, by):
    taker, layouts = rig(sensors, COUNTER)
    found = by_cycle(feed(taker, late_stream(layouts, late, by, 10, 60)))
    assert found == {
        number: {late} if number >= 10 else set() for number in range(10 if sensors == 4 else 60)
    }


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_rolling_counter_that_leaves_a_number_out_shows_that_the_frame_was_lost(sensors):
    taker, layouts = rig(sensors, COUNTER)
    found = by_cycle(
        feed(
            taker,
            [
                each
                for number in range(20)
                for each in cycle(layouts, number, {3} if number == 10 else ())
            ],
        )
    )
    assert found == {
        number: {3} if number == 10 else set()
        for number in range(20)
        if sensors > 4 or number != 10
    }
    # Nothing more is expected of it: the next set goes out with its last answer.
    assert taker.assembler.counters['sets at the end of the cycle'] == 1


def test_an_unchanged_rolling_counter_yields_no_set():
    taker, layouts = rig(4, COUNTER)
    stream = [cycle(layouts, number) for number in range(40)]
    for number in range(11, 20):
        stream[number][3].data[4] = 10
    # Frame 10 is the last fresh one; 20 comes as a jump, fresh again.
    assert [*by_cycle(feed(taker, sum(stream, [])))] == [*range(11), *range(20, 40)]
    assert taker.tally()['joint_1c rejected: rolling counter unchanged'] == 9
    assert taker.tally()['joint_1c rejected: rolling counter jumped (frame kept)'] == 1


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('late', [0, 3])
@pytest.mark.parametrize('by', [1, 2])
def test_a_cycle_of_two_periods_shows_an_encoder_that_is_late_since_its_start(sensors, late, by):
    taker, layouts = rig(sensors)
    found = by_cycle(feed(taker, late_stream(layouts, late, by, 0, 80, gaps={20, 60})), 20)
    assert {number: joints for number, joints in found.items() if number > 20} == {
        number: {late} for number in range(21, 80) if number != 60 and sensors > 4
    }
    assert LATE in taker.caution(T0 + 80 * PERIOD)
    reason = taker.explain(T0 + 80 * PERIOD, 1.0)
    assert reason == (f'joint_{"3a" if late else "1a"}: {LATE}' if sensors == 4 else None)


def test_an_encoder_that_is_in_time_again_is_taken_after_three_cycles_of_two_periods():
    taker, layouts = rig(6)
    feed(taker, late_stream(layouts, 4, 1, 0, 40, gaps={20}))
    pauses = (46, 53, 60)
    found = by_cycle(
        feed(
            taker,
            [
                each
                for number in range(40, 80)
                if number not in pauses
                for each in cycle(layouts, number)
            ],
        )
    )
    assert all(joints == ({4} if number < 60 else set()) for number, joints in found.items())


@pytest.mark.parametrize(('gaps', 'lost'), [({20, 22}, None), ({20, 40}, 40)])
def test_a_late_encoder_is_not_taken_because_it_answers_once_in_a_long_cycle(gaps, lost):
    """It has nothing to send for a period after a gap, or its other answer is lost."""
    taker, layouts = rig(6)
    stream = late_stream(layouts, 4, 1, 0, 80, gaps=gaps)
    if lost:
        stream.remove(
            next(
                message
                for message in stream
                if message.arbitration_id == 0x185 and message.timestamp > T0 + lost * PERIOD
            )
        )
    assert all(
        joints == {4}
        for number, joints in by_cycle(feed(taker, stream), 20).items()
        if number > 20
    )


def test_an_encoder_that_owed_its_second_answer_in_a_long_cycle_is_not_late():
    taker, layouts = rig(6)
    stream = [
        *late_stream(layouts, 4, 1, 10, 13, gaps={12}),
        *(each for number in range(13, 40) for each in cycle(layouts, number)),
    ]
    found = by_cycle(feed(taker, stream))
    assert found == {n: {4} if n == 10 else set() for n in range(40) if n != 12}


def test_a_lost_sync_is_no_sign_that_all_are_late():
    """The encoders heard it and answer: in two periods each of them twice."""
    taker, layouts = rig(6)
    stream = [each for number in range(40) for each in cycle(layouts, number)[number == 20 :]]
    assert by_cycle(feed(taker, stream)) == {n: set() for n in range(40) if n != 20}


def test_a_gap_in_which_frames_were_lost_shows_no_late_encoder():
    """E3: the receiver's queue ran over; behind it all but one seem to answer twice."""
    taker, layouts = rig(4)
    stream = [each for number in range(100) for each in cycle(layouts, number)]
    # Five frames a cycle: from the end of one until behind the first answer of a later one.
    del stream[5 * 20 : 5 * 50 + 2]
    assert [*by_cycle(feed(taker, stream))] == [*range(20), *range(51, 100)]


def test_a_cycle_that_two_lost_frames_made_long_is_forgotten():
    """E3: a late encoder would have had nothing to send in a later cycle."""
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = [each for number in range(end + 50) for each in cycle(layouts, number)]
    # SYNC, and the first answer behind it.
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    assert [*found][:20] == [*range(20)]
    assert [*found][20:] == [*range(end + 1, end + 50)]


def test_frames_that_are_lost_again_confirm_no_late_encoder():
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = [each for number in range(end + 50) for each in cycle(layouts, number)]
    # Behind the first gap another one, from the second answer of a cycle to the end of the next.
    del stream[5 * 30 + 2 : 5 * 32]
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    # Its SYNC was lost: a cycle less.
    assert [number for number in found if number > 20] == [*range(end + 2, end + 50)]


@pytest.mark.parametrize('joint', [1, 2, 3])
def test_a_frame_that_is_lost_alone_confirms_no_late_encoder(joint):
    """E3: all that one long cycle has shown to be late would have had nothing to send."""
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = [each for number in range(end + 50) for each in cycle(layouts, number)]
    # Long after the first gap the answer of one joint.
    del stream[5 * 30 + 1 + joint]
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    assert [number for number in found if number > 20] == [*range(end + 1, end + 50)]


@pytest.mark.parametrize('by', [1, 2, 3])
def test_a_late_encoder_stays_one_after_a_long_cycle_that_shows_others_too(by):
    """E3: a lost SYNC and answer make the others seem late as well, which is then refuted."""
    taker, layouts = rig(6)
    begin = 60 + LONGEST_QUEUE
    end = begin + 2 * LONGEST_QUEUE
    stream = late_stream(layouts, 3, by, 0, end, gaps={20})
    lost = (T0 + (begin - 0.5) * PERIOD, T0 + (begin + 0.5) * PERIOD)
    inside = [each for each in stream if lost[0] < each.timestamp < lost[1]]
    stream = [each for each in stream if each not in inside[:2]]
    found = by_cycle(feed(taker, stream), 20)
    assert all(joints == {3} for number, joints in found.items() if 20 < number < begin - 1)
    assert all(found[number] == {3} for number in range(begin + LONGEST_QUEUE + 2, end - 1))


@pytest.mark.parametrize('by', [1, 2, 3])
def test_a_late_encoder_that_a_single_long_cycle_has_shown_stays_one(by):
    taker, layouts = rig(4)
    stream = late_stream(
        layouts,
        3,
        by,
        0,
        60 + 10 * LONGEST_QUEUE,
        gaps={20},
    )
    assert max(by_cycle(feed(taker, stream), 20)) == 19


def test_the_driver_leaves_sync_out_until_all_are_proven(producing):
    driver, producer = producing((), rate=100.0, can__timeout=0.1)
    begin = driver.clock.now
    # The cycle at 2.5 s is one of two periods.
    producer.openings, driver.buses[0].script = opening_of(
        [*cycles(begin + 0.01, 249), *cycles(begin + 2.51, 250)]
    )
    for until, skipped in ((0.5, 1), (2.4, 3), (5.0, 3)):
        run(driver, begin + until)
        assert producer.skip.call_count == skipped


def counted(layouts, number, counts):
    """Return SYNC and the answers with the given counters, by joint, of a cycle."""
    return [
        sync(T0 + PERIOD * number),
        *(frame(layouts, index, number, count) for index, count in counts.items()),
    ]


@pytest.mark.parametrize(
    'first',
    [
        (),
        (0,),
        (3,),
        (1, 2, 3),
    ],
)
@pytest.mark.parametrize('silent', [1, 2, 3, 4, 7])
def test_encoders_that_come_up_are_soon_taken(silent, first):
    """Their counters count answers; once SYNC has paused, nothing is owed any more."""
    taker, layouts = rig(4, COUNTER)
    samples = []
    for answers, number in enumerate(sorted(set(range(200)) - set(range(30, 200, 20)))):
        # Encoders of `first` have answered the SYNC before the others came up.
        present = () if number < silent else first if number == silent else range(4)
        samples += feed(taker, counted(layouts, number, dict.fromkeys(present, answers - silent)))
    assert sum(sample.stamp > (T0 + PERIOD * 120) * 1e9 for sample in samples) > 70


@pytest.mark.parametrize(
    ('back', 'restart', 'taken'),
    [
        (60, 0, True),
        (60, 77, True),
        (60, 10, True),
        (43, 10, True),
        (42, 10, False),
    ],
)
def test_an_encoder_with_a_counter_is_taken_again_soon_after_a_long_silence(back, restart, taken):
    """Its counter goes on where it was (10; soon, it is late), or from anywhere after a reboot."""
    taker, layouts = rig(4, COUNTER)
    samples = []
    for number in range(back + 20):
        last = (
            {3: number} if number < 10 else {3: restart + number - back} if number >= back else {}
        )
        samples += feed(taker, counted(layouts, number, dict.fromkeys(range(3), number) | last))
    late = sum(sample.stamp > (T0 + PERIOD * (back + 4.5)) * 1e9 for sample in samples)
    assert late >= 14 if taken else late == 0
