# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback as the parameters of fkm describe it."""

import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import ForceLimits
from spm_haptic_master.nodes.force_factory import limits_from, make_motors
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.parameters.setting import complete

DRIVES = {'force.without_drives': False, 'drives.interface': 'virtual',
          'drives.channel': 'bus_of_the_drives', 'drives.rated_torque': [0.5]}


def values(**given):
    return complete(NODE_SETTINGS['fkm'], given)


def test_the_defaults_are_those_of_the_limits():
    assert limits_from(values()) == ForceLimits()
    assert values()['force.enabled'] is False


@pytest.mark.parametrize(('given', 'words'), [
    ({'force.sigma_full': 0.05}, r'force.sigma_full.*0.05.*above force.sigma_off \(0.05\)'),
    ({'force.small_torque': 0.4}, r'force.small_torque.*0.4.*at most force.torque_limit \(0.3'),
    ({'rate': 200.0}, r"'rate' is 200.*at least 250 Hz with force.enabled"),
    ({'force.without_drives': False}, 'force.without_drives.*true where force.enabled'),
    ({**DRIVES, 'drives.node_id': [11, 12]}, r'drives.node_id.*\[11, 12\].*3 drives \(force'),
    ({**DRIVES, 'drives.torque_limit': 0.4}, r'drives.torque_limit.*0.4.*at least force.motor'),
])
def test_settings_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(SettingError, match=words):
        make_motors(values(**{'force.without_drives': True, **given}))


@pytest.mark.parametrize('motors', [3, 4])
def test_the_motors_of_a_described_device(motors):
    given = {'force.motors': motors, 'force.gravity_handle': [0.0, 0.0, 0.004]}
    controller, drives = make_motors(values(**given, **{'force.without_drives': True}))
    assert drives is None and controller.acknowledge() is False
    _, drives = make_motors(values(**given, **DRIVES, **{
        'drives.node_id': list(range(11, 11 + motors))}))
    assert drives.motors == motors
