# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The soft wall before the workspace ends: where it pushes, how, and what it may not do."""

import math

from bench import at, Bench, STILL
import numpy as np
import pytest
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.force.end_stop import EndStop
from spm_haptic_master.force.rendering import make_statics
from spm_haptic_master.kinematics import (
    Geometry,
    inverse,
    jacobian,
    matrix_from_quaternion,
    quaternion_from_matrix,
    workspace_pose,
)
from spm_haptic_master.kinematics.rotations import quaternion_from_vector

PAPER = Geometry()
BEGIN = math.radians(5.0)


def margins(R):
    """Return the angles that each leg has left before its ends, rad, by its axes alone."""
    found = []
    for leg in PAPER.legs:
        angle = math.acos(np.dot(leg.first, R @ leg.third))
        alpha = math.acos(leg.cos_alpha)
        beta = math.acos(leg.cos_beta)
        found += [alpha + beta - angle, angle - abs(alpha - beta)]
    return np.array(found)


def energy(R, stiffness=2.0):
    """Return the energy that the wall has stored, J."""
    depths = np.maximum(0.0, BEGIN - margins(R))
    return float(0.5 * stiffness * np.sum(depths**2))


def poses_at_the_rim(count, seed):
    """Return poses within the wall that all legs reach."""
    rng = np.random.default_rng(seed)
    found = []
    while len(found) < count:
        R = workspace_pose(
            0.7 * rng.random(),
            6.3 * rng.random(),
            3.0 * rng.random() - 0.6,
        )
        is_within = 0.2 * BEGIN < margins(R).min() < 0.9 * BEGIN
        if is_within and np.isfinite(jacobian(R)).all():
            found.append(R)
    return found


def wall(motors=4, **limits):
    """Return a wall, and the torque that it has at a pose."""
    chosen = ForceLimits(**limits)
    rates = make_statics(PAPER, (1, 1, 1), motors, chosen)
    stop = EndStop(PAPER, chosen, rates)

    def torque(R, velocity=STILL):
        rates.place(R.ravel().tolist())
        return np.array(stop.torque(velocity))

    return torque


def test_the_wall_is_the_slope_of_its_energy():
    """So a hand gets back what it gave, but for the damping."""

    def turn(vector):
        return matrix_from_quaternion(quaternion_from_vector(*vector))

    torque = wall()
    step = 1e-6
    for R in poses_at_the_rim(30, seed=1):
        slope = []
        for axis in np.eye(3):
            ahead = energy(turn(step * axis) @ R)
            behind = energy(turn(-step * axis) @ R)
            slope.append((ahead - behind) / (2.0 * step))
        np.testing.assert_allclose(torque(R), np.negative(slope), atol=1e-6)


def test_the_wall_pushes_inwards_at_any_speed():
    """It never works against a wrench that pushes back into the workspace."""
    torque = wall()
    rng = np.random.default_rng(2)
    for R in poses_at_the_rim(60, seed=3):
        if np.count_nonzero(margins(R) < 2.0 * BEGIN) > 1:
            continue  # two legs: each has its own direction
        inwards = torque(R) / np.linalg.norm(torque(R))
        for velocity in 8.0 * rng.normal(size=(20, 3)):
            pushed = torque(R, tuple(velocity.tolist()))
            assert pushed @ inwards >= 0.0
            # Damping: more on the way out than on the way back.
            more = np.linalg.norm(pushed) - np.linalg.norm(torque(R))
            assert more * (velocity @ inwards) <= 1e-12


def alone_at_the_rim(seed, least_depth=0.0):
    """Return a pose at the rim in which one leg alone is near its end, and its depth, rad."""
    for R in poses_at_the_rim(40, seed):
        depth = BEGIN - margins(R).min()
        if np.count_nonzero(margins(R) < 2.0 * BEGIN) == 1 and depth > least_depth:
            return R, depth
    raise AssertionError


@pytest.mark.parametrize(
    ('limits', 'stiffness'),
    [
        ({}, 2.0),
        # The torque at the end is the limit at most.
        ({'torque': 0.1}, 0.1 / BEGIN),
    ],
)
def test_the_wall_is_a_spring_with_a_damping_of_5_ms(limits, stiffness):
    R, depth = alone_at_the_rim(8)
    torque = wall(**limits)
    push = torque(R)
    size = np.linalg.norm(push)
    assert size == pytest.approx(stiffness * depth)
    inwards = push / size
    for speed in (0.5, -0.5):
        outwards = tuple((-speed * inwards).tolist())
        felt = torque(R, outwards) @ inwards
        assert felt == pytest.approx(stiffness * (depth + 5e-3 * speed))


def test_a_fast_handle_meets_a_narrow_wall_without_a_step():
    """At 5 rad/s a wall of 0.5 deg begins 25 mrad earlier, from zero; here at 2 deg or less."""
    R, depth = alone_at_the_rim(8, math.radians(3.0))
    narrow = math.radians(0.5)
    margin = BEGIN - depth
    torque = wall(end_stop=narrow)
    push = wall()(R)
    outwards = -push / np.linalg.norm(push)
    for speed in np.linspace(0.0, 6.0, 61):
        felt = np.linalg.norm(torque(R, tuple((speed * outwards).tolist())))
        expected = 2.0 * max(0.0, narrow - margin + 5e-3 * speed)
        assert felt == pytest.approx(expected, abs=1e-9)


def test_there_is_no_wall_inside_nor_without_a_velocity_nor_where_it_is_switched_off():
    R = poses_at_the_rim(1, seed=4)[0]
    assert wall()(R).any()
    assert not wall(end_stop=0.0)(R).any()
    assert not wall()(R, None).any()
    assert not wall()(workspace_pose(0.1, 0.3, 0.3)).any()


def test_three_motors_push_only_where_they_are_strong():
    """Not where a torque in the direction of the wall takes more than 1 / 0.05 of it."""
    three = wall(3)
    four = wall(4)
    seen = []
    for R in poses_at_the_rim(300, seed=5):
        if np.count_nonzero(margins(R) < BEGIN) > 1:
            continue
        whole = four(R)
        size = np.linalg.norm(whole)
        of_motors = np.linalg.solve(jacobian(R).T, whole)
        needed = np.linalg.norm(of_motors) / size
        share = np.linalg.norm(three(R)) / size
        x = np.clip((1.0 / needed - 0.05) / 0.1, 0.0, 1.0)
        assert share == pytest.approx(x * x * (3.0 - 2.0 * x), abs=1e-9)
        seen.append(share)
    assert min(seen) < 0.9
    assert max(seen) == 1.0


def test_the_end_stop_is_there_without_wrenches_and_comes_up_by_the_ramp():
    bench = Bench(4)
    R = poses_at_the_rim(1, seed=6)[0]
    bench.torque = None
    outputs = [bench.step(**at(R)) for _ in range(800)]
    assert outputs[-1].state.text == 'ready'
    np.testing.assert_allclose(outputs[-1].rendered, wall()(R), atol=1e-9)
    steps = np.diff([output.rendered for output in outputs], axis=0)
    assert np.linalg.norm(steps, axis=1).max() <= 1e-3


def test_beyond_the_reach_there_is_no_torque():
    """As everywhere without an orientation that all legs reach."""
    bench = Bench(4)
    R = workspace_pose(0.9, 2.0, 2.0)
    with pytest.raises(SpmError):
        inverse(R)
    bench.engage(STILL)
    quaternion = tuple(quaternion_from_matrix(R).tolist())
    assert bench.step(quaternion=quaternion).state.text == 'fading: no orientation'


def test_a_wall_and_a_wrench_together_are_limited():
    limits = ForceLimits()
    bench = Bench(4)
    R = poses_at_the_rim(1, seed=7)[0]
    inwards = wall()(R) / np.linalg.norm(wall()(R))
    bench.engage(STILL)
    bench.torque = tuple((0.3 * inwards).tolist())
    output = bench.run(600, **at(R))
    assert np.linalg.norm(output.rendered) == pytest.approx(limits.torque)
    np.testing.assert_allclose(output.rendered, 0.3 * inwards, atol=1e-6)
