# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of `fkm` as a node: frames, rates, age of the samples, outputs."""

from __future__ import annotations

from dataclasses import replace

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.settings import Setting, Values
from spm_haptic_master.shared_settings import CALIBRATION_SETTING, RATE_SETTING

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


def check_frames(values: Values) -> None:
    """Refuse two frames of the mounting with one name; SettingError names the second."""
    seen: dict[str, str] = {}
    for name in ('frame_id', *(setting.name for setting in FRAME_SETTINGS)):
        first = seen.setdefault(values[name], name)
        if first != name:
            raise SettingError(name, values[name], f'another frame than that of {first}')
