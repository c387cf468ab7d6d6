# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The twist for a slave that is driven by rates: it ends at zero, and stops."""

import numpy as np
import pytest
from spm_haptic_master.teleoperation.command import Motion
from spm_haptic_master.teleoperation.fading_twist import FadingTwist

# Period of the command (s).
DT = 0.005


def end_of(twist):
    """Let a twist fade; return its motions."""
    motions = []
    for _ in range(100):
        motion = twist.fade(DT)
        if motion is None:
            return motions
        motions.append(motion)
    raise AssertionError('the twist does not end')


def test_a_twist_ends_at_zero_and_stops():
    twist = FadingTwist(
        acceleration=100.0,
        sliding_acceleration=1.0,
        zeros=3,
    )
    assert twist.fade(DT) is None
    assert twist.follow(Motion((0.0, 0.2, 0.0)), DT).angular == (0.0, 0.2, 0.0)
    for _ in range(2):
        # What is too far from the last one is met in steps.
        given = twist.follow(Motion((0.0, 1.2, 0.0)), DT)
    assert given.angular == pytest.approx((0.0, 1.2, 0.0))
    speeds = [np.linalg.norm(motion.angular) for motion in end_of(twist)]
    np.testing.assert_allclose(speeds, [0.7, 0.2, 0.0, 0.0, 0.0], atol=1e-12)
    assert twist.fade(DT) is None


def test_a_twist_ends_soon_however_small_the_acceleration():
    twist = FadingTwist(
        acceleration=2.0,
        sliding_acceleration=1.0,
        zeros=1,
    )
    while twist.follow(Motion((0.0, 0.0, 3.0)), 0.1).angular[2] < 3.0:
        pass
    speeds = [motion.angular[2] for motion in end_of(twist)]
    assert len(speeds) * DT <= 0.1 + 1.01 * DT
    assert sum(speeds) * DT < 0.16


def test_the_tip_of_a_pivoting_slave_fades_along_the_same_screw():
    """Turning and sliding shrink together: the shaft goes on passing through its trocar."""
    turning = (0.3, 0.4, 0.0)
    lever = (0.0, 0.0, 0.1)
    sliding = (0.0, 0.0, 0.05)
    twist = FadingTwist(
        acceleration=10.0,
        sliding_acceleration=1.0,
        zeros=2,
    )
    for _ in range(20):
        given = twist.follow(Motion(turning, lever, sliding), DT)
    np.testing.assert_allclose(given.linear, np.cross(turning, lever) + sliding, atol=1e-15)
    motions = end_of(twist)
    shares = [motion.angular[0] / turning[0] for motion in motions]
    assert 0.8 < shares[0] < 1.0
    assert shares[-2:] == [0.0, 0.0]
    for share, motion in zip(shares, motions, strict=True):
        np.testing.assert_allclose(motion.linear, share * np.array(given.linear), atol=1e-15)


def moving(speed=1.0, sliding=0.0, zeros=3):
    """Return a twist of 100 rad/s^2 and 2 m/s^2 that has reached some speeds, rad/s and m/s."""
    twist = FadingTwist(
        acceleration=100.0,
        sliding_acceleration=2.0,
        zeros=zeros,
    )
    twist.follow(Motion((0.0, speed, 0.0), sliding=(sliding, 0.0, 0.0)), 1.0)
    return twist


def test_a_fade_by_the_acceleration_ends_with_its_zeros_and_no_more():
    """1 rad/s by 100 rad/s^2: half of it after one period, nothing after two."""
    speeds = [motion.angular[1] for motion in end_of(moving())]
    assert speeds == pytest.approx([0.5, 0.0, 0.0, 0.0])


def test_sliding_has_its_own_acceleration():
    """0.1 m/s by 2 m/s^2 takes 50 ms; each command speeds it up by 10 mm/s at most."""
    twist = moving(0.0, 0.1)
    speeds = [motion.sliding[0] for motion in end_of(twist)]
    assert speeds[:10] == pytest.approx([0.09 - 0.01 * step for step in range(10)])
    given = twist.follow(Motion(sliding=(0.1, 0.0, 0.0)), DT)
    assert given.sliding == pytest.approx((0.01, 0.0, 0.0))


def test_a_command_ends_the_fade_and_the_next_one_is_whole():
    twist = moving()
    assert twist.fade(DT).angular[1] == pytest.approx(0.5)
    assert twist.follow(Motion((0.0, 0.9, 0.0)), DT).angular[1] == pytest.approx(0.9)
    assert [motion.angular[1] for motion in end_of(twist)] == pytest.approx([0.4, 0.0, 0.0, 0.0])


def test_after_a_stop_there_is_no_motion_and_the_next_begins_from_rest():
    twist = moving(3.0)
    twist.stop()
    assert twist.fade(DT) is None
    given = twist.follow(Motion((0.0, 3.0, 0.0)), DT)
    assert given.angular == pytest.approx((0.0, 0.5, 0.0))
