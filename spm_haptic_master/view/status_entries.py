# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The entries of one device on /diagnostics, as long as they are of now."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

# Longest age of an entry (s): they come every second.
ENTRY_TIMEOUT = 2.5


class StatusEntries:
    """
    The latest entry of each name.

    Parameters
    ----------
    prefix : str
        Namespace of the device, '' or '/NAME'.

    """

    def __init__(self, prefix: str) -> None:
        self._prefix = f'{prefix}/'.lstrip('/')
        # Entries by their name without namespace, and when they came (s, monotonic).
        self._entries: dict[str, tuple[DiagnosticStatus, float]] = {}

    def take(self, entry: DiagnosticStatus, now: float) -> str:
        """Keep an entry; return its name without namespace, '' of another device's."""
        name: str = entry.name.removeprefix(self._prefix)
        if '/' in name or not entry.name.startswith(self._prefix):
            return ''
        self._entries[name] = entry, now
        return name

    def has_come(self, name: str) -> bool:
        """Return whether an entry has ever come."""
        return name in self._entries

    def entry(self, name: str, now: float) -> DiagnosticStatus | None:
        """Return an entry, None without one that is as it should be at a time, s."""
        entry, came = self._entries.get(name, (None, 0.0))
        return entry if now - came <= ENTRY_TIMEOUT else None

    def text(self, name: str, key: str, now: float) -> str:
        """Return the value of a key of an entry; empty where there is none at a time, s."""
        entry = self.entry(name, now)
        return '' if entry is None else next(
            (value.value for value in entry.values if value.key == key), '')

    def numbers(self, name: str, now: float) -> dict[str, float]:
        """Return the numbers of an entry by key; none where there is no entry at a time, s."""
        found = {}
        entry = self.entry(name, now)
        for value in entry.values if entry is not None else ():
            try:
                found[value.key] = float(value.value)
            except ValueError:
                continue
        return found
