# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the readings of one encoder show by themselves: resolution, repeats and noise."""

from math import hypot, isnan, nan, pi, sqrt

import pytest
from spm_haptic_master.supervision.joint_readings import DIFFERENCE, JointReadings

SIGMA = 2e-3
# The resolution before a finer one is seen: of 12 bits.
COARSEST = 2.0 * pi / 4096.0


def added(*angles, sigma=SIGMA):
    """Return the readings of a sensor after some angles, rad."""
    readings = JointReadings(sigma)
    for angle in angles:
        readings.add(angle)
    return readings


def alternating(count, size=1e-3, sigma=SIGMA):
    """Return the readings of a sensor that goes up and down between two counts, rad."""
    return added(*[size * (index % 2) for index in range(count)], sigma=sigma)


def test_a_change_is_against_the_reading_before():
    readings = JointReadings(SIGMA)
    assert isnan(readings.latest)
    assert isnan(readings.add(0.5))
    assert readings.add(0.75) == 0.25
    assert readings.add(0.5) == -0.25
    assert readings.latest == 0.5


def test_equal_readings_are_counted_until_another_comes():
    readings = JointReadings(SIGMA)
    assert readings.repeats == 0
    counted = []
    for angle in (1.0, 1.0, 1.0, 2.0, 2.0, 1.0):
        readings.add(angle)
        counted.append(readings.repeats)
    assert counted == [0, 1, 2, 0, 1, 0]


@pytest.mark.parametrize(
    ('angles', 'resolution'),
    [
        ((), COARSEST),
        ((0.0,), COARSEST),
        ((0.0, 0.1), COARSEST),
        ((0.0, 1e-4), 1e-4),
        ((0.0, -1e-4), 1e-4),
        ((0.0, -0.1), COARSEST),
        ((0.0, 1e-4, 3e-4, 3e-4), 1e-4),
    ],
)
def test_the_resolution_is_the_smallest_change_of_twelve_bits_at_most(angles, resolution):
    readings = added(*angles)
    assert readings.resolution == pytest.approx(resolution)
    # A healthy reading deviates by its noise and by an even distribution over a count.
    assert readings.expected == pytest.approx(hypot(SIGMA, resolution / sqrt(12.0)))


def test_a_joint_is_slow_within_two_deviations_of_a_sample_or_one_count():
    readings = added(sigma=1e-9)
    assert readings.slow_step == pytest.approx(COARSEST)
    readings = added(sigma=COARSEST)
    assert readings.slow_step == pytest.approx(2.0 * COARSEST)
    readings.allow(0.1)
    assert readings.allowed == 0.1
    assert readings.slow_step == pytest.approx(0.2)
    # What is allowed outlasts a finer resolution, and is not what a healthy reading has.
    readings.add(0.0)
    readings.add(1e-6)
    assert readings.slow_step == pytest.approx(0.2)
    assert readings.expected == pytest.approx(COARSEST)


@pytest.mark.parametrize(
    ('count', 'sigma', 'rare'),
    [
        (501, 2e-3, False),
        (502, 2e-3, True),
        (900, 2e-3, True),
        # With a resolution of 1e-3 rad equal readings are not rare.
        (900, 1.51e-3, True),
        (900, 1.49e-3, False),
    ],
)
def test_repeats_are_rare_once_five_hundred_reversals_show_noise(count, sigma, rare):
    """The first changes direction at the third reading."""
    assert alternating(count, sigma=sigma).repeats_are_rare == rare


def test_neither_a_motion_nor_a_repeat_is_a_reversal():
    assert not added(*[1e-3 * index for index in range(1000)]).repeats_are_rare
    assert not added(*[1e-3 * (index // 2 % 2) for index in range(1002)]).repeats_are_rare
    assert added(*[1e-3 * (index // 2 % 2) for index in range(1003)]).repeats_are_rare


def test_an_encoder_is_slow_once_four_tenths_of_a_moving_joints_readings_repeat():
    """The share is averaged over eight: after three 0.33, after four 0.41."""
    readings = alternating(600)
    for repeats, is_slow in ((3, False), (1, True), (100, True)):
        for _ in range(repeats):
            readings.note_moving(is_repeated=True)
        assert readings.is_slower_than_bus == is_slow
        assert readings.repeats_are_rare != is_slow
    for others, is_slow in ((6, True), (1, False)):
        for _ in range(others):
            readings.note_moving(is_repeated=False)
        assert readings.is_slower_than_bus == is_slow


@pytest.mark.parametrize(
    ('before', 'factor', 'square', 'averaged'),
    [
        # The configured noise counts for 64 differences at the start, then up to 256 count.
        (0, 2.0, 4.0, 65),
        (0, -2.0, 4.0, 65),
        (0, 0.0, 0.0, 65),
        (1, 2.0, 4.0, 66),
        (191, 2.0, 4.0, 256),
        (400, 2.0, 4.0, 256),
        # One step is not noise: a square counts for 16 at most.
        (0, 3.9, 15.21, 65),
        (0, 4.1, 16.0, 65),
        (0, 100.0, 16.0, 65),
    ],
)
def test_the_noise_is_the_mean_square_of_differences(before, factor, square, averaged):
    readings = JointReadings(SIGMA)
    assert readings.noise == pytest.approx(SIGMA)
    for _ in range(before):
        readings.note_noise(DIFFERENCE * SIGMA)
    readings.note_noise(factor * DIFFERENCE * SIGMA)
    assert readings.noise == pytest.approx(SIGMA * sqrt(1.0 + (square - 1.0) / averaged))


def test_without_an_innovation_before_there_is_no_difference_to_average():
    readings = JointReadings(SIGMA)
    for _ in range(100):
        readings.note_noise(nan)
    assert readings.noise == pytest.approx(SIGMA)
    readings.note_noise(2.0 * DIFFERENCE * SIGMA)
    assert readings.noise == pytest.approx(SIGMA * sqrt(1.0 + 3.0 / 65.0))
