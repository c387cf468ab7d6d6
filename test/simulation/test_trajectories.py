# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated motions: every pose within reach of the manipulator."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master.kinematics import (
    dexterity,
    inverse,
    matrix_from_zxz,
    parallel_determinant,
)
from spm_haptic_master.simulation import trajectories


@pytest.mark.parametrize('tilt_deg', [0.0, 13.0, 20.0, 26.0])
def test_the_sweep_stays_within_reach_over_whole_periods(tilt_deg):
    """All of 7 x 11 x 17 s; the largest tilt is the given one."""
    at = trajectories.sweep(radians(tilt_deg))
    poses = np.array([at(t) for t in np.arange(0.0, 1309.0, 0.05)])
    rotations = matrix_from_zxz(*poses.T)
    joints = inverse(rotations)
    assert np.isfinite(joints.theta1).all()
    assert np.isfinite(joints.theta3a).all()
    tilt = np.degrees(np.arccos(np.clip(rotations[:, :, 2].sum(axis=1) / np.sqrt(3.0), -1.0, 1.0)))
    assert tilt.max() == pytest.approx(tilt_deg, abs=0.01)
    assert np.degrees(poses[:, 2].min()) == pytest.approx(10.0, abs=0.1)
    assert np.degrees(poses[:, 2].max()) == pytest.approx(40.0, abs=0.1)


def test_the_tour_begins_clear_of_the_singularity_and_crosses_it_within_ten_seconds():
    times = np.arange(0.0, 13.0 * 19.0 * 16.0, 0.2)
    rotations = matrix_from_zxz(*np.array([trajectories.tour(t) for t in times]).T)
    assert np.isfinite(inverse(rotations).theta3a).all()
    determinants, eta = parallel_determinant(rotations), dexterity(rotations)
    assert eta[times < 2.0].min() > 0.1
    signs = np.sign(determinants[times < 10.0])
    assert signs.min() < 0.0 < signs.max()
