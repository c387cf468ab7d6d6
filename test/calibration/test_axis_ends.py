# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The calibration of insertion and gripper from a motion between its ends: figures, refusals."""

import re

import numpy as np
import pytest
from spm_haptic_master.calibration.axis_ends import (
    AxisCalibration,
    AxisMotion,
    calibrate_axis,
    change_since,
    resting_counts,
)
from spm_haptic_master.exceptions import CalibrationError

RING = 4000
T0 = 1_700_000_000_000_000_000
# Ends of a slide 1000 counts apart, m.
ENDS = (0.05, 0.25)


def motion_of(
    seconds,
    counts,
    axis='insertion',
    ring=RING,
):
    """Return a motion with counts that begin again after a ring."""
    half = ring // 2
    stamps = T0 + np.rint(1e9 * np.asarray(seconds)).astype(np.int64)
    within = (np.asarray(counts, dtype=float) + half) % ring - half
    return AxisMotion(
        axis,
        stamps,
        within,
        ring,
    )


def way(
    first=0.0,
    second=1000.0,
    at_first=0.0,
    at_second=0.0,
    between=None,
    **how,
):
    """Return a motion of 1.5 s, with what the counts are off by at rest, every 0.05 s."""
    seconds = 0.05 * np.arange(31)
    counts = np.interp(seconds, [0.5, 1.0], [first, second])
    if between is not None:
        counts[12:19] = between
    # As often up as down: the mean at rest does not change.
    sign = np.where(np.arange(31) % 2, 1.0, -1.0)
    counts[:6] += at_first * sign[:6]
    counts[-6:] += at_second * sign[-6:]
    return motion_of(seconds, counts, **how)


@pytest.mark.parametrize('begin', [0.0, 1500.0, -2700.0])
@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize('ends', [ENDS, ENDS[::-1], (-0.1, 0.1)])
def test_a_slide_reads_its_ends_by_what_was_found(
    begin,
    direction,
    ends,
):
    """Whether the counts pass the end of their ring or not."""
    counts_between = 1000.0 * direction * np.sign(ends[1] - ends[0])
    found = calibrate_axis(way(begin, begin + counts_between), ends)
    assert found.direction == direction
    assert found.counts_per_unit == pytest.approx(5000.0)
    assert found.range == pytest.approx(sorted(ends))
    assert 0 <= found.zero_count < RING
    for counts, position in ((begin, ends[0]), (begin + counts_between, ends[1])):
        from_zero = direction * (counts - found.zero_count)
        read = ((from_zero + RING / 2) % RING - RING / 2) / found.counts_per_unit
        assert read == pytest.approx(position, abs=1e-9)
    assert found.parameters() == {
        'insertion.direction': direction,
        'insertion.zero_count': found.zero_count,
        'insertion.counts_per_metre': found.counts_per_unit,
        'insertion.range': found.range,
    }


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize(
    ('ends', 'limits'), [((10.0, 70.0), (6.7, 70.0)), ((60.0, 0.0), (0, 63.3))]
)
def test_a_gripper_turns_by_what_was_measured_from_its_second_end(
    direction,
    ends,
    limits,
):
    counts_between = 633.0 * direction * np.sign(ends[1] - ends[0])
    found = calibrate_axis(
        way(
            80.0,
            80.0 + counts_between,
            axis='gripper',
            ring=3600,
        ),
        ends,
    )
    assert found.direction == direction
    assert found.counts_per_unit == pytest.approx(10.0)
    assert found.range == pytest.approx(limits)
    zero = 80.0 + counts_between - 10.0 * direction * ends[1]
    assert found.zero_count == zero % 3600
    assert found.parameters() == {
        'gripper.direction': direction,
        'gripper.zero_count': found.zero_count,
        'gripper.range_deg': found.range,
    }


def test_figures_of_the_file_end_at_a_millionth():
    slide = calibrate_axis(way(), (0.0, 0.3))
    assert slide.counts_per_unit == 3333.333333
    # A seventh of a millimetre.
    assert calibrate_axis(way(), (1.0 / 7.0, 2.0 / 7.0)).range == (0.142857, 0.285714)


@pytest.mark.parametrize('ends', [(0.0, 50.0), (60.0, 10.0)])
@pytest.mark.parametrize(('counts', 'refused'), [(450, 0), (550, 0), (449, 1), (551, 1)])
def test_a_gripper_may_differ_by_a_tenth_from_the_angle_given(
    ends,
    counts,
    refused,
):
    motion = way(
        0.0,
        counts,
        axis='gripper',
        ring=3600,
    )
    if not refused:
        calibrate_axis(motion, ends)
        return
    words = (
        f'gripper turned by {counts / 10:.1f} deg with gripper.counts_per_turn 3600; '
        'expected 50 deg between the angles given'
    )
    with pytest.raises(CalibrationError, match=f'^{words}$'):
        calibrate_axis(motion, ends)


def test_the_counts_at_rest_are_means_that_go_on_beyond_the_ring():
    first, second = resting_counts(
        way(
            1800.0,
            2600.0,
            at_first=3.0,
            at_second=5.0,
        )
    )
    assert first == pytest.approx(1800.0)
    assert second == pytest.approx(2600.0)


def rest_and_way(
    period_at_first,
    period_at_second,
    rest=0.4,
):
    """Return a motion with readings at rest so often, s."""
    begin = np.arange(0.0, rest, period_at_first)
    end = 1.0 + rest - np.arange(0.0, rest, period_at_second)[::-1]
    seconds = [*begin, 0.5, 0.7, 0.9, *end]
    counts = [0.0] * len(begin) + [200.0, 500.0, 800.0] + [1000.0] * len(end)
    return motion_of(seconds, counts)


def refused(words, motion):
    """Check that a motion is refused in these words."""
    with pytest.raises(CalibrationError, match=f'^{re.escape(words)}$'):
        resting_counts(motion)


def test_each_end_needs_five_readings_at_rest():
    resting_counts(rest_and_way(0.07, 0.07))
    words = 'readings; expected at least 5 in 0.3 s at rest at each end'
    refused(f'insertion: 14 {words}', rest_and_way(0.08, 0.07))
    refused(f'insertion: 14 {words}', rest_and_way(0.07, 0.08))
    refused(f'insertion: 0 {words}', motion_of([], []))


@pytest.mark.parametrize(('last', 'long_enough'), [(0.61, True), (0.59, False)])
def test_the_two_rests_do_not_overlap(last, long_enough):
    """One counts that is just long enough for both, with the motion in a hundredth of a second."""
    first = np.linspace(0.0, 0.295, 6)
    seconds = [*first, 0.302, 0.305, 0.308, *(last - first[::-1])]
    motion = motion_of(np.sort(seconds), [0.0] * 6 + [250.0, 500.0, 750.0] + [1000.0] * 6)
    if long_enough:
        assert resting_counts(motion) == (0.0, 1000.0)
    else:
        refused('insertion: 15 readings; expected at least 5 in 0.3 s at rest at each end', motion)


def test_a_gap_of_more_than_half_a_second_is_refused():
    rest = np.arange(0.0, 0.51, 0.0625)
    counts = [0.0] * 9 + [500.0] + [1000.0] * 9
    assert resting_counts(motion_of([*rest, 1.0, *(1.5 + rest)], counts)) == (0.0, 1000.0)
    refused(
        'insertion: no reading for 0.51 s, 0.5 s after the beginning; expected one in 0.5 s',
        motion_of([*rest, 1.01, *(1.5 + rest)], counts),
    )


def test_an_axis_that_moves_by_less_than_a_hundred_counts_is_refused():
    resting_counts(way(0.0, 100.0))
    resting_counts(way(0.0, -100.0))
    for second in (99.0, -99.0):
        refused(
            'insertion did not move: 99 counts between begin and end of the motion; expected at '
            'least 100, from one end to the other',
            way(0.0, second),
        )


@pytest.mark.parametrize('end', ['first', 'second'])
def test_an_end_where_it_moves_by_more_than_a_fiftieth_is_refused(end):
    resting_counts(way(**{f'at_{end}': 10.0}))
    refused(
        f'insertion moved by 21 counts at its {end} end; expected 0.3 s at rest',
        way(**{f'at_{end}': 10.5}),
    )


def test_a_jump_of_more_than_half_the_way_is_refused():
    resting_counts(way(between=[200.0, 200.0, 700.0, 700.0, 750.0, 800.0, 800.0]))
    refused(
        'insertion jumps by 501 counts between two readings; expected a slow motion, and in '
        'insertion.mask all bits of the counts and no others',
        way(between=[200.0, 200.0, 701.0, 701.0, 750.0, 800.0, 800.0]),
    )


def test_a_motion_beyond_its_ends_by_more_than_a_twentyfifth_is_refused():
    counts = [200.0, 400.0, 600.0, 900.0, 1030.0]
    resting_counts(way(between=[*counts, 1040.0, 900.0]))
    refused(
        'insertion went beyond where it rested, by 41 of 1000 counts; expected the motion from '
        'one end to the other',
        way(between=[*counts, 1041.0, 900.0]),
    )


BEFORE = AxisCalibration(
    axis='insertion',
    zero_count=200,
    direction=1,
    counts_per_unit=10.0,
    range=(50.0, 150.0),
)


@pytest.mark.parametrize(
    ('first', 'second', 'words'),
    [
        (700.0, 1700.0, None),
        # One hundredth of the range, 1 m, is allowed: 10 counts.
        (710.0, 1690.0, None),
        (690.0, 1710.0, None),
        (711.0, 1700.0, 'insertion: its first end reads 51.1 m, not 50'),
        (689.0, 1700.0, 'insertion: its first end reads 48.9 m, not 50'),
        (700.0, 1711.0, 'insertion: its second end reads 151.1 m, not 150'),
        (
            720.0,
            1720.0,
            'insertion: its first end reads 52 m, not 50; its second end reads 152 m, not 150',
        ),
        (1700.0, 700.0, 'insertion counts in the opposite direction'),
    ],
)
def test_what_changed_of_a_slide_is_said(
    first,
    second,
    words,
):
    assert (
        change_since(
            way(first, second),
            (50.0, 150.0),
            BEFORE,
        )
        == words
    )


def test_what_changed_of_a_slide_is_the_same_from_its_other_end():
    ends = (150.0, 50.0)
    assert change_since(way(1700.0, 700.0), ends, BEFORE) is None
    found = change_since(way(1700.0, 689.0), ends, BEFORE)
    assert found == 'insertion: its second end reads 48.9 m, not 50'
    found = change_since(way(700.0, 1700.0), ends, BEFORE)
    assert found == 'insertion counts in the opposite direction'


@pytest.mark.parametrize('direction', [1, -1])
@pytest.mark.parametrize(
    ('positions', 'given', 'words'),
    [
        ((63.0, 0.0), (60.0, 0.0), None),
        ((62.4, 0.0), (60.0, 0.0), None),
        ((62.3, 0.0), (60.0, 0.0), 'gripper: its first end reads 62.3 deg, not 63'),
        ((0.7, 63.0), (2.0, 63.0), 'gripper: its first end reads 0.7 deg, not 0'),
        ((0.0, 62.3), (2.0, 63.0), 'gripper: its second end reads 62.3 deg, not 63'),
    ],
)
def test_a_gripper_begins_where_it_was_measured(
    direction,
    positions,
    given,
    words,
):
    """Not where its user had said that it does."""
    before = AxisCalibration(
        axis='gripper',
        zero_count=1000,
        direction=direction,
        counts_per_unit=10.0,
        range=(0.0, 63.0),
    )
    first, second = (1000.0 + 10.0 * direction * position for position in positions)
    assert (
        change_since(
            way(
                first,
                second,
                axis='gripper',
                ring=3600,
            ),
            given,
            before,
        )
        == words
    )
