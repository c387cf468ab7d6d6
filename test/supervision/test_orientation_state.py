# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of `state`, made and read back."""

import pytest
from spm_haptic_master.supervision import orientation_state as states

WORDS = {
    'starting': states.STARTING,
    'healthy': states.HEALTHY,
    'degraded: joint_3b missing': states.OrientationState(
        states.Condition.DEGRADED, 'joint_3b missing'
    ),
    'silent: 2 publishers on measured_js: fkm, other': states.silent(
        '2 publishers on measured_js: fkm, other'
    ),
}


@pytest.mark.parametrize('text', WORDS)
def test_the_words_of_a_state_are_read_back(text):
    assert states.read_state(text) == WORDS[text]
    assert WORDS[text].text == text
    assert states.read_state(text).publishes is text.startswith(('healthy', 'degraded'))


@pytest.mark.parametrize(
    'text',
    [
        '',
        'silence',
        'silent',
        'silent: ',
        'healthy: but',
        'degraded',
        'healthy; joint_3a unchecked',
        'Healthy',
    ],
)
def test_other_words_are_no_state_and_count_as_silence(text):
    assert states.read_state(text) is None
    assert states.received_state(text) == states.silent(f'unknown state {text!r}')


@pytest.mark.parametrize(
    ('text', 'joints'),
    [
        ('degraded: joint_1a excluded, joint_3b missing', ('joint_1a', 'joint_3b')),
        ('degraded: joint_3b missing, joint_1a excluded', ('joint_1a', 'joint_3b')),
        ('degraded: joint_3a jumped', ('joint_3a',)),
        ('healthy', ()),
        ('silent: joint_3a frozen', ()),
    ],
)
def test_the_joints_left_out_are_those_that_a_degraded_state_names(text, joints):
    assert states.read_state(text).left_out == joints
