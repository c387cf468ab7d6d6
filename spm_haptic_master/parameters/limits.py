# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of a healthy device and of a published orientation, from the settings of `fkm`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import erfc, exp, inf, pi, radians, sqrt
from statistics import NormalDist

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.setting import Values

# Sensors that determine an orientation, that check each other by one parity, by two.
THREE, FOUR, FIVE = 3, 4, 5
# Samples an hour (unit 1) that the rate of false alarms refers to: 1 kHz.
SAMPLES_AN_HOUR = 3.6e6
# Tests on a sample that share the false alarms: parity alone, parity over the window, four jumps.
TESTS = 6
TURN = 2.0 * pi - 1e-9  # rad; a full turn, less the rounding of degrees


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

    def threshold(self, entries: int = 1) -> float:
        """Return the limit of the norm of 1 to 3 entries of unit variance, at its false alarms."""
        share = self.false_alarms_per_hour / SAMPLES_AN_HOUR / TESTS
        if entries == 1:
            return -NormalDist().inv_cdf(share / 2.0)
        low, high = 0.0, 40.0
        while high - low > 1e-9:
            middle = 0.5 * (low + high)
            tail = exp(-0.5 * middle * middle)
            if entries == 3:
                # Maxwell's distribution.
                tail = erfc(middle / sqrt(2.0)) + sqrt(2.0 / pi) * middle * tail
            low, high = (middle, high) if tail > share else (low, middle)
        return high


def limits_from(values: Values) -> Limits:
    """Return the Limits that checked settings describe; SettingError for an empty joint range."""
    low, high = _each(values, 'joint_min_deg'), _each(values, 'joint_max_deg')
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise SettingError('joint_min_deg', list(values['joint_min_deg']),
                           f"less than joint_max_deg ({list(values['joint_max_deg'])})")
    # A joint that may turn all the way round: noise takes a reading past the end of its range.
    ends = [(-inf, inf) if b - a >= TURN else (a, b) for a, b in zip(low, high, strict=True)]
    # Five check each other by two parities: two that are wrong do not cancel in both.
    never = values['sensors'] + 1
    fewest = {'allow': THREE, 'auto': FIVE if values['sensors'] > FIVE else never, 'stop': never}
    same = {field.name: values[field.name] for field in fields(Limits) if field.name in values}
    return Limits(
        **same, bias=_each(values, 'bias_deg'), alert_limit=radians(values['alert_limit_deg']),
        joint_min=tuple(low for low, _ in ends), joint_max=tuple(high for _, high in ends),
        deviation=radians(values['deviation_limit_deg']),
        fewest_sensors=fewest[values['degraded']])


def sigma_from(values: Values) -> tuple[float, ...]:
    """Return the standard deviations of the sensors, rad, from checked settings."""
    return _each(values, 'sigma_deg')


def _each(values: Values, name: str) -> tuple[float, ...]:
    """Return a setting's value of each sensor, rad; SettingError for another number of them."""
    given, sensors = values[name], values['sensors']
    if len(given) not in (FOUR, sensors):
        raise SettingError(name, list(given), 'a list of ' + ' or '.join(
            map(str, sorted({FOUR, sensors}))))
    further = given[-1:] * (sensors - len(given))
    return tuple(map(radians, (*given, *further)))
