# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which lines of a node's log are printed, and which are counted first; without a clock.

A line that comes again within a period is counted. A count is printed before any newer line, so
the last line about a node is its present.
"""

from __future__ import annotations

from math import inf

# Time in which a line that comes again is counted and not repeated (s).
REPEAT_PERIOD = 10.0
# Time without a further line after which counts are printed if the present is among them (s):
# what changes faster is summed up.
QUIET = 1.0

# Severity and text.
Line = tuple[int, str]


class RepeatedLines:
    """The lines of one node; times are s on a clock that is never set."""

    def __init__(self) -> None:
        # When each line was printed, and how often it came since; in the order of the last ones.
        self._lines: dict[Line, tuple[float, int]] = {}
        # When the latest line came, and which was printed last.
        self._last = -inf
        self._printed: Line | None = None

    def take(self, line: Line, now: float) -> list[Line]:
        """Take a line and return what is to be printed now, in this order."""
        printed = self.due(now)
        if line in self._lines:
            since, count = self._lines.pop(line)
            self._lines[line] = since, count + 1
        else:
            printed += [*self.counts(now), line]
            self._lines[line], self._printed = (now, 0), line
        self._last = now
        return printed

    def due(self, now: float) -> list[Line]:
        """Return what is to be printed now although no line has come."""
        printed = self.counts(now) if now >= self.due_at() else []
        self._lines = {line: (since, count) for line, (since, count) in self._lines.items()
                       if count or now - since < REPEAT_PERIOD}
        return printed

    def due_at(self) -> float:
        """Return the time at which the counts are to be printed; infinity without a count."""
        counted = [since for since, count in self._lines.values() if count]
        if not counted:
            return inf
        due = min(counted) + REPEAT_PERIOD
        # The line that came last is the present. It is printed last already, or soon.
        present = next(reversed(self._lines))
        return due if present == self._printed else min(due, self._last + QUIET)

    def counts(self, now: float) -> list[Line]:
        """Return the counted lines with their counts, and begin to count them again."""
        printed = []
        for line, (since, count) in self._lines.items():
            if count:
                severity, text = line
                printed.append((severity, f'{text} ({count} more time{"s" * (count > 1)} in '
                                f'{now - since:.0f} s)'))
                self._lines[line], self._printed = (now, 0), line
        return printed
