# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which jumps the parity cannot show: of hidden sensors, and of those with a new rival."""

from types import SimpleNamespace

import pytest
from spm_haptic_master.supervision.unseen_jumps import UnseenJumps

STAMP = 5


class World:
    """What joints, exposure and rivals show, as a test says."""

    def __init__(self, hidden=(), steps=(), born=()):
        self.exposure = SimpleNamespace(hidden=hidden)
        self.rivals = SimpleNamespace(unseen_steps=dict(steps), born_since=self.born_since)
        self.joints = SimpleNamespace(distance=self.distances.get, jumps=self.jumps)
        self.born = dict(born)
        self.unseen_jumps = UnseenJumps(self.joints, self.exposure, self.rivals)

    # Distance of each sensor from the motion that it left, rad.
    distances = {0: 0.1, 1: 0.2, 2: 0.3, 3: 0.4}

    def born_since(self, stamp):
        return {sensor for sensor, born in self.born.items() if born > stamp}

    def jumps(self, used, unseen, is_gap):
        """Return what the joints are asked."""
        return used, unseen, is_gap

    def unseen(self, any_step=False):
        """Return the sensors whose jump the parity may not show."""
        used, unseen, is_gap = self.unseen_jumps.found((0, 1), True, any_step)
        assert (used, is_gap) == ((0, 1), True)
        return unseen


def test_at_the_begin_and_after_a_restart_every_step_of_a_hidden_sensor_is_unseen():
    world = World(hidden=(1, 2), steps={1: 9.0, 2: 9.0})
    assert world.unseen() == {1, 2}
    world.unseen_jumps.note_undisturbed(STAMP)
    assert world.unseen() == set()
    world.exposure.hidden = (2, 3)
    world.unseen_jumps.restart()
    assert world.unseen() == {2, 3}


@pytest.mark.parametrize(
    ('step', 'is_unseen'),
    [
        (0.3, True),
        (0.31, False),
        (0.0, True),
    ],
)
def test_a_step_is_unseen_that_may_lead_to_a_rival(step, is_unseen):
    world = World(hidden=(2,), steps={2: step})
    world.unseen_jumps.note_undisturbed(STAMP)
    assert world.unseen() == ({2} if is_unseen else set())
    # After a gap it may have been larger.
    assert world.unseen(any_step=True) == {2}


def test_a_hidden_sensor_without_a_rival_is_unseen_by_any_step():
    world = World(hidden=(2,))
    world.unseen_jumps.note_undisturbed(STAMP)
    assert world.unseen() == {2}


def test_what_could_not_be_seen_is_that_of_the_last_sample_with_all_joints_on_their_motion():
    world = World(hidden=(2,), steps={2: 9.0})
    world.unseen_jumps.note_undisturbed(STAMP)
    world.exposure.hidden = (1,)
    world.rivals.unseen_steps = {2: 0.0}
    assert world.unseen() == set()
    assert world.unseen(any_step=True) == {2}
    world.unseen_jumps.note_undisturbed(STAMP + 1)
    assert world.unseen(any_step=True) == {1}


@pytest.mark.parametrize(('born', 'is_unseen'), [(STAMP, False), (STAMP + 1, True)])
def test_a_sensor_with_a_rival_that_was_born_since_is_unseen(born, is_unseen):
    """The jump itself may have led to it."""
    world = World(born={3: born})
    world.unseen_jumps.note_undisturbed(STAMP)
    world.rivals.unseen_steps = {3: 0.4}
    assert world.unseen() == ({3} if is_unseen else set())


def test_of_a_new_rival_and_an_older_one_the_least_step_counts():
    for before, now, is_unseen in ((0.5, 0.3, True), (0.3, 0.5, True), (0.5, 0.45, False)):
        world = World(hidden=(3,), steps={3: before}, born={3: STAMP + 1})
        world.unseen_jumps.note_undisturbed(STAMP)
        world.rivals.unseen_steps = {3: now}
        assert world.unseen() == ({3} if is_unseen else set())
    world.rivals.unseen_steps = {}
    assert world.unseen() == {3}


def test_before_a_sample_with_all_joints_on_their_motion_every_rival_is_new():
    world = World(born={3: 1})
    assert world.unseen() == {3}
