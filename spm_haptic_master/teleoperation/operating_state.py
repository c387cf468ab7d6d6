# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The operating state of a CRTK device without motors, on which a slave's controller releases.

    DISABLED --enable--> ENABLED <--pause, resume--> PAUSED; silence: FAULT; its end: DISABLED

dVRK's C++ keeps the last pose and takes it as valid, however old it is. A silent device is
therefore in FAULT, and comes back as DISABLED: only `enable` leads to ENABLED. Some clients check
`is_homed` alone: it is true in ENABLED only, where the pose may be followed.
"""

from __future__ import annotations

from spm_haptic_master.supervision.orientation_state import Condition, OrientationState

# The states.
DISABLED = 'DISABLED'
ENABLED = 'ENABLED'
PAUSED = 'PAUSED'
FAULT = 'FAULT'
# The commands.
COMMANDS = ('enable', 'disable', 'pause', 'resume', 'home', 'unhome')
# A line for a client: its topic ('error', 'warning' or 'status'), and its text.
Event = tuple[str, str]


class OperatingState:
    """The state machine."""

    def __init__(self) -> None:
        self.name = DISABLED
        # Time of the command since which the device is enabled and homed, ns; 0 while it is not.
        self.enabling = 0
        self._orientation: OrientationState | None = None
        self._is_wanted_homed = True

    @property
    def is_homed(self) -> bool:
        """Return whether the pose may be followed: the device is enabled, and no `unhome` came."""
        return self._is_wanted_homed and self.name == ENABLED

    def take(self, orientation: OrientationState) -> list[Event]:
        """Take the state of the orientation and return the events of a change."""
        if orientation == self._orientation:
            return []
        self._orientation = orientation
        if orientation.condition is Condition.SILENT:
            return [('error', orientation.text), *self._enter(FAULT)]
        if not orientation.publishes:
            return self._enter(DISABLED)
        level = 'warning' if orientation.condition is Condition.DEGRADED else 'status'
        recovery = self._enter(DISABLED) if self.name == FAULT else []
        return [(level, orientation.text), *recovery]

    def command(self, text: str, time: int) -> tuple[bool, list[Event]]:
        """
        Execute one of `COMMANDS` that came at a time, ns, above 0 and another one for each.

        Return whether it has an effect, or its effect is already there, and the events.
        """
        refusal = self._refusal(text)
        if refusal:
            return False, [('warning', f"state_command '{text}': {refusal}")]
        return True, self._execute(text, time)

    def _execute(self, text: str, time: int) -> list[Event]:
        """Execute a command that is not refused, and return its events."""
        if text in ('enable', 'resume'):
            events = self._enter(ENABLED)
            # Also for one that is enabled already: each enable is a fresh one.
            self.enabling = time if self._is_wanted_homed else 0
            return events
        if text == 'pause':
            return self._enter(PAUSED)
        if text == 'home':
            self._is_wanted_homed = True
            if self.name != ENABLED:
                return [('status', 'homed once enabled: expected enable')]
            self.enabling = self.enabling or time
            return []
        if text == 'unhome':
            self._is_wanted_homed = False
        return [] if self.name == FAULT else self._enter(DISABLED)

    def _refusal(self, text: str) -> str:
        """Return why a command cannot be executed; empty if it can."""
        if text not in COMMANDS:
            return f'expected one of {", ".join(COMMANDS)}'
        orientation = self._orientation
        if text == 'enable' and (orientation is None or not orientation.publishes):
            return 'the orientation is ' + (
                'not there' if orientation is None else orientation.text
            )
        if (text == 'resume' and self.name != PAUSED) or (
            text == 'pause' and self.name not in (ENABLED, PAUSED)
        ):
            return f'the state is {self.name}'
        return ''

    def _enter(self, name: str) -> list[Event]:
        """Enter a state, or the same again, in which no enable is in effect yet; return events."""
        self.enabling = 0
        if name == self.name:
            return []
        self.name = name
        return [('status', name)]
