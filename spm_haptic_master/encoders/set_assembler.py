# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Assembly of joint samples: the angles of one cycle make a set, anything else is dropped.

With SYNC, a set is one answer of each encoder to one SYNC and carries its time. Without, it is a
frame of each within a window and carries the time of the first. A set never mixes answers of two
cycles: where that cannot be excluded, the set is dropped and counted by reason.
"""

from __future__ import annotations

from collections import Counter

from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.meters import LatencyMeter

# Time from one cycle to the next beyond which the second counts as overdue (periods).
OVERDUE = 1.5
# Least time after an incomplete cycle's SYNC for which late answers are expected (periods): 1.5
# covers the next cycle whatever its jitter. An answer does not identify its SYNC, so a set is
# dropped until every missing answer has come in addition to its own, or until this time and the
# window have passed.
LATE_ANSWER_PERIODS = 1.5
# Reason for dropping a complete set while late answers are expected.
STALE_ANSWER = 'may contain an answer to an earlier SYNC'


class SetAssembler:
    """
    Assembles the angles of four, five or six encoders into sets of one cycle.

    Parameters
    ----------
    joints : tuple of N str
        Names of the joints, in the order of the angles.
    synchronised : bool
        Whether SYNC opens a cycle; otherwise the first frame does.
    window : float
        Time in s. With SYNC: longest time from SYNC to an answer, and to a late answer. Without:
        longest time between the frames of a set.
    period : float
        Nominal time from cycle to cycle, s.

    Attributes
    ----------
    counters : collections.Counter
        Numbers of 'sets' and 'cycles', and of what was rejected or dropped, by reason.
    missed : list of N int
        Cycles without an answer, by joint.
    skew : LatencyMeter
        Time from the first to the last answer of a set, ns.
    jitter : LatencyMeter
        Deviation of the time between two cycles from the period, ns.
    cause : str or None
        Reason why the latest cycle yielded no set, None if it yielded one.
    surplus : tuple of (float, str) or None
        Time, s, and description of the latest answer that came after a complete set and that no
        missing answer explains; None before the first. Two encoders may share an identifier.

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
        self.surplus: tuple[float, str] | None = None
        # Start of the open cycle and its first answer, s; set by `reset`, as are the following.
        self._start: float | None
        self._first: float
        self._angles: list[float | None]
        self._answered: int
        # Reason why the open cycle cannot yield a set, None while it can.
        self._invalid: str | None
        # Start of the cycle before, s.
        self._previous: float | None
        # Number of late answers expected, and the latest time for them, s.
        self._late: int
        self._late_until: float
        self.reset()

    def reset(self) -> None:
        """Discard the open cycle, as after a reconnection or at the start of a recording."""
        self._clear()
        self._previous = None
        self._late = 0

    def begin(self, stamp: float) -> None:
        """Open the cycle of a SYNC received at `stamp`, s; the one before ends."""
        if self._start is not None and self._answered < len(self._joints):
            self._drop_incomplete()
            self._expect_late(self._start, len(self._joints) - self._answered)
        if self._late and stamp > self._late_until:
            self._late = 0
        self._clear()
        self._open(stamp)
        if self._late:
            self._invalid = STALE_ANSWER

    def answer(self, index: int, angle: float, stamp: float) -> JointSample | None:
        """
        Add the angle of one joint; return the set that it completes, if any.

        Parameters
        ----------
        index : int
            Joint, in their order.
        angle : float
            Joint angle, rad.
        stamp : float
            Receive time of the frame, s since the Unix epoch.

        """
        joint = self._joints[index]
        if not self._synchronised:
            start = self._cycle_of(index, stamp)
        elif self._start is None:
            self.counters['rejected: before the first SYNC'] += 1
            return None
        elif not 0.0 <= stamp - (start := self._start) <= self._window:
            self._reject(f'answer from {joint} outside the window')
        if self._angles[index] is not None:
            reason = f'two answers from {joint} in one cycle'
            self._reject(reason)
            if self._late:
                self._expect_late(start, -1)
            elif self._answered == len(self._joints):
                self.surplus = stamp, reason
            return None
        if not self._answered:
            self._first = stamp
        self._angles[index] = angle
        self._answered += 1
        if self._answered < len(self._joints):
            return None
        return self._complete(start, stamp)

    def _expect_late(self, start: float, answers: int) -> None:
        """Expect `answers` more late answers, as from the cycle that started at `start`, s."""
        self._late += answers
        self._late_until = start + max(self._window, LATE_ANSWER_PERIODS * self._period)

    def _complete(self, start: float, stamp: float) -> JointSample | None:
        if self._invalid is not None:
            self._drop(self._invalid)
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
        if self._previous is not None:
            late = stamp - self._previous - self._period
            self.jitter.add(round(abs(late) * 1e9))
            if late > (OVERDUE - 1.0) * self._period:
                self.counters['overdue cycles'] += 1
        self._previous = stamp

    def _cycle_of(self, index: int, stamp: float) -> float:
        """Without SYNC: return the start of a frame's cycle, s; open one if it fits no other."""
        if self._start is not None:
            inside = 0.0 <= stamp - self._start <= self._window
            if inside and self._angles[index] is None:
                return self._start
            self._drop_incomplete()
            self._clear()
        self._open(stamp)
        return stamp

    def _clear(self) -> None:
        self._start = None
        self._angles = [None] * len(self._joints)
        self._answered = 0
        self._invalid = None

    def _drop_incomplete(self) -> None:
        missing = []
        for index, angle in enumerate(self._angles):
            if angle is None:
                self.missed[index] += 1
                missing.append(self._joints[index])
        self._drop(f'no answer from {", ".join(missing)}')

    def _reject(self, reason: str) -> None:
        """Count an unusable answer; its cycle yields no set."""
        self.counters[f'rejected: {reason}'] += 1
        self._invalid = reason

    def _drop(self, reason: str) -> None:
        """Count a dropped set; a stale answer is a consequence, not a cause."""
        self.counters['dropped sets'] += 1
        self.counters[f'dropped: {reason}'] += 1
        if reason != STALE_ANSWER:
            self.cause = reason
