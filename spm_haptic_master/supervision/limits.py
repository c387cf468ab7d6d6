# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of a healthy device and of a published orientation; `settings` has their defaults."""

from __future__ import annotations

from dataclasses import dataclass
from math import erfc, exp, pi, sqrt
from statistics import NormalDist

# Samples an hour (unit 1) that the rate of false alarms refers to: 1 kHz.
SAMPLES_AN_HOUR = 3.6e6
# Tests on a sample that share the false alarms: parity alone, parity over the window, four jumps.
TESTS = 6


@dataclass(frozen=True, slots=True)
class Limits:
    """
    Limits of a healthy device and of a published orientation.

    Attributes
    ----------
    false_alarms_per_hour : float
        Rate of false alarms of the tests of parity and jumps together, 1/h at 1 kHz.
    bias : tuple of N float
        Nominal bias of each sensor, rad: bound of what is systematic on a healthy rig.
    alert_limit : float
        Largest protection level of a published orientation, rad.
    unchecked_limit : float
        Longest time that a sensor may go unchecked by the others, s; 0: any.
    start_checked : bool
        Whether every sensor must have been checked once before the first orientation.
    window : float
        Time over which small inconsistencies are averaged, s.
    skew : float
        Largest difference between the sampling times of two sensors of a set, s.
    joint_min, joint_max : tuple of N float
        Range of the joints, rad.
    joint_speed : float
        Human motion limit of the joint speed, rad/s.
    joint_acceleration : float
        Human motion limit of the joint acceleration, rad/s^2.
    frozen_samples : int
        Shortest run of equal readings that is a fault, where the sensor's noise makes it one
        (samples); 0: never.
    deviation : float
        Largest total standard deviation of a published orientation, rad.
    start_samples : int
        Number of consistent samples before the first orientation.
    recovery : float
        Recovery time: consistency after which a fault is cleared, s.
    degraded : bool
        Permission to continue without a sensor that is known to be faulty.

    """

    false_alarms_per_hour: float
    bias: tuple[float, ...]
    alert_limit: float
    unchecked_limit: float
    start_checked: bool
    window: float
    skew: float
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
        """Return the limit of a test, in standard deviations, at its share of the false alarms."""
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        return -NormalDist().inv_cdf(share / 2.0)

    def norm_threshold(self, entries: int) -> float:
        """
        Return the limit of the norm of a vector that a healthy one exceeds as rarely.

        Parameters
        ----------
        entries : {1, 2, 3}
            Number of its entries: independent, normal, of unit variance.

        """
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
