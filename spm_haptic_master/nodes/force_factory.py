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
from spm_haptic_master.force.statics import rotated
from spm_haptic_master.kinematics.mounting import IDENTITY, Mounting
from spm_haptic_master.kinematics.number_backends import Rotation, Vector
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


def unrotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by the inverse of a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    return rotated((a, d, g, b, e, h, c, f, i), vector)


class WrenchFrame(NamedTuple):
    """A frame of torques on the handle."""

    name: str  # frame_id
    in_handle: bool  # turns with the platform; else in the base frame
    rotation: Rotation[float]  # R_platform_frame or R_base_frame

    def inwards(self, torque: Vector[float]) -> Vector[float]:
        """Return a torque of this frame in the platform or base frame."""
        return rotated(self.rotation, torque)

    def outwards(self, torque: Vector[float]) -> Vector[float]:
        """Return a torque of the platform or base frame in this frame."""
        return unrotated(self.rotation, torque)


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
        self._by_name = {base: WrenchFrame(base, False, same),
                         platform: WrenchFrame(platform, True, same),
                         '': self.spatial, reference: self.spatial,
                         handle: self.body._replace(name=handle)}

    @property
    def names(self) -> tuple[str, ...]:
        """Return the frames that a header may have."""
        return tuple(sorted(filter(None, self._by_name)))

    def find(self, name: str) -> WrenchFrame | None:
        """Return a frame by its frame_id; None where it is not one of the device."""
        return self._by_name.get(name)
