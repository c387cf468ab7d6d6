# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of the orientation, and its words on the topic `state`: made and read here alone.

The words are a contract: `starting`, `healthy`, `degraded: WHY`, `silent: WHY`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from spm_haptic_master.kinematics.joints import named_joints


class Condition(Enum):
    """Whether orientations are published, and how far they can be relied on."""

    STARTING = 'starting'
    HEALTHY = 'healthy'
    DEGRADED = 'degraded'
    SILENT = 'silent'


# Conditions with a reason.
EXPLAINED = frozenset((Condition.DEGRADED, Condition.SILENT))


@dataclass(frozen=True, slots=True)
class OrientationState:
    """State of the orientation."""

    condition: Condition
    why: str = ''  # reason of a degraded orientation or of silence; else empty

    @property
    def publishes(self) -> bool:
        """Whether orientations are published in this state."""
        return self.condition in (Condition.HEALTHY, Condition.DEGRADED)

    @property
    def text(self) -> str:
        """Words of the state, as on the topic `state`."""
        word = self.condition.value
        return f'{word}: {self.why}' if self.condition in EXPLAINED else word

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the joints that a degraded orientation is computed without."""
        return named_joints(self.why) if self.condition is Condition.DEGRADED else ()


STARTING = OrientationState(Condition.STARTING)
HEALTHY = OrientationState(Condition.HEALTHY)


def degraded(why: str) -> OrientationState:
    """Return the state of orientations that are published with a reservation."""
    return OrientationState(Condition.DEGRADED, why)


def silent(why: str) -> OrientationState:
    """Return the state in which no orientation is published, for a reason."""
    return OrientationState(Condition.SILENT, why)


def read_state(text: str) -> OrientationState | None:
    """Return the state of the words on the topic `state`; None for any other words."""
    word, _, why = text.partition(': ')
    try:
        state = OrientationState(Condition(word), why)
    except ValueError:
        return None
    return state if state.text == text and bool(why) is (state.condition in EXPLAINED) else None


def received_state(text: str) -> OrientationState:
    """Return the state of words from the topic `state`; of any other words silence."""
    return read_state(text) or silent(f'unknown state {text!r}')
