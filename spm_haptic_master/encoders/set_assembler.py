# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Assembly of joint samples: the angles of one cycle make a set, anything else is dropped.

With SYNC, a set is one answer of each encoder to one SYNC and carries its time. Without, it is a
frame of each within a window and carries the time of the first. A set never mixes answers of two
cycles: a reading for which that cannot be excluded is left out. With four encoders that is the
end of the set; with five or six, four readings are a set, with NaN for the others.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from math import inf, nan

from spm_haptic_master.encoders.late_answers import LateAnswers, LONG_CYCLE
from spm_haptic_master.encoders.source import JointSample
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.timing import LatencyMeter

# Time from one cycle to the next beyond which the second counts as overdue (periods).
OVERDUE = 1.5
# Least time after an incomplete cycle's SYNC for which late answers are expected (periods).
LATE_ANSWER_PERIODS = 1.5
# Cycles in a row without an answer after which a joint is not waited for.
SILENT_CYCLES = 3
# Least number of readings of a set: the orientation and one parity.
LEAST_READINGS = len(JOINT_NAMES)
# Reason for leaving out a reading while late answers are expected.
STALE_ANSWER = 'may contain an answer to an earlier SYNC'
# Reason, in the counters, for dropping a set of encoders that send without SYNC.
PHASES = 'frames further apart than the window'
# The same of a joint that is known to be late.
BEHIND = 'answers late by whole cycles'


@dataclass(slots=True)
class Cycle:
    """
    Answers of the open cycle, by index of the joint.

    Attributes
    ----------
    start : float
        Time of SYNC, or of the first frame without SYNC, s.
    angles : list of (float or None)
        Latest angles, rad; NaN for an answer without a reading, None before the first answer.
    answered : int
        Number of joints that have answered, of those that are waited for.
    leader : int or None
        Joint that answered first.
    first : float
        Time of its answer, s.
    done : bool
        Whether the cycle has yielded its set, or cannot yield one.
    refused : dict of int to str
        Reasons why joints that answered have no reading.
    further : dict of int to int
        Number of answers of a joint after its first.
    tardy : set of int
        Joints with an answer after the time when the next SYNC would have come, or too late.
    paid : set of int
        Joints whose first answer was taken for a late one, and not for this cycle's.
    returned : dict of int to (int or None)
        Joints that were not waited for and answered, and what their counters left out.
    broken : bool
        Whether a joint answered again after more than a period: frames between were lost.

    """

    start: float
    angles: list[float | None]
    answered: int = 0
    leader: int | None = None
    first: float = nan
    done: bool = False
    refused: dict[int, str] = field(default_factory=dict)
    further: dict[int, int] = field(default_factory=dict)
    tardy: set[int] = field(default_factory=set)
    paid: set[int] = field(default_factory=set)
    returned: dict[int, int | None] = field(default_factory=dict)
    broken: bool = False

    @property
    def missing(self) -> list[int]:
        """Joints that have not answered."""
        return [index for index, angle in enumerate(self.angles) if angle is None]

    @property
    def once(self) -> set[int]:
        """Joints with one answer, in time; also where that was taken for a late one."""
        answered = {index for index, angle in enumerate(self.angles) if angle is not None}
        return (answered ^ self.paid) - self.further.keys() - self.tardy


class SetAssembler:
    """
    Assembles the angles of four, five or six encoders into sets of one cycle.

    A set goes out with its last answer. One that lacks an answer, or of which another answer may
    yet come, goes out when its cycle ends. A joint that is silent for `SILENT_CYCLES` cycles is
    not waited for; it is taken again once its late answers would have come.

    Parameters
    ----------
    joints : tuple of N str
        Names of the joints.
    synchronised : bool
        Whether the encoders answer SYNC.
    window : float
        With SYNC the longest time from it to an answer, and to a late one; without, the longest
        time between the frames of a set, s.
    period : float
        Nominal time from cycle to cycle, s.

    Attributes
    ----------
    counters : Counter of str
        Numbers of 'sets' and 'cycles', and of what was rejected or dropped, by reason.
    missed : list of N int
        Cycles without an answer, by joint.
    skew, jitter : LatencyMeter
        Time from the first to the last answer of a set, and deviation of the time between two
        cycles from the period, ns.
    cause : str or None
        Why the latest cycle yielded no set; None if it yielded one.
    surplus : tuple of (float, str), or None
        Time, s, and description of the latest answer that came after a complete set and that no
        missing answer explains: two encoders may share an identifier.
    absent : set of int
        Joints that are not waited for, by index.
    late : LateAnswers
        Account of the missing answers.

    """

    def __init__(
        self,
        joints: tuple[str, ...],
        synchronised: bool,
        window: float,
        period: float,
    ):
        self._joints = joints
        self._synchronised = synchronised
        self._window = window
        self._period = period
        # Longest time from SYNC to an answer before the next SYNC, s; without SYNC any frame of a
        # cycle is in time.
        self._in_time = min(window, period) if synchronised else inf
        self.counters: Counter[str] = Counter()
        # Time of the latest answer of each joint, s.
        self._answered_at = [nan] * len(joints)
        self.missed = [0] * len(joints)
        self.skew = LatencyMeter()
        self.jitter = LatencyMeter()
        self.cause: str | None = None
        self.surplus: tuple[float, str] | None = None
        self.reset()

    def reset(self) -> None:
        """Discard the open cycle, as after a reconnection or at the start of a recording."""
        self._cycle: Cycle | None = None
        # Joint that answered first in the latest cycle without doubt.
        self._usual_leader: int | None = None
        # Cycles in a row without an answer, of each joint that missed the latest.
        self._silent: dict[int, int] = {}
        # Whether an answer or a joint is missing, or may be late.
        self._unsettled = False
        self.absent: set[int] = set()
        self.late = LateAnswers(
            len(self._joints), max(self._window, LATE_ANSWER_PERIODS * self._period)
        )

    def begin(self, stamp: float) -> JointSample | None:
        """
        Open the cycle of a SYNC; the one before ends.

        Parameters
        ----------
        stamp : float
            Receive time of SYNC, s since the Unix epoch.

        Returns
        -------
        JointSample or None
            The set of the ended cycle, if it has not gone out and can be made.

        """
        self.counters['cycles'] += 1
        ended = None
        if (cycle := self._cycle) is not None:
            length = stamp - cycle.start
            ended = self._close(cycle, stamp, length)
            self.jitter.add(round(abs(length - self._period) * 1e9))
            if length > OVERDUE * self._period:
                self.counters['overdue cycles'] += 1
        self._cycle = Cycle(stamp, [None] * len(self._joints))
        return ended

    def answer(
        self,
        index: int,
        angle: float,
        stamp: float,
        lost: int | None = None,
        refused: str | None = None,
    ) -> JointSample | None:
        """
        Add the answer of one joint.

        Parameters
        ----------
        index : int
            Index of the joint.
        angle : float
            Joint angle, rad; NaN for an answer without a reading.
        stamp : float
            Receive time, s since the Unix epoch.
        lost : int, optional
            Numbers that the encoder's rolling counter left out since its answer before.
        refused : str, optional
            Why the answer has no reading.

        Returns
        -------
        JointSample or None
            The set that it completes, or whose cycle it ends.

        """
        if self._synchronised:
            ended = None
        else:
            ended = self._begin_without_sync(index, stamp)
        cycle = self._cycle
        if cycle is None:
            self.counters['rejected: before the first SYNC'] += 1
            return None
        if not 0.0 <= stamp - cycle.start <= self._in_time:
            refused = self._refusal_of_late(cycle, index, stamp, refused)
        self._answered_at[index] = stamp
        is_plain = cycle.angles[index] is None and not self._unsettled
        if not is_plain and not self._is_awaited(cycle, index, angle, stamp, lost):
            return ended
        if refused is not None:
            cycle.refused[index] = refused
        if cycle.leader is None:
            cycle.leader = index
            cycle.first = stamp
        cycle.angles[index] = angle
        cycle.answered += 1
        if cycle.answered + len(self.absent) < len(self._joints):
            return ended
        return self._complete(cycle, stamp, ended)

    def _complete(
        self,
        cycle: Cycle,
        stamp: float,
        ended: JointSample | None,
    ) -> JointSample | None:
        """Return the set that an answer completes; `ended` where late ones may yet come."""
        if self._unsettled and self.late.undecided:
            return ended
        sample = self._make(cycle)
        if sample is not None:
            self.skew.add(round((stamp - cycle.first) * 1e9))
        return sample

    def _begin_without_sync(self, index: int, stamp: float) -> JointSample | None:
        """Open a cycle with a frame that is none of the open one; return the set of that."""
        if self._belongs(index, stamp):
            return None
        return self.begin(stamp)

    def _belongs(self, index: int, stamp: float) -> bool:
        """Return whether a frame without SYNC is one of the open cycle."""
        cycle = self._cycle
        if cycle is None or cycle.angles[index] is not None:
            return False
        return 0.0 <= stamp - cycle.start <= self._window

    def _is_awaited(
        self,
        cycle: Cycle,
        index: int,
        angle: float,
        stamp: float,
        lost: int | None,
    ) -> bool:
        """Return whether an answer is one that the set waits for; the others are accounted for."""
        if cycle.angles[index] is not None:
            self._again(cycle, index, angle, stamp)
            return False
        return self._expects(cycle, index, stamp, lost)

    def _refusal_of_late(
        self,
        cycle: Cycle,
        index: int,
        stamp: float,
        refused: str | None,
    ) -> str | None:
        """Note an answer that is not in time; return why it has no reading, if it has none."""
        cycle.tardy.add(index)
        if stamp - self._answered_at[index] > OVERDUE * self._period:
            cycle.broken = True
        if 0.0 <= stamp - cycle.start <= self._window:
            return refused
        reason = f'answer from {self._joints[index]} outside the window'
        self.counters[f'rejected: {reason}'] += 1
        return reason

    def has_answered(self, index: int) -> bool:
        """Return whether a joint has answered in the open cycle."""
        return self._cycle is not None and self._cycle.angles[index] is not None

    def _expects(
        self,
        cycle: Cycle,
        index: int,
        stamp: float,
        lost: int | None,
    ) -> bool:
        """Return whether a joint's first answer of a cycle is one that the set waits for."""
        if index in self.absent:
            cycle.angles[index] = nan
            cycle.returned[index] = lost
            return False
        if index not in self.late.owed:
            return True
        if cycle.leader is None and self._usual_leader not in (None, index):
            self.late.pay(index, 1, stamp)
            cycle.paid.add(index)
            self.counters[f'rejected: late answer from {self._joints[index]}'] += 1
            return False
        # Only behind a cycle without an answer: later ones are consecutive anyway.
        if lost is not None and index in self._silent:
            self.late.count(index, lost)
        return True

    def _again(
        self,
        cycle: Cycle,
        index: int,
        angle: float,
        stamp: float,
    ) -> None:
        """Take a further answer of a joint in one cycle: only late ones explain it."""
        number = cycle.further.get(index, 0)
        cycle.further[index] = number + 1
        joint = self._joints[index]
        debt = self.late.owed.get(index)
        if debt is not None and number < debt.answers:
            self.counters[f'rejected: late answer from {joint}'] += 1
            cycle.angles[index] = angle
            return
        reason = f'two answers from {joint} in one cycle'
        self.counters[f'rejected: {reason}'] += 1
        cycle.refused[index] = reason
        if cycle.done:
            self.surplus = stamp, reason

    def _make(self, cycle: Cycle) -> JointSample | None:
        """Return the set of a cycle, None if too few joints have a reading."""
        cycle.done = True
        angles: tuple[float, ...] | None
        if not (cycle.refused or self._unsettled) and cycle.answered == len(self._joints):
            angles = tuple(cycle.angles)  # type: ignore[arg-type]
        else:
            angles = self._angles_without(cycle)
        if angles is None:
            return None
        self.counters['sets'] += 1
        self.cause = None
        return JointSample(round(cycle.start * 1e9), angles)

    def _angles_without(self, cycle: Cycle) -> tuple[float, ...] | None:
        """Return the angles of a cycle, NaN for those left out; None if too few are left."""
        missing = {*cycle.missing, *self.absent}
        doubtful = {index for index in range(len(self._joints)) if not self.late.takes(index)}
        without = missing | doubtful | cycle.refused.keys()
        if len(self._joints) - len(without) < LEAST_READINGS:
            self._drop(cycle, missing)
            return None
        if without:
            self.counters['sets with a joint missing'] += 1
        return tuple(
            nan if index in without or angle is None else angle
            for index, angle in enumerate(cycle.angles)
        )

    def _drop(self, cycle: Cycle, missing: set[int]) -> None:
        """Count a dropped set; a stale answer is a consequence, not a cause."""
        if phases := self._phases(cycle, missing):
            self.counters['dropped sets'] += 1
            self.counters[f'dropped: {PHASES}'] += 1
            self.cause = phases
            return
        names = [self._joints[index] for index in sorted(missing)]
        behind = [self._joints[index] for index in sorted(self.late.behind)]
        reason = (
            '; '.join(
                [
                    *([f'no answer from {", ".join(names)}'] if names else []),
                    # In the order of the joints: answers come in any.
                    *dict.fromkeys(cycle.refused[index] for index in sorted(cycle.refused)),
                    *([f'{", ".join(behind)}: {BEHIND}'] if behind else []),
                ]
            )
            or STALE_ANSWER
        )
        self.counters['dropped sets'] += 1
        self.counters[f'dropped: {reason}'] += 1
        if reason != STALE_ANSWER:
            self.cause = reason

    def _phases(self, cycle: Cycle, missing: set[int]) -> str | None:
        """Return that the joints missing in a cycle without SYNC send, at another phase."""
        if self._synchronised:
            return None
        since = [cycle.start - stamp for stamp in self._answered_at]
        # A joint that never answered has no time, and NaN compares as false.
        if not all(abs(since[index]) <= OVERDUE * self._period for index in missing):
            return None
        opener = min(range(len(since)), key=lambda index: abs(since[index]))
        shown = ', '.join(
            f'{self._joints[index]} {1e3 * (-since[index] % self._period):.1f} ms'
            for index in sorted(missing - {opener})
        )
        return (
            f'without SYNC {shown} after {self._joints[opener]} (phases of a period of '
            f'{1e3 * self._period:g} ms), and a set needs all frames within '
            f'{1e3 * self._window:g} ms: SYNC is needed (encoders.sync_id; docs/encoder_setup.md)'
        )

    def _close(
        self,
        cycle: Cycle,
        end: float,
        length: float,
    ) -> JointSample | None:
        """End a cycle at a time, s; return its set if that has not gone out."""
        long = self._synchronised and length >= LONG_CYCLE * self._period
        unclear = cycle.further or self._unsettled or long
        if not unclear and cycle.answered == len(self._joints):
            self._usual_leader = cycle.leader
            return None
        return self._settle(cycle, end, long)

    def _settle(
        self,
        cycle: Cycle,
        end: float,
        long: bool,
    ) -> JointSample | None:
        """
        Account for the answers that a cycle lacks, or that may belong to another one.

        Parameters
        ----------
        cycle : Cycle
            The cycle.
        end : float
            Its end, s.
        long : bool
            Whether it lasted so long that a SYNC may be missing in it.

        Returns
        -------
        JointSample or None
            Its set, if that has not gone out and can be made.

        """
        if self._synchronised:
            surplus = self._pay(cycle, end)
        else:
            surplus = set()
        self.absent -= cycle.returned.keys()
        sample = None
        if not cycle.done:
            self.counters['sets at the end of the cycle'] += 1
            sample = self._make(cycle)
        self._note_missing(cycle)
        late = self.late
        late.confirm(cycle.missing, not long and not cycle.tardy)
        if long and not cycle.broken:
            late.long_cycle(cycle.once, surplus & cycle.tardy)
        late.expire(end)
        self._unsettled = bool(late.owed or late.behind or self.absent or self._silent)
        return sample

    def _pay(self, cycle: Cycle, end: float) -> set[int]:
        """Count late answers at the end, s; return joints with more than late ones explain."""
        for index, lost in cycle.returned.items():
            self.late.return_of(index, self._silent[index], cycle.start - self._period, lost)
        return {
            index for index, number in cycle.further.items() if self.late.pay(index, number, end)
        }

    def _note_missing(self, cycle: Cycle) -> None:
        """Count the cycle for the joints that missed it; wait no more for the silent ones."""
        missing = cycle.missing
        self._silent = {index: self._silent.get(index, 0) + 1 for index in missing}
        for index in missing:
            self.missed[index] += 1
            if self._silent[index] == SILENT_CYCLES:
                self.absent.add(index)
                self.late.gone(index)
        if self._synchronised:
            self.late.miss((each for each in missing if each not in self.absent), cycle.start)
