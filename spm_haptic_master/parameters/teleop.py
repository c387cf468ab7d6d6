# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the tele-operation."""

from __future__ import annotations

from spm_haptic_master.parameters.setting import Setting
from spm_haptic_master.parameters.shared import RATE_SETTING

# Angle of any offset (deg).
ANY_OFFSET = 180.0

TELEOP_SETTINGS = (
    Setting('teleop.registration_zxz_deg', float, 'psi, theta, phi (ZXZ) of R_slave_master, from '
            "the frame of `orientation` to the slave's base or camera frame, deg; 0 each: none",
            default=(0.0,) * 3, minimum=-360.0, maximum=360.0, count=3),
    Setting('teleop.alignment', str, "'relative': the offset between master and slave at engaging "
            "is kept; 'absolute': it shrinks to none at teleop.align_speed",
            default='relative', allowed=('relative', 'absolute')),
    Setting('teleop.align_speed', float, "angular speed at which an 'absolute' slave meets the "
            'master, rad/s; at most teleop.speed_limit', default=0.2, minimum=0.001, maximum=10.0),
    Setting('teleop.alignment_tolerance_deg', float, 'largest angle between master and slave at '
            f'which they engage, deg; {ANY_OFFSET:g}: any',
            default=ANY_OFFSET, minimum=0.1, maximum=ANY_OFFSET),
    Setting('teleop.roll_deg', float, 'roll of the handle about its own z axis, to and fro, that '
            'engaging takes as a sign of a hand, deg; 0: none',
            default=0.0, minimum=0.0, maximum=90.0),
    Setting('teleop.enable_timeout', float, 'time after which an enable lapses that has not led '
            'to engaging, s', default=10.0, minimum=0.1, maximum=600.0),
    Setting('teleop.orientation_timeout', float, 'largest age of the orientation while engaged, '
            's', default=0.05, minimum=0.002, maximum=1.0),
    Setting('teleop.slave_timeout', float, "largest age of the slave's measured pose while "
            'engaged, s', default=0.1, minimum=0.002, maximum=10.0),
    Setting('teleop.presence_timeout', float, 'largest age of the message that the surgeon is '
            'present, s; 0: any, for a pedal that publishes changes only: one that hangs or is '
            'killed then leads the slave until DDS drops it, 20 s',
            default=0.5, minimum=0.0, maximum=10.0),
    Setting('teleop.protection_limit_deg', float, 'largest protection level at which the slave '
            'follows, deg; 0: any that fkm publishes (alert_limit_deg)',
            default=0.0, minimum=0.0, maximum=30.0),
    Setting('teleop.tracking_limit_deg', float, "largest angle from the command to the slave's "
            'measured pose, deg; 0: any', default=0.0, minimum=0.0, maximum=180.0),
    Setting('teleop.command_rate', float, 'rate of servo_cp, Hz; 0: with each orientation',
            default=200.0, minimum=0.0, maximum=10000.0),
    Setting('teleop.speed_limit', float, 'largest angular speed of the command, rad/s',
            default=6.0, minimum=0.01, maximum=100.0),
    Setting('teleop.acceleration_limit', float, 'largest angular acceleration of the command, '
            'rad/s^2', default=500.0, minimum=0.1, maximum=1e6),
    Setting('teleop.jump_limit_deg', float, 'largest rotation from one command to the next, deg',
            default=5.0, minimum=0.01, maximum=90.0),
    Setting('teleop.limit_action', str, "what a command does that would break a limit: 'slew' to "
            "it within the limits, or 'disengage'", default='slew', allowed=('slew', 'disengage')),
    Setting('teleop.frame_id', str, 'frame of servo_cp and of the twist; empty: that of the '
            "slave's measured pose", default='', blank=True),
    Setting('teleop.force_scale', float, 'share of the torque on slave/measured_cf that goes on '
            'to spatial/servo_cf while engaged; 0: none, and neither topic', default=0.0,
            minimum=0.0, maximum=1.0),
    RATE_SETTING,
)
