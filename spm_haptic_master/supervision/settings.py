# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The limits, the solver and the supervisor that the settings of `fkm` describe."""

from __future__ import annotations

from dataclasses import fields
from math import inf, pi, radians

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.limits import FIVE, FOUR, Limits, THREE
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.supervisor import Supervisor

# A full turn (rad), less the rounding of degrees.
TURN = 2.0 * pi - 1e-9


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


def make_supervisor(values: Values) -> Supervisor:
    """Return the supervisor that checked settings describe; SettingError as `limits_from`."""
    limits, sigma = limits_from(values), sigma_from(values)
    solver = Solver(geometry_from(values), sigma, values['solver'], values['working_mode'])
    return Supervisor(solver, sigma, limits)
