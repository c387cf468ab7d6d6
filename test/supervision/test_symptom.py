# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which symptom is the cause of a sample, and what a person can do about it."""

import pytest
from spm_haptic_master.supervision.symptom import (
    how_to_check,
    Reason,
    Severity,
    Symptom,
    with_remedy,
    withheld,
    worst,
)

TILT = 'tilt the handle towards the centre of the workspace'
TURN = 'turn the handle about its axis, away from the singularity'


def test_the_words_name_the_sensor_if_it_is_known():
    assert Symptom(Reason.JUMPED, sensor=0).words == 'joint_1a jumped'
    assert Symptom(Reason.JUMPED, sensor=5).words == 'joint_3c jumped'
    assert Symptom(Reason.INCONSISTENT).words == 'inconsistent angles'


def test_the_cause_is_the_most_severe_symptom_and_rather_one_of_a_known_sensor():
    minor = withheld(Reason.UNDETERMINED, '')
    pending = Symptom(Reason.INCONSISTENT)
    of_one = Symptom(Reason.OUT_OF_RANGE, sensor=0)
    drifted = Symptom(Reason.DRIFTED, severity=Severity.LATCH)
    frozen = Symptom(Reason.FROZEN, sensor=2, severity=Severity.LATCH)
    assert minor.severity is Severity.WITHHOLD
    assert pending.severity is Severity.PENDING
    ascending = [minor, pending, of_one, drifted, frozen]
    for count in range(1, 6):
        assert worst(ascending[:count]) is ascending[count - 1]
        assert worst(ascending[:count][::-1]) is ascending[count - 1]


@pytest.mark.parametrize(
    ('sensors', 'words'),
    [
        ((0,), TILT),
        ((0, 1, 2), TILT),
        ((3,), TURN),
        ((4, 5), TURN),
        ((2, 3), f'{TILT} and {TURN}'),
    ],
)
def test_motor_sensors_are_checked_by_a_tilt_and_those_of_passive_joints_by_a_turn(sensors, words):
    assert how_to_check(sensors) == words


def test_a_message_says_what_to_do_where_that_is_known():
    assert with_remedy('joint_3b not checked yet', 'silent') == f'silent: {TURN}'
    assert with_remedy('joint_1a not checked yet', 'silent') == f'silent: {TILT}'
    assert 'calibrate --motion --check' in with_remedy('no orientation fits', 'silent')
    assert with_remedy('joint_1a jumped', 'silent') == 'silent'
