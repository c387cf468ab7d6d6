# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The limits of the command: no motion of the target makes it break one."""

from math import hypot, nan, radians
import random

import numpy as np
import pytest
from spm_haptic_master.kinematics import rotations
from spm_haptic_master.teleoperation import command_limits
from spm_haptic_master.teleoperation.burst_limit import BurstLimit
from spm_haptic_master.teleoperation.tilt_cone import TiltCone
from spm_haptic_master.teleoperation.vectors import moved_toward, unit_quaternion

IDENTITY = (0.0, 0.0, 0.0, 1.0)
# Period of the command (s).
DT = 0.005
# How much later than the last one a sample comes, in periods.
PERIODS = (1.0, 1.0, 1.0, 0.8, 1.0, 1.0, 2.0, 4.0, 20.0)


def at_rest(acceleration=40.0, slews=True):
    """Return a command at rest, with limits that a slow hand does not reach."""
    limits = command_limits.CommandLimits(
        speed=6.0,
        acceleration=acceleration,
        jump=radians(5.0),
        slews=slews,
        longest_step=2.0 * DT,
    )
    return command_limits.LimitedRotation(limits, IDENTITY)


def test_single_precision_is_a_rotation_and_what_is_none_is_refused():
    given = tuple(map(float, np.float32([0.5, 0.5, 0.5, 0.500001])))
    assert hypot(*unit_quaternion(given)) == pytest.approx(1.0, abs=1e-15)
    for values in (
        (0.0, 0.0, 0.0, 0.0),
        (nan, 0.0, 0.0, 1.0),
        (0.0, 0.0, 0.0, float('inf')),
        (1e200, 0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0, 1.01),
        # By 0.07 % of its length.
        (0.0, 0.0, 0.0, 1.0007),
        (0.0, 0.9993, 0.0, 0.0),
    ):
        assert unit_quaternion(values) is None
    for length in (0.9996, 1.0004):
        assert unit_quaternion((0.0, length, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0, 0.0))


def random_limits(generator, period):
    """Return limits of a command, from far too slow to far too fast for a hand."""
    return command_limits.CommandLimits(
        speed=generator.uniform(0.1, 10.0),
        acceleration=10.0 ** generator.uniform(-1.0, 5.0),
        jump=radians(10.0 ** generator.uniform(-1.5, 1.5)),
        slews=True,
        longest_step=2.0 * period,
    )


def random_rate(generator):
    """Return an angular velocity in any direction, rad/s."""
    axis = np.array([generator.gauss(0.0, 1.0) for _ in range(3)])
    speed = generator.choice([0.0, 0.3, 3.0, 30.0])
    return speed * axis / np.linalg.norm(axis)


def random_target(generator, rotation):
    """Return the rotation itself, or one that is anywhere."""
    if generator.random() < 0.7:
        return rotation
    vector = [generator.uniform(-1.5, 1.5) for _ in range(3)]
    return rotations.quaternion_from_vector(*vector)


def turned(rate, dt, rotation):
    """Return a rotation after a turn at a rate, rad/s, for a time, s."""
    step = rotations.quaternion_from_vector(*rate * dt)
    return rotations.multiply_quaternions(step, rotation)


def velocity_between(before, after, dt):
    """Return the angular velocity from one rotation to the next, rad/s."""
    step = rotations.multiply_quaternions(after, rotations.conjugate(before))
    return np.array(rotations.vector_from_quaternion(*step)) / dt


def check_step(limits, last, velocity, dt):
    """Check that a step of the command breaks no limit, after one at the velocity `last`."""
    speed = np.linalg.norm(velocity)
    change = np.linalg.norm(velocity - last)
    assert speed <= limits.speed * (1.0 + 1e-6) + 1e-9
    assert speed * dt <= limits.jump * (1.0 + 1e-6) + 1e-9
    assert change <= limits.acceleration * dt * (1.0 + 1e-6) + 1e-7


def check_no_step_is_possible(limits, last, dt):
    """Check that the slowest motion within the acceleration is farther than a jump."""
    least = np.linalg.norm(last) - limits.acceleration * dt
    assert least * dt > limits.jump * (1.0 - 1e-6)


def check_arrival(command, target, period):
    """Check that a command arrives at a target, and stands."""
    for _ in range(round(5.0 / period)):
        command.advance(target, period)
    assert rotations.rotation_distance(command.rotation, target) < 1e-9
    assert np.linalg.norm(command.velocity) < 1e-6


@pytest.mark.parametrize('seed', range(20))
def test_no_limits_rates_and_gaps_make_the_command_break_one(seed):
    """By the rotations alone; where no motion is within the limits, it says so and stays."""
    generator = random.Random(seed)
    period = 1.0 / generator.choice([20.0, 100.0, 200.0, 500.0, 1000.0])
    limits = random_limits(generator, period)
    command = command_limits.LimitedRotation(limits, IDENTITY)
    velocity = np.zeros(3)
    moved = False
    for _ in range(40):
        rate = random_rate(generator)
        target = random_target(generator, command.rotation)
        for _ in range(generator.randint(1, 60)):
            dt = period * generator.choice(PERIODS)
            target = turned(rate, dt, target)
            before = command.rotation
            broken = command.advance(target, dt)
            if broken:
                assert broken == 'jump'
                check_no_step_is_possible(limits, velocity, dt)
                assert command.rotation == before
                command = command_limits.LimitedRotation(limits, before)
                velocity = np.zeros(3)
                continue
            last = velocity
            velocity = velocity_between(before, command.rotation, dt)
            moved = moved or velocity.any()
            check_step(limits, last, velocity, dt)
            assert np.dot(before, command.rotation) > 0.0
    assert moved
    if limits.acceleration > 10.0 and limits.speed > 1.0 and limits.jump > 0.1:
        check_arrival(command, target, period)


@pytest.mark.parametrize('angle', [0.001, 0.05, 3.0])
def test_a_target_that_stands_is_met_without_overshoot(angle):
    command = at_rest()
    turned = []
    for _ in range(1000):
        command.advance(rotations.quaternion_from_vector(0.0, 0.0, angle), DT)
        turned.append(rotations.vector_from_quaternion(*command.rotation)[2])
    assert turned[-1] == pytest.approx(angle, abs=1e-12)
    assert np.all(np.diff(turned) >= -1e-12)


def test_a_target_that_moves_is_caught_up_with():
    """As fast as the acceleration allows: no lag stays, however long it has been behind."""
    command = at_rest()
    behind = []
    for k in range(400):
        target = rotations.quaternion_from_vector(0.0, 0.0, 0.3 + 2.0 * DT * k)
        command.advance(target, DT)
        behind.append(rotations.rotation_distance(command.rotation, target))
    assert min(behind[:20]) > 0.1
    assert max(behind[100:]) < 1e-12


@pytest.mark.parametrize('heading', range(4))
def test_at_the_limit_of_the_speed_the_command_turns_with_its_target(heading):
    """Behind a target that is faster and changes its direction: in every step anew."""
    command = at_rest(500.0)
    target = IDENTITY
    velocities = []
    for step in range(200):
        phase = heading + 0.01 * step
        target = turned(np.array([9.0 * np.cos(phase), 9.0 * np.sin(phase), 1.0]), DT, target)
        command.advance(target, DT)
        velocities.append(command.velocity)
    at_the_limit = velocities[5:]
    assert np.linalg.norm(at_the_limit, axis=1) == pytest.approx(6.0)
    changes = np.linalg.norm(np.diff(at_the_limit, axis=0), axis=1)
    assert changes.min() > 1e-3


def test_a_pause_is_no_step():
    command = at_rest(500.0)
    assert command.advance(rotations.quaternion_from_vector(2.0, 0.0, 0.0), 10.0) == ''
    assert rotations.rotation_distance(command.rotation, IDENTITY) <= 6.0 * 2.0 * DT


@pytest.mark.parametrize(
    ('vector', 'dt', 'broken'),
    [
        ((radians(5.1), 0.0, 0.0), 0.5, 'jump'),
        ((0.0, 0.031, 0.0), DT, 'speed'),
        ((0.0, 0.0, 0.02), DT, 'acceleration'),
    ],
)
def test_a_broken_limit_is_named_and_the_command_stays(vector, dt, broken):
    command = at_rest(500.0, slews=False)
    assert command.advance(rotations.quaternion_from_vector(*vector), dt) == broken
    assert command.rotation == IDENTITY
    assert command.velocity == (0.0, 0.0, 0.0)
    assert command.advance(rotations.quaternion_from_vector(0.0, 0.01, 0.0), DT) == ''


def about_z(angle):
    return rotations.quaternion_from_vector(0.0, 0.0, angle)


def test_a_target_that_speeds_up_to_the_limits_is_followed_without_slewing():
    """By 0.5 rad/s a step, up to 6 rad/s: exactly at both limits, and no more."""
    command = at_rest(100.0, slews=False)
    angle = 0.0
    for step in range(1, 21):
        angle += DT * min(0.5 * step, 6.0)
        assert command.advance(about_z(angle), DT) == ''
        assert command.rotation == about_z(angle)
    assert command.advance(about_z(angle + DT * 6.01), DT) == 'speed'
    # It may not stop at once either.
    assert command.advance(about_z(angle), DT) == 'acceleration'


@pytest.mark.parametrize('axis', [(1.0, 0.0, 0.0), (0.0, 0.6, 0.8), (-0.6, 0.8, 0.0)])
def test_the_quaternion_is_continuous_over_a_whole_turn(axis):
    """Through half a turn and a whole one, whatever sign the target has."""
    command = at_rest(1e6)
    before = np.array(IDENTITY)
    for step in range(1, 320):
        target = rotations.quaternion_from_vector(*(0.02 * step * part for part in axis))
        if step % 2:
            target = tuple(-part for part in target)
        assert command.advance(target, DT) == ''
        assert before @ command.rotation == pytest.approx(1.0, abs=1e-4)
        before = np.array(command.rotation)


def test_after_a_restart_the_target_that_was_left_behind_does_not_count():
    command = at_rest(500.0)
    command.advance(about_z(0.5), DT)
    assert command.velocity == pytest.approx((0.0, 0.0, 2.5))
    command.restart()
    command.advance(about_z(0.0275), DT)
    assert command.velocity == pytest.approx((0.0, 0.0, 3.0))
    assert command.rotation == about_z(0.0275)


def test_a_jump_counts_from_the_command_whatever_the_time():
    command = at_rest(500.0, slews=False)
    assert command.advance(about_z(radians(4.9)), 1.0) == 'speed'
    assert command.advance(about_z(radians(5.1)), 1.0) == 'jump'
    # At 6 rad/s for two periods it may be 3.4 deg at most.
    assert command.advance(about_z(radians(3.4)), 1.0) == ''


def test_a_command_goes_on_from_where_it_was_withheld():
    """A target that was refused is not the one that the next is compared with."""
    command = at_rest(100.0, slews=False)
    assert command.advance(about_z(0.002), DT) == ''
    assert command.advance(about_z(0.05), DT) == 'speed'
    assert command.advance(about_z(0.006), DT) == ''


def test_a_burst_may_last_10_ms_beyond_a_step_and_grows_back_with_time():
    """By 1.25 ms in a millisecond; a pause counts as one longest step."""
    burst = BurstLimit(0.01)
    assert burst.allows(0.01)
    assert burst.allows(0.01)
    assert not burst.allows(1e-6)
    burst = BurstLimit(0.02)
    assert burst.allows(0.02)
    assert not burst.allows(0.0101)
    assert burst.allows(0.0099)
    assert not burst.allows(0.001)
    burst.pass_time(0.0041)
    assert burst.allows(0.005)
    assert not burst.allows(0.001)
    burst.pass_time(1000.0)
    assert burst.allows(3600.0)
    assert burst.allows(0.0099)
    assert not burst.allows(0.001)


@pytest.mark.parametrize(
    ('goal', 'step', 'expected'),
    [
        ((1.0, 2.0, 2.0), 0.3, (0.1, 0.2, 0.2)),
        ((1.0, 2.0, 2.0), 3.0, (1.0, 2.0, 2.0)),
        ((1.0, 2.0, 2.0), 9.0, (1.0, 2.0, 2.0)),
        ((0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0)),
    ],
)
def test_a_vector_moves_towards_its_goal_by_a_step(goal, step, expected):
    assert moved_toward((0.0, 0.0, 0.0), goal, step) == pytest.approx(expected)
    behind = moved_toward((5.0, -1.0, 2.0), (5.0 + goal[0], goal[1] - 1.0, 2.0 + goal[2]), step)
    assert behind == pytest.approx((5.0 + expected[0], expected[1] - 1.0, 2.0 + expected[2]))


AXIS = (0.0, 0.0, 1.0)
UPSIDE_DOWN = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize('angle', [0.0, 0.3, 1.2, 1.9, 3.1])
def test_the_tilt_is_the_angle_between_shaft_and_axis(angle):
    """Whatever the turn about the shaft; and it is turned back by what is too much."""
    cone = TiltCone(AXIS, AXIS, 1.0)
    spun = about_z(0.7)
    tilted = rotations.quaternion_from_vector(0.6 * angle, 0.8 * angle, 0.0)
    rotation = rotations.multiply_quaternions(tilted, spun)
    assert cone.tilt(rotation) == pytest.approx(angle, abs=1e-7)
    assert cone.contains(rotation) == (angle < 1.0)
    kept = cone.within(rotation, 1.0)
    assert cone.tilt(kept) == pytest.approx(min(angle, 1.0), abs=1e-7)
    moved = rotations.rotation_distance(rotation, kept)
    assert moved == pytest.approx(max(0.0, angle - 1.0), abs=1e-7)


def test_a_shaft_upside_down_has_no_way_back_of_its_own():
    cone = TiltCone(AXIS, AXIS, 1.0)
    assert cone.tilt(UPSIDE_DOWN) == pytest.approx(np.pi)
    assert cone.within(UPSIDE_DOWN, 1.0) == UPSIDE_DOWN


def test_rounding_of_a_cosine_beyond_1_is_no_tilt():
    draw = random.Random(3)
    for _ in range(200):
        shaft = rotations.quaternion_from_vector(*[draw.gauss(0.0, 1.0) for _ in range(3)])
        vector = np.array(shaft[:3]) / np.linalg.norm(shaft[:3])
        axis = tuple(vector.tolist())
        assert TiltCone(axis, axis, 1.0).tilt(IDENTITY) == pytest.approx(0.0, abs=1e-7)
