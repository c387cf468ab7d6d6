# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of the force feedback, checked once."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite, radians

from spm_haptic_master.exceptions import InputError, quoted


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """
    Limits of the force feedback.

    InputError: a value is not a finite number above 0 (`damping`: 0 or more), or `sigma_full` is
    not above `sigma_off`.
    """

    torque: float = 0.3  # largest asked of the handle, N m
    motor_torque: float = 0.5  # largest of a motor, N m
    slew: float = 10.0  # largest slope of the torque asked of the handle, N m/s
    ramp: float = 0.5  # time over which torque comes up after engaging, s
    damping: float = 0.005  # viscous damping added at the handle, N m s/rad
    # Smallest singular values of G (unit 1) between which the share of the weak direction of three
    # motors rises from 0 to 1.
    sigma_off: float = 0.05
    sigma_full: float = 0.15
    speed: float = 10.0  # fastest handle, rad/s: beyond, torque fades out
    # Largest protection level of an orientation that force relies on, rad. An orientation wrong by
    # 0.5 deg makes a torque wrong by up to 11 % where sigma is above 0.15.
    protection_level: float = radians(1.0)
    wrench_age: float = 0.03  # oldest wrench that is rendered, s
    small_torque: float = 0.05  # largest torque of a wrench with which force may begin, N m
    noise: float = 5.0  # largest noise of an encoder over its figure (unit 1)

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not (
                    isfinite(value)) or value < 0.0 or (value == 0.0 and each.name != 'damping'):
                raise InputError(f'{each.name} = {quoted(value)}: expected a number above 0')
        if self.sigma_full <= self.sigma_off:
            raise InputError(f'sigma_full = {self.sigma_full:g}: expected a number above '
                             f'sigma_off = {self.sigma_off:g}')
