# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words in which a symptom is reported."""

import pytest
from spm_haptic_master.supervision.symptom import Symptom


@pytest.mark.parametrize(('symptom', 'text'), [
    (Symptom('jumped', '', 0), 'joint_1a jumped'),
    (Symptom('jumped', '', 3), 'joint_3a jumped'),
    (Symptom('jumped', ''), 'jumped, sensor undetermined'),
    (Symptom('inconsistent angles', ''), 'inconsistent angles, sensor undetermined'),
    (Symptom('no orientation fits', ''), 'no orientation fits'),
    (Symptom('joint_1a jumped and joint_3a frozen', '', complete=True),
     'joint_1a jumped and joint_3a frozen'),
])
def test_text_names_the_sensor_or_that_it_is_undetermined(symptom, text):
    assert symptom.text == text


def test_a_symptom_is_no_fault_unless_its_monitor_decides_so():
    symptom = Symptom('jumped', '')
    assert not (symptom.fault or symptom.self_timed or symptom.complete)
