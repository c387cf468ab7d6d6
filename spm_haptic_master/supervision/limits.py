# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a healthy device keeps to; the defaults are those of `settings`."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

SAMPLES_AN_HOUR = 3.6e6
"""At 1 kHz."""

TESTS = 6
"""Tests on a sample that share the false alarms: parity at once, over the window, four jumps."""


@dataclass(frozen=True, slots=True)
class Limits:
    """
    What a healthy device keeps to.

    Attributes
    ----------
    false_alarms_per_hour : float
        At 1 kHz, of the parity and of the jumps together; it sets their threshold.
    joint_min, joint_max : tuple of 4 float
        Range of the joints, rad.
    joint_speed : float
        Fastest joint that a hand makes, rad/s.
    joint_acceleration : float
        Largest joint acceleration that a hand makes, rad/s^2.
    frozen_samples : int
        Equal readings in a row of one sensor, while the others live, that are a fault; 0: never.
    deviation : float
        Largest total standard deviation of an orientation that goes out, rad.
    start_samples : int
        Consistent samples before the first orientation.
    recovery : float
        s of consistency before a fault counts as gone.
    degraded : bool
        Whether three sensors go on where the fourth is known to be faulty.

    """

    false_alarms_per_hour: float
    joint_min: tuple[float, ...]
    joint_max: tuple[float, ...]
    joint_speed: float
    joint_acceleration: float
    frozen_samples: int
    deviation: float
    start_samples: int
    recovery: float
    degraded: bool

    @property
    def threshold(self) -> float:
        """Standard deviations that noise exceeds, in one test, at its share of the false alarms."""
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        return -NormalDist().inv_cdf(share / 2.0)
