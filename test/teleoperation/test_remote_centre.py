# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The law of a slave that pivots about a trocar, compared with its formulas in numpy."""

from dataclasses import replace
from math import inf, radians
import random

from mechanism import turn
import numpy as np
import pytest
from spm_haptic_master.kinematics import matrix_from_quaternion, quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import rotation_distance, vector_from_quaternion
from spm_haptic_master.teleoperation import remote_centre
from spm_haptic_master.teleoperation.command import Pose
from spm_haptic_master.teleoperation.command_limits import CommandLimits
from spm_haptic_master.teleoperation.following import Following
from spm_haptic_master.teleoperation.limited_depth import DepthLimits, LimitedDepth
from spm_haptic_master.teleoperation.remote_centre import RemoteCentre, RemoteCentreSettings

# Period of the command (s, ns).
DT = 0.005
PERIOD = 5_000_000
DEEP = DepthLimits(
    shortest=0.02,
    deepest=0.3,
    speed=0.2,
    acceleration=10.0,
    slews=True,
    longest_step=2.0 * DT,
)
FAST = CommandLimits(
    speed=6.0,
    acceleration=500.0,
    jump=radians(5.0),
    slews=True,
    longest_step=2.0 * DT,
)


def quaternion(matrix):
    return tuple(map(float, quaternion_from_matrix(matrix)))


def random_rotation(generator):
    return turn(generator.normal(size=3))


class Course:
    """A random slave about a random trocar, which follows a random master."""

    def __init__(self, seed, depth=0.1, limits=FAST, **settings):
        draw = np.random.default_rng(seed)
        self.master = random_rotation(draw)
        self.slave = random_rotation(draw)
        self.trocar = draw.uniform(-0.5, 0.5, 3)
        # Where the tool's frame lies on its shaft is the manufacturer's.
        self.shaft = draw.normal(size=3)
        self.shaft /= np.linalg.norm(self.shaft)
        self.first_depth = depth
        self.first_insertion = float(draw.uniform(-0.1, 0.1))
        self.tip = self.trocar + depth * self.slave @ self.shaft
        self.first_master = self.master
        given = {'scale': 1.0, 'depth': DEEP, 'largest_tilt': inf} | settings
        self.settings = RemoteCentreSettings(**given)
        pose = Pose(quaternion(self.slave), tuple(self.tip.tolist()))
        centre = RemoteCentre(
            self.settings,
            tuple(self.trocar.tolist()),
            pose,
            self.first_insertion,
            None,
        )
        self.following = Following(
            limits,
            0.0,
            quaternion(self.master),
            pose,
            0,
            centre,
        )
        self.insertion = self.first_insertion
        self.stamp = 0

    def advance(self, turning, sliding, dt=DT):
        """Turn and slide the master by some rad and m; return the limit that is broken."""
        self.master = turn(turning) @ self.master
        self.insertion += sliding
        self.stamp += round(1e9 * dt)
        return self.following.advance(quaternion(self.master), self.insertion, self.stamp)

    @property
    def expected_rotation(self):
        """R_m R_m0^T R_s0."""
        return self.master @ self.first_master.T @ self.slave

    @property
    def rotation(self):
        return matrix_from_quaternion(self.following.command.pose.rotation)

    @property
    def position(self):
        return np.array(self.following.command.pose.position)

    @property
    def depth(self):
        return float(np.linalg.norm(self.position - self.trocar))

    @property
    def distance_from_shaft(self):
        """Distance of the trocar from the line through the tip along R_cmd u."""
        direction = self.rotation @ self.shaft
        return np.linalg.norm(np.cross(self.trocar - self.position, direction))

    @property
    def tilt(self):
        direction = self.rotation @ self.shaft
        axis = self.slave @ self.shaft
        sine = np.linalg.norm(np.cross(axis, direction))
        return np.arctan2(sine, axis @ direction)


@pytest.mark.parametrize('seed', range(50))
def test_the_shaft_passes_through_the_trocar_in_every_command(seed):
    draw = np.random.default_rng(1000 + seed)
    course = Course(seed, scale=float(draw.uniform(0.05, 2.0)))
    # The first command is the slave's own pose.
    np.testing.assert_allclose(course.rotation, course.slave, atol=1e-12)
    np.testing.assert_allclose(course.position, course.tip, atol=1e-12)
    turning = draw.normal(scale=0.004, size=3)
    sliding = float(draw.uniform(-3e-4, 3e-4))
    for step in range(60):
        # From rest, within all limits.
        share = min(1.0, step / 20)
        assert course.advance(share * turning, share * sliding) == ''
        slid = course.insertion - course.first_insertion
        depth = course.first_depth + course.settings.scale * slid
        tip = course.trocar + depth * course.rotation @ course.shaft
        np.testing.assert_allclose(course.rotation, course.expected_rotation, atol=1e-12)
        np.testing.assert_allclose(course.position, tip, atol=1e-12)
        assert course.distance_from_shaft <= 1e-12


@pytest.mark.parametrize('seed', range(20))
def test_the_twist_is_the_derivative_of_the_pose_at_the_tip(seed):
    """By central differences; the command turns and slides evenly."""
    draw = np.random.default_rng(2000 + seed)
    course = Course(seed, limits=CommandLimits(6.0, 1e6, 1.5, True, 1.0), depth=0.15)
    rate = draw.normal(size=3)
    speed = float(draw.uniform(-0.1, 0.1))
    dt = 1e-3
    poses = []
    motions = []
    # The depth speeds up within its limit at first.
    for _ in range(30):
        course.advance(rate * dt, speed * dt, dt)
        poses.append((course.rotation, course.position))
        motions.append(course.following.command.motion)
    for before, motion, after in zip(poses[25:], motions[26:], poses[27:], strict=False):
        linear = (after[1] - before[1]) / (2.0 * dt)
        np.testing.assert_allclose(motion.linear, linear, atol=1e-6)
        np.testing.assert_allclose(motion.angular, rate, atol=1e-9)


def random_depth_limits(draw):
    """Return limits of a depth, from far too slow to far too fast for a hand."""
    return DepthLimits(
        shortest=0.02,
        deepest=draw.uniform(0.05, 0.3),
        speed=10.0 ** draw.uniform(-2.0, 0.5),
        acceleration=10.0 ** draw.uniform(-1.0, 2.0),
        slews=True,
        longest_step=2.0 * DT,
    )


@pytest.mark.parametrize('seed', range(30))
def test_the_depth_keeps_its_range_and_its_rates_whatever_comes(seed):
    draw = random.Random(seed)
    limits = random_depth_limits(draw)
    depth = LimitedDepth(limits, draw.uniform(limits.shortest, limits.deepest))
    rate = 0.0
    target = depth.depth
    sliding = 0.0
    for step in range(2000):
        if step % 40 == 0:
            sliding = draw.choice([0.0, 0.02, 0.3, 3.0]) * draw.choice([-1.0, 1.0])
            target += draw.choice([0.0, 0.0, 0.1, -0.1, 1.0, -1.0])
        dt = DT * draw.choice([1.0, 1.0, 0.8, 1.0, 2.0, 9.0])
        target = min(max(target + sliding * dt, -1.0), 1.0)
        before = depth.depth
        assert depth.advance(target, dt) == ''
        found = (depth.depth - before) / dt
        assert limits.shortest - 1e-12 <= depth.depth <= limits.deepest + 1e-12
        assert abs(found) <= limits.speed * (1.0 + 1e-6) + 1e-9
        assert abs(found - rate) <= limits.acceleration * dt * (1.0 + 1e-6) + 1e-9
        rate = found
    if limits.acceleration > 1.0 and limits.speed > 0.1:
        check_arrival(depth, 0.5 * (limits.shortest + limits.deepest))


def check_arrival(depth, target):
    """Check that a depth arrives at a target in its range, and stands."""
    for _ in range(2000):
        depth.advance(target, DT)
    assert depth.depth == pytest.approx(target, abs=1e-9)
    assert depth.rate == pytest.approx(0.0, abs=1e-6)


def test_a_jump_of_the_insertion_is_slewed_or_disengages():
    course = Course(1)
    depths = [course.depth]
    course.advance(np.zeros(3), 0.05)
    for _ in range(200):
        depths.append(course.depth)
        course.advance(np.zeros(3), 0.0)
    assert max(np.diff(depths)) <= 0.2 * DT * 1.001
    assert depths[-1] == pytest.approx(0.15, abs=1e-12)
    stopped = DepthLimits(
        0.02,
        0.3,
        speed=0.2,
        acceleration=10.0,
        slews=False,
        longest_step=2.0 * DT,
    )
    depth = LimitedDepth(stopped, 0.1)
    assert depth.advance(0.15, DT) == 'insertion speed'
    assert depth.depth == 0.1
    assert depth.advance(0.1008, DT) == 'insertion acceleration'
    assert depth.depth == 0.1
    assert depth.advance(0.1002, DT) == ''


def test_the_end_of_the_range_is_met_gently_and_left_again():
    course = Course(3, depth=0.28)
    for _ in range(100):
        course.advance(np.zeros(3), 0.0008)
    assert course.depth == pytest.approx(0.3, abs=1e-9)
    # The hand is 60 mm beyond the end: the tip waits until it is back.
    for _ in range(70):
        course.advance(np.zeros(3), -0.0008)
    assert course.depth == pytest.approx(0.3, abs=1e-9)
    for _ in range(50):
        course.advance(np.zeros(3), -0.0008)
    assert course.depth == pytest.approx(0.28 - 20 * 0.0008, abs=1e-6)


@pytest.mark.parametrize(
    'seed',
    [
        *range(6),
        *(pytest.param(seed, marks=pytest.mark.evidence) for seed in range(6, 20)),
    ],
)
def test_the_tilt_of_the_shaft_never_exceeds_its_limit(seed):
    draw = np.random.default_rng(3000 + seed)
    limit = radians(float(draw.uniform(5.0, 60.0)))
    course = Course(seed, largest_tilt=limit)
    last = course.rotation
    for _ in range(40):
        turning = draw.normal(scale=draw.choice([0.002, 0.01, 0.02]), size=3)
        for _ in range(int(draw.integers(5, 40))):
            assert course.advance(turning, 0.0) == ''
            assert course.tilt <= limit + 1e-9
            assert course.distance_from_shaft <= 1e-12
            step = rotation_distance(quaternion(course.rotation), quaternion(last))
            assert step <= 6.0 * DT * 1.001 + 1e-9
            last = course.rotation
    # Back within the cone it follows the hand again.
    course.master = course.first_master
    for _ in range(400):
        course.advance(np.zeros(3), 0.0)
    np.testing.assert_allclose(course.rotation, course.slave, atol=1e-9)


def test_at_the_largest_tilt_the_velocity_is_that_of_the_command():
    """It brakes ahead of the cone, and stands there while the hand goes on."""
    course = Course(4, largest_tilt=radians(20.0))
    across = np.cross(course.slave @ course.shaft, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    speeds = []
    for _ in range(80):
        before = course.rotation
        course.advance(0.01 * across, 0.0)
        turned = vector_from_quaternion(*quaternion(course.rotation @ before.T))
        given = course.following.command.motion.angular
        np.testing.assert_allclose(np.multiply(DT, given), turned, atol=1e-9)
        speeds.append(np.linalg.norm(given))
    assert max(speeds) == pytest.approx(2.0)
    assert speeds[-1] == pytest.approx(0.0, abs=1e-6)
    assert course.tilt == pytest.approx(radians(20.0), abs=1e-6)


def test_a_tilt_beyond_the_limit_disengages_where_commands_are_not_slewed():
    limits = CommandLimits(
        6.0,
        500.0,
        radians(5.0),
        slews=False,
        longest_step=2.0 * DT,
    )
    course = Course(4, limits=limits, largest_tilt=radians(20.0))
    across = np.cross(course.slave @ course.shaft, [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    answers = [course.advance(0.01 * across, 0.0) for _ in range(40)]
    assert answers[:34] == [''] * 34
    assert answers[34] == 'tilt'


def pose_of(tip, rotation=None):
    return Pose((0.0, 0.0, 0.0, 1.0) if rotation is None else quaternion(rotation), tip)


def obstacle(pose, known=None, **settings):
    given = {'scale': 1.0, 'depth': DEEP, 'largest_tilt': inf} | settings
    return remote_centre.obstacle(
        RemoteCentreSettings(**given),
        (0.0, 0.0, 0.0),
        pose,
        known,
    )


@pytest.mark.parametrize(
    ('tip', 'found'),
    [
        ((0.0, 0.0, 0.003), 'tip at the trocar: 3 mm, expected 5 mm or more'),
        ((0.0, 0.0, 0.0145), 'depth 14 mm, expected 20 to 300 mm'),
        ((0.0, 0.0, 0.0155), ''),
        ((0.0, 0.0, 0.3045), ''),
        ((0.0, 0.0, 0.306), 'depth 306 mm, expected 20 to 300 mm'),
        # A slave that waits at the end of its range, as it was led there.
        ((0.0, 0.0, 0.302), ''),
        ((0.008, 0.0, 0.1), 'shaft 8 mm off the trocar, expected 5 mm or less'),
        ((0.004, 0.0, 0.1), ''),
    ],
)
def test_a_slave_that_cannot_pivot_from_where_it_is_is_refused_with_the_distance(tip, found):
    assert obstacle(pose_of(tip), shaft=(0.0, 0.0, 1.0)) == found


def test_a_tip_5_mm_below_the_trocar_has_a_shaft():
    shallow = replace(DEEP, shortest=0.005)
    assert obstacle(pose_of((0.0, 0.0, 0.0051)), depth=shallow) == ''
    refused = obstacle(pose_of((0.0, 0.0, 0.0049)), depth=shallow)
    assert refused == 'tip at the trocar: 5 mm, expected 5 mm or more'


def test_after_the_clutch_the_shaft_has_to_be_where_it_was():
    first = pose_of((0.0, 0.0, 0.1))
    settings = RemoteCentreSettings(
        scale=1.0,
        depth=DEEP,
        largest_tilt=inf,
    )
    known = RemoteCentre(settings, (0.0, 0.0, 0.0), first, 0.0, None).pivot
    assert obstacle(first, known) == ''
    # Its tip was pushed aside, or the trocar is elsewhere.
    aside = pose_of((0.0, 0.01, 0.1))
    assert obstacle(aside, known) == 'shaft 10 mm off the trocar, expected 5 mm or less'
    # At a first engaging nobody knows the shaft but by the trocar.
    assert obstacle(aside) == ''


def test_a_slave_beyond_the_range_starts_where_it_is_and_moves_inwards_only():
    course = Course(5, depth=0.303)
    depths = [course.depth]
    for _ in range(100):
        course.advance(np.zeros(3), 0.0005)
        depths.append(course.depth)
    assert depths[0] == pytest.approx(0.303, abs=1e-12)
    assert np.all(np.diff(depths) <= 1e-12)
    assert depths[-1] == pytest.approx(0.3, abs=1e-9)


def test_without_insertion_the_depth_stays():
    course = Course(6, scale=0.0)
    for _ in range(20):
        course.advance((0.01, 0.0, 0.0), float('nan'))
    assert course.depth == pytest.approx(course.first_depth, abs=1e-12)


STRICT = replace(DEEP, slews=False)


def test_a_depth_that_speeds_up_to_its_limits_is_followed_without_slewing():
    """By 0.05 m/s a step, up to 0.2 m/s: exactly at both limits, and no more."""
    depth = LimitedDepth(STRICT, 0.1)
    target = 0.1
    for step in range(1, 11):
        target += DT * min(0.05 * step, 0.2)
        assert depth.advance(target, DT) == ''
        assert depth.depth == pytest.approx(target, abs=1e-12)
    assert depth.rate == pytest.approx(0.2)
    assert depth.advance(target + DT * 0.201, DT) == 'insertion speed'
    # It may not stop at once either.
    assert depth.advance(target, DT) == 'insertion acceleration'
    assert depth.advance(target + DT * 0.15, DT) == ''


def test_after_a_pause_the_depth_moves_no_farther_than_in_two_periods():
    depth = LimitedDepth(replace(DEEP, acceleration=1000.0), 0.1)
    assert depth.advance(0.2, 1.0) == ''
    assert depth.depth == pytest.approx(0.1 + 2.0 * DT * 0.2)


def test_a_depth_goes_up_as_it_goes_down():
    """From 0.1 m to both sides by 5 mm: the same way, mirrored."""
    down = LimitedDepth(DEEP, 0.1)
    up = LimitedDepth(DEEP, 0.1)
    for _ in range(60):
        down.advance(0.105, DT)
        up.advance(0.095, DT)
        assert down.depth - 0.1 == pytest.approx(0.1 - up.depth, abs=1e-12)
    assert down.depth == pytest.approx(0.105, abs=1e-12)


@pytest.mark.parametrize('speed', [0.0, 0.03, 0.1])
@pytest.mark.parametrize('behind', [0.0004, 0.002, 0.0123, 0.03])
def test_a_depth_that_catches_up_never_passes_its_target(speed, behind):
    for sense in (1.0, -1.0):
        depth = LimitedDepth(DEEP, 0.15)
        lags = []
        for step in range(150):
            target = 0.15 + sense * (behind + speed * DT * step)
            assert depth.advance(target, DT) == ''
            lags.append(sense * (target - depth.depth))
        assert min(lags) >= -1e-12
        assert lags[-1] == pytest.approx(0.0, abs=1e-12)
