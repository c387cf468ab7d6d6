# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the simulated device plays: in order, once, and back to its own motion."""

from math import radians

import pytest
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.simulation.stories import Player, SINGULAR, stories


@pytest.fixture
def done():
    """Give what a player does, and the player."""
    calls = []
    return calls, Player(lambda *pose: calls.append(pose), calls.append)


def run(player, seconds, begin=100.0):
    for tick in range(round(20.0 * seconds)):
        player.tick(begin + 0.05 * tick)


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('number', [0, 1, 2])
def test_a_story_ends_without_a_fault_and_the_device_goes_on(done, sensors, number):
    calls, player = done
    story = stories(sensors)[number]
    player.play(story)
    assert player.words == story.words
    run(player, story.end + 1.0)
    faults = [call for call in calls if isinstance(call, str)]
    assert faults[-1] == '' and calls[-1] == ()
    assert len(calls) == 1 + sum(
        (step.phi is not None) + (step.faults is not None) for step in story.steps)
    assert player.words == ''
    for text in filter(None, faults):
        parse_switched(text, sensors)
    assert all(PHI_LIMITS[0] <= pose[2] <= PHI_LIMITS[1]
               for pose in calls if isinstance(pose, tuple) and pose)


def test_the_first_one_crosses_the_singularity(done):
    calls, player = done
    player.play(stories(4)[0])
    run(player, 20.0)
    phis = [pose[2] for pose in calls if isinstance(pose, tuple) and pose]
    assert min(phis) < radians(SINGULAR) < max(phis)


def test_another_story_takes_its_place_and_a_knob_ends_it(done):
    calls, player = done
    one, other, _ = stories(4)
    player.play(one)
    run(player, 1.0)
    player.play(other)
    assert player.words == other.words
    run(player, 1.0, begin=200.0)
    before = len(calls)
    player.stop()
    run(player, 30.0, begin=201.0)
    assert len(calls) == before and player.words == ''


@pytest.mark.parametrize('sensors', [4, 5, 6])
def test_each_is_explained_in_two_or_three_sentences(sensors):
    for story in stories(sensors):
        assert 2 <= story.words.count('.') <= 3
        assert len(story.words) < 200
