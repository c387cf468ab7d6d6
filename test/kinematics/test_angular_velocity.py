# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angular velocity from orientations, compared with motions of known velocity."""

from mechanism import turn, zxz
import numpy as np
import pytest

from spm_haptic_master.kinematics import quaternion_from_matrix
from spm_haptic_master.kinematics.angular_velocity import AngularVelocity
from spm_haptic_master.kinematics.rotations import multiply_quaternions

# Window of the slope and period of the samples (ns).
WINDOW = 20_000_000
PERIOD = 1_000_000
START = zxz(0.3, 0.4, 0.5)


def play(omega, count, noise=0.0, rng=None):
    """Return a filled window of a turn at constant angular velocity, in the base frame."""
    rotations = [turn(omega * step * PERIOD * 1e-9) @ START for step in range(count)]
    quaternions = quaternion_from_matrix(rotations)
    if noise:
        tilt = np.ones((count, 4))
        tilt[:, :3] = 0.5 * rng.normal(0.0, noise, (count, 3))
        quaternions = np.transpose(multiply_quaternions(tilt.T, quaternions.T))
    velocity, last = AngularVelocity(WINDOW), quaternions[0]
    for step, quaternion in enumerate(quaternions):
        last = quaternion if quaternion @ last >= 0.0 else -quaternion
        velocity.add(step * PERIOD, tuple(last.tolist()))
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
    sigma, rng = np.radians(0.04), np.random.default_rng(70)
    at_rest = np.array([play(np.zeros(3), 21, sigma, rng).value() for _ in range(400)])
    # 21 samples are in a window of 20 ms: the slope's deviation is sigma / sqrt(sum of t^2).
    times = (np.arange(21) - 10.0) * PERIOD * 1e-9
    expected = sigma / np.sqrt(np.sum(times ** 2))
    np.testing.assert_allclose(np.std(at_rest, axis=0), expected, rtol=0.12)


def test_only_the_window_counts():
    # 1 rad/s, then at rest for longer than the window.
    velocity = AngularVelocity(WINDOW)
    for step in range(60):
        angle = min(step, 30) * PERIOD * 1e-9
        velocity.add(step * PERIOD, (0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)))
        if step == 40:
            # Half of the window in motion: the line through it still has a slope.
            assert 0.4 < velocity.value()[2] < 0.6
    np.testing.assert_allclose(velocity.value(), 0.0, atol=1e-12)


def test_uneven_stamps():
    omega, velocity = np.array([0.5, -1.0, 0.25]), AngularVelocity(WINDOW)
    for milliseconds in (0.0, 1.0, 5.0, 6.5, 7.0, 13.0, 14.0, 20.0):
        x, y, z = 0.5 * omega * milliseconds * 1e-3
        velocity.add(int(milliseconds * 1e6), (x, y, z, 1.0))
    np.testing.assert_allclose(velocity.value(), omega, rtol=1e-3)
