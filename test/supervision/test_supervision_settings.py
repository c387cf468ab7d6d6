# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the supervision: ranges, defaults, and what is made of them."""

from dataclasses import replace
from math import inf, pi, radians

from product_limits import product_limits
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics import inverse, matrix_from_zxz
from spm_haptic_master.parameters.fkm import SUPERVISION_SETTINGS
from spm_haptic_master.parameters.setting import ANY_COUNT, complete
from spm_haptic_master.supervision.settings import limits_from, sigma_from
from spm_haptic_master.supervision.supervisor import make_supervisor
from spm_haptic_master.supervision.symptom import Reason

NUMBERS = [setting for setting in SUPERVISION_SETTINGS
           if setting.minimum is not None and setting.count in (None, ANY_COUNT)]


def values(**changed):
    return complete(SUPERVISION_SETTINGS, changed)


@pytest.mark.parametrize('setting', NUMBERS, ids=lambda setting: setting.name)
def test_a_value_beyond_its_range_is_refused(setting):
    def given(value):
        return {setting.name: value if setting.count is None else [value] * 4}

    for bound, outwards in ((setting.minimum, -1), (setting.maximum, 1)):
        bound = setting.kind(bound)
        values(**given(bound))
        with pytest.raises(SettingError, match=setting.name):
            values(**given(bound + outwards))


@pytest.mark.parametrize('name', ['sigma_deg', 'bias_deg', 'joint_min_deg', 'joint_max_deg'])
def test_a_list_has_a_value_for_each_sensor(name):
    with pytest.raises(SettingError, match=f'{name}.*a list of 4'):
        make_supervisor(values(**{name: values()[name][:1] * 5}))


@pytest.mark.parametrize('name', ['solver', 'degraded'])
def test_another_word_is_refused(name):
    with pytest.raises(SettingError, match=name):
        values(**{name: 'other'})


def test_limits_are_in_si_units():
    limits = limits_from(values(
        joint_min_deg=[-10.0, -20.0, -30.0, -40.0], joint_max_deg=[10.0, 20.0, 30.0, 40.0],
        deviation_limit_deg=1.0, degraded='allow', recovery=2.0, frozen_samples=7,
        start_samples=9, joint_speed=3.0, joint_acceleration=44.0, false_alarms_per_hour=0.5,
        bias_deg=[0.1, 0.2, 0.3, 0.4], alert_limit_deg=2.0, unchecked_limit=60.0,
        start_checked=True, window=0.05, skew=0.001))
    assert limits.joint_min == pytest.approx([-radians(x) for x in (10, 20, 30, 40)])
    assert limits.joint_max == pytest.approx([radians(x) for x in (10, 20, 30, 40)])
    assert limits.deviation == pytest.approx(radians(1.0))
    assert limits.fewest_sensors == 3
    assert (limits.recovery, limits.frozen_samples, limits.start_samples) == (2.0, 7, 9)
    assert (limits.joint_speed, limits.joint_acceleration) == (3.0, 44.0)
    assert limits.false_alarms_per_hour == 0.5
    assert limits.bias == pytest.approx([radians(x) for x in (0.1, 0.2, 0.3, 0.4)])
    assert limits.alert_limit == pytest.approx(radians(2.0))
    assert (limits.unchecked_limit, limits.window, limits.skew) == (60.0, 0.05, 0.001)
    assert limits.start_checked is True
    assert limits_from(values()).fewest_sensors > 4
    assert limits_from(values()).start_checked is False


@pytest.mark.parametrize(('sensors', 'degraded', 'goes_on'), [
    (4, 'auto', False), (5, 'auto', False), (6, 'auto', True), (5, 'allow', True),
    (4, 'allow', True), (6, 'stop', False)])
def test_six_sensors_go_on_without_one_unless_told_otherwise(sensors, degraded, goes_on):
    limits = limits_from(values(sensors=sensors, degraded=degraded))
    assert (sensors > limits.fewest_sensors) is goes_on


def test_further_sensors_have_their_own_values_or_those_of_th3a():
    sigma = [0.01, 0.02, 0.03, 0.04]
    assert sigma_from(values(sensors=6, sigma_deg=sigma)) == pytest.approx(
        [radians(each) for each in (*sigma, 0.04, 0.04)])
    sigma += [0.05]
    assert sigma_from(values(sensors=5, sigma_deg=sigma)) == pytest.approx(
        [radians(each) for each in sigma])
    with pytest.raises(SettingError, match='sigma_deg.*expected a list of 4 or 6'):
        sigma_from(values(sensors=6, sigma_deg=sigma))


def test_a_joint_that_may_turn_all_the_way_round_has_no_end_of_its_range():
    limits = limits_from(values(joint_max_deg=[180.0, 180.0, 179.0, 180.0]))
    assert limits.joint_min == (-inf, -inf, pytest.approx(-pi), -inf)
    assert limits.joint_max == (inf, inf, pytest.approx(radians(179.0)), inf)


def test_the_alert_limit_alone_is_live():
    assert [setting.name for setting in SUPERVISION_SETTINGS if setting.live] == [
        'alert_limit_deg']


@pytest.mark.parametrize('low', [50.0, 60.0])
def test_an_empty_joint_range_is_an_error(low):
    with pytest.raises(SettingError, match=r'joint_min_deg.*less than joint_max_deg \(\['):
        limits_from(values(joint_min_deg=[-180.0, -180.0, low, -180.0],
                           joint_max_deg=[180.0, 180.0, 50.0, 180.0]))


def test_sigma_is_in_rad():
    assert sigma_from(values(sigma_deg=[0.1, 0.2, 0.3, 0.4])) == pytest.approx(
        (radians(0.1), radians(0.2), radians(0.3), radians(0.4)))


def test_threshold_is_the_false_alarm_rate():
    """At 3.6e6 samples an hour, shared by six tests, on both sides of the normal distribution."""
    limits = product_limits(false_alarms_per_hour=1e-4)
    assert 6.5 < limits.threshold() < 7.5
    assert replace(limits, false_alarms_per_hour=1e-12).threshold() > 8.0
    assert replace(limits, false_alarms_per_hour=3.6e6 * 6 * 0.0455).threshold() == pytest.approx(
        2.0, abs=1e-4)


def test_the_supervisor_follows_its_settings():
    joints = inverse(matrix_from_zxz(*[radians(x) for x in (135.0, 54.7356, 20.0)]))
    angles = (*joints.theta1.tolist(), float(joints.theta3a))
    supervisor = make_supervisor(values(start_samples=1))
    assert sum(supervisor.take(0, angles).estimate.covariance[::4]) ** 0.5 < radians(0.1)
    supervisor = make_supervisor(values(start_samples=1, sigma_deg=[2.0] * 4))
    assert supervisor.take(0, angles).cause.reason is Reason.UNDETERMINED
    supervisor = make_supervisor(values(start_samples=1, joint_max_deg=[-170.0] * 4))
    assert supervisor.take(0, angles).cause.reason is Reason.OUT_OF_RANGE


@pytest.mark.parametrize('name', ['window', 'joint_speed', 'alert_limit_deg'])
def test_an_integer_beyond_any_float_is_refused(name):
    with pytest.raises(SettingError, match=name):
        values(**{name: 10 ** 400})


@pytest.mark.parametrize('value', [{0.1, 0.2, 0.3, 0.4}, {0.1: 1, 0.2: 2, 0.3: 3, 0.4: 4}])
def test_numbers_without_an_order_are_no_list(value):
    with pytest.raises(SettingError, match='sigma_deg'):
        values(sigma_deg=value)
