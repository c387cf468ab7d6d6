# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The CRTK operating state: silence is a fault, and only an enable leads back to ENABLED."""

from hypothesis import given, strategies
import pytest
from spm_haptic_master.supervision.orientation_state import Condition, received_state
from spm_haptic_master.teleoperation.operating_state import COMMANDS, OperatingState

EXPECTED = f'expected one of {", ".join(COMMANDS)}'
# What comes (=: the state of the orientation), and then: state, time of the enable in effect, and
# the lines; those of a refused command are a warning with the reason. Times are 1, 2, ...
ENABLED = [
    ('=healthy', 'DISABLED', 0, 'status healthy'),
    ('enable', 'ENABLED', 2, 'status ENABLED'),
]
SCRIPTS = {
    'a device is disabled until an orientation and an enable': [
        ('enable', 'DISABLED', 0, "refused 'enable': the orientation is not there"),
        ('=starting', 'DISABLED', 0),
        ('enable', 'DISABLED', 0, "refused 'enable': the orientation is starting"),
        ('=healthy', 'DISABLED', 0, 'status healthy'),
        ('=healthy', 'DISABLED', 0),
        ('enable', 'ENABLED', 6, 'status ENABLED'),
        # Another one is fresh.
        ('enable', 'ENABLED', 7),
    ],
    'silence is a fault at once, and the way back takes an enable': [
        *ENABLED,
        ('=silent: x', 'FAULT', 0, 'error silent: x', 'status FAULT'),
        ('enable', 'FAULT', 0, "refused 'enable': the orientation is silent: x"),
        ('disable', 'FAULT', 0),
        ('unhome', 'FAULT', 0),
        ('home', 'FAULT', 0, 'status homed once enabled: expected enable'),
        ('=healthy', 'DISABLED', 0, 'status healthy', 'status DISABLED'),
        ('enable', 'ENABLED', 9, 'status ENABLED'),
    ],
    'degraded stays enabled with a warning; a new start of the orientation disables': [
        *ENABLED,
        ('=degraded: x', 'ENABLED', 2, 'warning degraded: x'),
        ('=starting', 'DISABLED', 0, 'status DISABLED'),
    ],
    'pause and resume': [
        *ENABLED,
        ('pause', 'PAUSED', 0, 'status PAUSED'),
        ('pause', 'PAUSED', 0),
        ('resume', 'ENABLED', 5, 'status ENABLED'),
        ('resume', 'ENABLED', 5, "refused 'resume': the state is ENABLED"),
        ('disable', 'DISABLED', 0, 'status DISABLED'),
        ('disable', 'DISABLED', 0),
        ('pause', 'DISABLED', 0, "refused 'pause': the state is DISABLED"),
    ],
    # Clients of dVRK enable first and home then; that is no second enable.
    'unhome disables until home and enable, in any order': [
        *ENABLED,
        ('unhome', 'DISABLED', 0, 'status DISABLED'),
        ('enable', 'ENABLED', 0, 'status ENABLED'),
        ('home', 'ENABLED', 5),
        ('home', 'ENABLED', 5),
        ('unhome', 'DISABLED', 0, 'status DISABLED'),
        ('home', 'DISABLED', 0, 'status homed once enabled: expected enable'),
        ('enable', 'ENABLED', 9, 'status ENABLED'),
    ],
    'a pause homes nothing': [
        *ENABLED,
        ('unhome', 'DISABLED', 0, 'status DISABLED'),
        ('enable', 'ENABLED', 0, 'status ENABLED'),
        ('pause', 'PAUSED', 0, 'status PAUSED'),
        ('resume', 'ENABLED', 0, 'status ENABLED'),
    ],
    'an unknown command is named': [
        *ENABLED,
        *(
            (text, 'ENABLED', 2, f"refused '{text}': {EXPECTED}")
            for text in ('', 'ENABLE', 'move_cp', 'enable ')
        ),
    ],
}


@pytest.mark.parametrize('script', SCRIPTS)
def test_the_script_of_a_client(script):
    state = OperatingState()
    for time, (text, name, enabling, *lines) in enumerate(SCRIPTS[script], 1):
        if text.startswith('='):
            accepted = True
            events = state.take(received_state(text[1:]))
        else:
            accepted, events = state.command(text, time)
        # Homed is the same: a client that checks `is_homed` alone releases.
        assert (state.name, state.enabling, state.is_homed) == (name, enabling, enabling > 0)
        assert list(map(' '.join, events)) == [
            line.replace('refused', 'warning state_command') for line in lines
        ]
        assert accepted != any(line.startswith('refused') for line in lines)


@given(
    strategies.lists(
        strategies.sampled_from(
            [
                *COMMANDS,
                'nonsense',
                '=starting',
                '=healthy',
                '=degraded: x',
                '=silent: x',
                '=healthy: but',
                '=all is well',
            ]
        )
    )
)
def test_whatever_comes_only_a_command_leads_to_enabled(sequence):
    state = OperatingState()
    orientation = None
    homed = True
    for time, text in enumerate(sequence, 1):
        before = state.name
        if text.startswith('='):
            orientation = received_state(text[1:])
            state.take(orientation)
            assert state.name in (before, 'DISABLED', 'FAULT')
        else:
            accepted, _ = state.command(text, time)
            homed = text == 'home' or (homed and text != 'unhome')
            if state.name == 'ENABLED' and before != 'ENABLED':
                assert accepted
                assert text in ('enable', 'resume')
        check_state(state, orientation, homed)


def check_state(state, orientation, homed):
    """Check a state by the orientation and the homing that it was told of."""
    is_silent = orientation is not None and orientation.condition is Condition.SILENT
    assert (state.name == 'FAULT') == is_silent
    if state.name == 'ENABLED':
        assert orientation.publishes
        assert state.is_homed == homed
        assert (state.enabling > 0) == homed
    else:
        assert not state.is_homed
        assert state.enabling == 0
