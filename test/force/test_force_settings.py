# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Force feedback as the parameters of fkm describe it, and the words of its state."""

from itertools import product

import pytest
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.force import Condition, ForceLimits, ForceState, read_force_state, Reason
from spm_haptic_master.force.force_state import EXPLAINED
from spm_haptic_master.force.settings import limits_from, make_controller
from spm_haptic_master.parameters.fkm import FKM_SETTINGS
from spm_haptic_master.parameters.setting import complete


def values(**given):
    return complete(FKM_SETTINGS, {
        name.replace('__', '.'): value for name, value in given.items()})


def test_the_defaults_are_those_of_the_limits():
    assert limits_from(values()) == ForceLimits()
    assert values()['force.enabled'] is False


@pytest.mark.parametrize(('given', 'words'), [
    ({'force__sigma_full': 0.05}, r'force.sigma_full.*0.05.*above force.sigma_off \(0.05\)'),
    ({'force__small_torque': 0.4}, r'force.small_torque.*0.4.*at most force.torque_limit \(0.3'),
    ({'rate': 200.0}, r"'rate' is 200.*at least 250 Hz with force.enabled"),
])
def test_settings_that_contradict_each_other_are_refused(given, words):
    with pytest.raises(SettingError, match=words):
        make_controller(values(**given))


@pytest.mark.parametrize('motors', [3, 4])
def test_a_controller_of_a_described_device(motors):
    controller = make_controller(values(
        force__motors=motors, force__gravity_handle=[0.0, 0.0, 0.004], rate=250.0))
    assert controller.acknowledge() is False


def test_every_word_of_the_state_is_read_as_it_was_made():
    whys = [None, *Reason]
    states = [ForceState(condition, why) for condition, why in product(Condition, whys)
              if (why is not None) is (condition in EXPLAINED)]
    assert len(states) == 4 + 2 * len(Reason)
    assert [read_force_state(state.text) for state in states] == states


@pytest.mark.parametrize('text', [
    '', 'on', 'fault', 'fading: ', 'fading', 'ready: disabled', 'fault: bad luck', 'ready '])
def test_other_words_are_no_state(text):
    assert read_force_state(text) is None
