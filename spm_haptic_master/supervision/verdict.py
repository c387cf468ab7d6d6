# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the supervision decides about a sample, and the only place that assigns the state."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.supervision.orientation_state import (
    degraded,
    HEALTHY,
    OrientationState,
    silent,
    STARTING,
)
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

# Longest silence that does not change the state (ns).
BRIEF = 20_000_000


class State(Enum):
    """Where the supervision is; docs/safety has the diagram."""

    STARTING = 'starting'
    HEALTHY = 'healthy'
    SETTLING = 'settling'
    DEGRADED = 'degraded'
    FAULT = 'fault'


class Verdict(NamedTuple):
    """The decision about one sample."""

    state: State  # a silence shorter than `BRIEF` does not change it
    announced: OrientationState  # the same with its reason, for those outside
    estimate: SampleEstimate | None  # continuous in sign; None where the sample is withheld
    # Largest error, rad, that an undetected fault of one checked sensor, noise and nominal bias
    # may cause; infinite where the sample is withheld.
    protection_level: float
    cause: Symptom | None = None  # why the sample is withheld
    left_out: tuple[str, ...] = ()  # names of the faulty, missing, or not yet trusted sensors

    @property
    def text(self) -> str:
        """Words of the state, as on the topic `state`."""
        return self.announced.text


class StateMachine:
    """
    State of the supervision: `state`, and `announced`, the same with its reason.

    `since` and `published` are the stamps (ns) of the first sample that was withheld and of the
    latest orientation published since a restart, None before.
    """

    def __init__(self) -> None:
        self.state, self.announced = State.STARTING, STARTING
        self.restart()

    def restart(self) -> None:
        """Wait for a first orientation again."""
        self.since: int | None = None
        self.published: int | None = None

    def enter(self, stamp: int, fault: str, cause: Symptom | None, reservations: str) -> None:
        """Assign the state: withheld for a fault (its words) or a cause, or published."""
        published = self.published
        if self.since is None:
            self.since = stamp
        if fault:
            state, announced = State.FAULT, silent(fault)
        elif cause is None:
            state = State.DEGRADED if reservations else State.HEALTHY
            announced = degraded(reservations) if reservations else HEALTHY
        elif published is None and (
                cause.reason is Reason.STARTING or cause.severity > Severity.WITHHOLD
                or stamp - self.since < BRIEF):
            # Only further samples are awaited for the first orientation.
            state, announced = State.STARTING, STARTING
        elif published is None or stamp - published >= BRIEF \
                or self.state in (State.FAULT, State.STARTING):
            state, announced = State.SETTLING, silent(cause.words)
        else:
            return
        self.state = state
        if announced != self.announced:
            self.announced = announced
