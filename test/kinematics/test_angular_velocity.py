# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Angular velocity from orientations, compared with motions of known velocity."""

from mechanism import turn, zxz
import numpy as np
import pytest
from spm_haptic_master.kinematics import quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import AngularVelocity

# Window of the slope and period of the samples (ns).
WINDOW = 20_000_000
PERIOD = 1_000_000
START = zxz(0.3, 0.4, 0.5)


def play(omega, count):
    """Return what a turn at constant angular velocity, in the base frame, gives."""
    velocity, last = AngularVelocity(WINDOW), np.zeros(4)
    for step in range(count):
        quaternion = quaternion_from_matrix(turn(omega * step * PERIOD * 1e-9) @ START)
        last = quaternion if quaternion @ last >= 0.0 else -quaternion
        velocity.add(step * PERIOD, tuple(last.tolist()))
    return velocity.value()


def test_a_constant_turn_in_the_base_frame_from_half_a_window_on():
    omega = np.array([1.0, -2.0, 0.5])
    for count in (60, 11):
        np.testing.assert_allclose(play(omega, count), omega, atol=2e-3)
    assert play(omega, 0) is None is play(omega, 10)


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
