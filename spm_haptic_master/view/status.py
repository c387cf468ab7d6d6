# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What a device reports in words: its banner and the states of its encoders."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from math import inf
import re

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision import orientation_state
from spm_haptic_master.supervision.orientation_state import OrientationState
from spm_haptic_master.view.names import with_sensor_names
from spm_haptic_master.view.status_entries import ORIENTATION, StatusEntries

# Time without new joint angles after which the picture is stale (s): a silence has to be visible
# within half a second.
STALE_AFTER = 0.25
# Longest time between two ticks that is no pause of this process (s): two periods.
LONGEST_TICK = 0.1
# Time without a check by the others after which an encoder is unchecked (s): less is a moment on
# the way through a singularity, and the figures come once a second.
UNCHECKED_AFTER = 1.0
# A joint in the reason of a state, with the words about it up to the next comma.
CLAUSE = re.compile(r'\b(joint_[13][abc])\b([^,;]*)')
# Words of a clause about a joint that has no reading: it may be in order.
NO_READING = re.compile(r'missing|no answer|no reading')


class Light(Enum):
    """State as a colour in CSS, under white text, and as a sign for whoever sees no colour."""

    GREEN = '#1a7f37', '\u2713'
    AMBER = '#9a5000', '!'
    RED = '#b42318', '\u2715'
    GREY = '#57606a', '\u2026'

    def __init__(self, colour: str, sign: str) -> None:
        self.colour = colour
        self.sign = sign


@dataclass(frozen=True, slots=True)
class Banner:
    """The words above the picture."""

    light: Light
    text: str  # state in words, with the reason
    # Whether the picture is the device's present pose; if not, it is grey and does not move.
    alive: bool
    # The same words without how long it has been so: it changes when the state does.
    event: str


class SampleAge:
    """
    Time since joint angles last came, as far as this process has had the time to read them.

    Attributes
    ----------
    value : float or None
        Age, s; None before the first angles.

    """

    def __init__(self) -> None:
        self.value: float | None = None  # s, None before the first
        # When they came, when the last tick was (s), and whether it was late.
        self._came = self._ticked = -inf
        self._late = False

    def renew(self, now: float) -> None:
        """Note joint angles that came at a time, s."""
        self._came = now
        self.value = 0.0

    def tick(self, now: float) -> None:
        """
        Advance to a time, s; call it every 50 ms.

        Parameters
        ----------
        now : float
            Present time on the same clock as of `renew`.

        """
        late = now - self._ticked > LONGEST_TICK
        # After a pause of this process itself, what came meanwhile is not read yet.
        if self.value is not None and (self._late or not late):
            self.value = now - self._came
        self._ticked = now
        self._late = late


def banner(
    state: OrientationState | None,
    age: float | None,
    diagnostics: str = '',
    heard: bool = True,
) -> Banner:
    """
    Return the banner for the latest state and the time since joint angles came.

    Parameters
    ----------
    state : OrientationState or None
        latest state, None before the first
    age : float or None
        time since joint angles came, s; None before the first
    diagnostics : str
        reason of the node diagnostics why there are no joint angles; empty: none
    heard : bool
        whether `fkm` is on /diagnostics: if not, its latched `state` may be an old one

    """
    if state is not None and state.condition is orientation_state.Condition.SILENT:
        return _banner(Light.RED, state.text)
    if age is None:
        return _before_angles(state, diagnostics)
    source = f'(diagnostics: {diagnostics})' if diagnostics else '(diagnostics)'
    if age <= STALE_AFTER:
        return _with_angles(state)
    return _without_angles(state, age, source, heard)


def _banner(
    light: Light,
    text: str,
    event: str = '',
    alive: bool = False,
) -> Banner:
    """Return the banner of words, and of the event if these differ, with the page's names."""
    text = with_sensor_names(text)
    return Banner(
        light=light,
        text=text,
        alive=alive,
        event=with_sensor_names(event) or text,
    )


def _before_angles(state: OrientationState | None, diagnostics: str) -> Banner:
    """Return the banner of a device whose joint angles have not come yet."""
    if state is not None and state.publishes:
        cause = f'diagnostics: {diagnostics}' if diagnostics else 'start diagnostics'
        return _banner(Light.AMBER, f'{state.text}, but no joint_states ({cause})')
    return _banner(Light.GREY, 'waiting for fkm' if state is None else state.text)


def _with_angles(state: OrientationState | None) -> Banner:
    """Return the banner of a device whose joint angles are of now."""
    if state is None:
        return _banner(Light.AMBER, 'state unknown: fkm publishes it')
    if state == orientation_state.HEALTHY:
        light = Light.GREEN
    else:
        light = Light.AMBER
    return _banner(light, state.text, alive=state.publishes)


def _without_angles(
    state: OrientationState | None,
    age: float,
    source: str,
    heard: bool,
) -> Banner:
    """Return the banner of a device whose joint angles have not come for an age, s."""
    since = f' for {age:.0f} s' if age >= 1.0 else f' for {STALE_AFTER:g} s'
    if not heard:
        event = orientation_state.silent('nothing from fkm, no joint_states').text
        return _banner(Light.RED, f'{event}{since}', event)
    if state is not None and state.publishes:
        # fkm publishes orientations: joint_states alone are missing.
        return _banner(Light.RED, f'no joint_states{since} {source}', f'no joint_states {source}')
    event = orientation_state.silent('no orientation').text
    return _banner(Light.RED, f'{event}{since}', event)


class SensorState(Enum):
    """
    State of an encoder: its words, its colour in CSS, and its sign.

    Attributes
    ----------
    words : str
        Words for a chip's title and for events.
    colour : str
        Colour in CSS.
    sign : str
        One character, for whoever sees no colour.

    """

    HEALTHY = 'healthy', Light.GREEN.colour, '\u2713'
    UNCHECKED = 'not checked by the others', Light.AMBER.colour, '?'
    EXCLUDED = 'faulty, excluded', Light.RED.colour, '\u2715'
    MISSING = 'no reading', '#24292f', '\u2205'
    UNKNOWN = 'unknown', Light.GREY.colour, '\u2026'

    def __init__(
        self,
        words: str,
        colour: str,
        sign: str,
    ) -> None:
        self.words = words
        self.colour = colour
        self.sign = sign


def sensor_states(
    entries: StatusEntries,
    sensors: int,
    state: OrientationState | None,
    unread: Collection[str] = (),
) -> list[SensorState]:
    """
    Return the state of each sensor, in the order of a sample.

    Parameters
    ----------
    entries : StatusEntries
        of the device on /diagnostics
    sensors : int
        number of them, 4 to 6
    state : OrientationState or None
        state of the orientation, None if it is not known
    unread : collection of str
        joints that had no number in the latest readings

    """
    why = '' if state is None else state.why
    clauses = {match[1]: match[2] for match in CLAUSE.finditer(why)}
    without = {name for name, words in clauses.items() if NO_READING.search(words)}
    missing = without.union(entries.missing_joints(), unread)
    figures = entries.numbers(ORIENTATION)
    return [
        _sensor_state(name in missing, name in clauses, figures.get(f'{name} unchecked (s)'))
        for name in ALL_JOINT_NAMES[:sensors]
    ]


def _sensor_state(
    missing: bool,
    faulty: bool,
    unchecked: float | None,
) -> SensorState:
    """Return the state of a sensor: without a reading, named as faulty, unchecked for s."""
    if missing:
        return SensorState.MISSING
    if faulty:
        return SensorState.EXCLUDED
    if unchecked is None:
        return SensorState.UNKNOWN
    if unchecked > UNCHECKED_AFTER:
        return SensorState.UNCHECKED
    return SensorState.HEALTHY
