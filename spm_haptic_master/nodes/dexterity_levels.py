# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Level and message of the dexterity: what the sensors in use can do."""

from __future__ import annotations

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.orientation_state import OrientationState
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN

# Messages on /diagnostics while the sensors in use hardly determine the orientation, by level.
TEXTS = {
    WARN: 'near a singularity of the sensors in use',
    ERROR: 'at a singularity of the sensors in use',
}
# Messages while they do, by the level that the three active joints alone would have.
COVERED_TEXTS = {
    OK: 'clear of singularities',
    WARN: 'near a parallel singularity; the sensors in use cover it',
    ERROR: 'at a parallel singularity; the sensors in use cover it',
}
# All of them: an orientation comes.
MESSAGES = frozenset((*TEXTS.values(), *COVERED_TEXTS.values()))


class Hysteresis:
    """
    Level of a dexterity: entered below a threshold, left above it by a margin.

    Parameters
    ----------
    warn, error : float
        Dexterity below which the level is WARN, ERROR.
    margin : float
        Fraction above a threshold at which its level is left.

    Raises
    ------
    SettingError
        If `error` is above `warn`.

    """

    def __init__(self, warn: float, error: float, margin: float) -> None:
        if error > warn:
            raise SettingError('dexterity_error', error,
                               f'a number of at most dexterity_warn ({warn:g})')
        self._warn, self._error, self._margin = warn, error, margin

    def level(self, eta: float, before: bytes) -> bytes:
        """Return the level at dexterity `eta`, given the level before."""
        leave = 1.0 + self._margin
        if eta < self._error * (leave if before == ERROR else 1.0):
            return ERROR
        if eta < self._warn * (leave if before in (WARN, ERROR) else 1.0):
            return WARN
        return OK


class Levels:
    """
    Level and message along the dexterities of a moving device.

    The level follows the sensors in use; the three active joints alone are in the message of
    level OK.

    Parameters
    ----------
    hysteresis : Hysteresis
        Of both.

    Attributes
    ----------
    hysteresis : Hysteresis
        May be replaced.
    level : bytes
        Latest level: OK, WARN or ERROR.

    """

    def __init__(self, hysteresis: Hysteresis) -> None:
        self.hysteresis = hysteresis
        self.level = OK
        self._of_three = OK

    def take(self, three: float, in_use: float) -> str:
        """Return the message at the dexterity of three sensors and of those in use."""
        self.level = self.hysteresis.level(in_use, self.level)
        self._of_three = self.hysteresis.level(three, self._of_three)
        return COVERED_TEXTS[self._of_three] if self.level == OK else TEXTS[self.level]


def left_out(state: OrientationState, sensors: int) -> tuple[int, ...]:
    """Return the indices of the sensors that an orientation is computed without."""
    return tuple(index for index, name in enumerate(ALL_JOINT_NAMES[:sensors])
                 if name in state.left_out)
