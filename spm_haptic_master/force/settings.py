# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The controller of the force feedback that the settings of `fkm` describe."""

from __future__ import annotations

from math import radians

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force.controller import ForceController, GAP
from spm_haptic_master.force.force_limits import ForceLimits
from spm_haptic_master.force.gravity import Gravity
from spm_haptic_master.parameters.geometry import geometry_from, WORKING_MODE_SETTING
from spm_haptic_master.parameters.setting import Values

# Fewest samples within the longest gap after which torque goes on (unit 1).
SAMPLES_IN_GAP = 2.5


def make_controller(values: Values) -> ForceController:
    """
    Return the controller that checked settings describe.

    Raises
    ------
    SettingError
        Two settings contradict each other.

    """
    _check(values)
    handle, proximal = values['force.gravity_handle'], values['force.gravity_proximal']
    gravity = None
    if any((*handle, *proximal)):
        gravity = Gravity(handle, proximal, values['force.gravity_down'])
    return ForceController(
        geometry_from(values), values[WORKING_MODE_SETTING.name], values['force.motors'],
        limits_from(values), gravity)


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
