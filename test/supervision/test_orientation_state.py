# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The words of `state`, made and read back."""

import pytest
from spm_haptic_master.supervision import orientation_state as states
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld

MS = 1_000_000
NO_NUMBER = withheld(Reason.NOT_FINITE, 'nan')
AWAITED = withheld(Reason.STARTING, '1 of 5')
INCONSISTENT = Symptom(Reason.INCONSISTENT)

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


def withheld_at(machine, *milliseconds, cause=NO_NUMBER, fault=''):
    """Withhold samples at times, ms; return the words of the state."""
    for now in milliseconds:
        machine.withhold(round(now * MS), fault, cause)
    return machine.announced.text


@pytest.mark.parametrize(
    ('cause', 'later'),
    [
        # What more samples cannot end is silence after 20 ms; bad samples may belong to a start.
        (NO_NUMBER, 'silent: angle not finite'),
        (AWAITED, 'starting'),
        (INCONSISTENT, 'starting'),
    ],
)
def test_before_the_first_orientation_it_is_starting_for_20_ms_at_least(cause, later):
    machine = states.StateMachine()
    assert machine.announced is states.STARTING
    assert machine.waiting_since is None
    assert withheld_at(machine, 7000, 7019.999999, cause=cause) == 'starting'
    assert machine.waiting_since == 7000 * MS
    assert withheld_at(machine, 7020, cause=cause) == later
    assert machine.published is None


def test_a_fault_is_silence_at_once():
    machine = states.StateMachine()
    assert withheld_at(machine, 1, fault='joint_1b jumped') == 'silent: joint_1b jumped'
    machine.publish(2 * MS, '')
    assert withheld_at(machine, 3, fault='joint_1b jumped') == 'silent: joint_1b jumped'


def test_a_silence_of_less_than_20_ms_does_not_change_the_state():
    machine = states.StateMachine()
    machine.publish(100 * MS, '')
    assert withheld_at(machine, 101, 119.999999) == 'healthy'
    assert withheld_at(machine, 120) == 'silent: angle not finite'
    # Nor is it ended by a shorter one.
    machine.publish(200 * MS, 'joint_3b missing')
    assert withheld_at(machine, 201, 219) == 'degraded: joint_3b missing'
    assert withheld_at(machine, 220, cause=INCONSISTENT) == 'silent: inconsistent angles'
    assert withheld_at(machine, 205) == 'silent: angle not finite'


def test_a_published_orientation_is_healthy_or_degraded_by_its_reservations():
    machine = states.StateMachine()
    machine.publish(MS, '')
    assert machine.announced is states.HEALTHY
    assert machine.published == MS
    machine.publish(2 * MS, 'joint_3b missing')
    degraded = machine.announced
    assert degraded.text == 'degraded: joint_3b missing'
    machine.publish(3 * MS, 'joint_3b missing')
    # The same object until it changes.
    assert machine.announced is degraded
    machine.publish(4 * MS, '')
    assert machine.announced is states.HEALTHY


def test_after_a_restart_a_first_orientation_is_awaited_again():
    machine = states.StateMachine()
    withheld_at(machine, 1)
    machine.publish(2 * MS, '')
    machine.restart()
    assert machine.waiting_since is None
    assert machine.published is None
    assert machine.announced is states.HEALTHY
    assert withheld_at(machine, 3, 22) == 'starting'
    assert withheld_at(machine, 23) == 'silent: angle not finite'
