# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An earlier calibration against readings: deviations, directions, and why it does not hold."""

from dataclasses import replace
from math import radians

import pytest
from spm_haptic_master.calibration.jig.jig_pose import Calibration, Station
from spm_haptic_master.calibration.jig.verification import check_joints, Direction
from spm_haptic_master.joints import JOINT_NAMES

# At joint angles 0 at both of its poses.
FIRST = Station((0.0, 0.0, 0.0), (0.0,) * 4, (100.0,) * 4, (1e-4,) * 4, 500)
CALIBRATION = Calibration('2026-01-02', (FIRST, FIRST), (1, -1, 1, 1), (100,) * 4, (3600,) * 4,
                          (False,) * 4, (1e-3,) * 4)
# Readings of four joints, at angles of the jig (deg).
NOW = Station((0.0, 0.0, 0.0), tuple(map(radians, (10.0, 10.0, 10.0, 0.0))),
              (200.0, 200.0, 199.0, 100.0), (2e-4,) * 4, 500)


def test_directions_and_deviations():
    checks = check_joints(CALIBRATION, NOW)
    assert [check.joint for check in checks] == list(JOINT_NAMES)
    assert [check.direction for check in checks] == [
        Direction.CONFIRMED, Direction.REVERSED, Direction.CONFIRMED, Direction.NOT_OBSERVABLE]
    assert [check.deviation for check in checks] == pytest.approx(
        [radians(each) for each in (0.0, -20.0, -0.1, 0.0)])
    assert {check.sigma for check in checks} == {2e-4}


def test_reasons_why_it_does_not_hold():
    checks = check_joints(CALIBRATION, NOW)
    assert [check.failure(radians(0.05)) for check in checks] == [
        None, 'joint_1b turns the other way', 'joint_1c is -0.100 deg off', None]
    assert checks[2].failure(radians(0.11)) is None


def test_earlier_poses_do_not_confirm_what_changed_since():
    """Joint 1a turns the other way now, and joint 1b is the calibrated one."""
    far = replace(FIRST, angles=(radians(30.0),) * 4, counts=(400.0, -200.0, 400.0, 400.0))
    checks = check_joints(replace(CALIBRATION, stations=(FIRST, far)), replace(
        NOW, angles=(radians(5.0),) * 4, counts=(50.0, 50.0, 150.0, 150.0)))
    assert [check.direction for check in checks] == [
        Direction.NOT_OBSERVABLE, *[Direction.CONFIRMED] * 3]
    assert checks[0].failure(radians(1.0)) == 'joint_1a is -10.000 deg off'
