# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which lines of a log are printed, and which are counted first; without a clock.

A line that comes again within a period is counted. A count is printed before any newer line of
its node, so the last line about a node is its present.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

# Time in which a line that comes again is counted and not repeated (s).
REPEAT_PERIOD = 10.0
# Time without a further line after which counts are printed if the present is among them (s):
# what changes faster is summed up.
QUIET = 1.0


class Line(NamedTuple):
    """
    A line, as it is recognised again.

    Attributes
    ----------
    severity : int
        Its severity.
    text : str
        Its text.

    """

    severity: int
    text: str


class Printed(NamedTuple):
    """
    A line that is to be printed.

    Attributes
    ----------
    node : str
        Name of the node.
    line : Line
        The line.
    repeated : str
        How often it has come, in words; empty where it is printed at once.

    """

    node: str
    line: Line
    repeated: str = ''


@dataclass(slots=True)
class Repeats:
    """
    How often a line came since it was printed.

    Attributes
    ----------
    since : float
        Time at which it was printed, s.
    count : int
        How often it has come since then.

    """

    since: float
    count: int = 0


@dataclass(slots=True)
class NodeLines:
    """
    Lines of one node.

    Attributes
    ----------
    repeats : dict of Line to Repeats
        By line, in the order in which the lines came last.
    last : float
        Time at which one came last, s.
    printed : Line or None
        Line printed last; None before the first.

    """

    repeats: dict[Line, Repeats] = field(default_factory=dict)
    last: float = -inf
    printed: Line | None = None


class RepeatedLines:
    """The lines of all nodes of a process."""

    def __init__(self) -> None:
        self._nodes: dict[str, NodeLines] = {}

    def take(self, node: str, line: Line, now: float) -> list[Printed]:
        """
        Take a line and return what is to be printed now.

        Parameters
        ----------
        node : str
            Name of the node.
        line : Line
            Its line.
        now : float
            Time, s, on a clock that is never set.

        Returns
        -------
        list of Printed
            In this order.

        """
        printed = self.due(now)
        lines = self._nodes.setdefault(node, NodeLines())
        repeats = lines.repeats.pop(line, None)
        if repeats is None:
            printed += self._sum_up(node, now)
            printed.append(Printed(node, line))
            repeats, lines.printed = Repeats(now), line
        else:
            repeats.count += 1
        lines.repeats[line] = repeats
        lines.last = now
        return printed

    def due(self, now: float) -> list[Printed]:
        """Return what is to be printed now although no line has come."""
        printed = []
        for node, lines in self._nodes.items():
            if now >= _due(lines):
                printed += self._sum_up(node, now)
            for line in [line for line, repeats in lines.repeats.items()
                         if not repeats.count and now - repeats.since >= REPEAT_PERIOD]:
                del lines.repeats[line]
        return printed

    def wait(self, now: float) -> float | None:
        """Return the time until something may be due, s; None if nothing is counted."""
        first = min(map(_due, self._nodes.values()), default=inf)
        return None if first == inf else max(0.0, first - now)

    def end(self, now: float) -> list[Printed]:
        """Return all that is counted."""
        return [each for node in self._nodes for each in self._sum_up(node, now)]

    def _sum_up(self, node: str, now: float) -> list[Printed]:
        """Return the counted lines of a node, and begin to count them again."""
        lines = self._nodes[node]
        printed = []
        for line, repeats in lines.repeats.items():
            if repeats.count:
                times = 'time' if repeats.count == 1 else 'times'
                printed.append(Printed(node, line, f' ({repeats.count} more {times} in '
                                       f'{now - repeats.since:.0f} s)'))
                lines.repeats[line] = Repeats(now)
                lines.printed = line
        return printed


def _due(lines: NodeLines) -> float:
    """Return the time at which the counted lines of a node are to be printed, s; or infinity."""
    counted = [line for line, repeats in lines.repeats.items() if repeats.count]
    if not counted:
        return inf
    due = min(lines.repeats[line].since for line in counted) + REPEAT_PERIOD
    # The line that came last is the present. It is printed last already, or soon.
    present = next(reversed(lines.repeats))
    return due if lines.printed == present else min(due, lines.last + QUIET)
