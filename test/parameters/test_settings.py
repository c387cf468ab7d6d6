# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Every setting of every node: default, range and meaning, what is refused, what is derived."""

from math import inf, nan, nextafter, pi, radians
from pathlib import Path
import re

import numpy as np
import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.arguments import help_text
from spm_haptic_master.parameters.fkm import FKM_SETTINGS, limits_from, sigma_from
from spm_haptic_master.parameters.nodes import NODE_SETTINGS, process_settings
from spm_haptic_master.parameters.resolver import check_agreement
from spm_haptic_master.parameters.setting import complete

EVERY = {
    setting.name: setting
    for node in ('master', *NODE_SETTINGS)
    for setting in process_settings(node)
}
# Values that no setting of a kind has.
OTHER_TYPES = {
    bool: (1, 'true'),
    int: (True, 1.0, '1'),
    float: (True, '1', nan, inf, 10**400),
    str: (1, True, None),
}


def test_the_page_of_parameters_is_current(monkeypatch):
    """It has name, default, range and meaning of every setting of every node."""
    monkeypatch.syspath_prepend(str(Path(__file__).resolve().parents[2]))
    from docs import generate_parameters

    assert generate_parameters.page() == generate_parameters.OUTPUT.read_text(encoding='utf-8'), (
        'run `make docs`'
    )


EACH_SETTING = pytest.mark.parametrize('setting', EVERY.values(), ids=list(EVERY))


def ends_of(setting):
    """Return the least and the largest value of a setting, those that there are."""
    return [end for end in (setting.minimum, setting.maximum) if end is not None]


def beyond(setting):
    """Return the nearest values outside the range of a setting."""
    found = []
    for end, step in ((setting.minimum, -1), (setting.maximum, 1)):
        if end is not None:
            found.append(nextafter(end, end + step) if setting.kind is float else end + step)
    return found


def good_values(setting):
    """Return single values that a setting takes."""
    found = list(setting.allowed) or list(map(setting.kind, ends_of(setting)))
    if setting.kind is str and setting.blank:
        found.append(' ')
    return found


def bad_values(setting):
    """Return single values that a setting refuses."""
    found = [*OTHER_TYPES[setting.kind], *beyond(setting)]
    if setting.kind is str and setting.allowed:
        found.append('no such word')
    if setting.kind is str and not setting.blank:
        found.append(' ')
    return found


def bad_lists(setting):
    """Return what is no list of the values of a setting, or one of another length."""
    found = [[], 'text', {1.0}, 1.0]
    if setting.count:
        found.append([0.0] * (setting.count + 1))
    return found


@EACH_SETTING
def test_a_setting_takes_its_range(setting):
    assert all(f'{end:g}' in setting.expected for end in ends_of(setting))
    for value in good_values(setting):
        if setting.count is None:
            assert setting.check(value) == value
        else:
            values = [value] * (setting.count or 3)
            assert setting.check(values) == tuple(values)


@EACH_SETTING
def test_a_setting_refuses_all_else(setting):
    bad = bad_values(setting)
    if setting.count is not None:
        bad = [[value] * (setting.count or 3) for value in bad] + bad_lists(setting)
    for value in bad:
        with pytest.raises(SettingError) as error:
            setting.check(value)
        given = 'not set' if value is None else repr(value)
        expected = value is None and setting.remedy or setting.expected
        assert str(error.value) == f"parameter '{setting.name}' is {given}; expected {expected}"


@EACH_SETTING
def test_a_setting_that_is_not_given_has_its_default(setting):
    if setting.default is not None:
        assert complete((setting,), {}) == {setting.name: setting.default}


def test_help_has_each_setting_with_its_default_below_its_group():
    shown = help_text(EVERY.values())
    assert all(len(line) <= 99 for line in shown.splitlines())
    groups = re.findall(
        r'^parameters (?:(\S+\.)\* )?\(-p NAME:=VALUE\) \[default\]:', shown, re.MULTILINE
    )
    assert groups == sorted({name[: name.find('.') + 1] for name in EVERY})
    text = ' '.join(shown.split())
    for name, setting in EVERY.items():
        assert re.search(rf' {name}( \[[^]]*\])? {re.escape(setting.description)}', text)
    for words in (
        'can.emcy_stops an encoder',
        'calibration name',
        'frame_id [spm_base] ',
        'rate [1000] ',
        'drives.rated_torque [0] ',
        'working_mode [1, 1, 1] ',
        'force.enabled [false] ',
        'false_alarms_per_hour [0.0001] ',
    ):
        assert f' {words}' in text


def values(**given):
    """Return checked values of fkm."""
    return complete(FKM_SETTINGS, given)


@pytest.mark.parametrize('rate', [1e-12, 1e-4, 1.0, 3600.0])
def test_thresholds_share_the_false_alarms_among_the_tests(rate):
    """An hour has 3.6 million samples at 1 kHz, each sample six tests."""
    limits = limits_from(values(false_alarms_per_hour=rate))
    for entries, density in (
        (1, lambda r: np.sqrt(2.0 / pi)),
        (2, lambda r: r),
        (3, lambda r: np.sqrt(2.0 / pi) * r * r),
    ):
        r = np.linspace(0.0, 10.0, 200_001) + limits.threshold(entries)
        tail = np.trapezoid(density(r) * np.exp(-0.5 * r * r), r)
        assert 6.0 * 3.6e6 * tail == pytest.approx(rate, rel=1e-6)
    assert limits.threshold() == limits.threshold(1)


@pytest.mark.parametrize(
    ('sensors', 'degraded', 'fewest'),
    [
        (4, 'auto', 5),
        (4, 'allow', 3),
        (4, 'stop', 5),
        (5, 'auto', 6),
        (5, 'allow', 3),
        (5, 'stop', 6),
        (6, 'auto', 5),
        (6, 'allow', 3),
        (6, 'stop', 7),
    ],
)
def test_limits_are_the_settings_in_rad_for_each_sensor(sensors, degraded, fewest):
    given = values(
        sensors=sensors,
        degraded=degraded,
        bias_deg=[0.1, 0.2, 0.3, 0.4],
        sigma_deg=[0.5, 0.6, 0.7, 0.8, 0.9, 1.0][:sensors],
        window=0.03,
        skew=0.01,
        joint_min_deg=[-180.0, -90.0, -1.0, 0.0],
        joint_max_deg=[180.0, 90.0, 1.0, 5.0],
    )
    limits = limits_from(given)
    further = sensors - 4
    assert limits.fewest_sensors == fewest
    assert limits.bias == (*np.radians([0.1, 0.2, 0.3]), *(radians(0.4),) * (1 + further))
    assert sigma_from(given) == tuple(np.radians(given['sigma_deg']))
    # A joint that turns all the way round has no end.
    assert limits.joint_min == (-inf, -pi / 2, -radians(1.0), *(0.0,) * (1 + further))
    assert limits.joint_max == (inf, pi / 2, *np.radians([1.0, *[5.0] * (1 + further)]))
    assert (limits.alert_limit, limits.deviation) == (radians(1.0), radians(0.5))
    assert {name: getattr(limits, name) for name in ('window', 'skew', 'recovery')} == {
        'window': 0.03,
        'skew': 0.01,
        'recovery': 1.0,
    }


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'sigma': 1}, "'sigma' is 1; expected a known name: .*, sigma_deg, "),
        ({'sigma_deg': [0.1] * 5}, "'sigma_deg' .* a list of 4$"),
        ({'bias_deg': [0.1] * 5, 'sensors': 6}, "'bias_deg' .* a list of 4 or 6$"),
        (
            {'joint_min_deg': [1.0] * 4, 'joint_max_deg': [2.0, 2.0, 1.0, 2.0]},
            r"'joint_min_deg' .* less than joint_max_deg \(\[2.0, 2.0, 1.0, 2.0\]\)",
        ),
    ],
)
def test_lists_that_fit_no_rig_are_refused(given, expected):
    with pytest.raises(SettingError, match=expected):
        checked = values(**given)
        limits_from(checked)
        sigma_from(checked)


def test_nodes_of_one_device_agree_but_for_their_processes():
    agreeing = {
        'fkm': {'rate': 1.0, 'realtime.cpus': '1'},
        'teleop': {'realtime.cpus': '2'},
        'encoder_driver': {'rate': 1.0},
    }
    check_agreement(agreeing)
    with pytest.raises(
        SettingError,
        match="'rate' is 2.0; expected the same value in teleop as "
        r'in fkm \(1.0\)',
    ):
        check_agreement({**agreeing, 'teleop': {'rate': 2.0}})
