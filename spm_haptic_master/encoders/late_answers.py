# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Answers that may belong to an earlier SYNC: which of a joint's readings are not taken.

An answer does not identify its SYNC, but an encoder's answers come in their order. After a cycle
without one, an encoder owes an answer. What shows whether it was lost or still comes:

- a second answer in a later cycle: the first was the late one, the second is the present one;
- a rolling counter: a number left out was lost; none left out is a late answer;
- an answer that comes first in a cycle although another joint's usually does: a late one;
- several encoders that miss the same cycle: the answers are queued somewhere;
- a cycle of two periods (SYNC left out): an encoder that answers twice in it is late by cycles.
  It may also be that SYNC and other frames were lost there. But what is late has nothing to send
  as many cycles after the long one. Unless each encoder that the long cycle has shown misses a
  cycle then, it has shown nothing: a frame may be lost by itself, too.

A single answer that is missing without any of these counts as lost.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass

# Length of a cycle that shows which encoders answer late by whole cycles (periods): nearly two,
# as late ones answer a second time a period after the first.
LONG_CYCLE = 1.75
# Such cycles in a row that clear a late encoder: one may lack its second answer by chance.
CLEARING_CYCLES = 3
# Most answers of an encoder that are queued somewhere: a CAN controller holds up to 32 messages.
# An encoder that has missed more, and whose counter left none out, did not answer meanwhile.
LONGEST_QUEUE = 32


@dataclass(slots=True)
class Debt:
    """
    Answers of a joint that may still come.

    Attributes
    ----------
    answers : int
        Number of them.
    until : float
        Latest time for them, s.
    queued : bool
        Whether no single answer of the joint is taken.
    counted : bool
        Whether its rolling counter has shown the debt: time does not clear it.

    """

    answers: int
    until: float
    queued: bool = False
    counted: bool = False


@dataclass(slots=True)
class Lateness:
    """
    What a long cycle has shown of a joint that seems to answer late by whole cycles.

    Attributes
    ----------
    is_certain : bool
        Whether an earlier long cycle has shown it, and was confirmed.
    cycles : int
        Cycles since the long one.
    has_missed : bool
        Whether it missed a cycle since then, as what is late has to.
    in_time : int
        Long cycles in a row since then in which it answered once.

    """

    is_certain: bool = False
    cycles: int = 0
    has_missed: bool = False
    in_time: int = 0


class LateAnswers:
    """
    Account of each joint's missing answers.

    Parameters
    ----------
    count : int
        Number of joints.
    span : float
        Time after their SYNC for which late answers are expected, s.

    Attributes
    ----------
    owed : dict of int to Debt
        Debts by index of the joint; a joint that owes no answer has none.
    behind : dict of int to Lateness
        Joints shown to answer late by whole cycles; none of their answers is taken.
    unproven : set of int
        Joints of which no long cycle has shown that they answer in time.

    """

    def __init__(self, count: int, span: float):
        self._span = span
        self.owed: dict[int, Debt] = {}
        self.behind: dict[int, Lateness] = {}
        self.unproven = set(range(count))

    @property
    def undecided(self) -> bool:
        """Whether a second answer in this cycle would show that a taken one is late."""
        return any(not debt.queued for debt in self.owed.values())

    def miss(self, indices: Iterable[int], start: float) -> None:
        """
        Note the joints without an answer in a cycle.

        Parameters
        ----------
        indices : iterable of int
            Indices of the joints.
        start : float
            Time at which the cycle started, s.

        """
        missing = list(indices)
        for index in missing:
            debt = self.owed.setdefault(index, Debt(0, 0.0))
            debt.answers += 1
            debt.until = start + self._span
            debt.queued |= len(missing) > 1 or debt.answers > 1
            self.unproven.add(index)

    def confirm(self, missing: Collection[int], is_clean: bool) -> None:
        """
        Judge the late joints by a cycle: one that misses none was not late.

        Those that one long cycle has shown are late all together, or none of them is: what is
        lost beside a SYNC is the answer of another joint, and then all the others seem to be late.

        Parameters
        ----------
        missing : collection of int
            Joints without an answer in the cycle.
        is_clean : bool
            Whether it shows no sign of a lost frame but for these.

        """
        # Frames are lost in bursts, with those of other joints.
        proves = is_clean and self.behind.keys() >= set(missing)
        shown_together = []
        for index, lateness in self.behind.items():
            lateness.cycles += 1
            lateness.has_missed |= proves and index in missing
            if lateness.cycles == LONGEST_QUEUE + 1:
                shown_together.append(index)
        late = [self.behind[index] for index in shown_together]
        is_confirmed = all(lateness.is_certain or lateness.has_missed for lateness in late)
        for index in shown_together:
            self.behind[index].is_certain |= is_confirmed
            if not self.behind[index].is_certain:
                del self.behind[index]

    def return_of(
        self,
        index: int,
        missed: int,
        start: float,
        lost: int | None,
    ) -> None:
        """
        Note the first answer of a joint that was not waited for.

        Parameters
        ----------
        index : int
            Index of the joint.
        missed : int
            Cycles without an answer before it.
        start : float
            Start of the latest of these cycles, s.
        lost : int or None
            Numbers that its rolling counter left out; None without a counter.

        """
        self.owed[index] = Debt(
            answers=missed,
            until=start + self._span,
            queued=True,
            counted=lost == 0 and missed <= LONGEST_QUEUE,
        )
        self.unproven.add(index)

    def gone(self, index: int) -> None:
        """Expect nothing more of a joint that does not answer."""
        self.owed.pop(index, None)
        self.unproven.discard(index)
        self.behind.pop(index, None)

    def pay(
        self,
        index: int,
        answers: int,
        now: float,
    ) -> int:
        """
        Count late answers that came.

        Parameters
        ----------
        index : int
            Index of the joint.
        answers : int
            Number of late answers.
        now : float
            Time, s.

        Returns
        -------
        int
            How many more there were than owed.

        """
        if index not in self.owed:
            return answers
        surplus = max(0, answers - self.owed[index].answers)
        self._settle(index, answers)
        # The queue drains: the late answers of other joints may come as much later.
        for debt in self.owed.values():
            debt.until = max(debt.until, now + self._span)
        return surplus

    def count(self, index: int, lost: int) -> None:
        """Note how many numbers a rolling counter left out, of a joint that owes an answer."""
        if lost:
            self._settle(index, lost)
        else:
            self.owed[index].queued = self.owed[index].counted = True

    def takes(self, index: int) -> bool:
        """Return whether the reading of a joint's latest answer is taken."""
        return index not in self.behind and not (index in self.owed and self.owed[index].queued)

    def expire(self, now: float) -> None:
        """Clear the joints whose late answers would have come by `now`, s."""
        self.owed = {
            index: debt for index, debt in self.owed.items() if debt.counted or now <= debt.until
        }

    def long_cycle(self, once: set[int], late: set[int]) -> None:
        """
        Evaluate a cycle of two periods, in which a late encoder answers twice.

        Parameters
        ----------
        once : set of int
            Joints with one answer, in time.
        late : set of int
            Joints with a second answer, after the time of the SYNC that was left out.

        """
        # If all answer twice, it was SYNC that was lost.
        if not once:
            return
        for index in late:
            known = self.behind.get(index)
            self.behind[index] = Lateness(known is not None and known.is_certain)
        self.unproven |= late
        for index in once:
            self.owed.pop(index, None)
            lateness = self.behind.get(index)
            if lateness is not None:
                lateness.in_time += 1
                if lateness.in_time < CLEARING_CYCLES:
                    continue
                del self.behind[index]
            self.unproven.discard(index)

    def _settle(self, index: int, answers: int) -> None:
        """Take a number of answers off a joint's debt."""
        debt = self.owed[index]
        debt.answers -= answers
        if debt.answers <= 0:
            del self.owed[index]
