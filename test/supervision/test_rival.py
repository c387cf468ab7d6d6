# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One other orientation, with the faults that explain it; places and samples at a time."""

from math import cos, inf, pi, sin

import pytest
from spm_haptic_master.supervision.rival import ANY, Interval, Rival
from spm_haptic_master.supervision.sample import Place, Sample

MS = 1_000_000


def turned(angle):
    """Return the quaternion of a rotation about a fixed axis, by rad."""
    return (0.6 * sin(0.5 * angle), 0.0, 0.8 * sin(0.5 * angle), cos(0.5 * angle))


@pytest.mark.parametrize(
    ('before', 'value', 'margin', 'after'),
    [
        (ANY, 0.5, 0.1, (0.4, 0.6)),
        (Interval(0.0, 1.0), 0.5, 0.1, (0.4, 0.6)),
        (Interval(0.45, 1.0), 0.5, 0.1, (0.45, 0.6)),
        (Interval(0.0, 0.55), 0.5, 0.1, (0.4, 0.55)),
        # Whole turns of the value mean nothing.
        (Interval(0.0, 1.0), 0.5 + 2.0 * pi, 0.1, (0.4, 0.6)),
        (Interval(0.0, 1.0), 0.5 - 4.0 * pi, 0.1, (0.4, 0.6)),
        (Interval(6.0, 7.0), 0.5, 0.1, (2.0 * pi + 0.4, 2.0 * pi + 0.6)),
        # In an interval of a turn and more it is not known which one.
        (Interval(-4.0, 4.0), 7.0, 0.1, (6.9, 4.0)),
        (Interval(-pi, pi), 7.0, 0.1, (6.9, pi)),
        (Interval(-3.0, 3.0), 7.0, 0.1, (7.0 - 2.0 * pi - 0.1, 7.0 - 2.0 * pi + 0.1)),
    ],
)
def test_an_interval_is_narrowed_to_a_margin_about_a_value(before, value, margin, after):
    assert before.narrowed(value, margin) == pytest.approx(after)


@pytest.mark.parametrize(
    ('interval', 'is_empty'),
    [
        (ANY, False),
        (Interval(0.4, 0.6), False),
        (Interval(0.5, 0.5), False),
        (Interval(0.6, 0.4), True),
        (Interval(0.0, 1.0).narrowed(2.0, 0.5), True),
    ],
)
def test_an_interval_is_empty_if_no_value_is_left(interval, is_empty):
    assert interval.is_empty == is_empty


def test_two_intervals_are_joined_with_what_is_between_them():
    assert Interval(0.0, 1.0).joined(Interval(2.0, 3.0)) == (0.0, 3.0)
    assert Interval(2.0, 3.0).joined(Interval(0.0, 1.0)) == (0.0, 3.0)
    assert Interval(0.0, 3.0).joined(Interval(1.0, 2.0)) == (0.0, 3.0)
    assert ANY == (-inf, inf)


@pytest.mark.parametrize('offset', [True, False])
@pytest.mark.parametrize('stuck', [True, False])
def test_a_rival_is_contradicted_once_neither_an_offset_nor_a_stuck_reading_explains_it(
    offset, stuck
):
    rival = Rival(1, None)
    assert not rival.is_contradicted
    empty = Interval(1.0, 0.0)
    rival.offset = empty if offset else ANY
    rival.stuck = empty if stuck else ANY
    assert rival.is_contradicted == (offset and stuck)


def test_a_rival_is_current_until_the_platform_turned_by_two_hundredths():
    rival = Rival(1, None)
    assert not rival.is_current(Place(0, turned(0.0)))
    rival.computed_at = turned(0.3)
    for angle, is_current in ((0.3, True), (0.319, True), (0.281, True), (0.321, False)):
        assert rival.is_current(Place(0, turned(angle))) == is_current


def test_its_part_is_how_far_it_is_with_what_the_platform_turned_since():
    here = Place(5, turned(0.0))
    rival = Rival(1, Place(0, turned(0.4)), healthy=0.003)
    rival.computed_at = turned(-0.01)
    # While it is lost, it may be anywhere.
    assert rival.part(here) == inf
    rival.found = True
    assert rival.part(here) == pytest.approx(0.4 + 0.01 + 0.003)
    rival.computed_at = None
    assert rival.part(here) == inf
    rival.computed_at = turned(-0.01)
    rival.place = None
    assert rival.part(here) == inf


def test_a_new_rival_is_lost_and_never_was_found():
    rival = Rival(2, None)
    assert (rival.found, rival.born, rival.misses) == (False, 0, 0)
    assert (rival.healthy, rival.least_step) == (0.0, 0.0)
    assert (rival.offset, rival.stuck) == (ANY, ANY)
    # Another one with the same values is another one.
    assert rival != Rival(2, None)


def sample(stamp, **fields):
    return Sample(stamp=stamp, angles=(), prior=None, bias=(), factors=(), **fields)


def test_a_place_selects_among_solutions_for_a_tenth_of_a_second():
    place = Place(700 * MS, turned(0.0))
    assert place.is_recent_at(800 * MS)
    assert not place.is_recent_at(800 * MS + 1)


@pytest.mark.parametrize(
    ('period', 'short'),
    [
        (0.0, 0),
        (1e-3, 2_500_000),
        (0.02, 50 * MS),
        # At any rate 60 ms at most.
        (0.025, 60 * MS),
    ],
)
def test_a_sample_follows_another_shortly_within_two_and_a_half_periods(period, short):
    this = sample(9000 * MS, period=period)
    assert this.short_time == short
    assert this.follows(9000 * MS - short)
    assert not this.follows(9000 * MS - short - 1)


def test_the_time_since_another_sample_is_a_period_at_least():
    this = sample(9000 * MS, period=1e-3)
    assert this.time_since(8996 * MS) == pytest.approx(4e-3)
    assert this.time_since(9000 * MS - 5) == 1e-3
    assert sample(9000 * MS).time_since(9000 * MS - 5) == pytest.approx(5e-9)
    assert sample(9000 * MS).parity_bias == pi
