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


@pytest.mark.slow
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


# The stamps of a rig count from 1970: a float does not resolve them.
@pytest.mark.parametrize('origin', [0, 1_700_000_000_123_456_789])
def test_slope_of_what_is_in_the_window(origin):
    # Rotation vectors that are small and not on a line; the first stamp is just outside the
    # window, the second on its edge.
    rng, velocity = np.random.default_rng(71), AngularVelocity(WINDOW)
    stamps = np.array([-1, 0, 1_000_000, 5_000_000, 6_500_000, 7_000_000, 13_000_000, 20_000_000])
    vectors = 1e-4 * rng.normal(size=(len(stamps), 3))
    vectors[-1] = 0.0
    for stamp, vector in zip(stamps.tolist(), vectors, strict=True):
        velocity.add(origin + stamp, (*(0.5 * vector).tolist(), 1.0))
    slope = np.polyfit(1e-9 * stamps[1:], vectors[1:], 1)[0]
    np.testing.assert_allclose(velocity.value(), slope, rtol=1e-9)
