# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controller, drives and frames of the force feedback that the settings of `fkm` describe."""

from __future__ import annotations

from math import radians
from typing import NamedTuple

from spm_haptic_master.drives.drives import Drives, make_drives
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceController, ForceLimits, Gravity
from spm_haptic_master.force.controller import GAP
from spm_haptic_master.kinematics.mounting import IDENTITY, Mounting
from spm_haptic_master.kinematics.number_backends import Rotation
from spm_haptic_master.kinematics.rotations import conjugate, rotation_from_quaternion
from spm_haptic_master.parameters.geometry import (
    geometry_from,
    mounting_from,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.parameters.setting import Values

# Fewest samples within the longest gap after which torque goes on (unit 1).
SAMPLES_IN_GAP = 2.5


def make_motors(values: Values) -> tuple[ForceController, Drives | None]:
    """
    Return the controller and its drives; None: another motor controller takes the torques.

    SettingError: two settings contradict each other.
    """
    off, most, motors, motor_most = (values[f'force.{name}'] for name in (
        'sigma_off', 'torque_limit', 'motors', 'motor_torque_limit'))
    least, has_drives = SAMPLES_IN_GAP / GAP, bool(values['drives.channel'])
    for name, is_refused, expected in (
        ('force.sigma_full', values['force.sigma_full'] <= off,
         f'above force.sigma_off ({off:g})'),
        ('force.small_torque', values['force.small_torque'] > most,
         f'at most force.torque_limit ({most:g})'),
        ('rate', values['rate'] < least, f'at least {least:g} Hz with force.enabled: torque '
         f'begins from zero after {GAP:g} s without a sample'),
        ('force.without_drives', has_drives is values['force.without_drives'],
         'with force.enabled the bus of the drives in drives.channel, or true for another '
         'motor controller, not both'),
        ('drives.node_id', has_drives and len(values['drives.node_id']) != motors,
         f'{motors} drives (force.motors)'),
        # What the drives cut would be a torque off its command.
        ('drives.torque_limit', has_drives and values['drives.torque_limit'] < motor_most,
         f'at least force.motor_torque_limit ({motor_most:g})'),
    ):
        if is_refused:
            given = values[name]
            raise SettingError(name, list(given) if isinstance(given, tuple) else given, expected)
    handle, proximal = values['force.gravity_handle'], values['force.gravity_proximal']
    gravity = None
    if any((*handle, *proximal)):
        gravity = Gravity(handle, proximal, values['force.gravity_down'])
    controller = ForceController(
        geometry_from(values), values[WORKING_MODE_SETTING.name], motors, limits_from(values),
        gravity)
    return controller, make_drives(values)


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


class WrenchFrame(NamedTuple):
    """A frame of torques on the handle."""

    name: str  # frame_id
    in_handle: bool  # turns with the platform; else in the base frame
    rotation: Rotation[float]  # R_platform_frame or R_base_frame


class WrenchFrames:
    """
    The frames of a device; `reference` is that of `orientation`.

    It is the table's where the base is mounted on it, or else the base's.
    """

    def __init__(self, values: Values, reference: str) -> None:
        mounting = mounting_from(values) or Mounting()
        base, platform, handle = (values[name] for name in (
            'frame_id', 'mounting.platform_frame_id', 'mounting.handle_frame_id'))
        same = rotation_from_quaternion(*IDENTITY)
        is_mounted = tuple(map(abs, mounting.handle)) != IDENTITY
        # Components in the table's frame to those in the base's: R_table_base^T.
        self.spatial = WrenchFrame(
            reference, False, rotation_from_quaternion(*conjugate(mounting.base)))
        self.body = WrenchFrame(handle if is_mounted else platform, True,
                                rotation_from_quaternion(*mounting.handle))
        # CRTK clients leave the frame of a header empty: it is that of `orientation`.
        self.by_name = {base: WrenchFrame(base, False, same),
                        platform: WrenchFrame(platform, True, same),
                        '': self.spatial, reference: self.spatial,
                        handle: self.body._replace(name=handle)}
