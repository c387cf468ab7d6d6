# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of the force feedback."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import inf, radians

from spm_haptic_master.exceptions import InputError, quoted

# Limits that may be 0; the others are at least this much above it.
MAY_BE_ZERO = frozenset(('damping', 'lock_stiffness', 'end_stop'))
SMALLEST = 1e-300


@dataclass(frozen=True, slots=True)
class ForceLimits:
    """
    Limits of the force feedback.

    InputError: a value is not a finite number above 0 (those of `MAY_BE_ZERO`: 0 or more), or
    `sigma_full` is not above `sigma_off`.
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
    speed: float = 6.0  # fastest handle, rad/s: beyond, torque fades out
    # Largest protection level of an orientation that force relies on, rad. An orientation wrong by
    # 0.5 deg makes a torque wrong by up to 11 % where sigma is above 0.15.
    protection_level: float = radians(1.0)
    wrench_age: float = 0.03  # oldest wrench that is rendered, s
    small_torque: float = 0.05  # largest torque of a wrench with which force may begin, N m
    noise: float = 5.0  # largest noise of an encoder over its figure (unit 1)
    lock_stiffness: float = 1.0  # of a locked orientation, N m/rad; 0: none
    end_stop: float = radians(5.0)  # angle before the end of a leg's reach, rad; 0: no end stop

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            may_be_zero = field.name in MAY_BE_ZERO
            least = 0.0 if may_be_zero else SMALLEST
            is_number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not is_number or not least <= value < inf:
                wanted = '0 or more' if may_be_zero else 'above 0'
                raise InputError(
                    f'{field.name} = {quoted(value)}: expected a finite number {wanted}'
                )
        if self.sigma_full <= self.sigma_off:
            raise InputError(
                f'sigma_full = {self.sigma_full:g}: expected a number above '
                f'sigma_off = {self.sigma_off:g}'
            )
