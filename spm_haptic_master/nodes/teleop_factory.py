# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The machine of tele-operation that checked settings describe."""

from __future__ import annotations

from math import inf, radians

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import zxz_quaternion
from spm_haptic_master.parameters.nodes import ANY_OFFSET
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.teleoperation.command_limits import CommandLimits
from spm_haptic_master.teleoperation.conditions import Conditions
from spm_haptic_master.teleoperation.engaging import Teleoperation

# Periods of the command that it makes up for in one step, after a pause.
LONGEST_STEP = 2.0


def registration_from(values: Values) -> Quaternion[float]:
    """Return the unit quaternion x, y, z, w of R_slave_master from checked settings."""
    return zxz_quaternion(*map(radians, values['teleop.registration_zxz_deg']))


def make_teleoperation(values: Values) -> Teleoperation:
    """Return the machine that checked settings describe; SettingError if two contradict."""
    speed = values['teleop.speed_limit']
    if values['teleop.align_speed'] > speed:
        raise SettingError('teleop.align_speed', values['teleop.align_speed'],
                           f'at most teleop.speed_limit ({speed:g})')
    rate, sample_rate = values['teleop.command_rate'], values['rate']
    tolerance = values['teleop.alignment_tolerance_deg']
    level, tracking = values['teleop.protection_limit_deg'], values['teleop.tracking_limit_deg']
    conditions = Conditions(
        registration=registration_from(values),
        align_speed=values['teleop.align_speed']
        if values['teleop.alignment'] == 'absolute' else 0.0,
        tolerance=inf if tolerance == ANY_OFFSET else radians(tolerance),
        roll=radians(values['teleop.roll_deg']),
        enable_timeout=values['teleop.enable_timeout'],
        orientation_timeout=values['teleop.orientation_timeout'],
        slave_timeout=values['teleop.slave_timeout'],
        presence_timeout=values['teleop.presence_timeout'] or inf,
        protection_limit=radians(level) if level else inf,
        tracking_limit=radians(tracking) if tracking else inf,
        command_rate=rate, sample_rate=sample_rate)
    return Teleoperation(conditions, CommandLimits(
        speed=speed, acceleration=values['teleop.acceleration_limit'],
        jump=radians(values['teleop.jump_limit_deg']),
        slews=values['teleop.limit_action'] == 'slew',
        longest=LONGEST_STEP / (min(rate, sample_rate) or sample_rate)))
