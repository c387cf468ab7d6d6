# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A steered simulation: smooth, at the pose in the end, and faults on request."""

from math import degrees, pi, radians, sin

from encoder_frames import values
import numpy as np
import pytest
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import matrix_from_zxz, workspace_pose
from spm_haptic_master.nodes.source_factory import make_source
from spm_haptic_master.simulation import trajectories
from spm_haptic_master.simulation.fault_injection import parse_switched
from spm_haptic_master.simulation.settings import make_motion
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


def test_until_it_is_steered_it_is_its_trajectory():
    steering = Steering(trajectories.fig9)
    assert [steering(t) for t in (0.0, 1.5, 0.2)] == [
        trajectories.fig9(t) for t in (0.0, 1.5, 0.2)]


@pytest.mark.parametrize('trajectory', [
    trajectories.fig9, trajectories.perturbed, trajectories.sweep(radians(20.0)),
    trajectories.fixed(radians(140.0), radians(50.0), radians(370.0))])
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
    now = steering(times[-1] + STEP)
    before = steering(times[-1])
    assert turned(matrices([now]), matrices([before]))[0] < FASTEST * STEP


@pytest.mark.parametrize(('pose', 'word'), [
    ((TILT_LIMIT + 0.01, 0.0, 0.0), 'tilt'), ((-0.1, 0.0, 0.0), 'tilt'),
    ((0.1, 0.0, PHI_LIMITS[1] + 0.01), 'phi'), ((float('nan'), 0.0, 0.0), 'tilt'),
    ((0.1, float('inf'), 0.0), 'azimuth')])
def test_a_pose_beyond_the_limits_is_refused(pose, word):
    steering = Steering(trajectories.fig9)
    with pytest.raises(InputError, match=word):
        steering.steer(*pose)
    assert steering(1.0) == trajectories.fig9(1.0)


def test_every_pose_that_can_be_steered_to_is_within_reach():
    motion = make_motion(values('sim'))
    for k in range(60):
        tilt, azimuth, phi = TILT_LIMIT, 2.0 * pi * 7.0 * k / 20.0, PHI_LIMITS[k % 2]
        motion.steering.steer(tilt, azimuth, phi)
        for t in np.arange(3.0 * k, 3.0 * k + 3.0, 0.03):
            motion.joints(t)  # raises UnreachableError
        pose = workspace_pose(tilt, azimuth, phi)
        assert turned(matrices([motion.steering(t)]), pose[None]) < 1e-3


def test_out_of_reach_it_waits():
    """With a mechanism that reaches less: no error ends the source."""
    source = make_source('sim', values('sim', sim__noise_deg=0.0, geometry__beta_deg=24.0))
    source.angles(0.0)
    source.steering.steer(TILT_LIMIT, 0.0, PHI_LIMITS[1])
    got = np.array([source.angles(t) for t in np.arange(0.0, 5.0, 0.01)])
    assert np.ptp(got[-100:], axis=0).max() == 0.0
    source.steering.release()
    got = np.array([source.angles(t) for t in np.arange(5.0, 9.0, 0.01)])
    assert np.ptp(got[-100:], axis=0).max() > 0.0


def read(source, count=20):
    return [sample for _ in range(count) if (sample := source.read(0.1)) is not None]


def test_faults_come_and_go():
    source = make_source('sim', values('sim', rate=500.0, sim__noise_deg=0.0,
                                       sim__trajectory='perturbed'))
    assert len(read(source)) == 20
    source.faults = (parse_switched('stuck:joint_1b'), parse_switched('offset:joint_3a=5'))
    faulty = read(source)
    assert len({sample.angles[1] for sample in faulty}) == 1
    assert len({sample.angles[0] for sample in faulty}) > 1
    source.faults = ()
    healthy = read(source, 1)[0]
    assert degrees(faulty[-1].angles[3] - healthy.angles[3]) == pytest.approx(5.0, abs=0.3)
    assert len({sample.angles[1] for sample in read(source)}) > 1
    source.faults = (parse_switched('dropout:joint_1a'),)
    assert read(source) == []
    assert source.fault == 'no answer of joint_1a'
    source.faults = ()
    assert source.fault is None
    assert len(read(source)) == 20


def test_an_offset_stays_within_a_turn():
    source = make_source('sim', values('sim', rate=500.0))
    source.faults = (parse_switched('offset:joint_1a=359'),)
    assert all(-pi <= angle <= pi for sample in read(source) for angle in sample.angles)
    assert sin(read(source, 1)[0].angles[0]) != 0.0


@pytest.mark.parametrize('text', [
    '', 'melt:joint_1a', 'stuck', 'stuck:joint_9', 'offset:joint_1a', 'offset:joint_1a=x',
    'offset:joint_1a=inf', 'stuck:joint_1a=3', 'stuck:joint_1a@2', 'stuck:joint_3b', 'silence'])
def test_a_fault_that_is_none_is_refused(text):
    with pytest.raises(InputError, match='fault'):
        parse_switched(text)
