# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which of the mounted sensors are in use, and how much each of them counts."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
import math

from spm_haptic_master.exceptions import InputError, quoted
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Smallest and largest standard deviation of a sensor (rad): a resolution of 32 bits a turn, and
# more than a reading has that says nothing.
SMALLEST_SIGMA, LARGEST_SIGMA = 1e-9, math.pi
# Fewest sensors that are mounted, and that determine an orientation.
FEWEST_MOUNTED, FEWEST_USED = 4, 3


@dataclass(frozen=True, slots=True)
class UsedSensors:
    """
    Three to six sensors in use of the four, five or six mounted ones.

    InputError for other than 4, 5 or 6 mounted sensors, fewer than three in use, or a standard
    deviation or a place out of range.

    Parameters
    ----------
    sigma : tuple of N float
        Standard deviations of the N mounted sensors th1A, th1B, th1C, th3A, th3B, th3C, rad.
    left_out : collection of int
        Places of mounted sensors that are not used.

    Attributes
    ----------
    weights : tuple of six float
        1 / sigma^2 of the sensors in use, 1 / rad^2; 0 for the others.
    used : tuple of int
        Places of the sensors in use, in ascending order; `count` is their number.
    largest : float
        Largest standard deviation of the sensors in use, rad.
    usual : bool
        Whether th1A, th1B, th1C and th3A are all in use.
    further : int
        Number of mounted sensors on th3B and th3C.

    """

    sigma: tuple[float, ...]
    left_out: Collection[int] = ()
    weights: tuple[float, float, float, float, float, float] = field(init=False, compare=False)
    used: tuple[int, ...] = field(init=False, compare=False)
    count: int = field(init=False, compare=False)
    largest: float = field(init=False, compare=False)
    usual: bool = field(init=False, compare=False)
    further: int = field(init=False, compare=False)

    def __post_init__(self) -> None:
        """Check the arguments and derive the other attributes."""
        sigma = tuple(self.sigma)
        mounted, left_out = len(sigma), frozenset(self.left_out)
        if not FEWEST_MOUNTED <= mounted <= len(ALL_JOINT_NAMES):
            raise InputError(f'sigma = {quoted(self.sigma)}: expected four, five or six standard '
                             'deviations')
        if not all(SMALLEST_SIGMA <= each <= LARGEST_SIGMA for each in sigma):
            raise InputError(
                f'sigma = {quoted(self.sigma)}: expected standard deviations in rad from '
                f'{SMALLEST_SIGMA:g} to {LARGEST_SIGMA:.6g}')
        if not left_out <= set(range(mounted)):
            raise InputError(f'left_out = {quoted(self.left_out)}: expected places from 0 to '
                             f'{mounted - 1}')
        used = tuple(place for place in range(mounted) if place not in left_out)
        if len(used) < FEWEST_USED:
            raise InputError(f'left_out = {quoted(self.left_out)} of {mounted} sensors: expected '
                             f'{FEWEST_USED} or more in use')
        weights = tuple(1.0 / (sigma[place] * sigma[place]) if place in used else 0.0
                        for place in range(len(ALL_JOINT_NAMES)))
        values = {
            'sigma': sigma, 'left_out': left_out, 'weights': weights, 'used': used,
            'count': len(used), 'largest': max(sigma[place] for place in used),
            'usual': used[:FEWEST_MOUNTED] == tuple(range(FEWEST_MOUNTED)),
            'further': mounted - FEWEST_MOUNTED}
        for name, value in values.items():
            object.__setattr__(self, name, value)
