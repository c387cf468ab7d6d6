# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the simulated device plays: in order, once, and back to its own motion."""

from math import radians

import pytest
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.steering import PHI_LIMITS
from spm_haptic_master.simulation.stories import Player, stories


@pytest.fixture
def done():
    """Give what a player does with its time, and the player."""
    calls, player = [], Player(lambda *pose: calls.append(pose), lambda text: calls.append(text))

    def run(seconds, begin=100.0):
        """Let time pass; return what was done, each with its time since then."""
        found = []
        for tick in range(round(20.0 * seconds)):
            player.tick(begin + 0.05 * tick)
            found += [(round(0.05 * tick, 2), call) for call in calls]
            calls.clear()
        return found

    return run, player


@pytest.mark.parametrize('sensors', [4, 5, 6])
@pytest.mark.parametrize('number', [0, 1, 2])
def test_a_story_does_its_steps_and_ends_without_a_fault(done, sensors, number):
    run, player = done
    story = stories(sensors)[number]
    player.play(story)
    assert player.words == story.words
    expected = []
    for step in story.steps:
        if step.faults is not None:
            expected.append((step.at, step.faults))
            assert not step.faults or parse_switched(step.faults, sensors)
        if step.phi is not None:
            expected.append((step.at, (0.0, 0.0, radians(step.phi))))
            assert PHI_LIMITS[0] <= radians(step.phi) <= PHI_LIMITS[1]
    assert run(story.end + 1.0) == [*expected, (story.end, ())]
    assert [faults for _, faults in expected if isinstance(faults, str)][-1] == ''
    assert player.words == ''


def test_another_story_takes_its_place_and_a_knob_ends_it(done):
    run, player = done
    one, other, _ = stories(4)
    player.play(one)
    run(1.0)
    player.play(other)
    assert player.words == other.words
    assert len(run(1.0, begin=200.0)) == 2
    player.stop()
    assert run(30.0, begin=201.0) == [] and player.words == ''
