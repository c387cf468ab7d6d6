# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Angles in, coherent sets out: what belongs to one cycle, and what must not go out.

With SYNC, a set is the four answers to one SYNC and carries its time. Without, it is four frames
inside a window and carries the first one's time. A set is never put together from two cycles:
where that cannot be excluded the set is dropped, and counted by reason.
"""

from __future__ import annotations

from collections import Counter

from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.meters import LatencyMeter

# A cycle counts as overdue when it begins this many periods after the one before.
OVERDUE = 1.5
# A missing answer may still come, in a later cycle, and nothing in it tells. So no set goes out
# until as many answers too many have come, or until the window has passed since SYNC, but for so
# many periods at least: the next cycle is always in doubt.
DOUBT_MINIMUM = 1.5
AFTERMATH = 'an answer to an earlier SYNC may be among them'


class SetAssembler:
    """
    Puts the angles of four encoders together into sets of one cycle.

    Parameters
    ----------
    joints : tuple of 4 str
        Names of the joints, in the order of the angles.
    synchronised : bool
        SYNC opens a cycle; else its first frame does.
    window : float
        s; with SYNC, how long after it an answer still counts, and how late a missing one may
        still come; without, how far apart the four frames of a set may be.
    period : float
        s; nominal time from cycle to cycle.

    Attributes
    ----------
    counters : collections.Counter
        'sets', 'cycles', and what was dropped, by reason.
    missed : list of int
        Cycles without an answer, for each joint.
    skew, jitter : LatencyMeter
        ns; first to last answer of a set; how far a cycle's beginning lies from a period after the
        one before.
    cause : str or None
        Why the latest cycle gave no set, None when it gave one.

    """

    def __init__(self, joints: tuple[str, ...], synchronised: bool, window: float,
                 period: float):
        self._joints = joints
        self._synchronised = synchronised
        self._window = window
        self._period = period
        self.counters: Counter[str] = Counter()
        self.missed = [0] * len(joints)
        self.skew = LatencyMeter()
        self.jitter = LatencyMeter()
        self.cause: str | None = None
        self._start: float | None = None
        self._first = 0.0
        self._angles: list[float | None] = []
        self._answered = 0
        # Why this cycle's set may not go out, None while it may.
        self._spoiled: str | None = None
        # When the cycle before began, for the jitter.
        self._before: float | None = None
        # Answers that may still come to earlier SYNCs, and until when, s.
        self._owed = 0
        self._owed_until = 0.0
        self.reset()

    def reset(self) -> None:
        """Forget the cycle under way, as after a reconnection or at a recording's beginning."""
        self._clear()
        self._before = None
        self._owed = 0
        self._owed_until = 0.0

    def begin(self, stamp: float) -> None:
        """Open SYNC's cycle (its time, s) and judge the one before."""
        if self._start is not None and self._answered < len(self._joints):
            self._incomplete()
            self._doubt(self._start, len(self._joints) - self._answered)
        if stamp > self._owed_until:
            self._owed = 0
        self._clear()
        self._open(stamp)
        if self._owed:
            self._spoiled = AFTERMATH

    def answer(self, index: int, angle: float, stamp: float) -> JointSample | None:
        """Take the angle (rad) of one joint and its time; return the set it completes, if any."""
        joint = self._joints[index]
        if not self._synchronised:
            start = self._slide(index, stamp)
        elif self._start is None:
            self.counters['rejected: before the first SYNC'] += 1
            return None
        elif not 0.0 <= stamp - (start := self._start) <= self._window:
            self._spoil(f'answer from {joint} outside the window')
        if self._angles[index] is not None:
            self._spoil(f'two answers from {joint} in one cycle')
            if self._owed:
                self._doubt(start, -1)
            return None
        if not self._answered:
            self._first = stamp
        self._angles[index] = angle
        self._answered += 1
        if self._answered < len(self._joints):
            return None
        return self._complete(start, stamp)

    def _doubt(self, start: float, answers: int) -> None:
        """Expect so many more answers to earlier SYNCs, for as long as they may take."""
        self._owed += answers
        self._owed_until = start + max(self._window, DOUBT_MINIMUM * self._period)

    def _complete(self, start: float, stamp: float) -> JointSample | None:
        if self._spoiled is not None:
            self._drop(self._spoiled)
            return None
        self.counters['sets'] += 1
        self.cause = None
        self.skew.add(round((stamp - self._first) * 1e9))
        # The set is complete: no angle is None.
        sample = JointSample(round(start * 1e9), tuple(self._angles))  # type: ignore[arg-type]
        if not self._synchronised:
            self._clear()
        return sample

    def _open(self, stamp: float) -> None:
        self._start = stamp
        self.counters['cycles'] += 1
        if self._before is not None:
            late = stamp - self._before - self._period
            self.jitter.add(round(abs(late) * 1e9))
            if late > (OVERDUE - 1.0) * self._period:
                self.counters['overdue cycles'] += 1
        self._before = stamp

    def _slide(self, index: int, stamp: float) -> float:
        """Without SYNC: begin anew where this frame cannot belong with those collected."""
        if self._start is not None:
            inside = 0.0 <= stamp - self._start <= self._window
            if inside and self._angles[index] is None:
                return self._start
            self._incomplete()
            self._clear()
        self._open(stamp)
        return stamp

    def _clear(self) -> None:
        self._start = None
        self._angles = [None] * len(self._joints)
        self._answered = 0
        self._spoiled = None

    def _incomplete(self) -> None:
        missing = []
        for index, angle in enumerate(self._angles):
            if angle is None:
                self.missed[index] += 1
                missing.append(self._joints[index])
        self._drop(f'no answer from {", ".join(missing)}')

    def _spoil(self, reason: str) -> None:
        """Let this cycle give no set."""
        self.counters[f'rejected: {reason}'] += 1
        self._spoiled = reason

    def _drop(self, reason: str) -> None:
        self.counters['dropped sets'] += 1
        self.counters[f'dropped: {reason}'] += 1
        if reason != AFTERMATH:
            self.cause = reason
