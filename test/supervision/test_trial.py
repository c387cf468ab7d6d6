# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A set of sensors on trial: since when it agrees, where it is, and what contradicts it."""

from math import cos, sin
from types import SimpleNamespace

import pytest
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld
from spm_haptic_master.supervision.trial import Trial

MS = 1_000_000
BEGIN = 1000 * MS
SPEED = 20.0
HEALTHY = 0.004
CONTRADICTS = Symptom(Reason.INCONSISTENT)
NO_FIT = Symptom(Reason.NO_FIT)
UNSURE = withheld(Reason.UNDETERMINED, '')


def turned(angle):
    """Return the quaternion of a rotation about a fixed axis, by rad."""
    return (0.6 * sin(0.5 * angle), 0.0, 0.8 * sin(0.5 * angle), cos(0.5 * angle))


class Set:
    """A set of sensors with so many parities, whose next solution is as a test says."""

    def __init__(self, entries=1):
        self.parity_count = entries
        self.restarts = 0
        self.symptom = None
        self.estimate = SimpleNamespace(quaternion=turned(0.0), determined=True)
        self.worth = SimpleNamespace(healthy=HEALTHY)
        self.prior = None
        # The orientation that explains the readings where there is no solution, and those near
        # which it was looked for.
        self.explained = None
        self.looked_near = []

    def restart(self):
        self.restarts += 1

    def solve(self, sample):
        self.prior = sample.prior
        return self.symptom

    def explaining(self, sample, near):
        self.looked_near.append(near)
        return self.explained

    def at(self, angle):
        """Find the next solution at a turn, rad."""
        self.estimate = SimpleNamespace(quaternion=turned(angle), determined=True)


def follow(trial, *milliseconds):
    """Let samples follow at times, ms after the begin; return whether the last one agrees."""
    for time in milliseconds:
        sample = Sample(
            stamp=BEGIN + round(time * MS),
            angles=(),
            prior=Place(0, turned(3.0)),
            bias=(),
            factors=(),
            period=1e-3,
        )
        agrees = trial.follow(sample, SPEED)
    return agrees


def place(angle=0.0, time=0):
    return Place(BEGIN + time * MS, turned(angle))


@pytest.mark.parametrize(
    ('entries', 'at', 'since', 'is_conclusive'),
    [
        (1, place(), None, True),
        (0, place(), None, False),
        (0, place(), 5, True),
        (0, None, None, True),
    ],
)
def test_three_sensors_can_agree_only_with_a_known_motion_or_without_any_place(
    entries, at, since, is_conclusive
):
    members = Set(entries)
    trial = Trial(members, at, since)
    assert trial.is_conclusive == is_conclusive
    assert not trial.has_failed
    assert members.restarts == 1


def test_its_own_place_selects_among_solutions_for_a_tenth_of_a_second():
    members = Set()
    trial = Trial(members, place(), None)
    follow(trial, 100)
    assert members.prior == place()
    trial = Trial(members, place(), None)
    follow(trial, 101)
    assert members.prior is None
    follow(Trial(members, None, None), 1)
    assert members.prior is None


def test_a_sample_that_agrees_is_its_place():
    members = Set()
    trial = Trial(members, None, None)
    members.at(0.5)
    assert follow(trial, 3)
    assert trial.place == place(0.5, 3)
    members.at(0.51)
    assert follow(trial, 4)
    assert trial.place == place(0.51, 4)


@pytest.mark.parametrize(('factor', 'agrees'), [(0.99, True), (1.01, False)])
@pytest.mark.parametrize('milliseconds', [1, 5])
def test_it_turns_no_faster_than_a_human_beside_noise_and_bias_of_both(
    factor, agrees, milliseconds
):
    members = Set()
    trial = Trial(members, place(), None)
    members.at(factor * (SPEED * milliseconds * 1e-3 + 2.0 * HEALTHY))
    assert follow(trial, milliseconds) == agrees
    assert trial.has_failed != agrees
    assert (trial.place == place()) != agrees


@pytest.mark.parametrize(
    ('symptom', 'determined', 'has_failed'),
    [
        (CONTRADICTS, True, True),
        # A sample that determines no orientation contradicts nothing.
        (UNSURE, True, False),
        (None, False, False),
    ],
)
def test_a_sample_that_does_not_agree_begins_its_time_again(symptom, determined, has_failed):
    members = Set()
    trial = Trial(members, place(), BEGIN)
    members.symptom = symptom
    members.estimate.determined = determined
    assert not follow(trial, 1)
    assert trial.has_failed == has_failed
    assert trial.place == place()
    members.symptom = None
    members.at(0.0)
    assert follow(trial, *range(2, 12))
    assert trial.has_failed == has_failed
    assert not trial.has_agreed_for(BEGIN + 11 * MS, 0.010)
    assert trial.has_agreed_for(BEGIN + 11 * MS, 0.009)


def test_samples_before_one_that_does_not_agree_do_not_count():
    members = Set()
    trial = Trial(members, place(), None)
    follow(trial, *range(1, 6))
    members.symptom = UNSURE
    follow(trial, 6)
    members.symptom = None
    follow(trial, *range(7, 16))
    assert not trial.has_agreed_for(BEGIN + 15 * MS, 0.001)
    follow(trial, 16)
    assert trial.has_agreed_for(BEGIN + 16 * MS, 0.001)


@pytest.mark.parametrize(
    ('symptom', 'explained', 'has_failed'),
    [
        # No fit, and an orientation elsewhere, are no evidence where one nearby explains both.
        (NO_FIT, 0.0, False),
        (NO_FIT, 3.0, False),
        (NO_FIT, None, True),
        (None, 0.02, False),
        (None, 0.03, True),
        (None, None, True),
        # Angles that are inconsistent are.
        (CONTRADICTS, 0.0, True),
    ],
)
def test_it_has_failed_where_no_orientation_nearby_explains_the_readings(
    symptom, explained, has_failed
):
    members = Set()
    trial = Trial(members, place(), BEGIN)
    members.symptom = symptom
    members.at(1.0)
    members.explained = None if explained is None else turned(explained)
    assert not follow(trial, 1)
    assert trial.has_failed == has_failed
    assert members.looked_near == [turned(0.0)] * (symptom is not CONTRADICTS)
    # It has failed for good.
    members.symptom = None
    members.at(0.0)
    follow(trial, 2)
    members.symptom = UNSURE
    follow(trial, 3)
    assert trial.has_failed == has_failed


def test_what_explains_the_readings_is_looked_for_near_where_it_was_last():
    members = Set()
    trial = Trial(members, None, None)
    members.symptom = NO_FIT
    members.explained = turned(0.3)
    follow(trial, 1, 2)
    # At first near the published orientation.
    assert members.looked_near == [turned(3.0), turned(0.3)]
    members.symptom = None
    members.at(0.5)
    assert follow(trial, 3)
    members.symptom = NO_FIT
    follow(trial, 4)
    assert members.looked_near[2:] == [turned(0.5)]


def test_without_an_orientation_it_neither_agrees_nor_fails():
    members = Set()
    trial = Trial(members, place(), None)
    members.estimate = None
    members.worth = None
    assert not follow(trial, 1)
    assert not trial.has_failed


@pytest.mark.parametrize('symptom', [None, CONTRADICTS])
def test_three_sensors_without_a_known_motion_show_nothing(symptom):
    members = Set(0)
    trial = Trial(members, place(), None)
    members.symptom = symptom
    assert not follow(trial, 1)
    assert not trial.has_failed


def test_three_sensors_that_once_do_not_continue_their_motion_have_failed_for_good():
    members = Set(0)
    trial = Trial(members, place(), BEGIN)
    assert follow(trial, 1, 2)
    members.at(1.0)
    assert not follow(trial, 3)
    assert trial.has_failed
    members.at(0.0)
    assert not follow(trial, 4)


@pytest.mark.parametrize(
    ('samples', 'time', 'has_agreed'),
    [
        # For the time, and in ten samples.
        (10, 0.009, True),
        (10, 0.0091, False),
        (9, 0.001, False),
        (21, 0.02, True),
        (21, 0.0201, False),
    ],
)
def test_it_has_agreed_for_a_time_and_in_ten_samples(samples, time, has_agreed):
    trial = Trial(Set(), None, None)
    assert not trial.has_agreed_for(BEGIN, 0.0)
    follow(trial, *range(samples))
    now = BEGIN + (samples - 1) * MS
    assert trial.has_agreed_for(now, time) == has_agreed
    assert trial.passes(now, 0, time) == has_agreed


def test_it_passes_at_once_if_it_agreed_before_the_fault():
    trial = Trial(Set(), place(), BEGIN)
    follow(trial, 1)
    assert trial.passes(BEGIN + MS, BEGIN + 1, 9.0)
    assert not trial.passes(BEGIN + MS, BEGIN, 9.0)
    assert not Trial(Set(), place(), None).passes(BEGIN + MS, BEGIN + 1, 9.0)
