# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device reports: its entries on /diagnostics, its banner, the states of its encoders."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from math import inf

from diagnostic_msgs.msg import DiagnosticStatus
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, named_joints
from spm_haptic_master.ros.diagnostic_status import MISSING_KEY
from spm_haptic_master.supervision import orientation_state
from spm_haptic_master.supervision.orientation_state import OrientationState

# Time without new joint angles after which the picture is stale (s): a silence has to be visible
# within half a second.
STALE_AFTER = 0.25
# Longest time between two ticks that is no pause of this process (s): two periods.
LONGEST_TICK = 0.1
# Names of entries, without a namespace.
ENCODERS, ORIENTATION, TIMING = 'encoder_driver: encoders', 'fkm: orientation', 'fkm: timing'
SINGULARITY = 'diagnostics: singularity'
# Longest age of an entry (s): they come every second.
ENTRY_TIMEOUT = 2.5
# Time without a check by the others after which an encoder is unchecked (s): less is a moment on
# the way through a singularity, and the figures come once a second.
UNCHECKED_AFTER = 1.0


class Light(Enum):
    """Colour of the banner, as CSS has it."""

    GREEN = '#1a7f37'
    AMBER = '#b35900'
    RED = '#b42318'
    GREY = '#57606a'


@dataclass(frozen=True, slots=True)
class Banner:
    """The words above the picture."""

    light: Light
    text: str  # state in words, with the reason
    # Whether the picture is the device's present pose; if not, it is grey and does not move.
    alive: bool


class SampleAge:
    """Time since joint angles last came, as far as this process has had the time to read them."""

    def __init__(self) -> None:
        self.value: float | None = None  # s, None before the first
        # When they came, when the last tick was (s), and whether it was late.
        self._came = self._ticked = -inf
        self._late = False

    def renew(self, now: float) -> None:
        """Note joint angles that came at a time, s."""
        self._came, self.value = now, 0.0

    def tick(self, now: float) -> None:
        """Advance to a time, s; call it every 50 ms."""
        late = now - self._ticked > LONGEST_TICK
        # After a pause of this process itself, what came meanwhile is not read yet.
        if self.value is not None and (self._late or not late):
            self.value = now - self._came
        self._ticked, self._late = now, late


def banner(
    state: OrientationState | None, age: float | None, diagnostics: str = '', heard: bool = True
) -> Banner:
    """
    Return the banner for the latest state and the time since joint angles came, s, if any did.

    `diagnostics` is the reason of the node diagnostics why there are no joint angles. `heard` is
    whether `fkm` is on /diagnostics: if not, its latched `state` may be an old one.
    """
    text, publishes = ('', False) if state is None else (state.text, state.publishes)
    if state is not None and state.condition is orientation_state.Condition.SILENT:
        return Banner(Light.RED, text, False)
    of_diagnostics = f'(diagnostics{diagnostics and f": {diagnostics}"})'
    if age is None:
        if publishes:
            return Banner(Light.AMBER, f'{text}, but no joint_states {of_diagnostics}', False)
        return Banner(Light.GREY, text or 'waiting for fkm', False)
    if age <= STALE_AFTER:
        light = Light.GREEN if state == orientation_state.HEALTHY else Light.AMBER
        return Banner(light, text or 'state unknown: fkm publishes it', publishes)
    since = f'for {age:.0f} s' if age >= 1.0 else f'for {STALE_AFTER:g} s'
    if not heard:
        missing = orientation_state.silent(f'nothing from fkm, no joint_states {since}').text
    elif publishes:
        # fkm publishes orientations: joint_states alone are missing.
        missing = f'no joint_states {since} {of_diagnostics}'
    else:
        missing = orientation_state.silent(f'no orientation {since}').text
    return Banner(Light.RED, missing, False)


class SensorState(Enum):
    """State of an encoder: its words, and its colour in CSS."""

    HEALTHY = 'healthy', Light.GREEN.value
    UNCHECKED = 'not checked by the others', Light.AMBER.value
    EXCLUDED = 'faulty, excluded', Light.RED.value
    MISSING = 'no reading', '#24292f'
    UNKNOWN = 'unknown', Light.GREY.value

    def __init__(self, words: str, colour: str) -> None:
        self.words, self.colour = words, colour


class StatusEntries:
    """The latest entry of each name, of a device with a namespace: '' or '/NAME'."""

    def __init__(self, namespace: str) -> None:
        self._prefix = f'{namespace}/'.lstrip('/')
        # Entries by their name without namespace, and when they came (s, monotonic).
        self._entries: dict[str, tuple[DiagnosticStatus, float]] = {}
        # The present, s: the caller sets it.
        self.now = 0.0

    def take(self, entry: DiagnosticStatus, now: float) -> None:
        """Keep an entry if it is this device's."""
        name = entry.name.removeprefix(self._prefix)
        if '/' not in name and entry.name.startswith(self._prefix):
            self._entries[name] = entry, now

    def has_ended(self, name: str) -> bool:
        """Return whether an entry came once, but not lately."""
        return name in self._entries and self.entry(name) is None

    def entry(self, name: str) -> DiagnosticStatus | None:
        """Return an entry, None if there is none or only an old one."""
        entry, came = self._entries.get(name, (None, 0.0))
        return entry if self.now - came <= ENTRY_TIMEOUT else None

    def texts(self, name: str) -> dict[str, str]:
        """Return the values of an entry by key; none without one."""
        entry = self.entry(name)
        return {} if entry is None else {value.key: value.value for value in entry.values}

    def numbers(self, name: str) -> dict[str, float]:
        """Return the values of an entry that are numbers, by key."""
        found = {}
        for key, text in self.texts(name).items():
            with suppress(ValueError):
                found[key] = float(text)
        return found

    def missing_joints(self) -> tuple[str, ...]:
        """Return the joints of which the driver has no reading."""
        entry = self.entry(ENCODERS)
        # Without a set the message names the encoders that do not answer.
        if entry is not None and entry.level == DiagnosticStatus.ERROR:
            return named_joints(entry.message)
        return named_joints(self.texts(ENCODERS).get(MISSING_KEY, ''))

    def sensor_states(self, sensors: int, state: OrientationState | None) -> list[SensorState]:
        """Return the state of each sensor, with the state of the orientation, if that is known."""
        missing, figures = self.missing_joints(), self.numbers(ORIENTATION)
        named = () if state is None else named_joints(state.why)

        def of(name: str) -> SensorState:
            if name in missing:
                return SensorState.MISSING
            if name in named:
                return SensorState.EXCLUDED
            unchecked = figures.get(f'{name} unchecked (s)')
            if unchecked is None:
                return SensorState.UNKNOWN
            return SensorState.UNCHECKED if unchecked > UNCHECKED_AFTER else SensorState.HEALTHY

        return [of(name) for name in ALL_JOINT_NAMES[:sensors]]
