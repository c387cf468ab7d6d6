# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motors of the force feedback that checked settings describe."""

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
    off, most, motors, motor_most = (
        values[f'force.{name}']
        for name in ('sigma_off', 'torque_limit', 'motors', 'motor_torque_limit')
    )
    least, has_drives = SAMPLES_IN_GAP / GAP, bool(values['drives.channel'])
    for name, is_refused, expected in (
        (
            'force.sigma_full',
            values['force.sigma_full'] <= off,
            f'above force.sigma_off ({off:g})',
        ),
        (
            'force.small_torque',
            values['force.small_torque'] > most,
            f'at most force.torque_limit ({most:g})',
        ),
        (
            'rate',
            values['rate'] < least,
            f'at least {least:g} Hz with force.enabled: torque '
            f'begins from zero after {GAP:g} s without a sample',
        ),
        (
            'force.without_drives',
            has_drives is values['force.without_drives'],
            'with force.enabled the bus of the drives in drives.channel, or true for another '
            'motor controller, not both',
        ),
        (
            'drives.node_id',
            has_drives and len(values['drives.node_id']) != motors,
            f'{motors} drives (force.motors)',
        ),
        # What the drives cut would be a torque off its command.
        (
            'drives.torque_limit',
            has_drives and values['drives.torque_limit'] < motor_most,
            f'at least force.motor_torque_limit ({motor_most:g})',
        ),
    ):
        if is_refused:
            given = values[name]
            raise SettingError(name, list(given) if isinstance(given, tuple) else given, expected)
    handle, proximal = values['force.gravity_handle'], values['force.gravity_proximal']
    gravity = (
        Gravity(handle, proximal, values['force.gravity_down'])
        if any((*handle, *proximal))
        else None
    )
    return ForceController(
        geometry_from(values),
        values[WORKING_MODE_SETTING.name],
        motors,
        limits_from(values),
        gravity,
    ), make_drives(values)


def limits_from(values: Values) -> ForceLimits:
    """Return the limits that checked settings describe."""
    return ForceLimits(
        torque=values['force.torque_limit'],
        motor_torque=values['force.motor_torque_limit'],
        slew=values['force.slew'],
        ramp=values['force.ramp'],
        damping=values['force.damping'],
        sigma_off=values['force.sigma_off'],
        sigma_full=values['force.sigma_full'],
        speed=values['force.speed_limit'],
        protection_level=radians(values['force.protection_limit_deg']),
        wrench_age=values['force.wrench_timeout'],
        small_torque=values['force.small_torque'],
        noise=values['force.noise_limit'],
    )
