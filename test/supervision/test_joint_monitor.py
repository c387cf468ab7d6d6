# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint by itself: jumps, gaps, slow encoders, noise, repeated readings, restart."""

from math import nextafter, pi, radians, sqrt

import numpy as np
import pytest
from spm_haptic_master.supervision.joint_monitor import FAST, JointMonitor, SLOW

# A power of two, so that sums of it are exact (s).
DT = 2.0 ** -10
SIGMA = radians(0.04)
THRESHOLD = 7.0
ACCELERATION = 500.0
# Count of a 14-bit encoder, rad.
COUNT = 2.0 * pi / 2**14


def joint(sigma=SIGMA, threshold=THRESHOLD, acceleration=ACCELERATION):
    return JointMonitor(sigma, threshold, acceleration)


def feed(monitor, readings, dt=DT, period=DT, timing=0.0):
    """Pass readings to the monitor; return which ones left the motion."""
    return [monitor.jumped(reading, dt, period, timing) for reading in readings]


def at_rest(angle=0.0, count=50, **changed):
    """Return a monitor after equal readings, which determine rest exactly."""
    monitor = joint(**changed)
    assert not any(feed(monitor, [angle] * count))
    return monitor


def moving(speed, count=50, first=0.0, **changed):
    """Return a monitor after a motion of constant speed, rad/s, and the next reading."""
    monitor = joint(**changed)
    assert not any(feed(monitor, [first + speed * DT * index for index in range(count)]))
    return monitor, first + speed * DT * count


def noisy(count, sigma=SIGMA, resolution=COUNT, seed=1):
    """Return readings of a joint at rest, quantised."""
    noise = np.random.default_rng(seed).normal(0.0, sigma, count)
    return (np.round(noise / resolution) * resolution).tolist()


# The filter ---------------------------------------------------------------------------------

def test_the_first_two_readings_determine_the_motion():
    monitor = joint()
    assert feed(monitor, [1.0, 1.002]) == [False, False]
    assert monitor.velocity == pytest.approx(0.002 / DT)
    assert monitor.innovation == 0.0
    # However far apart they are.
    assert feed(joint(), [1.0, -1.0]) == [False, False]


def test_readings_closer_than_the_period_are_no_speed():
    monitor = joint()
    feed(monitor, [1.0, 1.002], dt=1e-5)
    assert monitor.velocity == pytest.approx(0.002 / DT)
    monitor.jumped(1.002 + 0.002 * 1e-5 / DT + 0.001, 1e-5, DT, 0.0)
    assert monitor.velocity == pytest.approx((0.002 + 0.2 * 0.001) / DT)
    # Readings farther apart are.
    monitor = joint()
    feed(monitor, [1.0, 1.002], dt=4.0 * DT)
    assert monitor.velocity == pytest.approx(0.002 / (4.0 * DT))


def test_a_reading_corrects_position_and_velocity_by_the_gains():
    monitor, expected = moving(2.0)
    monitor.jumped(expected + 0.003, DT, DT, 0.0)
    assert monitor.velocity == pytest.approx(2.0 + 0.2 * 0.003 / DT)
    # The corrected position is where the next prediction begins.
    monitor.jumped(expected + 0.6 * 0.003 + monitor.velocity * DT, DT, DT, 0.0)
    assert monitor.innovation == pytest.approx(0.0, abs=1e-9)


def test_a_late_reading_corrects_the_velocity_by_its_time():
    monitor, expected = moving(2.0)
    monitor.jumped(expected + 2.0 * 2.0 * DT + 0.003, 3.0 * DT, DT, 0.0)
    assert monitor.velocity == pytest.approx(2.0 + 0.2 * 0.003 / (3.0 * DT))


@pytest.mark.parametrize('speed', [3.0, -3.0])
def test_a_steady_motion_has_no_innovation_even_past_half_a_turn(speed):
    monitor = joint()
    for index in range(2200):
        angle = pi - 0.2 + speed * DT * index
        assert not monitor.jumped((angle + pi) % (2.0 * pi) - pi, DT, DT, 0.0)
        assert monitor.innovation == pytest.approx(0.0, abs=1e-6)
    assert monitor.velocity == pytest.approx(speed)


def test_past_half_a_turn_between_the_first_two_readings():
    monitor = joint()
    feed(monitor, [pi - 0.001, -pi + 0.001])
    assert monitor.velocity == pytest.approx(0.002 / DT)


# Jumps --------------------------------------------------------------------------------------

@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_reading_off_the_motion_by_more_than_noise_and_a_human_has_jumped(sign):
    limit = joint().limit(DT, DT)
    assert limit == pytest.approx(
        THRESHOLD * sqrt(1.4 / 0.78) * SIGMA + ACCELERATION * DT * DT / 0.2)
    monitor = at_rest()
    assert not monitor.jumped(sign * limit, DT, DT, 0.0)
    assert not monitor.coasting
    monitor = at_rest()
    assert monitor.jumped(sign * nextafter(limit, 1.0), DT, DT, 0.0)
    assert monitor.coasting


def test_the_limit_allows_for_more_noise_than_configured_if_it_is_told():
    monitor = at_rest()
    limit = monitor.limit(DT, DT)
    monitor.sigma = 3.0 * SIGMA
    wider = monitor.limit(DT, DT)
    assert wider - limit == pytest.approx(THRESHOLD * 2.0 * sqrt(1.4 / 0.78) * SIGMA)
    assert not monitor.jumped(wider, DT, DT, 0.0)


def test_innovations_are_in_standard_deviations_of_the_configured_noise():
    monitor = at_rest()
    monitor.sigma = 3.0 * SIGMA
    monitor.jumped(-4.0 * SIGMA, DT, DT, 0.0)
    assert monitor.innovation == pytest.approx(4.0 / sqrt(1.4 / 0.78))


@pytest.mark.parametrize('speed', [3.0, -3.0])
def test_the_time_of_a_sample_may_be_uncertain(speed):
    for factor, jumped in ((0.999, False), (1.001, True)):
        monitor, expected = moving(speed)
        limit = monitor.limit(DT, DT) + 3.0 * 0.002
        assert monitor.jumped(expected + factor * limit, DT, DT, 0.002) == jumped


# Gaps ---------------------------------------------------------------------------------------

def filters(periods, count=40_000):
    """Return the rms of innovations after a gap, over the sensor's, of many filters at rest."""
    rng = np.random.default_rng(5)
    angle, step = np.zeros(count), np.zeros(count)
    for _ in range(60):
        innovation = rng.normal(size=count) - angle - step
        angle, step = angle + step + 0.6 * innovation, step + 0.2 * innovation
    return np.sqrt(np.mean((rng.normal(size=count) - angle - periods * step) ** 2))


@pytest.mark.parametrize('periods', [1, 2, 3, 7, 24])
def test_after_a_gap_the_limit_follows_the_filters_variances(periods):
    """Noise of position and velocity add up with the time; compared with many filters."""
    limit = joint(acceleration=0.0).limit(periods * DT, DT)
    assert limit / (THRESHOLD * SIGMA) == pytest.approx(filters(periods), rel=0.015)


@pytest.mark.parametrize('periods', [1, 2, 3, 4.5, 9])
def test_after_a_gap_the_limit_follows_a_constant_acceleration(periods):
    """The lag of a filter that has followed it for long, without noise."""
    lenient = joint(acceleration=1e9)
    period = 1e-3
    times = [index * period for index in range(200)]
    for time in times:
        lenient.jumped(20.0 * time * time, period if time else 0.0, period, 0.0)
    lenient.jumped(20.0 * (times[-1] + periods * period) ** 2, periods * period, period, 0.0)
    lag = lenient.innovation * sqrt(1.4 / 0.78) * SIGMA
    assert joint(threshold=0.0, acceleration=40.0).limit(periods * period, period) \
        == pytest.approx(lag, rel=1e-6)


@pytest.mark.parametrize('gains', [FAST, SLOW], ids=['fast', 'slow'])
def test_the_variances_follow_from_the_gains(gains):
    """The response to one reading of 1, with a period of 1."""
    position = velocity = 0.0
    responses = []
    for reading in [1.0] + 400 * [0.0]:
        innovation = reading - position - velocity
        position += velocity + gains.alpha * innovation
        velocity += gains.beta * innovation
        responses.append((innovation, position, velocity))
    innovations, positions, velocities = np.array(responses).T
    assert gains.innovation == pytest.approx(np.linalg.norm(innovations))
    assert gains.position == pytest.approx(positions @ positions)
    assert gains.velocity == pytest.approx(velocities @ velocities)
    assert gains.covariance == pytest.approx(positions @ velocities)
    assert gains.difference == pytest.approx(
        np.linalg.norm(np.diff(innovations, prepend=0.0)), rel=1e-4)


def settled(period, seed=1):
    """Return a monitor after noisy readings at rest, so many seconds apart."""
    monitor = joint()
    feed(monitor, noisy(500, seed=seed), period, period)
    return monitor


def test_at_250_hz_a_jump_shows_from_ten_times_the_noise_and_human_motion_on():
    """The filter of fast samples would lag by 2.3 deg of human motion, this one by 0.9."""
    period = 4e-3
    limit = settled(period).limit(period, period)
    motion = ACCELERATION * period * period
    assert limit == pytest.approx(
        THRESHOLD * 1.66227 * SIGMA + motion / 0.5, rel=1e-4)
    assert limit < radians(1.87)


def test_the_filter_follows_the_period_and_the_measured_noise_stays():
    monitor = settled(DT)
    noise = monitor.noise
    limits = [monitor.limit(DT, DT)]
    for period in (4e-3, DT):
        assert not monitor.jumped(0.0, period, period, 0.0)
        assert monitor.noise == pytest.approx(noise, rel=0.02)
        limits.append(monitor.limit(DT, DT))
    fast = THRESHOLD * FAST.innovation * SIGMA + ACCELERATION * DT * DT / FAST.beta
    slow = THRESHOLD * SLOW.innovation * SIGMA + ACCELERATION * DT * DT / SLOW.beta
    assert limits == pytest.approx([fast, slow, fast])


def test_samples_closer_than_the_period_have_its_limit():
    monitor = joint()
    assert monitor.limit(1e-5, DT) == monitor.limit(DT, DT)
    assert monitor.limit(nextafter(DT, 1.0), DT) == pytest.approx(monitor.limit(DT, DT))


def test_the_limit_holds_for_the_time_since_the_last_reading():
    limit = joint().limit(3.0 * DT, DT)
    assert not at_rest().jumped(limit, 3.0 * DT, DT, 0.0)
    assert at_rest().jumped(nextafter(limit, 1.0), 3.0 * DT, DT, 0.0)


def test_the_velocity_of_more_than_five_periods_ago_says_nothing():
    monitor = at_rest()
    monitor.jumped(0.001, 5.0 * DT, DT, 0.0)
    assert monitor.jumped(0.101, DT, DT, 0.0)
    monitor = at_rest()
    monitor.jumped(0.001, nextafter(5.0 * DT, 1.0), DT, 0.0)
    # The next reading sets it.
    assert not monitor.jumped(0.101, DT, DT, 0.0)
    assert monitor.velocity == pytest.approx(0.1 / DT)


# Coasting, and the return -------------------------------------------------------------------

@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_after_a_jump_only_half_the_limit_is_a_return(sign):
    half = 0.5 * joint().limit(DT, DT)
    for reading, jumped in ((half, False), (nextafter(half, 1.0), True)):
        monitor = at_rest()
        assert monitor.jumped(0.2, DT, DT, 0.0)
        assert monitor.jumped(sign * reading, DT, DT, 0.0) == jumped
        assert monitor.coasting == jumped


def test_back_from_a_jump_the_whole_limit_holds_again():
    monitor = at_rest()
    assert feed(monitor, [0.2, 0.0, 0.9 * monitor.limit(DT, DT)]) == [True, False, False]


def test_half_the_limit_of_a_return_is_that_of_one_period_however_long_the_jump():
    monitor = at_rest()
    assert feed(monitor, [0.2, 0.2, 0.2]) == [True] * 3
    assert monitor.jumped(0.51 * monitor.limit(DT, DT), DT, DT, 0.0)


def test_a_moving_joint_coasts_on_while_it_jumps():
    monitor, expected = moving(2.0)
    assert feed(monitor, [expected + 0.1, expected + 0.1, expected + 0.1]) == [True] * 3
    assert monitor.velocity == pytest.approx(2.0)
    assert not monitor.jumped(expected + 3.0 * 2.0 * DT, DT, DT, 0.0)
    assert monitor.innovation == pytest.approx(0.0, abs=1e-9)


def test_a_return_after_more_than_five_periods_sets_the_velocity_anew():
    for bad, jumped in ((4, True), (5, False)):
        monitor = at_rest()
        assert feed(monitor, [0.2] * bad) == [True] * bad
        assert feed(monitor, [0.001, 0.101]) == [False, jumped]


def test_a_joint_that_jumped_before_a_gap_is_back_within_half_the_limit_of_noise():
    limit = 0.5 * THRESHOLD * sqrt(1.4 / 0.78) * SIGMA
    monitor = at_rest()
    assert not monitor.back_after_gap(0.0)
    monitor.jumped(0.2, DT, DT, 0.0)
    for sign in (1.0, -1.0):
        assert monitor.back_after_gap(0.999 * sign * limit)
        assert not monitor.back_after_gap(1.001 * sign * limit)
    assert monitor.back_after_gap(2.0 * pi)
    monitor.sigma = 2.0 * SIGMA
    assert monitor.back_after_gap(1.999 * limit)


# Slower encoders than the bus ---------------------------------------------------------------

def slow_encoder(repeats, speed=3.0, every=4):
    """
    Return a monitor of an encoder that repeats each of its readings, and the latest one.

    The joint has come to its speed, rad/s, slowly; its latest reading was repeated some times.
    """
    monitor = joint()
    # Its resolution.
    feed(monitor, [-1e-5, 0.0])
    start = round(speed / 20.0 / DT / every) * every
    count = start + 40 * every
    position = 0.0
    for index in range(count + 1 + repeats):
        if index % every == 0 and index <= count:
            late = max(index - start, 0)
            position = DT * DT * 10.0 * min(index, start) ** 2 + 20.0 * start * DT * DT * late
        assert not monitor.jumped(position, DT, DT, 0.0)
    return monitor, position


def test_repeats_of_a_slower_encoder_are_held_and_their_age_is_known():
    for repeats in (0, 1, 3):
        monitor, last = slow_encoder(repeats)
        assert monitor.since == repeats * DT
        assert monitor.velocity == pytest.approx(3.0, rel=0.03)
    # A new reading ends it.
    assert not monitor.jumped(last + 4.0 * 3.0 * DT, DT, DT, 0.0)
    assert monitor.since == 0.0


def test_an_encoder_at_the_rate_of_the_bus_is_never_held():
    monitor, last = slow_encoder(0, every=1)
    assert not monitor.jumped(last, DT, DT, 0.0)
    assert monitor.since == 0.0


@pytest.mark.parametrize('repeats', [1, 3, 8])
def test_after_a_hold_the_limit_is_that_of_the_encoders_own_period(repeats):
    own = (repeats + 1) * DT
    for factor, jumped in ((0.999, False), (1.001, True)):
        monitor, last = slow_encoder(repeats)
        predicted = last + monitor.velocity * own
        assert monitor.jumped(predicted + factor * monitor.limit(own, own), DT, DT, 0.0) == jumped
        assert monitor.coasting == jumped


def test_the_encoders_own_period_is_below_ten_milliseconds():
    monitor, last = slow_encoder(10)
    # Later than that: the limit is that of a gap.
    predicted = last + monitor.velocity * 11.0 * DT
    gap, own = monitor.limit(11.0 * DT, DT), monitor.limit(11.0 * DT, 11.0 * DT)
    assert gap < own
    assert monitor.jumped(predicted + 1.001 * gap, DT, DT, 0.0)


def test_it_holds_no_longer_than_ten_milliseconds():
    monitor, last = slow_encoder(10)
    assert monitor.since == 10.0 * DT
    assert monitor.velocity == pytest.approx(3.0, rel=0.03)
    # Then it has stopped.
    assert not monitor.jumped(last, DT, DT, 0.0)
    assert (monitor.since, monitor.velocity) == (0.0, 0.0)
    assert not monitor.jumped(last + 0.999 * monitor.limit(DT, DT), DT, DT, 0.0)


def test_a_held_joint_that_stopped_meanwhile_is_where_it_was():
    """A fast motion that ends: the prediction has run on, the joint has not."""
    for sign in (1.0, -1.0):
        monitor, last = slow_encoder(3, speed=16.0)
        limit = monitor.limit(4.0 * DT, 4.0 * DT)
        assert 16.0 * 4.0 * DT > 1.3 * limit
        assert not monitor.jumped(last + 0.999 * sign * limit, DT, DT, 0.0)
    assert slow_encoder(3, speed=16.0)[0].jumped(last - 1.001 * limit, DT, DT, 0.0)
    # At the rate of the bus a joint that stopped at once is off its motion.
    monitor, last = slow_encoder(0, speed=16.0, every=1)
    assert monitor.jumped(last, DT, DT, 0.0)


def test_an_encoder_is_slower_from_two_repeats_in_five_on():
    """Of a joint that moves; at 0.4 of 1 kHz it is a sensor of 600 Hz."""
    for pattern, held in ((3, False), (2, True)):
        monitor = joint(acceleration=1e9)
        feed(monitor, [-1e-5, 0.0])
        position = 0.0
        for index in range(400):
            position = position if index % pattern == 0 else 3.0 * DT * index
            monitor.jumped(position, DT, DT, 0.0)
        monitor.jumped(position, DT, DT, 0.0)
        assert (monitor.since > 0.0) == held


@pytest.mark.parametrize(('factor', 'held'), [(0.9, False), (1.03, True)])
def test_a_joint_moves_from_two_counts_and_sigmas_a_period_on(factor, held):
    """A slower one repeats itself whatever its encoder is."""
    monitor = joint(acceleration=1e9)
    feed(monitor, [-1e-3, 0.0])
    speed = factor * 2.0 * (1e-3 + SIGMA) / DT
    for index in range(400):
        monitor.jumped(speed * DT * (index - index % 2), DT, DT, 0.0)
    monitor.jumped(speed * DT * 398, DT, DT, 0.0)
    assert (monitor.since > 0.0) == held


def test_the_motion_begins_with_two_different_readings_of_a_slow_encoder():
    """A repeated one says nothing of the speed."""
    monitor, last = slow_encoder(0)
    monitor.reset_motion()
    feed(monitor, [last + 0.5, last + 0.5])
    assert not monitor.jumped(last + 0.51, DT, DT, 0.0)
    assert monitor.velocity == pytest.approx(0.01 / DT)
    # One at the rate of the bus: rest.
    monitor, last = slow_encoder(0, every=1)
    monitor.reset_motion()
    feed(monitor, [last + 0.5, last + 0.5])
    assert monitor.velocity == 0.0
    assert monitor.jumped(last + 0.51, DT, DT, 0.0)


# Noise --------------------------------------------------------------------------------------

@pytest.mark.parametrize('readings', [4, 50, 195])
def test_the_configured_noise_counts_for_64_readings_at_the_start(readings):
    """Without any noise: 0 over the readings, beside 64 of the configured one."""
    monitor = at_rest(count=readings)
    assert monitor.noise == pytest.approx(SIGMA * sqrt(64.0 / (64.0 + readings - 3)))


def test_the_noise_is_averaged_over_256_readings():
    monitor = at_rest(count=195 + 100)
    assert monitor.noise == pytest.approx(SIGMA * sqrt(64.0 / 256.0 * (255.0 / 256.0) ** 100))


@pytest.mark.parametrize('sigma', [0.5 * SIGMA, SIGMA, 2.0 * SIGMA])
def test_the_noise_is_measured_at_rest_and_in_a_slow_motion(sigma):
    for speed in (0.0, 0.2):
        monitor = joint(threshold=50.0)
        noise = np.random.default_rng(3).normal(0.0, sigma, 10_000)
        measured = []
        for index, each in enumerate(noise.tolist()):
            monitor.jumped(each + speed * DT * index, DT, DT, 0.0)
            measured.append(monitor.noise)
        assert np.mean(measured[1000:]) == pytest.approx(sigma, rel=0.03)
        assert np.std(measured[1000:]) < 0.1 * sigma


def test_one_step_is_not_noise():
    """It counts for sixteen mean squares, however large it is."""
    for step in (0.1, 1.0):
        monitor = at_rest(threshold=1e4)
        before = monitor.noise
        monitor.jumped(step, DT, DT, 0.0)
        assert monitor.noise == pytest.approx(
            before * sqrt(1.0 + 15.0 / (64.0 + 50.0 + 1.0 - 3.0)))


def test_a_small_difference_counts_as_it_is():
    monitor = at_rest()
    before = monitor.noise
    monitor.jumped(SIGMA, DT, DT, 0.0)
    expected = before ** 2 + ((SIGMA / 2.1243) ** 2 - before ** 2) / 112.0
    assert monitor.noise == pytest.approx(sqrt(expected), rel=1e-9)


def test_the_noise_is_that_of_differences_of_innovations():
    """Which a steady lag does not change: the second of two equal innovations adds nothing."""
    monitor = at_rest()
    monitor.jumped(SIGMA, DT, DT, 0.0)
    before = monitor.noise
    # The filter predicts 0.8 sigma; its innovation is one sigma again.
    monitor.jumped(1.8 * SIGMA, DT, DT, 0.0)
    assert monitor.noise == pytest.approx(before * sqrt(1.0 - 1.0 / 113.0))


@pytest.mark.parametrize(('factor', 'learns'), [(0.99, True), (1.01, False)])
def test_noise_is_measured_where_the_joint_is_slow(factor, learns):
    """Where it moves less in a period than three sigmas and a count."""
    monitor = joint(threshold=50.0)
    feed(monitor, [0.0, 1e-3 * SIGMA])
    step = factor * (3.0 + 1e-3) * SIGMA
    feed(monitor, [1e-3 * SIGMA + step * index for index in range(1, 60)])
    before = monitor.noise
    feed(monitor, [1e-3 * SIGMA + step * index for index in range(60, 70)])
    assert (monitor.noise < before) == learns


def test_noise_is_measured_again_some_time_after_a_fast_motion():
    """Turning points of a tremor are no rest: the fastest motion fades by 5 % a sample."""
    monitor, last = moving(8.0, 100, threshold=1e3)
    resolution = 8.0 * DT
    monitor.jumped(last, DT, DT, 0.0)
    feed(monitor, [last + 1e-6])
    assert resolution > 3.0 * SIGMA
    learnt = []
    for index in range(60):
        before = monitor.noise
        monitor.jumped(last + 1e-6 * (index % 2), DT, DT, 0.0)
        learnt.append(monitor.noise != before)
    first = learnt.index(True)
    assert all(learnt[first:])
    expected = np.log(3.0 * SIGMA / resolution) / np.log(0.95)
    assert first == pytest.approx(expected, abs=8)


# Repeated readings --------------------------------------------------------------------------

def learnt(count=2500, sigma=SIGMA, resolution=COUNT, speed=0.0):
    """Return a monitor after readings of a slow joint, and the longest run of equal ones."""
    monitor = joint(sigma=sigma, threshold=50.0)
    moved = np.arange(count) * speed * DT
    noise = np.random.default_rng(1).normal(0.0, sigma, count)
    readings = (np.round((noise + moved) / resolution) * resolution).tolist()
    feed(monitor, readings)
    longest = run = 0
    for before, after in zip(readings, readings[1:], strict=False):
        run = run + 1 if before == after else 0
        longest = max(longest, run)
    return monitor, longest


def test_equal_readings_are_counted():
    monitor = joint()
    feed(monitor, [0.1, 0.2, 0.2, 0.2])
    assert monitor.run == 2
    feed(monitor, [0.3])
    assert monitor.run == 0
    feed(monitor, [0.3])
    assert monitor.run == 1


def test_a_run_is_withheld_or_a_fault_by_the_longest_that_the_sensor_made():
    monitor, longest = learnt()
    assert longest >= 2
    assert monitor.withheld_run == 2 * longest + 4
    assert monitor.frozen_run == 4 * longest + 8


def test_a_longer_run_is_learnt_below_that_of_a_fault():
    monitor, longest = learnt()
    frozen = monitor.frozen_run
    feed(monitor, [9 * COUNT] * (frozen + 1))
    feed(monitor, [0.0])
    assert monitor.frozen_run == frozen
    feed(monitor, [9 * COUNT] * frozen)
    assert monitor.run == frozen - 1
    feed(monitor, [0.0])
    assert monitor.frozen_run == 4 * (frozen - 1) + 8
    assert monitor.withheld_run == 2 * (frozen - 1) + 4


def test_before_500_changes_in_slow_motion_repeats_mean_nothing():
    readings = noisy(1000)
    # The first two readings set the motion.
    changes = np.cumsum(np.diff(readings)[1:] != 0.0)
    last = 2 + int(np.flatnonzero(changes == 500)[0])
    monitor = joint(threshold=50.0)
    feed(monitor, readings[:last])
    assert (monitor.withheld_run, monitor.frozen_run) == (None, None)
    feed(monitor, readings[last:last + 1])
    assert monitor.withheld_run is not None
    assert monitor.frozen_run is not None


@pytest.mark.parametrize(('resolution', 'known'), [(1.2, True), (1.4, False)])
def test_of_a_quiet_encoder_repeats_mean_nothing(resolution, known):
    """The noise of readings at rest, quantisation included, has to be 0.8 counts."""
    monitor, _ = learnt(20_000, resolution=resolution * SIGMA)
    assert (monitor.noise > 0.8 * resolution * SIGMA) == known
    assert (monitor.frozen_run is not None) == known
    assert (monitor.withheld_run is not None) == known


@pytest.mark.parametrize(('speed', 'known'), [(0.15, True), (0.40, False)])
def test_repeats_of_a_moving_joint_are_rarer_and_teach_nothing(speed, known):
    """It is slow up to a quarter count in a period: 0.098 rad/s of 14 bits at 1 kHz."""
    monitor, _ = learnt(2500, speed=speed * COUNT / DT)
    assert (monitor.frozen_run is not None) == known


def test_the_resolution_is_the_smallest_difference_of_readings():
    """Learnt from one difference, it decides whether the noise is some counts."""
    monitor = joint(threshold=50.0)
    readings = noisy(2500, resolution=2.0 * SIGMA)
    feed(monitor, readings)
    assert monitor.frozen_run is None
    feed(monitor, [readings[-1] + 0.5 * SIGMA])
    assert monitor.frozen_run is not None


# Restart ------------------------------------------------------------------------------------

def test_reset_motion_lets_the_joint_be_anywhere_and_keeps_the_run():
    monitor = at_rest()
    monitor.jumped(0.2, DT, DT, 0.0)
    monitor.jumped(0.2, DT, DT, 0.0)
    monitor.reset_motion()
    assert (monitor.coasting, monitor.velocity, monitor.innovation) == (False, 0.0, 0.0)
    assert monitor.since == 0.0
    assert feed(monitor, [0.2, 0.2]) == [False, False]
    assert monitor.run == 3


def test_reset_motion_forgets_the_last_innovation():
    """The first difference behind it would be of two motions."""
    monitor = at_rest()
    monitor.jumped(SIGMA, DT, DT, 0.0)
    before = monitor.noise
    monitor.reset_motion()
    feed(monitor, [0.5, 0.5, 0.5])
    assert monitor.noise == before
    feed(monitor, [0.5])
    assert monitor.noise < before


def test_restart_forgets_the_run_and_keeps_what_was_learnt():
    monitor, _ = learnt()
    feed(monitor, [0.0] * 3)
    frozen, noise = monitor.frozen_run, monitor.noise
    monitor.restart()
    assert (monitor.run, monitor.frozen_run, monitor.noise) == (0, frozen, noise)
    assert not monitor.jumped(0.0, DT, DT, 0.0)
    assert monitor.run == 0
