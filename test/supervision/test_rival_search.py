# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Solutions without one sensor: those that a human can have turned the platform to."""

from math import cos, sin
from types import SimpleNamespace

import pytest
from spm_haptic_master.supervision.rival_search import RivalSearch
from spm_haptic_master.supervision.sample import Place, Sample

MS = 1_000_000
SPEED = 20.0
DEVIATION = 1e-3
SENSOR = 2
# Reach of a human, rad, 4 ms after a place.
REACH = SPEED * 4e-3 + 6.0 * DEVIATION


def turned(angle):
    """Return the quaternion of a rotation about a fixed axis, by rad."""
    return (0.6 * sin(0.5 * angle), 0.0, 0.8 * sin(0.5 * angle), cos(0.5 * angle))


def solution(angle):
    """Return a solution at a turn, rad."""
    return SimpleNamespace(quaternion=turned(angle), total_deviation=DEVIATION)


PLACE = Place(1000 * MS, turned(0.0))
HERE = Place(1004 * MS, turned(0.5))
SAMPLE = Sample(
    stamp=1004 * MS,
    angles=(),
    prior=None,
    bias=(),
    factors=(),
    period=1e-3,
)


def search(near=(), every=(), are_left=True):
    """Return a search by others that have solutions next to turns, rad."""
    found = {turned(angle): each for angle, each in dict(near).items()}
    others = SimpleNamespace(
        near=lambda sample, quaternion: found.get(quaternion),
        every=lambda sample: list(every),
    )
    sensors = SimpleNamespace(
        one_less=lambda sensor: others if are_left and sensor == SENSOR else None
    )
    return RivalSearch(sensors, SPEED)


def test_the_reach_is_what_a_human_turns_the_platform_by_in_a_period_at_least():
    assert search().reach(SAMPLE, PLACE) == pytest.approx(SPEED * 4e-3)
    assert search().reach(SAMPLE, HERE) == pytest.approx(SPEED * 1e-3)


@pytest.mark.parametrize(('factor', 'is_in_reach'), [(0.99, True), (1.01, False)])
def test_a_solution_within_reach_of_a_place_continues_it(factor, is_in_reach):
    near = solution(factor * REACH)
    expected = near if is_in_reach else None
    assert search({0.0: near}).next_to(SAMPLE, SENSOR, PLACE) is expected
    reached = search().reached(SAMPLE, PLACE, [None, near, solution(3.0)])
    assert reached == [near] * is_in_reach
    # From an unknown place all are in reach.
    assert search().reached(SAMPLE, None, [None, near]) == [near]


def test_without_others_or_their_solution_nothing_continues_a_place():
    near = {0.0: solution(0.0)}
    assert search().next_to(SAMPLE, SENSOR, PLACE) is None
    assert search(near, are_left=False).next_to(SAMPLE, SENSOR, PLACE) is None
    assert search(near).next_to(SAMPLE, SENSOR + 1, PLACE) is None
    assert search(near).next_to(SAMPLE, SENSOR, PLACE) is near[0.0]


def test_all_solutions_are_those_of_the_others():
    every = [solution(0.0), solution(2.0)]
    assert search(every=every).every(SAMPLE, SENSOR) == every
    assert search(every=every, are_left=False).every(SAMPLE, SENSOR) == []


def recent(near, starts=(), are_left=True):
    """Return what is found of a sensor that stepped shortly before; the platform is at 0.5 rad."""
    return search(near, are_left=are_left).recent(
        SAMPLE, SENSOR, PLACE, HERE, [turned(start) for start in starts]
    )


def test_the_truth_is_the_solution_next_to_the_place():
    first = solution(0.05)
    assert recent({0.0: first, 0.5: solution(0.5)}) == [first]
    assert recent({0.0: first}) == [first]


def test_the_solution_next_to_the_orientation_is_none_of_them():
    beside = solution(0.05)
    for off, is_same in ((0.9 * DEVIATION, True), (1.1 * DEVIATION, False)):
        first = solution(0.05 + off)
        assert recent({0.0: first, 0.5: beside}) == ([] if is_same else [first])
    # Also where that is out of reach of the place.
    assert recent({0.0: solution(0.5), 0.5: solution(0.5)}) == []


def test_it_is_not_known_without_a_solution_in_reach_of_the_place():
    beside = {0.5: solution(0.5)}
    assert recent(beside) is None
    assert recent({}) is None
    assert recent(beside | {0.0: solution(1.01 * REACH)}) is None
    assert recent(beside | {0.0: solution(0.05)}, are_left=False) is None


def test_what_further_starts_lead_to_is_found_within_reach():
    first = solution(0.05)
    further = solution(-0.05)
    near = {0.0: first, 0.5: solution(0.5), 1.0: further, 1.1: solution(1.0), 1.2: None}
    assert recent(near, starts=(1.0, 1.1, 1.2)) == [first, further]
    assert recent(near, starts=(0.5, 1.0)) == [first, further]
