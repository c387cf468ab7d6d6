# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the supervision decides about a sample: one typed value."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.sample_estimate import SampleEstimate
from spm_haptic_master.orientation_state import OrientationState
from spm_haptic_master.supervision.symptom import Symptom


class State(Enum):
    """Where the supervision is; docs/safety has the diagram."""

    STARTING = 'starting'
    HEALTHY = 'healthy'
    SETTLING = 'settling'
    DEGRADED = 'degraded'
    FAULT = 'fault'


class Verdict(NamedTuple):
    """
    The decision about one sample.

    Attributes
    ----------
    state : State
        Where the supervision is. A silence shorter than `supervisor.BRIEF` does not change it.
    announced : OrientationState
        The state with its reason, for those outside; its `text` has the words of `state`.
    estimate : SampleEstimate or None
        The orientation, continuous in sign with the last one, and its covariance; None where the
        sample is withheld.
    protection_level : float
        Largest error, rad, that an undetected fault of one checked sensor, noise and nominal bias
        may cause; infinite where the sample is withheld.
    cause : Symptom or None
        Why the sample is withheld.
    left_out : tuple of str
        Names of the mounted sensors that the orientation does without: faulty, missing, or not
        trusted again.

    """

    state: State
    announced: OrientationState
    estimate: SampleEstimate | None
    protection_level: float
    cause: Symptom | None = None
    left_out: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """Words of the state, as on the topic `state`."""
        return self.announced.text
