# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of the force feedback, and its words on `force_state`: made and read here alone.

The words are a contract: `off`, `ready`, `engaged`, `holding`, `fading: WHY`, `fault: WHY`.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple


class Condition(Enum):
    """Whether the motors have torque."""

    OFF = 'off'
    READY = 'ready'
    ENGAGED = 'engaged'
    HOLDING = 'holding'
    FADING = 'fading'
    FAULT = 'fault'


class Reason(Enum):
    """Why torque fades out: every word of `force_state` behind a colon."""

    DISABLED = 'disabled'
    DRIVES_OFF = 'drives not in operation'
    DISENGAGED = 'teleoperation not engaged'
    ABSENT = 'no hand on the handle'
    STALE = 'wrench missing or too old'
    DRIVE = 'fault of a drive'
    ANGLE = 'angle of a motor missing'
    NO_ORIENTATION = 'no orientation'
    UNPROTECTED = 'protection level above the limit of force'
    NOISY = 'encoder too noisy'
    SPEED = 'handle too fast'
    TORQUE = 'torque of a motor off its command'
    NOT_FINITE = 'wrench not finite'
    SOURCES = 'two sources of the wrench'
    ENERGY = 'energy generated'


# Between condition and reason.
SEPARATOR = ': '
# Conditions with a reason.
EXPLAINED = frozenset((Condition.FADING, Condition.FAULT))
# Reasons after which somebody has to acknowledge; after the others force may begin again.
LATCHED = frozenset((
    Reason.DRIVE, Reason.ANGLE, Reason.NO_ORIENTATION, Reason.UNPROTECTED, Reason.NOISY,
    Reason.SPEED, Reason.TORQUE, Reason.NOT_FINITE, Reason.SOURCES, Reason.ENERGY))
# Time in which torque fades out (s); after a drive's fault the other motors alone pull askew.
FADE, DRIVE_FADE = 0.02, 0.003


class ForceState(NamedTuple):
    """
    State of the force feedback.

    Attributes
    ----------
    condition : Condition
        Whether the motors have torque.
    why : Reason or None
        Why torque fades out, or has.

    """

    condition: Condition
    why: Reason | None = None

    @property
    def text(self) -> str:
        """Words of the state, as on the topic `force_state`."""
        word = self.condition.value
        return word if self.why is None else f'{word}{SEPARATOR}{self.why.value}'


OFF, READY = ForceState(Condition.OFF), ForceState(Condition.READY)
ENGAGED, HOLDING = ForceState(Condition.ENGAGED), ForceState(Condition.HOLDING)


def read_force_state(text: str) -> ForceState | None:
    """Return the state of the words on the topic `force_state`; None for any other words."""
    word, _, why = text.partition(SEPARATOR)
    try:
        state = ForceState(Condition(word), Reason(why) if why else None)
    except ValueError:
        return None
    return state if state.text == text and bool(why) is (state.condition in EXPLAINED) else None
