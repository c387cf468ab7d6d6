# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angular velocity from orientations, held against a motion whose velocity is known."""

import numpy as np
import pytest

from spm_haptic_master.kinematics import matrix_from_zxz, quaternion_from_matrix
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity

WINDOW = 20_000_000
PERIOD = 1_000_000


def turn(vector):
    """Return the rotation by a rotation vector (Rodrigues)."""
    angle = np.linalg.norm(vector)
    x, y, z = vector / angle if angle else vector
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross


def play(omega, count, noise=0.0, seed=0):
    """Return a filled window of a turn at constant angular velocity, in the base frame."""
    rng = np.random.default_rng(seed)
    start = matrix_from_zxz(0.3, 0.4, 0.5)
    velocity, last = AngularVelocity(WINDOW), None
    for step in range(count):
        rotation = turn(rng.normal(0.0, noise, 3)) @ turn(omega * step * PERIOD * 1e-9) @ start
        q = quaternion_from_matrix(rotation)
        last = q if last is None or q @ last >= 0.0 else -q
        velocity.add(step * PERIOD, tuple(map(float, last)))
    return velocity


@pytest.mark.parametrize('omega', [[1.0, 0.0, 0.0], [0.0, -2.0, 0.0], [1.0, -2.0, 0.5]])
def test_constant_turn_in_the_base_frame(omega):
    got = play(np.array(omega), 60).value()
    np.testing.assert_allclose(got, omega, atol=2e-3)


def test_nothing_before_half_a_window():
    assert AngularVelocity(WINDOW).value() is None
    assert play(np.ones(3), 10).value() is None
    assert play(np.ones(3), 11).value() is not None


def test_noise_is_that_of_a_straight_line():
    sigma = np.radians(0.04)
    at_rest = np.array([play(np.zeros(3), 40, sigma, seed).value() for seed in range(400)])
    # 21 samples lie in a window of 20 ms: the slope's deviation is sigma / sqrt(sum of t^2).
    times = (np.arange(21) - 10.0) * PERIOD * 1e-9
    expected = sigma / np.sqrt(np.sum(times ** 2))
    assert np.std(at_rest) == pytest.approx(expected, rel=0.06)
