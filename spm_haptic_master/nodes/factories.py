# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The motors of the force feedback that checked settings describe."""

from __future__ import annotations

from math import radians
from typing import NoReturn

from spm_haptic_master.drives.drive_factory import make_drives
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceController, ForceLimits, Gravity
from spm_haptic_master.force.controller import TORQUE_GAP
from spm_haptic_master.parameters.geometry import geometry_from, WORKING_MODE_SETTING
from spm_haptic_master.parameters.setting import Values

# Fewest samples within the longest gap after which torque goes on (unit 1).
SAMPLES_IN_GAP = 2.5


def make_motors(values: Values) -> tuple[ForceController, Drives | None]:
    """
    Make the controller of the force feedback and its drives.

    Parameters
    ----------
    values : mapping
        Checked settings of `fkm`.

    Returns
    -------
    tuple of ForceController and Drives or None
        The drives are None where another motor controller takes the torques.

    Raises
    ------
    SettingError
        Two settings contradict each other.

    """
    _check_torques(values)
    _check_drives(values)
    handle = values['force.gravity_handle']
    proximal = values['force.gravity_proximal']
    gravity = None
    if any((*handle, *proximal)):
        gravity = Gravity(
            handle=handle,
            proximal=proximal,
            down=values['force.gravity_down'],
        )
    controller = ForceController(
        geometry=geometry_from(values),
        working_mode=values[WORKING_MODE_SETTING.name],
        motors=values['force.motors'],
        limits=limits_from(values),
        gravity=gravity,
    )
    return controller, make_drives(values)


def _check_torques(values: Values) -> None:
    """Raise SettingError for limits of the torque that contradict each other."""
    off = values['force.sigma_off']
    most = values['force.torque_limit']
    least_rate = SAMPLES_IN_GAP / TORQUE_GAP
    if values['force.sigma_full'] <= off:
        _refuse(values, 'force.sigma_full', f'above force.sigma_off ({off:g})')
    if values['force.small_torque'] > most:
        _refuse(values, 'force.small_torque', f'at most force.torque_limit ({most:g})')
    if values['rate'] < least_rate:
        _refuse(
            values,
            'rate',
            f'at least {least_rate:g} Hz with force.enabled: torque begins from zero after '
            f'{TORQUE_GAP:g} s without a sample',
        )


def _check_drives(values: Values) -> None:
    """Raise SettingError unless there are drives, one for each motor, or a controller of them."""
    has_drives = bool(values['drives.channel'])
    motors = values['force.motors']
    motor_most = values['force.motor_torque_limit']
    if has_drives is values['force.without_drives']:
        _refuse(
            values,
            'force.without_drives',
            'with force.enabled the bus of the drives in drives.channel, or true for another '
            'motor controller, not both',
        )
    if not has_drives:
        if values['crtk_rate'] > 0.0:
            _refuse(
                values,
                'crtk_rate',
                '0 with force.without_drives: the other motor controller needs the torque of each '
                'sample',
            )
        return
    if len(values['drives.node_id']) != motors:
        _refuse(values, 'drives.node_id', f'{motors} drives (force.motors)')
    # What the drives cut would be a torque off its command.
    if values['drives.torque_limit'] < motor_most:
        expected = f'at least force.motor_torque_limit ({motor_most:g})'
        _refuse(values, 'drives.torque_limit', expected)


def _refuse(
    values: Values,
    name: str,
    expected: str,
) -> NoReturn:
    """
    Raise SettingError for a value that another setting forbids.

    Parameters
    ----------
    values : mapping
        Checked settings of `fkm`.
    name : str
        Name of the setting that is refused.
    expected : str
        What it has to be, in words.

    Raises
    ------
    SettingError
        In every case.

    """
    value = values[name]
    raise SettingError(
        name=name,
        value=list(value) if isinstance(value, tuple) else value,
        expected=expected,
    )


def limits_from(values: Values) -> ForceLimits:
    """
    Return the limits that checked settings describe.

    Parameters
    ----------
    values : mapping
        Checked settings of `fkm`.

    Returns
    -------
    ForceLimits
        Angles in rad; all else in the units of the settings.

    """
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
        lock_stiffness=values['force.lock_stiffness'],
        end_stop=radians(values['force.end_stop_deg']),
    )
