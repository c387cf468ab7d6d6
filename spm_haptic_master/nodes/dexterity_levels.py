# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Level and message of the dexterity: what the sensors in use can do."""

from __future__ import annotations

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.setting import Values
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


class Levels:
    """
    Level and message along the dexterities of a moving device.

    A level is entered below its threshold, and left above it by a margin. It follows the sensors
    in use; the three active joints alone are in the message of level OK. The values are those of
    `DIAGNOSTICS_SETTINGS`; SettingError where they contradict each other.
    """

    def __init__(self, values: Values) -> None:
        # Latest level: OK, WARN or ERROR.
        self.level = OK
        self._of_three = OK
        self.use(values)

    def use(self, values: Values) -> None:
        """Use other thresholds; SettingError, and no change, if they contradict each other."""
        warn, error = values['dexterity_warn'], values['dexterity_error']
        if error > warn:
            raise SettingError('dexterity_error', error,
                               f'a number of at most dexterity_warn ({warn:g})')
        self._warn, self._error = warn, error
        self._leave = 1.0 + values['dexterity_hysteresis']

    def take(self, three: float, in_use: float) -> str:
        """Return the message at the dexterity of three sensors and of those in use."""
        self.level = self._next(in_use, self.level)
        self._of_three = self._next(three, self._of_three)
        return COVERED_TEXTS[self._of_three] if self.level == OK else TEXTS[self.level]

    def _next(self, eta: float, before: bytes) -> bytes:
        """Return the level at dexterity `eta`, given the level before."""
        if eta < self._error * (self._leave if before == ERROR else 1.0):
            return ERROR
        if eta < self._warn * (1.0 if before == OK else self._leave):
            return WARN
        return OK
