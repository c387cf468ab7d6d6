# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The entries of one device on /diagnostics, while they are new, and the state of each encoder."""

from __future__ import annotations

from enum import Enum

from diagnostic_msgs.msg import DiagnosticStatus
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, named_joints
from spm_haptic_master.ros.diagnostic_status import MISSING_KEY
from spm_haptic_master.supervision.orientation_state import EXPLAINED, OrientationState
from spm_haptic_master.view.liveness import Light

# Names of entries, without a namespace.
ENCODERS, ORIENTATION, TIMING = 'encoder_driver: encoders', 'fkm: orientation', 'fkm: timing'
SINGULARITY = 'diagnostics: singularity'
# Longest age of an entry (s): they come every second.
ENTRY_TIMEOUT = 2.5
# Time without a check by the others after which an encoder is unchecked (s): less is a moment on
# the way through a singularity, and the figures come once a second.
UNCHECKED_AFTER = 1.0


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

    def take(self, entry: DiagnosticStatus, now: float) -> str:
        """Keep an entry; return its name without namespace, '' of another device's."""
        name: str = entry.name.removeprefix(self._prefix)
        if '/' in name or not entry.name.startswith(self._prefix):
            return ''
        self._entries[name] = entry, now
        return name

    def has_ended(self, name: str) -> bool:
        """Return whether an entry came before, and does no longer."""
        return name in self._entries and self.entry(name) is None

    def entry(self, name: str) -> DiagnosticStatus | None:
        """Return an entry, None without a new one."""
        entry, came = self._entries.get(name, (None, 0.0))
        return entry if self.now - came <= ENTRY_TIMEOUT else None

    def text(self, name: str, key: str) -> str:
        """Return the value of a key of an entry; empty without one."""
        entry = self.entry(name)
        return '' if entry is None else next(
            (value.value for value in entry.values if value.key == key), '')

    def numbers(self, name: str) -> dict[str, float]:
        """Return the numbers of an entry by key."""
        found = {}
        entry = self.entry(name)
        for value in entry.values if entry is not None else ():
            try:
                found[value.key] = float(value.value)
            except ValueError:
                continue
        return found

    def missing_joints(self) -> tuple[str, ...]:
        """Return the joints of which the driver has no reading."""
        entry = self.entry(ENCODERS)
        # Without a set the message names the encoders that do not answer.
        if entry is not None and entry.level == DiagnosticStatus.ERROR:
            return named_joints(entry.message)
        return named_joints(self.text(ENCODERS, MISSING_KEY))

    def sensor_states(self, sensors: int, state: OrientationState | None) -> list[SensorState]:
        """Return the state of each sensor, with the state of the orientation, if that is known."""
        missing, figures = self.missing_joints(), self.numbers(ORIENTATION)
        named = () if state is None or state.condition not in EXPLAINED \
            else named_joints(state.why)

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
