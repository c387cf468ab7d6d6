# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CRTK operating state: silence is a fault, and only an enable leads back to ENABLED."""

from hypothesis import given, strategies
import pytest
from spm_haptic_master.orientation_state import Condition, read_state, received_state
from spm_haptic_master.teleoperation.operating_state import COMMANDS, OperatingState


def enabled():
    state = OperatingState()
    state.take(read_state('healthy'))
    assert state.command('enable', 5)[0]
    return state


def lines(events):
    return [(event.level, event.text) for event in events]


def test_a_healthy_device_is_disabled_until_enable():
    state = OperatingState()
    assert (state.name, state.is_homed, state.enabling) == ('DISABLED', False, 0)
    assert lines(state.take(read_state('starting'))) == []
    assert lines(state.take(read_state('healthy'))) == [('status', 'healthy')]
    assert (state.name, state.is_homed, state.enabling) == ('DISABLED', False, 0)
    accepted, events = state.command('enable', 5)
    assert accepted and lines(events) == [('status', 'ENABLED')]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', True, 5)


def test_silence_is_a_fault_at_once_and_the_way_back_takes_an_enable():
    state = enabled()
    assert lines(state.take(read_state('silent: no joint samples'))) == [
        ('error', 'silent: no joint samples'), ('status', 'FAULT')]
    assert (state.name, state.is_homed, state.enabling) == ('FAULT', False, 0)
    # A client that sends it nevertheless is told why.
    accepted, events = state.command('enable', 6)
    assert not accepted and 'silent: no joint samples' in events[0].text
    assert state.command('disable', 7) == (True, [])
    assert state.name == 'FAULT'
    assert lines(state.take(read_state('healthy'))) == [
        ('status', 'healthy'), ('status', 'DISABLED')]
    assert state.command('enable', 8)[0] and state.name == 'ENABLED'


def test_degraded_stays_enabled_with_a_warning():
    state = enabled()
    assert lines(state.take(read_state('degraded: joint_3a stuck'))) == [
        ('warning', 'degraded: joint_3a stuck')]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', True, 5)


def test_an_enable_of_an_enabled_device_is_a_fresh_one():
    state = enabled()
    assert state.command('enable', 9) == (True, [])
    assert state.enabling == 9


def test_pause_and_resume():
    state = enabled()
    assert state.command('pause', 6)[0] and state.name == 'PAUSED' and state.enabling == 0
    assert state.command('resume', 7)[0] and state.name == 'ENABLED' and state.enabling == 7
    accepted, events = state.command('resume', 8)
    assert not accepted and 'the state is ENABLED' in events[0].text
    state.command('disable', 9)
    assert not state.command('pause', 10)[0] and state.name == 'DISABLED'


@pytest.mark.parametrize('command', ['disable', 'pause'])
def test_a_client_that_checks_is_homed_only_lets_go(command):
    state = enabled()
    assert state.command(command, 6)[0]
    assert not state.is_homed


def test_unhome_disables_until_home_and_enable_in_any_order():
    state = enabled()
    assert state.command('unhome', 6)[0]
    assert (state.name, state.is_homed, state.enabling) == ('DISABLED', False, 0)
    # Clients of dVRK enable first and home then.
    assert state.command('enable', 7)[0]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', False, 0)
    assert state.command('home', 8)[0]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', True, 8)
    # It is no second enable.
    assert state.command('home', 9)[0] and state.enabling == 8
    state.command('unhome', 10)
    accepted, events = state.command('home', 11)
    assert accepted and 'expected enable' in events[0].text
    assert (state.name, state.is_homed) == ('DISABLED', False)
    assert state.command('enable', 12)[0]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', True, 12)


def test_a_pause_homes_nothing():
    state = enabled()
    for time, command in enumerate(('unhome', 'enable', 'pause', 'resume'), 6):
        assert state.command(command, time)[0]
    assert (state.name, state.is_homed, state.enabling) == ('ENABLED', False, 0)


def test_a_start_over_of_the_orientation_disables():
    state = enabled()
    state.take(read_state('starting'))
    assert (state.name, state.is_homed) == ('DISABLED', False)


@pytest.mark.parametrize('text', ['', 'ENABLE', 'move_cp', 'enable '])
def test_an_unknown_command_is_named(text):
    state = enabled()
    accepted, (event,) = state.command(text, 6)
    assert not accepted and event.level == 'warning'
    assert f"state_command '{text}': expected one of enable, disable" in event.text
    assert state.name == 'ENABLED'


@given(strategies.lists(strategies.sampled_from(
    [*COMMANDS, 'nonsense', '=starting', '=healthy', '=degraded: x', '=silent: x',
     '=healthy: but', '=all is well'])))
def test_whatever_comes_only_a_command_leads_to_enabled(sequence):
    state, orientation, homed = OperatingState(), None, True
    for time, text in enumerate(sequence, 1):
        before = state.name
        if text.startswith('='):
            orientation = received_state(text[1:])
            state.take(orientation)
            assert state.name in (before, 'DISABLED', 'FAULT')
        else:
            accepted, _ = state.command(text, time)
            homed = homed and text != 'unhome' or text == 'home'
            if state.name == 'ENABLED' and before != 'ENABLED':
                assert accepted and text in ('enable', 'resume')
        if state.name == 'ENABLED':
            assert orientation.publishes
            assert state.is_homed == homed == (state.enabling > 0)
        else:
            assert not state.is_homed and state.enabling == 0
        assert (state.name == 'FAULT') == (
            orientation is not None and orientation.condition is Condition.SILENT)
