# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Whether this machine is too busy: one rule, for every node.

A periodic task that runs more than one period late has lost that time. The machine is too busy
while the time lost within a second exceeds `LIMIT`; symptoms meanwhile are not faults of the rig.
"""

from __future__ import annotations

from collections import deque
from math import floor, inf, log10

TOO_BUSY = 'this machine is too busy'
# Time for which lost time counts (s).
SPAN = 1.0
# Lost time within it that is too much (s): a pause that long silences fkm by default
# (sample_timeout).
LIMIT = 0.05
# Part of that limit below which the machine is no longer too busy.
LEAVE = 0.5
# Time after the first run of a task in which nothing counts (s): the process starts.
START = 1.0
# Longest time for which the overload explains a symptom (s), without the time lost: heartbeats
# return within a second.
EXPLAINED = 1.0
# Steps of reported times above a power of ten.
STEPS = (5, 2)


class Overload:
    """
    The time that a process lost because a task did not run in time.

    Parameters
    ----------
    period : float
        Time after which the task is due again, s.

    """

    def __init__(self, period: float) -> None:
        self._period = period
        # Time of the latest run, s; None before the first. Time after which lost time counts, s.
        self._last: float | None = None
        self._from = inf
        # When time was lost within the last `SPAN`, and how much, s.
        self._lost: deque[tuple[float, float]] = deque()
        # Largest lost time since the machine has been too busy, s; 0 while it is not.
        self._most = 0.0
        # Time in which the task ran in time, s.
        self._ran = 0.0
        # Symptom reported before the machine was too busy.
        self._known = ''
        # `_ran` when the symptom that it explains appeared; None without one.
        self._since: float | None = None
        # Message with the time lost; empty while the machine is not too busy.
        self.words = ''

    def tick(
        self,
        now: float,
        elsewhere: float = 0.0,
        reported: str = '',
    ) -> None:
        """
        Take a run of the task, and derive whether the machine is too busy.

        Parameters
        ----------
        now : float
            Time of the run, s, on a clock that is never set.
        elsewhere : float
            Time that other tasks of this process have lost since the last run, s.
        reported : str
            Words of another process of this machine that lost time.

        """
        if self._last is None:
            self._last = now
            self._from = now + START
        passed = now - self._last
        late = passed - self._period
        self._ran += min(passed, 2.0 * self._period)
        self._last = now
        lost_here = 0.0
        if late > self._period:
            lost_here = late
        # Tasks of one process lose the same time.
        lost_now = max(elsewhere, lost_here)
        if now - lost_now >= self._from:
            self._lost.append((now, lost_now))
        while self._lost and now - self._lost[0][0] > SPAN:
            self._lost.popleft()
        lost = sum(each for _, each in self._lost)
        limit = LIMIT
        if self._most:
            limit *= LEAVE
        if lost >= limit:
            self._most = max(self._most, lost)
            duration = more_than(self._most)
            self.words = f'{TOO_BUSY}: this process was due and did not run for {duration}'
        else:
            self._most = 0.0
            self.words = reported

    def explains(self, symptom: str) -> bool:
        """Return whether a symptom (empty: none) follows from the overload; call after `tick`."""
        if not self.words:
            self._known = symptom
            self._since = None
            return False
        if not symptom:
            self._since = None
        elif self._since is None and symptom != self._known:
            self._since = self._ran
        if self._since is None:
            return False
        return self._ran - self._since <= EXPLAINED


def more_than(seconds: float) -> str:
    """Return a time above 0, s, in words and in steps: each other figure would be logged."""
    power = 10.0 ** floor(log10(seconds))
    step = next((step for step in STEPS if seconds >= step * power), 1)
    return f'more than {step * power:g} s'
