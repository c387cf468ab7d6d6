# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The state of each encoder, and its colour."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus
from spm_haptic_master.joints import ALL_JOINT_NAMES, named_joints
from spm_haptic_master.orientation_state import EXPLAINED, OrientationState
from spm_haptic_master.ros.diagnostic_status import MISSING_KEY
from spm_haptic_master.view.liveness import Light
from spm_haptic_master.view.status_entries import StatusEntries

# Time without a check by the others after which an encoder is unchecked (s): less is a moment on
# the way through a singularity, and the figures come once a second.
UNCHECKED_AFTER = 1.0


class Look(NamedTuple):
    """Words and colour (CSS) of a state."""

    words: str
    colour: str


class SensorState(Enum):
    """State of an encoder."""

    HEALTHY = Look('healthy', Light.GREEN.value)
    UNCHECKED = Look('not checked by the others', Light.AMBER.value)
    EXCLUDED = Look('faulty, excluded', Light.RED.value)
    MISSING = Look('no reading', '#24292f')
    UNKNOWN = Look('unknown', Light.GREY.value)


def missing_joints(entries: StatusEntries, now: float) -> tuple[str, ...]:
    """Return the joints of which the driver has no reading at a time, s."""
    entry = entries.entry('encoder_driver: encoders', now)
    # Without a set the message names who does not answer.
    if entry is not None and entry.level == DiagnosticStatus.ERROR:
        return named_joints(entry.message)
    return named_joints(entries.text('encoder_driver: encoders', MISSING_KEY, now))


def sensor_states(sensors: int, state: OrientationState | None, entries: StatusEntries,
                  now: float) -> list[SensorState]:
    """
    Return the state of each sensor.

    Parameters
    ----------
    sensors : int
        Number of sensors.
    state : OrientationState or None
        State of the orientation; None before the first.
    entries : StatusEntries
        Entries of the device on /diagnostics.
    now : float
        Time, s.

    """
    missing = missing_joints(entries, now)
    named = () if state is None or state.condition not in EXPLAINED else named_joints(state.why)
    figures = entries.numbers('fkm: orientation', now)

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
