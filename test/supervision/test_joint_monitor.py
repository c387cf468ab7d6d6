# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One joint by itself: its motion, what leaves it, slow encoders, noise, equal readings."""

from math import pi, radians

import numpy as np
import pytest
from rig import product_limits
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import complete
from spm_haptic_master.supervision.joint_monitor import (
    innovation_deviation,
    JointMonitor,
    lag,
    Step,
)
from spm_haptic_master.supervision.supervisor import make_supervisor

DT = 1e-3
SIGMA = radians(0.04)
LIMITS = product_limits()
# Samples before something happens, at which the joint has been followed for long.
ONSET = 400
# Noise (1 sigma, deg) and bits of the encoders.
ENCODERS = [(0.04, 14), (0.006, 14), (0.006, 17)]


def joint(sigma=SIGMA):
    return JointMonitor(
        sigma,
        LIMITS.threshold(),
        LIMITS.joint_acceleration,
        LIMITS.joint_speed,
    )


def encoder(angles, noise=0.04, bits=14, seed=1):
    """Return readings of angles, rad, noisy and quantised."""
    count = 2.0 * pi / 2**bits
    rng = np.random.default_rng(seed)
    noisy = angles + radians(noise) * rng.normal(size=len(angles))
    return (np.round(noisy / count) * count).tolist()


def times(count=ONSET + 200, dt=DT):
    """Return the times of samples, s, from the onset on."""
    return (np.arange(count) - ONSET) * dt


def follow(monitor, readings, dt=DT, period=DT):
    """Return what the monitor shows after each reading, by attribute."""
    names = 'away', 'step', 'returned', 'velocity', 'reading_age'
    rows = []
    for reading in readings:
        monitor.follow(reading, dt, period, 0.0)
        rows.append([getattr(monitor, name) for name in names])
    return dict(zip(names, np.array(rows, float).T, strict=True))


def runs(angles, noise, bits, seeds=8):
    """Return what monitors show of an encoder's readings with different noise."""
    found = []
    for seed in range(seeds):
        readings = encoder(angles, noise, bits, seed)
        found.append(follow(joint(radians(noise)), readings))
    return found


# Its motion ---------------------------------------------------------------------------------


@pytest.mark.parametrize(('noise', 'bits'), ENCODERS)
@pytest.mark.parametrize('dt', [2.5e-4, DT, 0.01])
def test_a_human_motion_is_followed(noise, bits, dt):
    """Up to 450 rad/s^2, beside a limit of 500."""
    time = times(2000, dt)
    for hertz, amplitude in ((0.1, 2.0), (2.0, 1.5), (8.0, 0.17)):
        angles = amplitude * np.sin(2.0 * pi * hertz * time)
        readings = encoder(angles, noise, bits)
        seen = follow(joint(radians(noise)), readings, dt, dt)
        assert not seen['away'].any()
        assert not seen['step'].any()


@pytest.mark.parametrize('periods', [1, 2, 5])
def test_an_innovation_is_in_standard_deviations_of_a_healthy_one(periods):
    """However long ago the last reading is, which every tenth one here is by some periods."""
    monitor = joint()
    found = []
    for index, reading in enumerate(encoder(np.zeros(20_000), bits=17)):
        is_tenth = index % 10 == 0
        waited = periods * DT if is_tenth else DT
        monitor.follow(reading, waited, DT, 0.0)
        if is_tenth:
            found.append(monitor.innovation)
    mean_square = np.mean(np.square(found[1:]))
    assert np.sqrt(mean_square) == pytest.approx(1.0, rel=0.07)
    monitor.follow(radians(4.0), DT, DT, 0.0)
    assert monitor.innovation == pytest.approx(100.0 / innovation_deviation(1.0), rel=0.05)


@pytest.mark.parametrize('periods', [1, 2, 4])
def test_the_lag_is_what_an_acceleration_moves_a_joint_off_its_prediction(periods):
    index = np.array([*range(100), 99 + periods])
    monitor = joint()
    angles = 0.5e-4 * index**2
    counts = np.diff(index, prepend=-1)
    for angle, count in zip(angles, counts, strict=True):
        monitor.follow(angle, count * DT, DT, 0.0)
    moved = monitor.innovation * innovation_deviation(max(periods, 1)) * monitor.readings.expected
    assert moved == pytest.approx(1e-4 * lag(periods), rel=1e-3)


def test_after_five_periods_without_a_reading_the_velocity_is_set_anew():
    for periods, forgotten in ((5, False), (6, True)):
        monitor = joint()
        for index in range(100):
            monitor.follow(0.002 * index, DT, DT, 0.0)
        monitor.follow(0.2, periods * DT, DT, 0.0)
        monitor.follow(0.198, DT, DT, 0.0)
        assert (monitor.velocity == pytest.approx(-2.0)) == forgotten


# What leaves it -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('readings', 'away'),
    [
        ((0.0, 1.3), False),
        ((0.0, 1.9), True),
        ((0.0, 0.0, 0.8), True),
    ],
)
def test_two_readings_set_the_motion_and_no_human_moves_faster_than_the_second(readings, away):
    """By the speed limit in a period, 1.15 deg, and noise."""
    seen = follow(joint(), np.radians(readings).tolist())
    assert bool(seen['away'][-1]) == away


def test_neither_staying_away_nor_a_motion_across_the_old_one_nor_another_jump_is_a_return():
    """It stays 10 deg off; or jumps by 2 and moves back slowly; or jumps by 20, then by -15."""
    time = times()
    has_jumped = time >= 0.0
    has_jumped_again = time >= 0.004
    stays = 2.0 * time + radians(10.0) * has_jumped
    across = 1.0 + (radians(2.0) - time) * has_jumped
    twice = radians(20.0) * has_jumped - radians(15.0) * has_jumped_again
    for angles in (stays, across, twice):
        for seen in runs(angles, 0.04, 14):
            assert not seen['returned'].any()
    for seen in runs(stays, 0.04, 14):
        # It is followed from there.
        assert seen['away'][ONSET]
        assert not seen['away'][-100:].any()
        assert seen['velocity'][-1] == pytest.approx(2.0, abs=1.0)


@pytest.mark.parametrize(
    ('noise', 'bits', 'size', 'speed', 'share'),
    [
        (0.04, 14, 0.8, 2.0, 0.9),
        (0.04, 14, 0.8, -3.0, 0.9),
        (0.006, 17, 0.7, 6.0, 0.9),
        # At rest, by less than the speed limit allows: it may repeat its readings.
        (0.04, 14, 1.0, 0.0, 0.8),
        (0.006, 14, 1.0, 0.0, 0.8),
    ],
)
def test_a_step_with_the_same_velocity_behind_it_is_certain_after_three_readings(
    noise, bits, size, speed, share
):
    angles = speed * times() + radians(size) * (times() >= 0.0)
    found = []
    for seen in runs(angles, noise, bits, 20):
        first, second, third = seen['step'][ONSET : ONSET + 3]
        # One at rest may repeat its readings: then it is not suspected before.
        is_suspected = first == second == Step.SUSPECTED
        found.append(third == Step.CERTAIN and (is_suspected or not speed))
    assert np.mean(found) >= share


# Slower encoders than the bus -----------------------------------------------------------------


def slow(angles, every):
    """Return readings of an encoder that has a new one every few samples."""
    readings = encoder(angles)
    return [readings[index - index % every] for index in range(len(readings))]


def coming_to(speed):
    """Return angles of a joint that comes to a speed, rad/s, within 0.2 s before the onset."""
    begin = np.clip(times() + 0.3, 0.0, 0.2)
    return speed * (begin**2 / 0.4 + np.maximum(times() + 0.1, 0.0))


@pytest.mark.parametrize('every', [1, 2, 3, 4])
def test_a_slow_encoder_is_on_its_motion_and_the_age_of_its_reading_is_known(every):
    readings = slow(coming_to(3.0), every)
    seen = follow(joint(), readings)
    assert not seen['away'].any()
    assert seen['velocity'][ONSET:] == pytest.approx(3.0, abs=1.0)
    expected = np.arange(ONSET, ONSET + 200) % every * DT
    assert seen['reading_age'][ONSET:] == pytest.approx(expected)
    if every in (2, 4):
        # One that stops is at rest where it was.
        before = readings[: ONSET + 1]
        seen = follow(joint(), before + 50 * [readings[ONSET]])
        assert not seen['away'].any()
        assert seen['velocity'][-1] == 0.0
        assert seen['reading_age'][-1] == 0.0


@pytest.mark.parametrize(
    ('noise', 'speed'),
    [
        (0.02, 0.0),
        (0.04, 0.2),
        (0.08, 0.2),
    ],
)
def test_the_noise_is_measured_at_rest_and_in_a_slow_motion(noise, speed):
    monitor = joint(radians(0.08))
    measured = []
    for reading in encoder(speed * times(6000), noise, bits=17):
        monitor.follow(reading, DT, DT, 0.0)
        measured.append(monitor.readings.noise)
    later = measured[2000:]
    assert np.mean(later) == pytest.approx(radians(noise), rel=0.04)
    assert np.std(later) < 0.1 * radians(noise)


def test_equal_readings_mean_something_of_a_noisy_sensor_only():
    """A quiet one rests on one count, a slow encoder repeats its readings."""
    monitor = joint()
    # At the angle that is farthest from its neighbours.
    for reading in encoder(0.0 * times(10_000)):
        monitor.follow(reading, DT, DT, 0.0)
        assert monitor.readings.repeats < 20
    assert monitor.readings.repeats_are_rare
    follow(monitor, [reading + radians(0.1)] * 31)
    assert monitor.readings.repeats == 30
    assert monitor.readings.repeats_are_rare


AT_REST = np.zeros(3000)


@pytest.mark.parametrize(
    'readings',
    [
        encoder(AT_REST, 0.006),
        encoder(AT_REST, 0.012),
        encoder(AT_REST, 0.03),
        encoder(AT_REST, 0.1, bits=12),
        slow(coming_to(3.0), 4),
    ],
    ids=['0.006', '0.012', '0.03', 'coarse', 'slow'],
)
def test_equal_readings_of_a_quiet_or_slow_encoder_mean_nothing(readings):
    monitor = joint()
    follow(monitor, readings)
    assert not monitor.readings.repeats_are_rare


@pytest.mark.parametrize(('jitter', 'away'), [(0.0, True), (0.001, False)])
def test_a_fast_joint_may_be_off_by_what_the_jitter_of_the_stamps_explains(jitter, away):
    """At 3 rad/s a stamp that is off by 1 ms is 0.17 deg, four times the noise."""
    supervisor = make_supervisor(complete(SUPERVISION_SETTINGS, {}))
    place = np.array([0.5, 0.4, 0.3, 0.2])
    velocity = 3.0
    period = 0.001
    for number in range(100):
        angles = tuple((place + velocity * period * number).tolist())
        supervisor.joints.follow(angles, period, period, 0.0, ())
    ahead = tuple((place + velocity * (period * 100 + 0.003)).tolist())
    found, _ = supervisor.joints.follow(ahead, period, period, jitter, ())
    assert found == away
