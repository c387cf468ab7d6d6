# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Encoders that answer late by whole cycles: what can be known, and what cannot.

A rolling counter shows it from the first late answer on. Without one, a cycle of two periods shows
it: the driver leaves SYNC out where it makes SYNC itself; else the bus has to pause by chance.
"""

from encoder_frames import feed, PERIOD, sync, T0
from marked_cycles import by_cycle, COUNTER, cycle, frame, rig, sets_of, stream_of
import pytest
from scripted_bus import cycles, opening_of, run
from spm_haptic_master.encoders.late_answers import LONGEST_QUEUE
from spm_haptic_master.kinematics.joints import JOINT_NAMES

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
            due = number + by if number >= begin else number
            queue.append((due, number))
        while queue and queue[0][0] <= number:
            _, sampled = queue.pop(0)
            stream.append(frame(layouts, late, number, sampled))
    return stream


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('late', [0, 3])
@pytest.mark.parametrize('by', [1, 2, 3])
def test_a_rolling_counter_shows_a_late_encoder_from_its_first_late_answer(sensors, late, by):
    taker, layouts = rig(sensors, COUNTER)
    found = by_cycle(feed(taker, late_stream(layouts, late, by, 10, 60)))
    numbers = range(10 if sensors == 4 else 60)
    assert found == sets_of(numbers, {late}, when=range(10, 60))


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_a_rolling_counter_that_leaves_a_number_out_shows_that_the_frame_was_lost(sensors):
    taker, layouts = rig(sensors, COUNTER)
    found = by_cycle(feed(taker, stream_of(layouts, range(20), {3}, when=[10])))
    expected = sets_of(range(20), {3}, when=[10])
    if sensors == 4:
        del expected[10]
    assert found == expected
    # Nothing more is expected of it: the next set goes out with its last answer.
    assert taker.assembler.counters['sets at the end of the cycle'] == 1


def test_an_unchanged_rolling_counter_yields_no_set():
    taker, layouts = rig(4, COUNTER)
    stream = [cycle(layouts, number) for number in range(40)]
    for number in range(11, 20):
        stream[number][3].data[4] = 10
    # Frame 10 is the last fresh one; 20 comes as a jump, fresh again.
    found = by_cycle(feed(taker, sum(stream, [])))
    assert [*found] == [*range(11), *range(20, 40)]
    tally = taker.tally()
    assert tally['joint_1c rejected: rolling counter unchanged'] == 9
    assert tally['joint_1c rejected: rolling counter jumped (frame kept)'] == 1


def later_than(last, found):
    """Return the sets of cycles after one."""
    return {number: joints for number, joints in found.items() if number > last}


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('late', [0, 3])
@pytest.mark.parametrize('by', [1, 2])
def test_a_cycle_of_two_periods_shows_an_encoder_that_is_late_since_its_start(sensors, late, by):
    taker, layouts = rig(sensors)
    stream = late_stream(layouts, late, by, 0, 80, gaps={20, 60})
    found = by_cycle(feed(taker, stream), 20)
    after = [*range(21, 60), *range(61, 80)]
    expected = {} if sensors == 4 else sets_of(after, {late}, when=after)
    assert later_than(20, found) == expected
    assert LATE in taker.caution(T0 + 80 * PERIOD)
    reason = taker.explain(T0 + 80 * PERIOD, 1.0)
    of_four = f'{JOINT_NAMES[late]}: {LATE}'
    assert reason == (of_four if sensors == 4 else None)


def test_an_encoder_that_is_in_time_again_is_taken_after_three_cycles_of_two_periods():
    taker, layouts = rig(6)
    feed(taker, late_stream(layouts, 4, 1, 0, 40, gaps={20}))
    numbers = [*range(40, 46), *range(47, 53), *range(54, 60), *range(61, 80)]
    found = by_cycle(feed(taker, stream_of(layouts, numbers)))
    assert found
    for number, joints in found.items():
        assert joints == ({4} if number < 60 else set())


@pytest.mark.parametrize(('gaps', 'lost'), [({20, 22}, None), ({20, 40}, 40)])
def test_a_late_encoder_is_not_taken_because_it_answers_once_in_a_long_cycle(gaps, lost):
    """It has nothing to send for a period after a gap, or its other answer is lost."""
    taker, layouts = rig(6)
    stream = late_stream(layouts, 4, 1, 0, 80, gaps=gaps)
    if lost:
        of_late = [message for message in stream if message.arbitration_id == 0x185]
        behind = [each for each in of_late if each.timestamp > T0 + lost * PERIOD]
        stream.remove(behind[0])
    found = later_than(20, by_cycle(feed(taker, stream), 20))
    assert found
    for joints in found.values():
        assert joints == {4}


def test_an_encoder_that_owed_its_second_answer_in_a_long_cycle_is_not_late():
    taker, layouts = rig(6)
    stream = late_stream(layouts, 4, 1, 10, 13, gaps={12})
    stream += stream_of(layouts, range(13, 40))
    found = by_cycle(feed(taker, stream))
    numbers = [*range(12), *range(13, 40)]
    assert found == sets_of(numbers, {4}, when=[10])


def test_a_lost_sync_is_no_sign_that_all_are_late():
    """The encoders heard it and answer: in two periods each of them twice."""
    taker, layouts = rig(6)
    stream = stream_of(layouts, range(20))
    stream += cycle(layouts, 20)[1:]
    stream += stream_of(layouts, range(21, 40))
    found = by_cycle(feed(taker, stream))
    assert found == sets_of([*range(20), *range(21, 40)])


def test_a_gap_in_which_frames_were_lost_shows_no_late_encoder():
    """E3: the receiver's queue ran over; behind it all but one seem to answer twice."""
    taker, layouts = rig(4)
    stream = stream_of(layouts, range(100))
    # Five frames a cycle: from the end of one until behind the first answer of a later one.
    del stream[5 * 20 : 5 * 50 + 2]
    found = by_cycle(feed(taker, stream))
    assert [*found] == [*range(20), *range(51, 100)]


def test_a_cycle_that_two_lost_frames_made_long_is_forgotten():
    """E3: a late encoder would have had nothing to send in a later cycle."""
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = stream_of(layouts, range(end + 50))
    # SYNC, and the first answer behind it.
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    assert [*found][:20] == [*range(20)]
    assert [*found][20:] == [*range(end + 1, end + 50)]


def test_frames_that_are_lost_again_confirm_no_late_encoder():
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = stream_of(layouts, range(end + 50))
    # Behind the first gap another one, from the second answer of a cycle to the end of the next.
    del stream[5 * 30 + 2 : 5 * 32]
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    # Its SYNC was lost: a cycle less.
    assert [*later_than(20, found)] == [*range(end + 2, end + 50)]


@pytest.mark.parametrize('joint', [1, 2, 3])
def test_a_frame_that_is_lost_alone_confirms_no_late_encoder(joint):
    """E3: all that one long cycle has shown to be late would have had nothing to send."""
    taker, layouts = rig(4)
    end = 21 + LONGEST_QUEUE
    stream = stream_of(layouts, range(end + 50))
    # Long after the first gap the answer of one joint.
    del stream[5 * 30 + 1 + joint]
    del stream[5 * 20 : 5 * 20 + 2]
    found = by_cycle(feed(taker, stream))
    assert [*later_than(20, found)] == [*range(end + 1, end + 50)]


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
    for number, joints in found.items():
        if 20 < number < begin - 1:
            assert joints == {3}
    for number in range(begin + LONGEST_QUEUE + 2, end - 1):
        assert found[number] == {3}


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
    frames = [sync(T0 + PERIOD * number)]
    for index, count in counts.items():
        frames.append(frame(layouts, index, number, count))
    return frames


def samples_after(samples, number):
    """Return how many sets are of cycles after one."""
    after = (T0 + PERIOD * number) * 1e9
    return sum(sample.stamp > after for sample in samples)


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
    pauses = range(30, 200, 20)
    numbers = [number for number in range(200) if number not in pauses]
    for answers, number in enumerate(numbers):
        present = range(4)
        if number < silent:
            present = ()
        if number == silent:
            # They have answered the SYNC before the others came up.
            present = first
        counts = dict.fromkeys(present, answers - silent)
        samples += feed(taker, counted(layouts, number, counts))
    assert samples_after(samples, 120) > 70


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
        counts = {0: number, 1: number, 2: number}
        if number < 10:
            counts[3] = number
        if number >= back:
            counts[3] = restart + number - back
        samples += feed(taker, counted(layouts, number, counts))
    late = samples_after(samples, back + 4.5)
    assert late >= 14 if taken else late == 0
