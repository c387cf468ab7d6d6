# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three encoders alone: right clear of the singularity, lost at it."""

from math import degrees, radians, sin

import numpy as np
import pytest
from spm_haptic_master.description.three_encoders import RESULT_TIMEOUT, ThreeEncoders
from spm_haptic_master.kinematics import dexterity, Geometry, mechanism_angles, workspace_pose
from spm_haptic_master.kinematics.mode_tracking import continue_mode
from spm_haptic_master.kinematics.rotations import rotation_from_quaternion

# Time between two poses and two readings (ns), and the noise of an encoder (rad).
POSE_PERIOD, READING_PERIOD = 16_666_667, 50_000_000
NOISE = radians(0.04)


def angles_at(t, motion):
    return mechanism_angles(tuple(workspace_pose(*motion(t)).ravel().tolist()), Geometry())


def errors(motion, seconds, noise=NOISE, offset=0.0, geometry=None):
    """Return the error, deg, at each reading along a motion: tilt, azimuth, phi (rad) at t (s)."""
    rng, three = np.random.default_rng(1), ThreeEncoders(geometry or Geometry())
    found, due = [], 0
    for stamp in range(0, round(1e9 * seconds), POSE_PERIOD):
        t = 1e-9 * stamp
        # The readings are of another time than the poses.
        while due <= stamp:
            truth = angles_at(1e-9 * due, motion)
            th1 = np.array([truth[0], truth[3], truth[6]])
            three.add_readings(due, th1 + offset + noise * rng.standard_normal(3))
            due += READING_PERIOD
            break
        three.add_pose(stamp, angles_at(t, motion))
        eta = float(dexterity(workspace_pose(*motion(t)), Geometry()))
        three.solve(eta)
        if three.error is not None:
            found.append((t, eta, degrees(three.error)))
    return np.array(found)


def cross(t):
    """Turn through the singularity at phi = 49.36 deg and back, at the centre."""
    return 0.0, 0.0, radians(45.0 - 20.0 * np.cos(2.0 * np.pi * t / 12.0))


def test_far_from_the_singularity_three_are_as_good_as_four():
    """While the device moves by up to 1 rad/s: readings are compared with poses of their time."""
    found = errors(lambda t: (radians(8.0), 0.3 * t, radians(0.5 * 20.0 * sin(3.0 * t))), 4.0)
    assert len(found) > 150
    assert found[:, 1].min() > 0.1
    assert found[:, 2].max() < 0.5


def test_at_the_singularity_three_are_lost_and_clear_of_it_they_are_back():
    found = errors(cross, 24.0)
    near, clear = found[found[:, 1] < 0.03], found[found[:, 1] > 0.12]
    assert len(near) > 50 and len(clear) > 50
    assert near[:, 2].max() > 3.0
    assert clear[:, 2].max() < 1.0


def test_without_noise_they_are_exact_but_at_the_singularity():
    found = errors(lambda t: (radians(5.0), 0.2, radians(10.0 + t)), 3.0, noise=0.0)
    # What remains is the pose between two poses, by a straight line.
    assert found[:, 2].max() < 1e-3


def test_readings_that_no_longer_come_leave_no_ghost():
    three = ThreeEncoders(Geometry())

    def still(t):
        return 0.05, 0.3, 0.2

    angles = angles_at(0.0, still)
    for stamp in (0, 100):
        three.add_pose(stamp, angles)
    three.add_readings(50, (angles[0], angles[3], angles[6]))
    three.solve(0.2)
    assert three.error == pytest.approx(0.0, abs=1e-6)
    three.add_pose(RESULT_TIMEOUT - 1, angles)
    assert three.error is not None
    three.add_pose(RESULT_TIMEOUT + 100, angles)
    assert three.error is None


def test_a_reading_without_a_number_is_none():
    three = ThreeEncoders(Geometry())
    angles = angles_at(0.0, lambda t: (0.05, 0.3, 0.2))
    for stamp in (0, 100):
        three.add_pose(stamp, angles)
    three.add_readings(50, (float('nan'), 0.0, 0.0))
    three.solve(0.2)
    assert three.error is None


def test_a_clock_that_is_set_back_begins_anew():
    three = ThreeEncoders(Geometry())
    angles = angles_at(0.0, lambda t: (0.05, 0.3, 0.2))
    th1 = angles[0], angles[3], angles[6]
    for begin in (10_000, 0):
        three.add_readings(begin + 50, th1)
        for stamp in (begin, begin + 100):
            three.add_pose(stamp, angles)
        three.turn = None
        three.solve(0.2)
        assert three.turn is not None


@pytest.mark.parametrize('phi', [-20.0, 10.0, 40.0, 60.0])
def test_the_continued_mode_closes_all_legs(phi):
    rotation = workspace_pose(radians(7.0), 1.0, radians(phi))
    angles = mechanism_angles(tuple(rotation.ravel().tolist()), Geometry())
    th1 = angles[0], angles[3], angles[6]
    mode = continue_mode(th1, angles[1] + 0.01, angles[2] - 0.01)
    np.testing.assert_allclose(
        np.reshape(rotation_from_quaternion(*mode.quaternion), (3, 3)), rotation, atol=1e-9)
