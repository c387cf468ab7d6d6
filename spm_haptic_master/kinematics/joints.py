# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The measured joints: names and order, in every module and on every topic; which are in use."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
import math
import re

from spm_haptic_master.exceptions import InputError, quoted

# Names of the joints of th1A, th1B, th1C on the motor axes of the legs A, B, C, and of th3A on
# leg A's passive joint, in the order of a sample.
JOINT_NAMES = ('joint_1a', 'joint_1b', 'joint_1c', 'joint_3a')

# The same with the fifth sensor, on leg B's joint of th3B, and the sixth, on leg C's of th3C.
ALL_JOINT_NAMES = (*JOINT_NAMES, 'joint_3b', 'joint_3c')

# The joints with sensors in short, as the paper has them after th.
SHORT_NAMES = ('1A', '1B', '1C', '3A', '3B', '3C')

# Names of all nine joints of the mechanism: th1k, th2k, th3k of leg A, then of B and of C.
MECHANISM_JOINT_NAMES = tuple(f'joint_{number}{leg}' for leg in 'abc' for number in (1, 2, 3))

# The legs.
LEG_NAMES = 'ABC'

# Numbers of sensors, in words.
NUMBER_WORDS = {
    4: 'four',
    5: 'five',
    6: 'six',
}

# Smallest and largest standard deviation of a sensor (rad): a resolution of 32 bits a turn, and
# more than a reading has that says nothing.
SMALLEST_SIGMA = 1e-9
LARGEST_SIGMA = math.pi
# Fewest sensors that are mounted, and that determine an orientation.
FEWEST_MOUNTED = 4
FEWEST_USED = 3


def named_joints(text: str) -> tuple[str, ...]:
    """Return the joints with sensors that a text names, in their order."""
    words = re.findall(r'\w+', text)
    return tuple(name for name in ALL_JOINT_NAMES if name in words)


@dataclass(frozen=True, slots=True)
class UsedSensors:
    """
    Three to six sensors in use of the four, five or six mounted ones.

    `sigma` are the standard deviations of the N mounted sensors th1A, th1B, th1C, th3A, th3B,
    th3C, rad, `left_out` the places of mounted sensors that are not used. InputError for other
    than 4, 5 or 6 mounted sensors, fewer than three in use, or a deviation or place out of range.
    """

    sigma: tuple[float, ...]
    left_out: Collection[int] = ()
    # 1 / sigma^2 of the sensors in use (1 / rad^2); 0 for the others.
    weights: tuple[float, float, float, float, float, float] = field(init=False)
    # Places of the sensors in use, in ascending order, their number and largest deviation (rad).
    used: tuple[int, ...] = field(init=False)
    count: int = field(init=False)
    largest: float = field(init=False)
    # Whether th1A, th1B, th1C and th3A are all in use.
    usual: bool = field(init=False)
    # Number of mounted sensors on th3B and th3C.
    further: int = field(init=False)

    def __post_init__(self) -> None:
        """Check the arguments and derive the other attributes."""
        sigma = self._checked_sigma()
        left_out = frozenset(self.left_out)
        used = self._checked_places(len(sigma), left_out)
        weights = [0.0] * len(ALL_JOINT_NAMES)
        for place in used:
            weights[place] = 1.0 / (sigma[place] * sigma[place])
        values = {
            'sigma': sigma,
            'left_out': left_out,
            'weights': tuple(weights),
            'used': used,
            'count': len(used),
            'largest': max(sigma[place] for place in used),
            'usual': used[:FEWEST_MOUNTED] == tuple(range(FEWEST_MOUNTED)),
            'further': len(sigma) - FEWEST_MOUNTED,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _checked_sigma(self) -> tuple[float, ...]:
        """Return the standard deviations, rad; InputError if a number or a size is wrong."""
        sigma = tuple(self.sigma)
        if not FEWEST_MOUNTED <= len(sigma) <= len(ALL_JOINT_NAMES):
            raise InputError(
                f'sigma = {quoted(self.sigma)}: expected four, five or six standard deviations'
            )
        if not all(SMALLEST_SIGMA <= deviation <= LARGEST_SIGMA for deviation in sigma):
            raise InputError(
                f'sigma = {quoted(self.sigma)}: expected standard deviations in rad from '
                f'{SMALLEST_SIGMA:g} to {LARGEST_SIGMA:.6g}'
            )
        return sigma

    def _checked_places(self, mounted: int, left_out: frozenset[int]) -> tuple[int, ...]:
        """Return the places in use; InputError if one left out is not mounted, or too few are."""
        if not left_out <= set(range(mounted)):
            raise InputError(
                f'left_out = {quoted(self.left_out)}: expected places from 0 to {mounted - 1}'
            )
        used = tuple(place for place in range(mounted) if place not in left_out)
        if len(used) < FEWEST_USED:
            raise InputError(
                f'left_out = {quoted(self.left_out)} of {mounted} sensors: expected '
                f'{FEWEST_USED} or more in use'
            )
        return used
