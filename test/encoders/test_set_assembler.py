# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The assembler alone: what each rejected or dropped thing is called, and at which time."""

import pytest
from spm_haptic_master.encoders.set_assembler import SetAssembler
from spm_haptic_master.kinematics.joints import JOINT_NAMES

PERIOD, WINDOW = 1.0, 0.5
GOOD = pytest.approx((0.0, 0.1, 0.2, 0.3))


def assembler(synchronised=True, window=WINDOW):
    return SetAssembler(JOINT_NAMES, synchronised, window, PERIOD)


def answer_all(taker, stamp, without=(), spacing=0.1):
    """Answer for the joints in order, from `stamp`; return the set, if any."""
    got = [taker.answer(index, 0.1 * index, stamp + spacing * index)
           for index in range(4) if index not in without]
    return next((sample for sample in got if sample is not None), None)


@pytest.mark.parametrize('synchronised', [True, False])
def test_counters_and_figures_of_good_cycles(synchronised):
    taker = assembler(synchronised)
    for at in (100.0, 101.1, 102.0, 103.0):
        if synchronised:
            taker.begin(at)
        sample = answer_all(taker, at)
        assert (sample.stamp, sample.angles) == (round(at * 1e9), GOOD)
    assert dict(taker.counters) == {'cycles': 4, 'sets': 4}
    assert (taker.cause, taker.missed, taker.jitter.count) == (None, [0, 0, 0, 0], 3)
    assert taker.skew.percentiles(0.5, 1.0) == pytest.approx((0.3e6, 0.3e6))
    assert taker.jitter.percentiles(0.0, 0.5, 1.0) == pytest.approx((0.0, 0.1e6, 0.1e6), abs=1e-3)


@pytest.mark.parametrize(('late', 'overdue'), [(0.5, 0), (0.51, 1), (2.0, 1)])
def test_a_cycle_is_overdue_from_one_and_a_half_periods_on(late, overdue):
    taker = assembler()
    for stamp in (100.0, 101.0 + late):
        taker.begin(stamp)
        answer_all(taker, stamp)
    assert taker.counters['overdue cycles'] == overdue


def test_a_reset_forgets_the_cycle_its_jitter_and_its_doubts():
    taker = assembler()
    taker.begin(100.0)
    answer_all(taker, 100.0, without=(2,))
    taker.begin(101.0)
    taker.reset()
    assert taker.answer(0, 0.1, 101.1) is None
    assert taker.counters['rejected: before the first SYNC'] == 1
    taker.begin(101.2)
    assert answer_all(taker, 101.2) is not None
    assert taker.jitter.count == 1


@pytest.mark.parametrize(('at', 'good'), [
    (0.0, True), (WINDOW, True), (WINDOW + 0.001, False), (-0.001, False)])
def test_an_answer_counts_within_the_window(at, good):
    taker = assembler()
    taker.begin(64.0)
    for index in (0, 1, 2):
        taker.answer(index, 0.1, 64.0)
    assert (taker.answer(3, 0.1, 64.0 + at) is not None) == good
    if not good:
        reason = 'answer from joint_3a outside the window'
        assert taker.cause == reason
        assert taker.counters[f'rejected: {reason}'] == taker.counters[f'dropped: {reason}'] == 1


def test_missing_answers_are_named_and_the_next_set_waits_for_the_end_of_its_cycle():
    taker = assembler()
    taker.begin(100.0)
    answer_all(taker, 100.0, without=(1,))
    assert taker.cause is None and taker.begin(101.0) is None
    assert taker.cause == 'no answer from joint_1b' and taker.missed == [0, 1, 0, 0]
    assert answer_all(taker, 101.0) is None
    sample = taker.begin(102.0)
    assert (sample.stamp, sample.angles) == (101 * 10**9, GOOD)
    # Late answers are expected for 1.5 periods after the incomplete cycle's SYNC.
    assert answer_all(taker, 102.0) is not None
    assert taker.cause is None
    assert taker.counters['dropped sets'] == 1
    assert taker.counters['sets at the end of the cycle'] == 1 + 1


@pytest.mark.parametrize(('window', 'doubt'), [(0.5, 1.5), (3.5, 3.5)])
@pytest.mark.parametrize('beyond', [False, True])
def test_doubt_lasts_for_the_window_and_at_least_one_and_a_half_periods(window, doubt, beyond):
    taker = assembler(window=window)
    taker.begin(64.0)
    answer_all(taker, 64.0, without=(1,))
    stamp = 64.0 + doubt + (0.001 if beyond else 0.0)
    taker.begin(stamp)
    assert (answer_all(taker, stamp) is not None) == beyond


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


def test_a_late_answer_that_comes_renews_the_doubt_of_the_others():
    """The late answer came in this cycle: those of the others may be late by as much."""
    taker = assembler(window=2.2)
    taker.begin(100.0)
    answer_all(taker, 100.0, without=(1, 2))
    for number in (1, 2):
        taker.begin(100.0 + number)
        answer_all(taker, 100.0 + number)
    taker.answer(1, 0.0, 102.6)
    for number in (3, 4, 5):
        assert taker.begin(100.0 + number) is None
        assert answer_all(taker, 100.0 + number) is None
    taker.begin(106.0)
    assert answer_all(taker, 106.0) is not None


def test_two_answers_in_one_cycle_spoil_it_and_owe_nothing():
    taker = assembler()
    taker.begin(100.0)
    taker.answer(0, 0.1, 100.0)
    assert taker.answer(0, 0.9, 100.1) is None
    assert answer_all(taker, 100.1, without=(0,)) is None
    reason = 'two answers from joint_1a in one cycle'
    assert taker.cause == reason
    assert taker.counters[f'dropped: {reason}'] == 1
    taker.begin(101.0)
    assert answer_all(taker, 101.0) is not None


@pytest.mark.parametrize(('at', 'same'), [(WINDOW, True), (WINDOW + 0.01, False), (-0.01, False)])
def test_without_sync_a_frame_beyond_the_window_opens_a_new_cycle(at, same):
    taker = assembler(synchronised=False)
    for index in range(3):
        taker.answer(index, 0.1, 64.0)
    assert (taker.answer(3, 0.1, 64.0 + at) is not None) == same
    if not same:
        assert taker.cause == 'no answer from joint_3a'
        assert taker.missed == [0, 0, 0, 1]
        assert taker.counters['cycles'] == 2


def test_without_sync_a_second_frame_of_a_joint_opens_a_new_cycle():
    taker = assembler(synchronised=False)
    taker.answer(0, 0.1, 100.0)
    taker.answer(0, 0.2, 100.1)
    assert taker.cause == 'no answer from joint_1b, joint_1c, joint_3a'
    sample = answer_all(taker, 100.2, without=(0,))
    assert (sample.stamp, sample.angles[0]) == (round(100.1e9), 0.2)
