# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The jaw: nothing jumps, and its offset to the gripper shrinks to none."""

import numpy as np
import pytest
from spm_haptic_master.teleoperation.jaw import FollowingJaw

MS = 1_000_000


@pytest.mark.parametrize(
    ('gripper', 'jaw'),
    [
        (0.2, 0.6),
        (0.6, 0.2),
        (0.3, 0.3),
    ],
)
def test_the_jaw_starts_where_it_is_and_meets_the_gripper(gripper, jaw):
    following = FollowingJaw(0.5, gripper, jaw, 0)
    angles = [following.advance(gripper, 5 * MS * step) for step in range(200)]
    assert angles[0] == jaw
    assert np.max(np.abs(np.diff(angles))) <= 0.5 * 0.005 + 1e-12
    # 0.4 rad at 0.5 rad/s.
    assert angles[159] != pytest.approx(gripper) or jaw == gripper
    assert angles[161:] == pytest.approx([gripper] * 39)


def test_the_jaw_moves_with_the_gripper_meanwhile():
    following = FollowingJaw(0.5, 0.0, 0.2, 0)
    assert following.advance(0.1, 100 * MS) == pytest.approx(0.1 + 0.2 - 0.05)


def test_a_stamp_that_is_not_newer_shrinks_nothing_and_its_time_counts_once():
    following = FollowingJaw(0.5, 0.0, 0.2, 0)
    assert following.advance(0.0, 100 * MS) == pytest.approx(0.15)
    assert following.advance(0.0, 40 * MS) == pytest.approx(0.15)
    assert following.advance(0.0, 100 * MS) == pytest.approx(0.15)
    assert following.advance(0.0, 120 * MS) == pytest.approx(0.14)
