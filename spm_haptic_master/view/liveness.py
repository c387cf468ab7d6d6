# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the picture of a device is alive, and the words above it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from spm_haptic_master.supervision.orientation_state import (
    Condition,
    HEALTHY,
    OrientationState,
    silent,
)

# Time without new joint angles after which the picture is no longer that of the device (s): 15 of
# them are missing at 60 Hz, and half a second is the most that a silence may take to be seen.
STALE_AFTER = 0.25
# Longest time between two ticks of which the second is not late (s): two periods.
LONGEST_TICK = 0.1


class Light(Enum):
    """Colour of the banner, as CSS has it."""

    GREEN = '#1a7f37'
    AMBER = '#b35900'
    RED = '#b42318'
    GREY = '#57606a'


@dataclass(frozen=True, slots=True)
class Banner:
    """What is above the picture."""

    light: Light
    text: str  # state in words, with the reason
    # Whether the picture is the device's present pose; if not, it is grey and does not move.
    alive: bool


class SampleAge:
    """Time since joint angles last came, as far as this process has had the time to read them."""

    def __init__(self, now: float) -> None:
        # Time since they came (s); None before the first.
        self.value: float | None = None
        self._came: float | None = None
        # When the last tick was (s), and whether it was late: this process stood still.
        self._ticked, self._late = now, False

    def renew(self, now: float) -> None:
        """Note joint angles that came at a time, s."""
        self._came, self.value = now, 0.0

    def tick(self, now: float) -> None:
        """Advance to a time, s; call it every 50 ms."""
        late = now - self._ticked > LONGEST_TICK
        if self._came is not None:
            age = max(0.0, now - self._came)
            # After a pause of this process itself, what came meanwhile is not read yet.
            self.value = min(age, (self.value or 0.0) + LONGEST_TICK) \
                if late and not self._late else age
        self._ticked, self._late = now, late


def banner(state: OrientationState | None, age: float | None, diagnostics: str = '',
           heard: bool = True) -> Banner:
    """
    Return the banner for the latest state and the time since joint angles came, s, if any did.

    `diagnostics` is why the node of that name has no joint angles, `heard` whether `fkm` is on
    /diagnostics: `state` is latched, and without that it may be an old one.
    """
    if state is not None and state.condition is Condition.SILENT:
        return Banner(Light.RED, state.text, False)
    publishes = state is not None and state.publishes
    text = '' if state is None else state.text
    of_diagnostics = f'(diagnostics{diagnostics and f": {diagnostics}"})'
    if age is None:
        if publishes:
            return Banner(Light.AMBER, f'{text}, but no joint_states {of_diagnostics}', False)
        return Banner(Light.GREY, text or 'waiting for fkm', False)
    if age > STALE_AFTER:
        since = f'for {age:.0f} s' if age >= 1.0 else f'for {STALE_AFTER:g} s'
        if not heard:
            return Banner(
                Light.RED, silent(f'nothing from fkm, no joint_states {since}').text, False)
        # With a state in which orientations go out it is not these that are missing.
        missing = f'no joint_states {since} {of_diagnostics}' \
            if publishes else silent(f'no orientation {since}').text
        return Banner(Light.RED, missing, False)
    light = Light.GREEN if state == HEALTHY else Light.AMBER
    return Banner(light, text or 'state unknown: fkm publishes it', publishes)
