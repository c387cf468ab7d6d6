# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulated motions: the same in every version, and within reach of the manipulator."""

from math import radians

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.simulation import trajectories


@pytest.mark.parametrize(
    ('trajectory', 'pose_deg'),
    [
        (trajectories.fig9, (135.0, 54.7356103, 51.6131187)),
        (trajectories.perturbed, (135.0, 54.7356103, 48.1798073)),
        (trajectories.sweep(0.3), (131.528985, 67.0370412, 36.2699783)),
        (trajectories.tour, (132.1170512, 57.0731222, 26.3799331)),
        (trajectories.hand, (139.2475205, 50.9382805, 59.0843245)),
        (trajectories.fixed(0.1, 0.2, 0.3), (5.729578, 11.4591559, 17.1887339)),
    ],
)
def test_a_motion_is_that_of_recordings_and_figures(trajectory, pose_deg):
    assert np.degrees(trajectory(2.3)) == pytest.approx(pose_deg, abs=1e-6)


@pytest.mark.parametrize(
    ('trajectory', 'seconds', 'tilt_deg', 'turns_deg'),
    [
        (trajectories.sweep(radians(26.0)), 7.0 * 11.0 * 17.0, 26.0, (10.0, 40.0)),
        (trajectories.tour, 13.0 * 19.0 * 16.0, 12.0, (18.0, 62.0)),
    ],
)
def test_a_motion_stays_within_reach_over_whole_periods(trajectory, seconds, tilt_deg, turns_deg):
    poses = np.array([trajectory(t) for t in np.arange(0.0, seconds, 0.1)])
    rotations = kinematics.matrix_from_zxz(*poses.T)
    joints = kinematics.inverse(rotations)
    assert np.isfinite(joints.theta1).all()
    assert np.isfinite(joints.theta3a).all()
    cosines = rotations[:, :, 2].sum(axis=1) / np.sqrt(3.0)
    tilt = np.degrees(np.arccos(np.clip(cosines, -1.0, 1.0)))
    assert tilt.max() == pytest.approx(tilt_deg, abs=0.01)
    turns = np.degrees([poses[:, 2].min(), poses[:, 2].max()])
    assert turns == pytest.approx(turns_deg, abs=0.1)


def test_the_tour_begins_clear_of_the_singularity_and_crosses_it_within_ten_seconds():
    angles = [trajectories.tour(t) for t in np.arange(0.0, 10.0, 0.2)]
    rotations = kinematics.matrix_from_zxz(*np.transpose(angles))
    assert kinematics.dexterity(rotations[:10]).min() > 0.1
    signs = np.sign(kinematics.parallel_determinant(rotations))
    assert signs.min() < 0.0 < signs.max()


def test_arms_turn_one_motor_at_a_time_and_the_passive_joint_of_leg_a_moves_with_each():
    """What `can_scan --watch` shows then is the order of the joints."""
    for number in range(3):
        times = number * trajectories.ARM_TIME + np.arange(0.05, trajectories.ARM_TIME, 0.05)
        poses = np.array([trajectories.arms(t) for t in times])
        found = kinematics.inverse(kinematics.matrix_from_zxz(*poses.T))
        spans = np.degrees(np.ptp(np.unwrap(found.theta1, axis=0), axis=0))
        others = np.delete(spans, number)
        assert 14.5 < spans[number] < 15.5
        assert others.max() < 0.02
        assert np.degrees(np.ptp(np.unwrap(found.theta3a))) > 3.0
