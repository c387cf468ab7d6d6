# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The state of the orientation, and its words on the topic `state`: assigned and read here alone.

The words are a contract: `starting`, `healthy`, `degraded: WHY`, `silent: WHY`.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from spm_haptic_master.kinematics.joints import named_joints
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

# Longest silence that does not change the state (ns).
BRIEF = 20_000_000


class Condition(Enum):
    """Whether orientations are published, and how far they can be relied on."""

    STARTING = 'starting'
    HEALTHY = 'healthy'
    DEGRADED = 'degraded'
    SILENT = 'silent'


# Conditions whose words have a reason.
EXPLAINED = frozenset((Condition.DEGRADED, Condition.SILENT))


@dataclass(frozen=True, slots=True)
class OrientationState:
    """
    State of the orientation.

    Attributes
    ----------
    condition : Condition
        Whether orientations are published.
    why : str
        Reason of a degraded orientation or of silence; else empty.

    """

    condition: Condition
    why: str = ''

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


def silent(why: str) -> OrientationState:
    """Return the state in which no orientation is published, for a reason."""
    return OrientationState(Condition.SILENT, why)


class StateMachine:
    """
    State of the supervision; docs/safety has the diagram.

    Attributes
    ----------
    announced : OrientationState
        The state after the latest sample: the same object until it changes.
    waiting_since : int or None
        Stamp of the first sample since a restart that was withheld, ns; None before.
    published : int or None
        Stamp of the latest orientation published since a restart, ns; None before.

    """

    def __init__(self) -> None:
        self.announced = STARTING
        self.restart()

    def restart(self) -> None:
        """Wait for a first orientation again."""
        self.waiting_since: int | None = None
        self.published: int | None = None

    def publish(self, stamp: int, reservations: str) -> None:
        """Note an orientation, published at a stamp, ns; its reservations are in words."""
        self.published = stamp
        if reservations:
            self._announce(OrientationState(Condition.DEGRADED, reservations))
        elif self.announced is not HEALTHY:
            self._announce(HEALTHY)

    def withhold(self, now: int, fault: str, cause: Symptom) -> None:
        """Note a sample that is withheld at a time, ns, for a fault (its words) or a cause."""
        if self.waiting_since is None:
            self.waiting_since = now
        if fault:
            self._announce(silent(fault))
        elif self._awaits_first(now - self.waiting_since, cause):
            self._announce(STARTING)
        elif not self._is_brief(now):
            self._announce(silent(cause.words))

    def _announce(self, state: OrientationState) -> None:
        """Assign the state: the only place."""
        if state != self.announced:
            self.announced = state

    def _awaits_first(self, waited: int, cause: Symptom) -> bool:
        """Whether only further samples are awaited for the first orientation, after a time, ns."""
        if self.published is not None:
            return False
        is_starting = cause.reason is Reason.STARTING or cause.severity > Severity.WITHHOLD
        return is_starting or waited < BRIEF

    def _is_brief(self, now: int) -> bool:
        """Whether a silence is too short to change the state."""
        if self.published is None or not self.announced.publishes:
            return False
        return now - self.published < BRIEF


def read_state(text: str) -> OrientationState | None:
    """Return the state of the words on the topic `state`; None for any other words."""
    word, _, why = text.partition(': ')
    try:
        state = OrientationState(Condition(word), why)
    except ValueError:
        return None
    is_explained = state.condition in EXPLAINED
    return state if state.text == text and bool(why) is is_explained else None


def received_state(text: str) -> OrientationState:
    """Return the state of words from the topic `state`; of any other words silence."""
    return read_state(text) or silent(f'unknown state {text!r}')
