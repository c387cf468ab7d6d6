# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the supervision: what is made of them, and what they may not be."""

from math import inf, pi, radians

import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.fkm import limits_from, sigma_from, SUPERVISION_SETTINGS
from spm_haptic_master.parameters.geometry import MECHANISM_SETTINGS, MOUNTING_SETTINGS
from spm_haptic_master.parameters.setting import complete, SENSORS_SETTING
from spm_haptic_master.supervision.supervisor import make_supervisor


def values(**changed):
    return complete(SUPERVISION_SETTINGS, changed)


def test_limits_are_in_si_units():
    same = {
        'recovery': 2.0,
        'frozen_samples': 7,
        'start_samples': 9,
        'joint_speed': 3.0,
        'joint_acceleration': 44.0,
        'false_alarms_per_hour': 0.5,
        'unchecked_limit': 60.0,
        'start_checked': True,
        'window': 0.05,
        'skew': 0.001,
    }
    limits = limits_from(
        values(
            **same,
            joint_min_deg=[-10.0, -20.0, -30.0, -40.0],
            joint_max_deg=[10.0, 20.0, 30.0, 40.0],
            deviation_limit_deg=1.0,
            degraded='allow',
            bias_deg=[0.1, 0.2, 0.3, 0.4],
            alert_limit_deg=2.0,
        )
    )
    assert {name: getattr(limits, name) for name in same} == same
    assert limits.joint_min == pytest.approx([-radians(x) for x in (10, 20, 30, 40)])
    assert limits.joint_max == pytest.approx([radians(x) for x in (10, 20, 30, 40)])
    assert limits.bias == pytest.approx([radians(x) for x in (0.1, 0.2, 0.3, 0.4)])
    assert (limits.deviation, limits.alert_limit) == pytest.approx((radians(1.0), radians(2.0)))
    # A joint that may turn all the way round has no end of its range.
    limits = limits_from(values(joint_max_deg=[180.0, 180.0, 179.0, 180.0]))
    assert limits.joint_min == (-inf, -inf, pytest.approx(-pi), -inf)
    assert limits.joint_max == (inf, inf, pytest.approx(radians(179.0)), inf)


def another(setting):
    """Return another value of a setting than its default."""
    default = setting.default
    if setting.allowed:
        return next(each for each in setting.allowed if each != default)
    if setting.kind is bool:
        return not default
    first = default[0] if setting.count is not None else default
    end = setting.minimum if first == setting.maximum else setting.maximum
    middle = setting.kind((first + end) / 2)
    return [middle] * len(default) if setting.count is not None else middle


LIMITS = [
    each
    for each in SUPERVISION_SETTINGS
    if each not in (SENSORS_SETTING, *MECHANISM_SETTINGS, *MOUNTING_SETTINGS)
    and each.name != 'sigma_deg'
]


@pytest.mark.parametrize('setting', LIMITS, ids=lambda setting: setting.name)
def test_each_setting_is_one_of_the_limits(setting):
    """One without a field of Limits would be accepted and have no effect."""
    assert limits_from(values(**{setting.name: another(setting)})) != limits_from(values())


def test_further_sensors_have_their_own_values_or_those_of_th3a():
    sigma = [0.01, 0.02, 0.03, 0.04]
    assert sigma_from(values(sensors=6, sigma_deg=sigma)) == pytest.approx(
        [radians(each) for each in (*sigma, 0.04, 0.04)]
    )
    assert sigma_from(values(sensors=5, sigma_deg=[*sigma, 0.05])) == pytest.approx(
        [radians(each) for each in (*sigma, 0.05)]
    )


@pytest.mark.parametrize(
    ('changed', 'text'),
    [
        ({'sensors': 6, 'sigma_deg': [0.04] * 5}, 'sigma_deg.*expected a list of 4 or 6'),
        ({'sigma_deg': [0.04] * 5}, 'sigma_deg.*a list of 4'),
        ({'joint_max_deg': [180.0] * 5}, 'joint_max_deg.*a list of 4'),
        ({'sigma_deg': {0.1, 0.2, 0.3, 0.4}}, 'sigma_deg'),
        (
            {'joint_min_deg': [-180.0, -180.0, 50.0, -180.0], 'joint_max_deg': [50.0] * 4},
            r'joint_min_deg.*less than joint_max_deg \(\[',
        ),
        ({'degraded': 'other'}, 'degraded'),
        ({'window': 10**400}, 'window'),
    ],
)
def test_what_cannot_be_is_refused(changed, text):
    with pytest.raises(SettingError, match=text):
        make_supervisor(values(**changed))
