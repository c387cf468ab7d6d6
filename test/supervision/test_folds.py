# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parts of the level to second order: the curvatures are renewed before they are old."""

from math import cos, hypot, inf, sin, sqrt
from types import SimpleNamespace

import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.inverse_model import measured_angles, RIG_WORKING_MODE
from spm_haptic_master.kinematics.rotations import (
    multiply_quaternions,
    quaternion_from_vector,
    rotation_from_quaternion,
)
from spm_haptic_master.supervision.folds import Folds
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensor_set import SensorSet
from spm_haptic_master.supervision.solver import Solver

LIMITS = product_limits()
SIGMA = (np.radians(0.04),) * 4
# The worst of 1,200 turns: steps of 0.01 rad, the orientation at which it begins (x, y, z, w), the
# axis. The curvature of th1A is near 0 on the way, and the fold is at the end of a leg's reach.
STEPS = 37
START = (0.298540, 0.403338, 0.775272, 0.383595)
AXIS = (-0.586926, 0.506396, -0.631729)


def judged(sensor_set, quaternion, stamp):
    """Return the orientation of exact readings at a quaternion, and what it is worth."""
    angles = measured_angles(
        rotation_from_quaternion(*quaternion), Geometry(), RIG_WORKING_MODE, 4
    )
    sample = Sample(
        stamp=stamp,
        angles=angles,
        prior=Place(stamp - 500_000, quaternion),
        bias=LIMITS.bias,
        factors=(1.0,) * 4,
        parity_bias=LIMITS.parity_bias,
        period=0.0005,
    )
    sensor_set.solve(sample)
    return sensor_set.estimate, sensor_set.worth


def test_no_curvature_is_kept_on_the_way_into_a_fold():
    """Where it was near 0 it was kept for 0.2 rad: 2 deg where no fault is detected at all."""
    start = tuple((np.array(START) / np.linalg.norm(START)).tolist())
    solver = Solver(Geometry(), SIGMA, RIG_WORKING_MODE, LIMITS.bias)
    sensor_set = SensorSet(solver, SIGMA, LIMITS)
    kept = Folds(4)
    tried = 0
    for step in range(STEPS + 1):
        turn = quaternion_from_vector(*(0.01 * step * np.array(AXIS)).tolist())
        estimate, worth = judged(sensor_set, multiply_quaternions(turn, start), 500_000 * step)
        parts = kept.parts(sensor_set, estimate, worth)
        renewed = Folds(4).parts(sensor_set, estimate, worth)
        # Where the device cannot turn by 0.03 rad there is no curvature at all.
        known = [solver.parity_curvature(estimate, sensor) < inf for sensor in range(4)]
        for sensor in np.flatnonzero(np.array(parts) < np.radians(3.0)):
            if known[sensor]:
                assert renewed[sensor] <= 1.1 * parts[sensor], (step, sensor)
                tried += 1
    assert tried > 10


class Bent:
    """Sensors whose parity bends, with first-order parts and curvatures as a test says."""

    healthy = 1e-3
    # Length of the parity's derivative by the readings: a turn of 1 rad changes curvatures by 16.
    sizes = (1.2, 1.6)

    def __init__(self, linear, slopes, curvatures):
        self.linear = linear
        self.worth = SimpleNamespace(healthy=self.healthy, slopes=slopes)
        self.curvatures = curvatures
        self.computed = 0
        self.members = tuple(range(len(linear)))
        self.solver = SimpleNamespace(parity_curvature=self.curvature)
        self.folds = Folds(len(linear))

    def curvature(self, estimate, sensor):
        self.computed += 1
        return self.curvatures[sensor]

    def parts(self, worth):
        return [self.healthy + part for part in self.linear]

    def at(self, turn):
        """Return the parts at a turn of the platform, rad."""
        estimate = SimpleNamespace(
            quaternion=(sin(0.5 * turn), 0.0, 0.0, cos(0.5 * turn)), parity_sizes=self.sizes
        )
        return self.folds.parts(self, estimate, self.worth)

    def is_kept(self, turn):
        """Whether the curvatures are those from before a turn of the platform, rad."""
        self.at(0.0)
        before = self.computed
        self.at(turn)
        return self.computed == before


def test_a_part_is_the_turn_that_leaves_the_parity_of_an_undetected_fault():
    """Of e / s - c e^2 = l / s the smaller solution e; none beyond a quarter of 1 / (s^2 c)."""
    bent = Bent([0.01, 0.01, 0.01, inf], [2.0, 2.0, 2.0, inf], [5.0, 0.0, 13.0, 0.0])
    first, straight, folded, unchecked = bent.at(0.0)
    turn = first - bent.healthy
    assert turn == pytest.approx((1.0 - sqrt(1.0 - 4.0 * 2.0 * 5.0 * 0.01)) / (2.0 * 2.0 * 5.0))
    assert turn / 2.0 - 5.0 * turn**2 == pytest.approx(0.01 / 2.0)
    assert straight == pytest.approx(bent.healthy + 0.01)
    assert folded == inf
    assert unchecked == inf
    # Exactly there as well.
    bent = Bent([0.5], [1.0], [0.5])
    bent.healthy = bent.worth.healthy = 0.0
    assert bent.at(0.0) == [inf]


def test_the_other_solution_is_behind_the_fold():
    bent = Bent([0.01, 0.01, inf], [2.0, 3.0, inf], [5.0, 0.0, 0.0])
    assert bent.folds.distance(0) == inf
    assert not bent.folds.may_reach(0, 100.0)
    assert not bent.folds.may_reach_any(100.0)
    bent.at(0.0)
    assert bent.folds.distance(0) == pytest.approx(0.1)
    assert bent.folds.distance(1) == inf
    # Of one that the others do not check it may be anywhere.
    assert bent.folds.distance(2) == 0.0
    assert bent.folds.may_reach(2, 1e-9)


def reached(bend, change):
    """Return the turn, rad, over which the way to a solution is half of it."""
    return (-bend + sqrt(bend**2 + 4.0 * change * 0.5)) / (2.0 * change)


def test_a_turn_may_reach_it_from_half_the_way_on():
    """The bend grows with the turn, by 8 times the parity's derivative."""
    change = 8.0 * hypot(1.2, 1.6)
    bent = Bent([0.01, 0.01, inf], [2.0, 3.0, inf], [5.0, 1.0, 0.0])
    bent.at(0.0)
    for sensor, slope, curvature in ((0, 2.0, 5.0), (1, 3.0, 1.0)):
        turn = reached(slope * curvature, slope * change)
        assert not bent.folds.may_reach(sensor, 0.99 * turn)
        assert bent.folds.may_reach(sensor, 1.01 * turn)
    # Of any sensor: with the largest bend and the largest change of those that are checked.
    turn = reached(2.0 * 5.0, 3.0 * change)
    assert not bent.folds.may_reach_any(0.99 * turn)
    assert bent.folds.may_reach_any(1.01 * turn)
    bent.folds.restart()
    assert not bent.folds.may_reach(0, 100.0)
    assert not bent.folds.may_reach_any(100.0)
    # Where nothing bends none is expected.
    bent = Bent([0.01], [0.1], [0.0])
    bent.sizes = (0.0,)
    bent.at(0.0)
    assert not bent.folds.may_reach_any(100.0)
    # Exactly half of it is not expected.
    bent = Bent([0.01], [1.0], [1.0])
    bent.sizes = (0.0,)
    bent.at(0.0)
    assert not bent.folds.may_reach(0, 0.5)
    assert not bent.folds.may_reach_any(0.5)


# Part of a sensor without a bend, whose share of the largest parity changes by 0.05 in a tenth.
TENTH = 0.05 / (4.0 * 2.0 * 16.0 * 0.1)


@pytest.mark.parametrize(
    ('linear', 'curvatures', 'turn'),
    [
        # Far from a fold, and over one.
        ([1e-6, 1e-6], [5.0, 5.0], 0.2),
        ([1.0, 1e-6], [5.0, 0.0], 0.02),
        ([1e-6, 1.0], [0.0, 5.0], 0.02),
        # Between, the least of the turns in which a share changes by 0.05.
        ([TENTH, 1e-6], [0.0, 0.0], 0.1),
        ([TENTH, 2.0 * TENTH], [0.0, 0.0], 0.05),
        ([2.0 * TENTH, TENTH], [0.0, 0.0], 0.05),
        ([9.0 * TENTH, TENTH], [0.0, 0.0], 0.02),
        # Of what is left to the fold.
        ([TENTH, 1e-6], [0.25 / (8.0 * TENTH), 0.0], 0.075),
        ([0.5 * TENTH, 1e-6], [0.25 / (4.0 * TENTH), 0.0], 0.15),
        # One that is not checked does not matter.
        ([inf, TENTH], [0.0, 0.0], 0.1),
    ],
)
def test_curvatures_are_kept_while_the_platform_turns_by_less_than_may_matter(
    linear, curvatures, turn
):
    slopes = [inf if part == inf else 2.0 for part in linear]
    assert Bent(linear, slopes, curvatures).is_kept(0.99 * turn)
    assert not Bent(linear, slopes, curvatures).is_kept(1.01 * turn)


def test_new_curvatures_count_at_once_and_after_a_restart():
    bent = Bent([0.01], [2.0], [5.0])
    old = bent.at(0.0)
    bent.curvatures = [0.0]
    assert bent.at(0.001) == old
    new = bent.at(0.3)
    assert new == [pytest.approx(bent.healthy + 0.01)]
    # From where they were computed.
    bent.curvatures = [5.0]
    assert bent.at(0.301) == new
    bent.folds.restart()
    assert bent.at(0.301) == old
