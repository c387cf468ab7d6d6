# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The latest entries of a device on /diagnostics."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticStatus
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, named_joints
from spm_haptic_master.ros.diagnostic_status import MISSING_KEY

# Names of entries, without a namespace.
ENCODERS = 'encoder_driver: encoders'
ORIENTATION = 'fkm: orientation'
TIMING = 'fkm: timing'
SINGULARITY = 'diagnostics: singularity'
# Longest age of an entry (s): they come every second.
ENTRY_TIMEOUT = 2.5


@dataclass(frozen=True, slots=True)
class EncoderDevice:
    """
    What the driver reports of an encoder beside its angle, once a second.

    Attributes
    ----------
    counts : str or None
        Counts as the encoder sent them last; None from a source without counts.
    serial : str or None
        Serial number of the CANopen node, or why there is none; None of an encoder that is no
        such node.

    """

    counts: str | None
    serial: str | None


class StatusEntries:
    """
    The latest entry of each name, of one device.

    Parameters
    ----------
    namespace : str
        Namespace of the device, '' or '/NAME'.

    Attributes
    ----------
    now : float
        Present time, s, monotonic; the caller sets it.

    """

    def __init__(self, namespace: str) -> None:
        self._prefix = f'{namespace}/'.lstrip('/')
        # Entries by their name without namespace, and when they came (s, monotonic).
        self._entries: dict[str, tuple[DiagnosticStatus, float]] = {}
        # The present, s: the caller sets it.
        self.now = 0.0

    def add(self, entry: DiagnosticStatus, now: float) -> None:
        """
        Keep an entry that came at a time, s, if it is this device's.

        Parameters
        ----------
        entry : DiagnosticStatus
            An entry of any node of any device.
        now : float
            Time at which it came, monotonic.

        """
        name = entry.name.removeprefix(self._prefix)
        if '/' not in name and entry.name.startswith(self._prefix):
            self._entries[name] = entry, now

    def has_ended(self, name: str) -> bool:
        """Return whether an entry came once, but not lately."""
        return name in self._entries and self.entry(name) is None

    def entry(self, name: str) -> DiagnosticStatus | None:
        """
        Return an entry, None if there is none or only an old one.

        Parameters
        ----------
        name : str
            Name of the entry without a namespace, such as ORIENTATION.

        Returns
        -------
        DiagnosticStatus or None
            The latest one, if it is not older than ENTRY_TIMEOUT.

        """
        entry, came = self._entries.get(name, (None, 0.0))
        if self.now - came <= ENTRY_TIMEOUT:
            return entry
        return None

    def texts(self, name: str) -> dict[str, str]:
        """Return the values of an entry by key; none without one."""
        entry = self.entry(name)
        if entry is None:
            return {}
        return {value.key: value.value for value in entry.values}

    def numbers(self, name: str) -> dict[str, float]:
        """
        Return the values of an entry that are numbers, by key.

        Parameters
        ----------
        name : str
            Name of the entry without a namespace.

        Returns
        -------
        dict
            Values in the units that their keys have.

        """
        found = {}
        for key, text in self.texts(name).items():
            with suppress(ValueError):
                found[key] = float(text)
        return found

    def encoders(self) -> dict[str, EncoderDevice]:
        """Return what the driver reports of each encoder, by joint; nothing without a driver."""
        if self.entry(ENCODERS) is None:
            return {}
        values = self.texts(ENCODERS)
        return {
            joint: EncoderDevice(
                values.get(f'{joint} counts'), values.get(f'{joint} serial number')
            )
            for joint in ALL_JOINT_NAMES
        }

    def missing_joints(self) -> tuple[str, ...]:
        """Return the joints of which the driver has no reading."""
        entry = self.entry(ENCODERS)
        # Without a set the message names the encoders that do not answer.
        if entry is not None and entry.level == DiagnosticStatus.ERROR:
            return named_joints(entry.message)
        return named_joints(self.texts(ENCODERS).get(MISSING_KEY, ''))
