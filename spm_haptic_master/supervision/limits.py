# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits that a healthy device keeps to; their defaults are those of `settings`."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

# Samples an hour (unit 1) that the rate of false alarms refers to: 1 kHz.
SAMPLES_AN_HOUR = 3.6e6
# Tests on a sample that share the false alarms: parity alone, parity over the window, four jumps.
TESTS = 6


@dataclass(frozen=True, slots=True)
class Limits:
    """
    Limits that a healthy device keeps to.

    Attributes
    ----------
    false_alarms_per_hour : float
        Rate of false alarms of the tests of parity and jumps together, 1/h at 1 kHz.
    joint_min, joint_max : tuple of 4 float
        Range of the joints, rad.
    joint_speed : float
        Human motion limit of the joint speed, rad/s.
    joint_acceleration : float
        Human motion limit of the joint acceleration, rad/s^2.
    frozen_samples : int
        Repeats in a row of one sensor, while the others change, that are a fault; 0: never.
    deviation : float
        Largest total standard deviation of a published orientation, rad.
    start_samples : int
        Number of consistent samples before the first orientation.
    recovery : float
        Recovery time: consistency after which a fault is cleared, s.
    degraded : bool
        Permission to continue with three sensors if the fourth is known to be faulty.

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
        """Threshold of each test that noise exceeds at its share of the false alarms, sigma."""
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        return -NormalDist().inv_cdf(share / 2.0)
