# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controller of the force feedback and the drives that the settings of `fkm` describe."""

from __future__ import annotations

from math import radians

from spm_haptic_master.drives.drives import Drives, make_drives
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceController, ForceLimits, Gravity
from spm_haptic_master.force.controller import GAP
from spm_haptic_master.parameters.geometry import geometry_from, WORKING_MODE_SETTING
from spm_haptic_master.parameters.setting import Values

# Fewest samples within the longest gap after which torque goes on (unit 1).
SAMPLES_IN_GAP = 2.5


def make_motors(values: Values) -> tuple[ForceController, Drives | None]:
    """
    Return the controller and its drives; None: another motor controller takes the torques.

    SettingError: two settings contradict each other.
    """
    _check(values)
    handle, proximal = values['force.gravity_handle'], values['force.gravity_proximal']
    gravity = None
    if any((*handle, *proximal)):
        gravity = Gravity(handle, proximal, values['force.gravity_down'])
    controller = ForceController(
        geometry_from(values), values[WORKING_MODE_SETTING.name], values['force.motors'],
        limits_from(values), gravity)
    drives = make_drives(values)
    if drives is not None:
        _check_drives(values, drives.motors)
    elif not values['force.without_drives']:
        raise SettingError('force.without_drives', False,
                           'true where force.enabled is true and drives.channel is empty')
    return controller, drives


def limits_from(values: Values) -> ForceLimits:
    """Return the limits that checked settings describe."""
    return ForceLimits(
        torque=values['force.torque_limit'], motor_torque=values['force.motor_torque_limit'],
        slew=values['force.slew'], ramp=values['force.ramp'], damping=values['force.damping'],
        sigma_off=values['force.sigma_off'], sigma_full=values['force.sigma_full'],
        speed=values['force.speed_limit'],
        protection_level=radians(values['force.protection_limit_deg']),
        wrench_age=values['force.wrench_timeout'], small_torque=values['force.small_torque'],
        noise=values['force.noise_limit'])


def _check(values: Values) -> None:
    """Refuse settings that contradict each other; SettingError names the one to change."""
    off, full = values['force.sigma_off'], values['force.sigma_full']
    if full <= off:
        raise SettingError('force.sigma_full', full, f'above force.sigma_off ({off:g})')
    small, most = values['force.small_torque'], values['force.torque_limit']
    if small > most:
        raise SettingError('force.small_torque', small, f'at most force.torque_limit ({most:g})')
    rate, least = values['rate'], SAMPLES_IN_GAP / GAP
    if rate < least:
        raise SettingError('rate', rate, f'at least {least:g} Hz with force.enabled: torque '
                           f'begins from zero after {GAP:g} s without a sample')


def _check_drives(values: Values, count: int) -> None:
    """Refuse drives that are not those of the motors, or cut their torque."""
    motors = values['force.motors']
    if count != motors:
        raise SettingError('drives.node_id', list(values['drives.node_id']),
                           f'{motors} drives (force.motors)')
    cap, most = values['drives.torque_limit'], values['force.motor_torque_limit']
    if cap < most:
        # What the drives cut would be a torque off its command.
        raise SettingError('drives.torque_limit', cap,
                           f'at least force.motor_torque_limit ({most:g})')
