# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of a healthy device and of a published orientation; `settings` has their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, exp, pi, sqrt
from statistics import NormalDist

# Sensors that determine an orientation, that check each other by one parity, by two.
THREE, FOUR, FIVE = 3, 4, 5
# Samples an hour (unit 1) that the rate of false alarms refers to: 1 kHz.
SAMPLES_AN_HOUR = 3.6e6
# Tests on a sample that share the false alarms: parity alone, parity over the window, four jumps.
TESTS = 6


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a healthy device and of a published orientation, of N sensors."""

    false_alarms_per_hour: float  # of the tests of parity and jumps together, 1/h at 1 kHz
    bias: tuple[float, ...]  # rad; what is systematic on a healthy rig
    alert_limit: float  # rad; largest protection level of a published orientation
    unchecked_limit: float  # s that a sensor may go unchecked by the others; 0: any
    start_checked: bool  # every sensor has to be checked before the first orientation
    window: float  # s over which small inconsistencies are averaged
    skew: float  # s between the sampling times of two sensors of a set, at most
    joint_min: tuple[float, ...]  # rad
    joint_max: tuple[float, ...]  # rad
    joint_speed: float  # rad/s; human motion limit
    joint_acceleration: float  # rad/s^2; human motion limit
    frozen_samples: int  # equal readings in a row that are a fault of a noisy sensor; 0: never
    deviation: float  # rad; largest total standard deviation of a published orientation
    start_samples: int  # consistent samples before the first orientation
    recovery: float  # s of consistency that clear a fault
    fewest_sensors: int  # that go on without one that is known to be faulty

    @property
    def threshold(self) -> float:
        """Return the limit of a test, in standard deviations, at its share of the false alarms."""
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        return -NormalDist().inv_cdf(share / 2.0)

    def norm_threshold(self, entries: int) -> float:
        """Return the norm threshold of 1 to 3 independent entries with the same false alarms."""
        if entries == 1:
            return self.threshold
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        low, high = 0.0, 40.0
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            tail = exp(-0.5 * middle * middle)
            if entries == 3:
                # Maxwell's distribution.
                tail = erfc(middle / sqrt(2.0)) + sqrt(2.0 / pi) * middle * tail
            low, high = (middle, high) if tail > share else (low, middle)
        return high
