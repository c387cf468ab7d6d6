# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the supervision, and the limits, solver and supervisor made from them."""

from __future__ import annotations

from math import inf, pi, radians

from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.fkm_settings import INTERFACE_SETTINGS
from spm_haptic_master.geometry_settings import (
    geometry_from,
    GEOMETRY_SETTINGS,
    MOUNTING_SETTINGS,
    WORKING_MODE_SETTING,
)
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.settings import ANY_COUNT, Setting, Values
from spm_haptic_master.shared_settings import SENSORS_SETTING
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.solver import METHODS, Solver
from spm_haptic_master.supervision.supervisor import Supervisor

# A full turn (rad), less the rounding of degrees.
TURN = 2.0 * pi - 1e-9

# Sensors that determine an orientation without checking each other, that check each other twice,
# and more than can be mounted.
THREE, FIVE, NEVER = 3, 5, len(ALL_JOINT_NAMES) + 1

# Values of a list for the fifth and the sixth sensor.
FURTHER = 'th3B and th3C have the values behind them, else that of th3A'

SUPERVISION_SETTINGS = (
    Setting('solver', str, "forward model: 'estimate' from all four sensors, 'theta3a' the "
            "paper's Case 2, 'classic' the three active joints alone",
            default='estimate', allowed=METHODS),
    SENSORS_SETTING,
    Setting('sigma_deg', float, f'standard deviation of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(0.04,) * 4, minimum=1e-6, maximum=10.0, count=ANY_COUNT),
    Setting('bias_deg', float, 'nominal bias of th1A, th1B, th1C, th3A, deg: bound of what is '
            f'systematic on a healthy, calibrated rig (zeros, links, play); {FURTHER}',
            default=(0.05,) * 4, minimum=0.0, maximum=10.0, count=ANY_COUNT),
    Setting('alert_limit_deg', float, 'largest protection level of an orientation that is '
            'published, deg; where it is lower, more sensors count as unchecked and leave the '
            'level: the bounds on protection_level say what their faults may do',
            default=1.0, minimum=0.01, maximum=30.0, live=True),
    Setting('unchecked_limit', float, 'longest time that a sensor may go unchecked by the '
            'others, s; 0: any', default=600.0, minimum=0.0, maximum=1e6),
    Setting('start_checked', bool, 'publish no orientation before the others have checked '
            'every sensor once', default=False),
    Setting('window', float, 'time over which the parity is averaged (ten samples at least): '
            'the time to alert of a small fault, s', default=0.02, minimum=0.001, maximum=1.0),
    Setting('skew', float, 'largest difference between the sampling times of two sensors of a '
            'sample, s', default=0.0, minimum=0.0, maximum=0.1),
    Setting('false_alarms_per_hour', float, 'rate of false alarms of the tests of parity and '
            'jumps at 1 kHz; sets their threshold', default=1e-4, minimum=1e-12, maximum=3600.0),
    Setting('joint_min_deg', float, f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(-180.0,) * 4, minimum=-180.0, maximum=180.0, count=ANY_COUNT),
    Setting('joint_max_deg', float, f'range of th1A, th1B, th1C, th3A, deg; {FURTHER}',
            default=(180.0,) * 4, minimum=-180.0, maximum=180.0, count=ANY_COUNT),
    Setting('joint_speed', float, 'human motion limit of the joint speed, rad/s',
            default=20.0, minimum=0.1, maximum=1000.0),
    Setting('joint_acceleration', float, 'human motion limit of the joint acceleration, '
            'rad/s^2', default=500.0, minimum=1.0, maximum=1e6),
    Setting('frozen_samples', int, 'smallest number of equal readings in a row that is a fault, '
            'where the noise of the sensor makes such a run one; 0: never',
            default=20, minimum=0, maximum=100000),
    Setting('deviation_limit_deg', float, 'largest total standard deviation of a published '
            'orientation, deg', default=0.5, minimum=0.001, maximum=5.0),
    Setting('start_samples', int, 'number of consistent samples before the first orientation',
            default=5, minimum=1, maximum=100000),
    Setting('recovery', float, 'consistency after which a fault is cleared, s',
            default=1.0, minimum=0.01, maximum=3600.0),
    Setting('degraded', str, "'allow': continue without a sensor that is known to be faulty; "
            "'stop': publish nothing; 'auto': 'allow' with six sensors, else 'stop'",
            default='auto', allowed=('auto', 'allow', 'stop')),
    *GEOMETRY_SETTINGS,
    WORKING_MODE_SETTING,
    *MOUNTING_SETTINGS,
)

# Settings of `fkm`, which a recording takes, too: it may have the same parameter files.
FKM_SETTINGS = (*INTERFACE_SETTINGS, *SUPERVISION_SETTINGS)


def limits_from(values: Values) -> Limits:
    """Return the Limits that checked settings describe; SettingError for an empty joint range."""
    low, high = _each(values, 'joint_min_deg'), _each(values, 'joint_max_deg')
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise SettingError('joint_min_deg', list(values['joint_min_deg']),
                           f"less than joint_max_deg ({list(values['joint_max_deg'])})")
    # A joint that may turn all the way round: noise takes a reading past the end of its range.
    ends = [(-inf, inf) if b - a >= TURN else (a, b) for a, b in zip(low, high, strict=True)]
    return Limits(
        false_alarms_per_hour=values['false_alarms_per_hour'],
        bias=_each(values, 'bias_deg'), alert_limit=radians(values['alert_limit_deg']),
        unchecked_limit=values['unchecked_limit'], start_checked=values['start_checked'],
        window=values['window'], skew=values['skew'],
        joint_min=tuple(low for low, _ in ends), joint_max=tuple(high for _, high in ends),
        joint_speed=values['joint_speed'], joint_acceleration=values['joint_acceleration'],
        frozen_samples=values['frozen_samples'], deviation=radians(values['deviation_limit_deg']),
        start_samples=values['start_samples'], recovery=values['recovery'],
        fewest_sensors=_fewest_sensors(values['degraded'], values['sensors']))


def _fewest_sensors(degraded: str, sensors: int) -> int:
    """Return the fewest sensors that go on without a faulty one; more than there are: never."""
    if degraded == 'allow':
        return THREE
    if degraded == 'auto' and sensors == len(ALL_JOINT_NAMES):
        # Five check each other by two parities: two that are wrong do not cancel in both.
        return FIVE
    return NEVER


def sigma_from(values: Values) -> tuple[float, ...]:
    """Return the standard deviations of the sensors, rad, from checked settings."""
    return _each(values, 'sigma_deg')


def _each(values: Values, name: str) -> tuple[float, ...]:
    """Return a setting's value of each sensor, rad; SettingError for another number of them."""
    given, sensors = values[name], values['sensors']
    if len(given) not in (len(JOINT_NAMES), sensors):
        raise SettingError(name, list(given), 'a list of ' + ' or '.join(
            map(str, sorted({len(JOINT_NAMES), sensors}))))
    further = given[-1:] * (sensors - len(given))
    return tuple(map(radians, (*given, *further)))


def make_supervisor(values: Values) -> Supervisor:
    """Return the supervisor that checked settings describe; SettingError as `limits_from`."""
    limits, sigma = limits_from(values), sigma_from(values)
    solver = Solver(geometry_from(values), sigma, values['solver'], values['working_mode'])
    return Supervisor(solver, sigma, limits)
