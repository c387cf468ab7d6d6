# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of `fkm`: those of the node, of its supervision and of its force feedback."""

from __future__ import annotations

from dataclasses import replace

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.force import FORCE_SETTINGS
from spm_haptic_master.parameters.geometry import (
    GEOMETRY_SETTINGS,
    MOUNTING_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.setting import ANY_COUNT, Setting, Values
from spm_haptic_master.parameters.shared import (
    CALIBRATION_SETTING,
    RATE_SETTING,
    SENSORS_SETTING,
)

# Settings of the names of the mounting's frames, beside that of the base (`frame_id`).
FRAME_SETTINGS = (
    Setting('mounting.table_frame_id', str, 'frame of the table, in which all outputs are where '
            'mounting.base_zxz_deg is not 0', default='spm_table'),
    Setting('mounting.platform_frame_id', str, 'frame of the platform, on which the handle is '
            'mounted', default='spm_platform'),
    Setting('mounting.handle_frame_id', str, 'frame of the handle, whose orientation is published '
            'where mounting.handle_zxz_deg is not 0', default='spm_handle'),
)

# Shortest window of the angular velocity (sample periods): three samples, and their jitter.
VELOCITY_PERIODS = 2.5

INTERFACE_SETTINGS = (
    Setting('frame_id', str, 'frame of the base, in which all outputs are unless it is mounted',
            default='spm_base'),
    *FRAME_SETTINGS,
    replace(RATE_SETTING, description='expected rate of joint samples, Hz; a lower one is a '
            'warning'),
    Setting('latency_limit', float, 'largest 99th percentile of the latency from sample to '
            'publication, s; a larger one is a warning', default=0.005, minimum=1e-5,
            maximum=10.0),
    Setting('max_age', float, 'largest age of a joint sample, s; an older one is stale and '
            'rejected', default=0.1, minimum=0.001, maximum=10.0),
    Setting('sample_timeout', float, 'time without a joint sample after which that is an error, s',
            default=0.05, minimum=0.002, maximum=60.0),
    Setting('velocity_window', float, 'time over which the angular velocity is averaged, s; at '
            f'least {VELOCITY_PERIODS:g} sample periods are used',
            default=0.02, minimum=0.002, maximum=1.0),
    Setting('crtk_rate', float, 'rate of measured_cp, setpoint_cp, measured_cv, crtk/measured_js '
            'and gripper/measured_js, Hz; 0: with each orientation', default=200.0, minimum=0.0,
            maximum=10000.0),
    Setting('gripper.axis', int, 'axis of the messages on gripper/joy that is the gripper; -1: '
            'none, gripper.position_deg holds', default=-1, minimum=-1, maximum=63),
    Setting('gripper.position_deg', float, 'angle of the gripper without an axis, deg',
            default=0.0, minimum=-180.0, maximum=180.0),
    Setting('gripper.range_deg', float, 'angles of the gripper at the ends -1 and 1 of the axis, '
            'deg', default=(0.0, 60.0), minimum=-180.0, maximum=180.0, count=2),
    CALIBRATION_SETTING,
)

# Forward models to choose from: 'estimate' is the maximum-likelihood orientation of all four
# sensors; 'theta3a' the paper's Case 2 (eqs. 15, 16); 'classic' the three active joints alone
# (eqs. 1 to 7), in the assembly mode nearest to the last orientation.
METHODS = ('estimate', 'theta3a', 'classic')
# Values of a list for the fifth and the sixth sensor.
FURTHER = 'th3B and th3C have the values behind them, else that of th3A'

SUPERVISION_SETTINGS = (
    Setting('solver', str, "forward model: 'estimate' from all four sensors, 'theta3a' the "
            "paper's Case 2, 'classic' the three active joints alone",
            default='estimate', allowed=METHODS),
    SENSORS_SETTING,
    Setting('sigma_deg', float, f'standard deviation of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(0.04,) * 4, minimum=1e-6, maximum=10.0, count=ANY_COUNT),
    Setting('bias_deg', float, 'nominal bias of th1A, th1B, th1C, th3A, deg: bound of what is '
            f'systematic on a healthy, calibrated rig (zeros, links, play); {FURTHER}',
            default=(0.05,) * 4, minimum=0.0, maximum=10.0, count=ANY_COUNT),
    Setting('alert_limit_deg', float, 'largest protection level of an orientation that is '
            'published, deg; where it is lower, more sensors count as unchecked and leave the '
            'level: the bounds on protection_level say what their faults may do',
            default=1.0, minimum=0.01, maximum=30.0, live=True),
    Setting('unchecked_limit', float, 'longest time that a sensor may go unchecked by the '
            'others, s; 0: any', default=600.0, minimum=0.0, maximum=1e6),
    Setting('start_checked', bool, 'publish no orientation before the others have checked '
            'every sensor once', default=False),
    Setting('window', float, 'time over which the parity is averaged (ten samples at least): '
            'the time to alert of a small fault, s', default=0.02, minimum=0.001, maximum=1.0),
    Setting('skew', float, 'largest difference between the sampling times of two sensors of a '
            'sample, s', default=0.0, minimum=0.0, maximum=0.1),
    Setting('false_alarms_per_hour', float, 'rate of false alarms of the tests of parity and '
            'jumps at 1 kHz; sets their threshold', default=1e-4, minimum=1e-12, maximum=3600.0),
    Setting('joint_min_deg', float, f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(-180.0,) * 4, minimum=-180.0, maximum=180.0, count=ANY_COUNT),
    Setting('joint_max_deg', float, f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(180.0,) * 4, minimum=-180.0, maximum=180.0, count=ANY_COUNT),
    Setting('joint_speed', float, 'human motion limit of the joint speed, rad/s',
            default=20.0, minimum=0.1, maximum=1000.0),
    Setting('joint_acceleration', float, 'human motion limit of the joint acceleration, '
            'rad/s^2', default=500.0, minimum=1.0, maximum=1e6),
    Setting('frozen_samples', int, 'smallest number of equal readings in a row that is a fault, '
            'where the noise of the sensor makes such a run one; 0: never',
            default=20, minimum=0, maximum=100000),
    Setting('deviation_limit_deg', float, 'largest total standard deviation of a published '
            'orientation, deg', default=0.5, minimum=0.001, maximum=5.0),
    Setting('start_samples', int, 'number of consistent samples before the first orientation',
            default=5, minimum=1, maximum=100000),
    Setting('recovery', float, 'consistency after which a fault is cleared, s',
            default=1.0, minimum=0.01, maximum=3600.0),
    Setting('degraded', str, "'allow': continue without a sensor that is known to be faulty; "
            "'stop': publish nothing; 'auto': 'allow' with six sensors, else 'stop'",
            default='auto', allowed=('auto', 'allow', 'stop')),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
    *MOUNTING_SETTINGS,
)

# All settings of `fkm`; `supervise` takes the same, and so the same parameter files.
FKM_SETTINGS = (*INTERFACE_SETTINGS, *SUPERVISION_SETTINGS, *FORCE_SETTINGS)


def check_frames(values: Values) -> None:
    """Refuse two frames of the mounting with one name; SettingError names the second."""
    seen: dict[str, str] = {}
    for name in ('frame_id', *(setting.name for setting in FRAME_SETTINGS)):
        first = seen.setdefault(values[name], name)
        if first != name:
            raise SettingError(name, values[name], f'another frame than that of {first}')
