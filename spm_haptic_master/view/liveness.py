# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the picture of a device is alive, and the words above it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

# Time without new joint angles after which the picture is no longer that of the device (s): 15 of
# them are missing at 60 Hz, and half a second is the most that a silence may take to be seen.
STALE_AFTER = 0.25
# States of fkm in which orientations go out.
ALIVE = ('healthy', 'degraded')
# Time between two ticks from which on the second is late (s): two periods.
LONGEST_TICK = 0.1


class Light(Enum):
    """Colour of the banner, as CSS has it."""

    GREEN = '#1a7f37'
    AMBER = '#b35900'
    RED = '#b42318'
    GREY = '#57606a'


@dataclass(frozen=True, slots=True)
class Banner:
    """
    What is above the picture.

    Attributes
    ----------
    light : Light
        Its colour.
    text : str
        State in words, with the reason.
    alive : bool
        Whether the picture is the device's present pose; if not, it is grey and stands still.

    """

    light: Light
    text: str
    alive: bool


class SampleAge:
    """
    Time since joint angles last came, as far as this process has had the time to read them.

    Parameters
    ----------
    now : float
        Time, s.

    """

    def __init__(self, now: float) -> None:
        # Time since they came (s); None before the first.
        self.value: float | None = None
        self._came: float | None = None
        # When the last tick was (s), and whether it was late: this process stood still.
        self._ticked, self._late = now, False

    def renew(self, now: float) -> None:
        """Have joint angles at a time, s."""
        self._came, self.value = now, 0.0

    def tick(self, now: float) -> None:
        """Let the time go on to now, s; call it every 50 ms."""
        late = now - self._ticked > LONGEST_TICK
        if self._came is not None:
            age = max(0.0, now - self._came)
            # After a pause of this process itself, what came meanwhile is not read yet.
            self.value = min(age, (self.value or 0.0) + LONGEST_TICK) \
                if late and not self._late else age
        self._ticked, self._late = now, late


def banner(state: str, age: float | None, diagnostics: str = '', heard: bool = True) -> Banner:
    """
    Return the banner of a device.

    Parameters
    ----------
    state : str
        Latest text on the topic `state`; empty before the first.
    age : float or None
        Time since joint angles last came, s; None before the first.
    diagnostics : str, optional
        Why the node `diagnostics` has no joint angles, in its words; empty where it gives no
        reason.
    heard : bool, optional
        Whether `fkm` is on /diagnostics. `state` is latched: without that it may be an old one.

    """
    if state.startswith('silent'):
        return Banner(Light.RED, state, False)
    of_diagnostics = f'(diagnostics{diagnostics and f": {diagnostics}"})'
    if age is None:
        if state.startswith(ALIVE):
            return Banner(Light.AMBER, f'{state}, but no joint_states {of_diagnostics}', False)
        return Banner(Light.GREY, state or 'waiting for fkm', False)
    if age > STALE_AFTER:
        since = f'for {age:.0f} s' if age >= 1.0 else f'for {STALE_AFTER:g} s'
        if not heard:
            return Banner(Light.RED, f'silent: nothing from fkm, no joint_states {since}', False)
        # With a state in which orientations go out it is not these that are missing.
        missing = f'no joint_states {since} {of_diagnostics}' \
            if state.startswith(ALIVE) else f'silent: no orientation {since}'
        return Banner(Light.RED, missing, False)
    if state == 'healthy':
        return Banner(Light.GREEN, state, True)
    if state.startswith(ALIVE):
        return Banner(Light.AMBER, state, True)
    return Banner(Light.AMBER, state or 'state unknown: fkm publishes it', False)
