# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words in which a symptom is published."""

import pytest
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.supervision.symptom import Symptom


@pytest.mark.parametrize('sensor', range(4))
def test_words_name_the_sensor(sensor):
    assert Symptom('jumped', '0.1 rad', sensor).words == f'{JOINT_NAMES[sensor]} jumped'


def test_words_without_a_sensor_are_the_reason():
    assert Symptom('inconsistent angles', 'parity 8').words == 'inconsistent angles'


def test_a_symptom_is_no_fault_and_not_passive_unless_its_monitor_decides_so():
    symptom = Symptom('jumped', '')
    assert (symptom.sensor, symptom.fault, symptom.passive) == (None, False, False)
