# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where the supervision is, and what is announced of it: the only place that assigns the state."""

from __future__ import annotations

from spm_haptic_master.orientation_state import degraded, HEALTHY, silent, STARTING
from spm_haptic_master.supervision.fault import Fault
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom
from spm_haptic_master.supervision.verdict import State

# Longest silence that does not change the state (ns).
BRIEF = 20_000_000


class StateMachine:
    """
    State of the supervision.

    Attributes
    ----------
    state : State
        Where the supervision is.
    announced : OrientationState
        The same with its reason, for those outside.
    since, published : int or None
        Stamps (ns) of the first sample, and of the latest orientation published, since a restart.

    """

    def __init__(self) -> None:
        self.state, self.announced = State.STARTING, STARTING
        self.restart()

    def restart(self) -> None:
        """Wait for a first orientation again."""
        self.since: int | None = None
        self.published: int | None = None

    def enter(self, stamp: int, fault: Fault | None, cause: Symptom | None,
              reservations: str) -> None:
        """
        Assign the state after a sample.

        It is withheld for a latched fault or another cause, or published, with reservations or
        without any.
        """
        published = self.published
        if fault is not None:
            state, announced = State.FAULT, silent(fault.words)
        elif cause is None:
            state = State.DEGRADED if reservations else State.HEALTHY
            announced = degraded(reservations) if reservations else HEALTHY
        elif published is None and self._awaits(stamp, cause):
            state, announced = State.STARTING, STARTING
        elif published is None or stamp - published >= BRIEF \
                or self.state in (State.FAULT, State.STARTING):
            state, announced = State.SETTLING, silent(cause.words)
        else:
            return
        self.state = state
        if announced != self.announced:
            self.announced = announced

    def _awaits(self, stamp: int, cause: Symptom) -> bool:
        """Whether only further samples are awaited for the first orientation."""
        return cause.reason is Reason.STARTING or cause.severity > Severity.WITHHOLD \
            or self.since is None or stamp - self.since < BRIEF
