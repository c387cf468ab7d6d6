# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint reading by reading: how it begins, what leaves its motion, what returns to it."""

from math import hypot, pi, sqrt

import numpy as np
import pytest
from spm_haptic_master.supervision.joint_monitor import (
    innovation_deviation,
    JointMonitor,
    lag,
    outside,
    Step,
)

DT = 1e-3
SIGMA = 1e-3
THRESHOLD = 7.0
ACCELERATION = 500.0
SPEED = 20.0
# Gains of the filter.
ALPHA = 0.7
BETA = 0.49 / 1.3
# Largest innovation by noise alone, rad; deviation of a healthy reading with a count of 12 bits.
NOISE = THRESHOLD * innovation_deviation(1.0) * SIGMA
HEALTHY = hypot(SIGMA, 2.0 * pi / 4096.0 / sqrt(12.0))
# Largest step of a human within a period, rad, with noise.
HUMAN = SPEED * DT + NOISE


def joint():
    return JointMonitor(SIGMA, THRESHOLD, ACCELERATION, SPEED)


def read(monitor, *readings, dt=DT):
    """Let a joint follow readings, rad, so many s apart."""
    for reading in readings:
        monitor.follow(reading, dt, DT, 0.0)
    return monitor


def resting(*readings):
    """Return a joint that has been at rest at 0 for long, and then has readings, rad."""
    return read(joint(), *[0.0] * 20, *readings)


def moving(speed, count=40):
    """Return a joint that moves at a speed, rad/s, and its latest angle, rad."""
    angles = [speed * DT * index for index in range(count)]
    return read(joint(), *angles), angles[-1]


# Its motion -----------------------------------------------------------------------------------


def test_the_deviation_is_that_of_the_filters_steady_state():
    """Its covariance for a sensor of unit variance and a period of 1."""
    gain = np.array([[ALPHA], [BETA]])
    motion = np.array([[1.0, 1.0], [0.0, 1.0]])
    step = (np.eye(2) - gain @ [[1.0, 0.0]]) @ motion
    covariance = np.zeros((2, 2))
    for _ in range(200):
        covariance = step @ covariance @ step.T + gain @ gain.T
    for periods in (0.0, 1.0, 3.0, 10.0):
        ahead = np.array([1.0, periods])
        expected = sqrt(1.0 + ahead @ covariance @ ahead)
        assert innovation_deviation(periods) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('dt', 'periods'),
    [
        (0.5e-3, 1.0),
        (1e-3, 1.0),
        (1.2e-3, 1.2),
        (5e-3, 5.0),
    ],
)
def test_the_limit_is_noise_and_the_lag_behind_a_human(dt, periods):
    human = ACCELERATION * DT**2 * lag(periods)
    expected = THRESHOLD * innovation_deviation(periods) * SIGMA + human
    assert joint().limit(dt, DT) == pytest.approx(expected)
    # With more noise that is allowed for.
    monitor = joint()
    monitor.allow(3.0 * SIGMA)
    expected = THRESHOLD * innovation_deviation(periods) * 3.0 * SIGMA + human
    assert monitor.limit(dt, DT) == pytest.approx(expected)


@pytest.mark.parametrize(
    ('moved', 'predicted', 'expected'),
    [
        (0.0, 2.0, 0.0),
        (2.0, 2.0, 0.0),
        (3.0, 2.0, 1.0),
        (-1.0, 2.0, 1.0),
        (-3.0, -2.0, 1.0),
        (1.0, -2.0, 1.0),
        (-1.0, -2.0, 0.0),
        (0.5, 0.0, 0.5),
    ],
)
def test_a_motion_may_be_anything_between_none_and_the_predicted_one(moved, predicted, expected):
    assert outside(moved, predicted) == expected


@pytest.mark.parametrize(
    ('first', 'second', 'dt', 'velocity'),
    [
        (0.0, 0.002, 1e-3, 2.0),
        (0.0, -0.002, 1e-3, -2.0),
        (0.0, 0.004, 2e-3, 2.0),
        # At the begin the time since the last sample may be 0.
        (0.0, 0.002, 0.0, 2.0),
        (pi - 1e-3, 1e-3 - pi, 1e-3, 2.0),
    ],
)
def test_two_readings_set_position_and_velocity(first, second, dt, velocity):
    monitor = read(joint(), first)
    assert monitor.velocity == 0.0
    read(monitor, second, dt=dt)
    assert monitor.velocity == pytest.approx(velocity)
    read(monitor, second + velocity * DT)
    assert monitor.innovation == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(('dt', 'largest'), [(1e-3, HUMAN), (2e-3, SPEED * 2e-3 + NOISE)])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_second_reading_beyond_what_a_human_moves_is_a_certain_step(dt, largest, sign):
    monitor = read(read(joint(), 0.0), 0.999 * sign * largest, dt=dt)
    assert (monitor.away, monitor.step, monitor.departures) == (0, Step.NONE, 0)
    monitor = read(read(joint(), 0.0), 1.001 * sign * largest, dt=dt)
    assert (monitor.away, monitor.step, monitor.departures) == (1, Step.CERTAIN, 1)
    assert monitor.distance == pytest.approx(1.001 * largest)
    assert monitor.velocity == 0.0
    # It may come back to where it was.
    read(monitor, 0.0)
    assert (monitor.away, monitor.step, monitor.returned) == (0, Step.NONE, 1)


@pytest.mark.parametrize(
    ('dt', 'periods'),
    [
        (0.5e-3, 1.0),
        (1e-3, 1.0),
        (1.4e-3, 1.4),
    ],
)
def test_the_filter_takes_its_part_of_an_innovation(dt, periods):
    """Seven tenths of it for the position, and 0.377 a period for the velocity."""
    size = 5e-3
    monitor = read(resting(), size, dt=dt)
    assert monitor.velocity == pytest.approx(BETA * size / (DT * periods))
    assert monitor.innovation == pytest.approx(size / innovation_deviation(1.0) / HEALTHY)
    expected = ALPHA * size + monitor.velocity * DT
    read(monitor, 0.0)
    assert monitor.innovation == pytest.approx(expected / innovation_deviation(1.0) / HEALTHY)


@pytest.mark.parametrize('factor', [0.3, 0.999, 1.001, 1.05])
def test_an_innovation_counts_alike_whether_noise_explains_it_or_not(factor):
    size = factor * NOISE
    monitor = resting(size)
    assert monitor.innovation == pytest.approx(size / innovation_deviation(1.0) / HEALTHY)
    assert monitor.velocity == pytest.approx(BETA * size / DT)
    assert not monitor.away


@pytest.mark.parametrize(('periods', 'counted'), [(1.4, 1.0), (1.6, 1.6), (4.0, 4.0)])
def test_an_innovation_after_a_gap_is_over_its_own_deviation(periods, counted):
    monitor = read(resting(), 3e-3, dt=periods * DT)
    assert monitor.innovation == pytest.approx(3e-3 / innovation_deviation(counted) / HEALTHY)
    assert monitor.velocity == pytest.approx(BETA * 3e-3 / (periods * DT))


def test_whole_turns_of_a_reading_mean_nothing():
    """A step, its way back, a second one that stays: each reading may begin another turn."""
    readings = [*[0.0] * 20, 0.02, 0.02, 0.0, 0.001, *[0.02] * 12, 0.2]
    shown = []
    for turned in range(len(readings)):
        monitor = joint()
        for index, reading in enumerate(readings):
            turn = 2.0 * pi * ((index >= turned) - (index >= turned + 3))
            read(monitor, reading + turn)
        shown.append((monitor.away, monitor.step, monitor.departures, monitor.returned))
    assert set(shown) == {(13, Step.CERTAIN, 2, 1)}


# How fast it is -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('speed', 'is_slow'), [(1.9, True), (2.1, False), (-1.9, True), (-2.1, False)]
)
def test_the_noise_is_measured_while_a_joint_moves_by_less_than_two_deviations(speed, is_slow):
    monitor, _ = moving(speed)
    assert (monitor.readings.noise < 0.9 * SIGMA) == is_slow
    if not is_slow:
        assert monitor.readings.noise == pytest.approx(SIGMA)


@pytest.mark.parametrize(
    ('speed', 'is_slow'), [(1.0, True), (3.0, False), (-1.0, True), (-3.0, False)]
)
def test_repeated_readings_of_a_joint_that_is_not_slow_are_those_of_a_slow_encoder(speed, is_slow):
    monitor = joint()
    for index in range(60):
        read(monitor, speed * DT * (index - index % 2))
    assert monitor.readings.is_slower_than_bus != is_slow


def test_a_difference_of_innovations_is_noise_only_of_two_readings_in_a_row():
    """Neither behind a large innovation, nor behind a late reading, nor behind a reset."""
    monitor = resting()
    quiet = monitor.readings.noise
    read(monitor, 1.05 * NOISE, 1.05 * NOISE)
    assert monitor.readings.noise == quiet
    monitor = resting(3e-3)
    quiet = monitor.readings.noise
    late = ALPHA * 3e-3 + monitor.velocity * 2.0 * DT
    read(monitor, late, dt=2.0 * DT)
    read(monitor, late)
    assert monitor.readings.noise == quiet
    monitor = resting()
    monitor.reset_motion()
    read(monitor, 0.0, 0.0)
    quiet = monitor.readings.noise
    read(monitor, 5e-3)
    assert monitor.readings.noise == quiet
    read(monitor, 5e-3)
    assert monitor.readings.noise != quiet


def slow_encoder(speed=3.0):
    """Return a joint with a new reading in every other sample, and its latest angle, rad."""
    monitor = joint()
    for index in range(61):
        angle = speed * DT * (index - index % 2)
        read(monitor, angle)
    assert monitor.readings.is_slower_than_bus
    return monitor, angle


def test_a_slow_encoder_that_has_no_new_reading_for_ten_milliseconds_has_stopped():
    monitor, angle = slow_encoder()
    for count in range(1, 10):
        read(monitor, angle)
        assert monitor.reading_age == pytest.approx(count * DT)
        assert monitor.velocity == pytest.approx(3.0, rel=1e-3)
    read(monitor, angle, angle)
    assert monitor.velocity == 0.0


def test_a_slow_encoder_that_moves_again_does_so_from_its_reading():
    """Not from where the filter had it."""
    monitor, angle = slow_encoder()
    bump = angle + 6e-3 + 4e-3
    read(monitor, angle, *[bump] * 12)
    assert monitor.velocity == 0.0
    read(monitor, bump + 3e-3)
    assert monitor.innovation == pytest.approx(3e-3 / innovation_deviation(1.0) / HEALTHY)
    assert monitor.away == 0


def test_a_reading_of_a_slow_encoder_that_comes_late_is_on_its_motion():
    monitor, angle = slow_encoder()
    read(monitor, *[angle] * 6)
    read(monitor, angle + 3.0 * 7.0 * DT)
    assert monitor.reading_age == 0.0
    assert monitor.innovation == pytest.approx(0.0, abs=1e-4)
    assert monitor.velocity == pytest.approx(3.0)
    # After a gap that is longer than an encoder repeats its readings it begins again.
    read(monitor, angle + 3.0 * 8.0 * DT + 0.06, dt=0.02)
    read(monitor, angle + 3.0 * 8.0 * DT + 0.055)
    assert monitor.velocity == pytest.approx(-5.0)


# What leaves it -------------------------------------------------------------------------------


@pytest.mark.parametrize('periods', [1.0, 1.4, 3.0])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_reading_beyond_the_limit_leaves_the_motion(periods, sign):
    limit = joint().limit(periods * DT, DT)
    monitor = read(resting(), 0.999 * sign * limit, dt=periods * DT)
    assert monitor.away == 0
    assert monitor.departures == 0
    monitor = read(resting(), 1.001 * sign * limit, dt=periods * DT)
    assert monitor.away == 1
    assert monitor.departures == 1
    assert monitor.distance == pytest.approx(1.001 * limit)


@pytest.mark.parametrize(('timing', 'leaves'), [(0.0, True), (0.9e-3, True), (1.1e-3, False)])
@pytest.mark.parametrize('speed', [2.0, -2.0])
def test_a_moving_joint_may_be_off_by_its_motion_in_the_error_of_the_stamp(timing, leaves, speed):
    monitor, angle = moving(speed)
    off = monitor.limit(DT, DT) + 2.0 * 1e-3
    monitor.follow(angle + speed * DT + off, DT, DT, timing)
    assert bool(monitor.away) == leaves


@pytest.mark.parametrize(
    ('periods', 'part', 'beyond', 'leaves'),
    [
        # It moves at 15 rad/s, and may have stopped if the reading is late.
        (1.4, 0.0, 0.0, True),
        (1.6, 0.0, 0.0, False),
        (1.6, 0.0, -0.99, False),
        (1.6, 0.0, -1.01, True),
        (1.6, 1.0, 0.99, False),
        (1.6, 1.0, 1.01, True),
    ],
)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_joint_may_have_stopped_before_a_late_reading(periods, part, beyond, leaves, sign):
    monitor, angle = moving(sign * 15.0)
    moved = part * 15.0 * periods * DT + beyond * monitor.limit(periods * DT, DT)
    read(monitor, angle + sign * moved, dt=periods * DT)
    assert bool(monitor.away) == leaves


@pytest.mark.parametrize(('factor', 'step'), [(0.99, Step.SUSPECTED), (1.01, Step.CERTAIN)])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_step_beyond_what_a_human_moves_is_certain_at_once(factor, step, sign):
    """It is the change of the reading less the motion: noise of the last one is part of it."""
    monitor = resting(sign * 5e-3)
    change = monitor.velocity * DT + sign * factor * HUMAN
    read(monitor, sign * 5e-3 + change)
    assert monitor.away == 1
    assert monitor.step == step


@pytest.mark.parametrize(('factor', 'step'), [(0.99, Step.SUSPECTED), (1.01, Step.CERTAIN)])
def test_of_a_late_reading_the_step_is_its_distance_from_the_motion(factor, step):
    monitor, angle = slow_encoder()
    bump = 5e-3
    read(monitor, angle, angle + 6e-3 + bump)
    held = angle + 6e-3 + bump
    read(monitor, held)
    filtered = angle + 6e-3 + ALPHA * bump
    off = factor * (SPEED * 2.0 * DT + NOISE)
    read(monitor, filtered + monitor.velocity * 2.0 * DT + off)
    assert monitor.away == 1
    assert monitor.step == step


@pytest.mark.parametrize('speed', [0.0, 2.0, -2.0])
@pytest.mark.parametrize(
    ('second', 'third', 'steps'),
    [
        (0.0, 0.0, (Step.SUSPECTED, Step.CERTAIN)),
        # It goes on in the direction of the step, by less or more than noise and a human explain.
        (0.99, 0.0, (Step.SUSPECTED, Step.CERTAIN)),
        (1.01, 0.0, (Step.NONE, Step.NONE)),
        (0.0, 0.99, (Step.SUSPECTED, Step.CERTAIN)),
        (0.0, 1.01, (Step.SUSPECTED, Step.NONE)),
        # Back: that is no impact.
        (-1.01, 0.0, (Step.SUSPECTED, Step.CERTAIN)),
    ],
)
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_step_is_certain_with_the_third_reading_unless_the_motion_goes_on(
    speed, second, third, steps, sign
):
    """As after an impact."""
    monitor, angle = moving(speed)
    noise = THRESHOLD * sqrt(2.0) * SIGMA
    offs = (
        0.025,
        0.025 + second * (noise + 0.5 * ACCELERATION * DT**2),
        0.025 + third * (noise + 0.5 * ACCELERATION * (2.0 * DT) ** 2),
    )
    shown = []
    for off in offs:
        angle += speed * DT
        read(monitor, angle + sign * off)
        shown.append(monitor.step)
    assert tuple(shown) == (Step.SUSPECTED, *steps)


def test_a_step_is_evidence_for_six_readings_and_the_joint_is_away_for_fifty_milliseconds():
    monitor = resting()
    steps = []
    away = []
    for _ in range(54):
        read(monitor, 0.02)
        steps.append(monitor.step)
        away.append(monitor.away)
    assert steps == [Step.SUSPECTED] * 2 + [Step.CERTAIN] * 4 + [Step.NONE] * 48
    assert away[:50] == list(range(1, 51))
    assert away[-1] == 0
    assert monitor.departures == 1
    assert monitor.returned == 0


def test_a_joint_that_left_is_followed_from_where_it_is_with_the_third_reading():
    monitor = resting(0.02, 0.022)
    assert monitor.velocity == 0.0
    assert monitor.distance == pytest.approx(0.022)
    assert monitor.innovation == pytest.approx(0.022 / innovation_deviation(1.0) / HEALTHY)
    read(monitor, 0.024, 0.027)
    assert monitor.velocity == pytest.approx(3.0)
    assert monitor.away == 4
    # A second step shortly after the first is certain, and no departure of its own.
    read(monitor, *[0.027 + 0.003 * index for index in range(1, 7)])
    assert monitor.step is Step.NONE
    read(monitor, 0.2)
    assert monitor.step is Step.CERTAIN
    assert monitor.departures == 1
    read(monitor, 0.2, 0.201)
    assert monitor.velocity == pytest.approx(1.0)


def test_behind_a_gap_a_joint_that_left_is_followed_with_the_next_reading():
    monitor = read(resting(0.02), 0.02, dt=0.06)
    assert (monitor.away, monitor.step) == (2, Step.SUSPECTED)
    read(monitor, 0.021)
    assert (monitor.away, monitor.step) == (0, Step.NONE)
    assert monitor.velocity == pytest.approx(1.0)


def test_a_motion_that_begins_anew_behind_a_gap_is_at_rest_until_its_second_reading():
    monitor, angle = moving(15.0)
    angle += 15.0 * 6.0 * DT
    read(monitor, angle, dt=6.0 * DT)
    read(monitor, angle + 0.3, angle + 0.3)
    assert monitor.away == 2
    read(monitor, angle)
    assert monitor.returned == 1
    assert monitor.velocity == 0.0


# What returns to it ---------------------------------------------------------------------------


@pytest.mark.parametrize('stayed', [1, 2, 3, 10])
@pytest.mark.parametrize('speed', [0.0, 2.0])
@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('factor', 'returns'), [(0.99, True), (1.01, False)])
def test_a_joint_returns_that_jumps_back_to_half_its_limit(stayed, speed, sign, factor, returns):
    monitor, angle = moving(speed)
    for _ in range(stayed):
        angle += speed * DT
        read(monitor, angle + sign * 0.3)
    angle += speed * DT
    off = factor * 0.5 * monitor.limit((stayed + 1) * DT, DT)
    read(monitor, angle + sign * off)
    assert (monitor.returned == 1) == returns
    assert (monitor.away == 0) == returns
    if returns:
        assert monitor.step is Step.NONE
        assert monitor.velocity == pytest.approx(speed, abs=1e-6)
        read(monitor, angle + speed * DT + sign * off)
        assert monitor.innovation == pytest.approx(0.0, abs=1e-6)


def test_a_joint_that_returns_has_the_velocity_of_the_motion_that_it_left():
    """It rested meanwhile."""
    monitor, angle = moving(2.0)
    read(monitor, *[angle + 0.3] * 6)
    assert monitor.velocity == 0.0
    read(monitor, angle + 2.0 * 7.0 * DT)
    assert monitor.returned == 1
    assert monitor.velocity == pytest.approx(2.0)


@pytest.mark.parametrize('speed', [0.0, 2.0, -2.0])
@pytest.mark.parametrize(('factor', 'returns'), [(0.98, False), (1.02, True)])
def test_a_joint_returns_only_by_a_jump(speed, factor, returns):
    """Twenty milliseconds later its limit is so wide that it is near its old motion anyway."""
    monitor, angle = moving(speed)
    for _ in range(20):
        angle += speed * DT
        read(monitor, angle + 0.03)
    jump = factor * (0.5 * monitor.limit(DT, DT) + abs(speed) * DT)
    read(monitor, angle + 0.03 - jump)
    assert (monitor.returned == 1) == returns


@pytest.mark.parametrize(('milliseconds', 'returns'), [(49, True), (52, False)])
def test_a_joint_returns_within_fifty_milliseconds(milliseconds, returns):
    monitor = resting(*[0.3] * (milliseconds - 1), 0.0)
    assert (monitor.returned == 1) == returns
    assert monitor.departures == 2 - returns


def test_a_reset_forgets_the_motion_and_not_what_it_left():
    monitor = resting(0.3, 0.3, 0.0, 0.001, 0.3)
    monitor.reset_motion()
    assert (monitor.away, monitor.step) == (0, Step.NONE)
    assert (monitor.velocity, monitor.innovation, monitor.distance) == (0.0, 0.0, 0.0)
    assert monitor.reading_age == 0.0
    assert (monitor.departures, monitor.returned) == (2, 1)
    read(monitor, 1.0, 1.002)
    assert monitor.velocity == pytest.approx(2.0)
    assert monitor.away == 0
