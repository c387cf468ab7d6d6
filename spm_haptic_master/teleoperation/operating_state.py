# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The operating state of a CRTK device without motors: what a slave's controller lets go by.

    DISABLED --enable--> ENABLED <--pause, resume--> PAUSED; silence: FAULT; its end: DISABLED

A client keeps the last pose and takes it as valid, however old it is. A silent device is therefore
in FAULT, and comes back as DISABLED: only `enable` leads to ENABLED.
"""

from __future__ import annotations

from dataclasses import dataclass

# The states.
DISABLED, ENABLED, PAUSED, FAULT = 'DISABLED', 'ENABLED', 'PAUSED', 'FAULT'
# The commands.
COMMANDS = ('enable', 'disable', 'pause', 'resume', 'home', 'unhome')
# States of the orientation that are a fault, and in which there are orientations, by first words.
SILENT, USABLE = 'silent', ('healthy', 'degraded')


@dataclass(frozen=True, slots=True)
class Event:
    """
    A line for a client.

    Attributes
    ----------
    level : str
        'error', 'warning' or 'status': the topic.
    text : str
        The line.

    """

    level: str
    text: str


class OperatingState:
    """
    The state machine.

    Attributes
    ----------
    name : str
        DISABLED, ENABLED, PAUSED or FAULT.
    enabling : int
        Time of the command that led to ENABLED, ns, as that command gave it; 0 in any other state.

    """

    def __init__(self) -> None:
        self.name = DISABLED
        self.enabling = 0
        self._orientation = ''
        self._is_wanted_homed = True

    @property
    def is_homed(self) -> bool:
        """Return whether the device knows where it is: orientations come, and no `unhome`."""
        return self._is_wanted_homed and self._is_usable()

    def take(self, orientation: str) -> list[Event]:
        """Take the state of the orientation and return the events of a change."""
        if orientation == self._orientation:
            return []
        self._orientation = orientation
        events = []
        if orientation.startswith(SILENT):
            events.append(Event('error', orientation))
            self._enter(FAULT, events)
        elif not self._is_usable():
            self._enter(DISABLED, events)
        else:
            level = 'warning' if orientation.startswith('degraded') else 'status'
            events.append(Event(level, orientation))
            if self.name == FAULT:
                self._enter(DISABLED, events)
        return events

    def command(self, text: str, time: int) -> tuple[bool, list[Event]]:
        """
        Execute a command.

        Parameters
        ----------
        text : str
            One of `COMMANDS`.
        time : int
            Time at which it came, ns, above 0; two commands have different ones.

        Returns
        -------
        accepted : bool
            Whether it has an effect, or its effect is already there.
        events : list of Event
            What a client should know.

        """
        events: list[Event] = []
        refusal = self._refusal(text)
        if refusal:
            return False, [Event('warning', f"state_command '{text}': {refusal}")]
        if text in ('enable', 'resume'):
            self._enter(ENABLED, events)
            # Also for one that is enabled already: each enable is a fresh one.
            self.enabling = time
        elif text == 'pause':
            self._enter(PAUSED, events)
        elif text == 'home':
            self._is_wanted_homed = True
        else:
            if text == 'unhome':
                self._is_wanted_homed = False
            if self.name != FAULT:
                self._enter(DISABLED, events)
        return True, events

    def _refusal(self, text: str) -> str:
        """Return why a command cannot be executed; empty if it can."""
        if text not in COMMANDS:
            return f'expected one of {", ".join(COMMANDS)}'
        if text == 'enable':
            if not self._is_usable():
                return f'the orientation is {self._orientation or "not there"}'
            if not self._is_wanted_homed:
                return 'not homed, expected home before'
        if (text == 'resume' and self.name != PAUSED) \
                or (text == 'pause' and self.name not in (ENABLED, PAUSED)):
            return f'the state is {self.name}'
        return ''

    def _is_usable(self) -> bool:
        return self._orientation.startswith(USABLE)

    def _enter(self, name: str, events: list[Event]) -> None:
        if name != self.name:
            self.name = name
            events.append(Event('status', name))
        self.enabling = 0
