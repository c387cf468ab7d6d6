# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Three encoders alone: right clear of the singularity, lost at it."""

from math import degrees, nan, pi, radians, sin

import numpy as np
import pytest
from spm_haptic_master import kinematics
from spm_haptic_master.description.three_encoders import ThreeEncoders

GEOMETRY = kinematics.Geometry()
# Time between two poses and two readings (ns), and the noise of an encoder (rad).
POSE_PERIOD = 16_666_667
READING_PERIOD = 50_000_000
NOISE = radians(0.04)


def angles_at(t, motion):
    pose = kinematics.workspace_pose(*motion(t))
    return kinematics.mechanism_angles(tuple(pose.ravel().tolist()), GEOMETRY)


def errors(motion, seconds):
    """Return time, dexterity and error, deg, along a motion: tilt, azimuth, phi (rad) at t (s)."""
    rng = np.random.default_rng(1)
    three = ThreeEncoders(GEOMETRY)
    found = []
    due = 0
    for stamp in range(0, round(1e9 * seconds), POSE_PERIOD):
        t = 1e-9 * stamp
        # The readings are of another time than the poses.
        if due <= stamp:
            th1 = np.array(angles_at(1e-9 * due, motion)[::3])
            noise = NOISE * rng.standard_normal(3)
            three.add_readings(due, th1 + noise)
            due += READING_PERIOD
        three.add_pose(stamp, angles_at(t, motion))
        pose = kinematics.workspace_pose(*motion(t))
        eta = float(kinematics.dexterity(pose, GEOMETRY))
        three.solve(eta)
        if three.error is not None:
            found.append((t, eta, degrees(three.error)))
    return np.array(found)


def test_three_are_as_good_as_four_clear_of_the_singularity_and_lost_at_it():
    """While the device moves by up to 1 rad/s: readings are compared with poses of their time."""

    def clear_of_it(t):
        return radians(8.0), 0.3 * t, radians(10.0 * sin(3.0 * t))

    def through_it(t):
        return 0.0, 0.0, radians(45.0 - 20.0 * np.cos(0.5 * pi * t))

    _, eta, error = errors(clear_of_it, 2.2).T
    assert len(error) > 80
    assert eta.min() > 0.1
    assert error.max() < 0.5
    _, eta, error = errors(through_it, 4.0).T
    near = error[eta < 0.03]
    clear = error[eta > 0.12]
    assert len(near) > 7
    assert len(clear) > 7
    assert near.max() > 3.0
    assert clear.max() < 1.0


@pytest.fixture
def still():
    """Give three encoders of a device at rest, its angles, and what feeds and solves them."""
    three = ThreeEncoders(GEOMETRY)
    angles = angles_at(0.0, lambda t: (0.05, 0.3, 0.2))

    def feed(begin, readings=angles[::3], offset=50):
        three.add_readings(begin + offset, readings)
        # The same pose, a turn further.
        for stamp, turn in ((begin, 0.0), (begin + 100, 2.0 * pi)):
            three.add_pose(stamp, [angle + turn for angle in angles])
        three.solve(0.2)
        return three.error

    return three, angles, feed


def test_its_orientation_has_the_three_angles_that_were_read(still):
    """Also where the pose at their time comes later than the next readings."""
    three, angles, feed = still
    read = np.array(angles[::3]) + [0.01, -0.008, 0.012]
    three.add_pose(-100, angles)
    three.add_readings(-50, read)
    three.add_readings(-40, (nan, 0.0, 0.0))
    three.solve(0.2)
    assert three.error is None
    three.add_pose(0, angles)
    three.solve(0.2)
    turn = kinematics.matrix_from_quaternion(three.turn)
    R = kinematics.workspace_pose(0.05, 0.3, 0.2) @ turn
    angle = np.arccos(0.5 * np.trace(turn) - 0.5)
    assert kinematics.inverse(R).theta1 == pytest.approx(read, abs=1e-9)
    assert three.error == pytest.approx(angle, abs=1e-9)


def test_readings_that_no_longer_come_leave_no_ghost(still):
    """A result is shown for half a second; a reading without a number is none."""
    three, angles, feed = still
    assert feed(-1000, (nan, 0.0, 0.0)) is None
    assert feed(0) == pytest.approx(0.0, abs=1e-6)
    for stamp, is_there in ((500_000_049, True), (500_000_050, False)):
        three.add_pose(stamp, angles)
        assert (three.error is not None) == is_there


def test_a_clock_that_is_set_back_or_stands_still_restarts(still):
    three, angles, feed = still
    # The readings are of the time of one of two poses.
    for begin, offset in ((10_000, 0), (0, 100)):
        three.turn = None
        assert feed(begin, offset=offset) == pytest.approx(0.0, abs=1e-6)
    # There is no time between the two.
    three.add_readings(100, angles[::3])
    three.add_pose(100, [angle + 2.0 * pi for angle in angles])
    three.solve(0.2)
    three.add_pose(200, angles)
    three.turn = None
    three.solve(0.2)
    assert three.error == pytest.approx(0.0, abs=1e-6)
