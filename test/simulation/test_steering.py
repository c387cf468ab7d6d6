# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A steered simulation: smooth, at the pose in the end, and back on its trajectory."""

from math import pi, radians

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import matrix_from_zxz, workspace_pose
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.noisy_motion import make_motion
from spm_haptic_master.simulation.steering import PHI_LIMITS, Steering, TILT_LIMIT

STEP = 0.001
# Fastest turn of a hand (rad/s) that a steered device may have.
FASTEST = 3.0


def turned(one, other):
    """Return the angles between two batches of rotations, rad."""
    trace = np.einsum('...ij,...ij', one, other)
    return np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))


def matrices(poses):
    return matrix_from_zxz(*np.array(poses).T)


@pytest.mark.parametrize(
    'trajectory',
    [
        trajectories.fig9,
        trajectories.perturbed,
        trajectories.sweep(radians(20.0)),
        trajectories.fixed(radians(140.0), radians(50.0), radians(370.0)),
    ],
)
def test_it_goes_to_the_pose_without_a_jump_and_comes_back(trajectory):
    steering = Steering(trajectory)
    times = np.arange(0.0, 20.0, STEP)
    poses = []
    for t in times:
        if abs(t - 3.0) < 0.5 * STEP:
            steering.steer(radians(15.0), radians(80.0), radians(60.0))
        if abs(t - 3.4) < 0.5 * STEP:
            steering.steer(radians(20.0), radians(-100.0), radians(-40.0))
        if abs(t - 8.0) < 0.5 * STEP:
            steering.release()
        poses.append(steering(t))
    found = matrices(poses)
    speed = turned(found[1:], found[:-1]) / STEP
    assert speed.max() < FASTEST
    # Neither does the velocity jump: 1 ms changes it by little.
    assert np.abs(np.diff(speed[10:])).max() < 0.1
    there = workspace_pose(radians(20.0), radians(-100.0), radians(-40.0))
    assert turned(found[round(7.9 / STEP)], there) < 1e-4
    own = matrices([trajectory(t) for t in times[-100:]])
    assert np.abs(found[-100:] - own).max() < 1e-9
    # A sensor that is late asks for a time before the latest one.
    steering.steer(0.0, 0.0, radians(20.0))
    now, before = matrices([steering(times[-1] + STEP), steering(times[-1])])
    assert turned(now, before) < FASTEST * STEP


@pytest.mark.parametrize(
    ('pose', 'word'),
    [
        ((TILT_LIMIT + 0.01, 0.0, 0.0), 'tilt'),
        ((-0.1, 0.0, 0.0), 'tilt'),
        ((0.1, 0.0, PHI_LIMITS[1] + 0.01), 'phi'),
        ((float('nan'), 0.0, 0.0), 'tilt'),
        ((0.1, float('inf'), 0.0), 'azimuth'),
    ],
)
def test_a_pose_beyond_the_limits_is_refused(pose, word):
    steering = Steering(trajectories.fig9)
    with pytest.raises(InputError, match=word):
        steering.steer(*pose)
    assert steering(1.0) == trajectories.fig9(1.0)


def test_every_pose_that_can_be_steered_to_is_within_reach():
    motion = make_motion(values('sim'))
    for k in range(60):
        tilt = TILT_LIMIT
        azimuth = 2.0 * pi * 7.0 * k / 20.0
        phi = PHI_LIMITS[k % 2]
        motion.steering.steer(tilt, azimuth, phi)
        for t in np.arange(3.0 * k, 3.0 * k + 3.0, 0.03):
            motion.joints(t)  # raises UnreachableError
        pose = workspace_pose(tilt, azimuth, phi)
        assert turned(matrices([motion.steering(t)]), pose[None]) < 1e-3
