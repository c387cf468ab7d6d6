# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An earlier calibration against readings: deviations, directions, and why it does not hold."""

from math import radians

import pytest
from spm_haptic_master.calibration.jig_pose import Calibration, Reading
from spm_haptic_master.calibration.verification import check_joints, Direction
from spm_haptic_master.joints import JOINT_NAMES

CALIBRATION = Calibration('2026-01-02', (0.0, 0.0, 0.0), (100.0,) * 4, (1e-4,) * 4, (1, -1, 1, 1),
                          (100,) * 4, (3600,) * 4, (False,) * 4, 500)


def readings(*counts):
    return [Reading(float(each), 2e-4, 0.0) for each in counts]


def test_directions_and_deviations():
    checks = check_joints(CALIBRATION, readings(200, 200, 199, 100),
                          [radians(each) for each in (10.0, 10.0, 10.0, 0.0)])
    assert [check.joint for check in checks] == list(JOINT_NAMES)
    assert [check.direction for check in checks] == [
        Direction.CONFIRMED, Direction.REVERSED, Direction.CONFIRMED, Direction.NOT_OBSERVABLE]
    assert [check.deviation for check in checks] == pytest.approx(
        [radians(each) for each in (0.0, -20.0, -0.1, 0.0)])
    assert {check.sigma for check in checks} == {2e-4}


def test_reasons_why_it_does_not_hold():
    checks = check_joints(CALIBRATION, readings(200, 200, 199, 100),
                          [radians(each) for each in (10.0, 10.0, 10.0, 0.0)])
    assert [check.failure(radians(0.05)) for check in checks] == [
        None, 'joint_1b turns the other way', 'joint_1c is -0.100 deg off', None]
    assert checks[2].failure(radians(0.11)) is None
