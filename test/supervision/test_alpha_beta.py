# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Variances and lag of the alpha-beta filter, beside the filter itself."""

import numpy as np
import pytest
from spm_haptic_master.supervision.joint_monitor import ALPHA, BETA, deviation, DIFFERENCE, lag

# Periods since the last reading.
PERIODS = [1.0, 2.0, 3.0, 7.0, 24.0]


def filtered(readings):
    """Return the innovations of readings a period apart, then position and velocity."""
    position = velocity = 0.0 * readings[0]
    innovations = []
    for reading in readings:
        innovation = reading - position - velocity
        position = position + velocity + ALPHA * innovation
        velocity = velocity + BETA * innovation
        innovations.append(innovation)
    return innovations, position, velocity


@pytest.mark.parametrize('periods', PERIODS)
def test_the_deviation_of_an_innovation_is_that_of_many_filters_of_noise(periods):
    rng = np.random.default_rng(5)
    _, position, velocity = filtered(rng.normal(size=(200, 40_000)))
    innovation = rng.normal(size=40_000) - position - periods * velocity
    assert deviation(periods) == pytest.approx(innovation.std(), rel=0.015)


def test_the_deviation_of_a_difference_is_that_of_two_innovations_in_a_row():
    innovations, _, _ = filtered(np.random.default_rng(6).normal(size=(200, 40_000)))
    assert pytest.approx((innovations[-1] - innovations[-2]).std(), rel=0.015) == DIFFERENCE


@pytest.mark.parametrize('periods', [*PERIODS, 4.5])
def test_the_lag_is_that_of_a_constant_acceleration_followed_for_long(periods):
    """Of 1 / T^2, without noise."""
    steps = np.arange(400.0)
    _, position, velocity = filtered(0.5 * steps**2)
    innovation = 0.5 * (steps[-1] + periods) ** 2 - position - periods * velocity
    assert lag(periods) == pytest.approx(innovation, rel=1e-6)
