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
- a cycle of two periods (SYNC left out): whoever answers twice in it answers late by whole cycles.

A single answer that is missing without any of these counts as lost.
"""

from __future__ import annotations

from collections.abc import Iterable

# Length of a cycle that shows which encoders answer late by whole cycles (periods): nearly two,
# as late ones answer a second time a period after the first.
LONG_CYCLE = 1.75
# Such cycles in a row that clear a late encoder: one may lack its second answer by chance.
CLEARING_CYCLES = 3
# Most answers of an encoder that are queued somewhere: a CAN controller holds up to 32 messages.
# An encoder that has missed more, and whose counter left none out, did not answer meanwhile.
LONGEST_QUEUE = 32


class LateAnswers:
    """Account of each joint's missing answers, expected for `span` s after their SYNC."""

    def __init__(self, count: int, span: float):
        self._span = span
        # Answers that may still come, by index of the joint; a joint without any has no entry.
        self.owed: dict[int, int] = {}
        # Of these joints, those of which no single answer is taken.
        self.queued: set[int] = set()
        # Joints shown to answer late by whole cycles, and the long cycles in a row since in which
        # they did not; none of their answers is taken.
        self.behind: dict[int, int] = {}
        # Joints of which no long cycle has shown that they answer in time.
        self.unproven = set(range(count))
        # Latest time for each joint's late answers, s.
        self._until: dict[int, float] = {}
        # Joints shown to be behind by their counters: time does not clear them.
        self._counted: set[int] = set()

    @property
    def undecided(self) -> bool:
        """Whether a second answer in this cycle would show that a taken one is late."""
        return any(index not in self.queued for index in self.owed)

    def miss(self, indices: Iterable[int], start: float) -> None:
        """Note the joints without an answer in the cycle that started at `start`, s."""
        missing = list(indices)
        for index in missing:
            self.owed[index] = self.owed.get(index, 0) + 1
            self._until[index] = start + self._span
            self.unproven.add(index)
            if len(missing) > 1 or self.owed[index] > 1:
                self.queued.add(index)

    def return_of(self, index: int, missed: int, start: float, lost: int | None) -> None:
        """
        Note the first answer of a joint after `missed` cycles without one, the last from `start`.

        `lost` numbers its rolling counter left out; None without a counter.
        """
        self.owed[index] = missed
        self._until[index] = start + self._span
        self.queued.add(index)
        self.unproven.add(index)
        if lost == 0 and missed <= LONGEST_QUEUE:
            self._counted.add(index)

    def gone(self, index: int) -> None:
        """Expect nothing more of a joint that does not answer."""
        self._clear(index)
        self.unproven.discard(index)
        self.behind.pop(index, None)

    def pay(self, index: int, answers: int, now: float) -> int:
        """Count late answers that came; return how many more there were than owed."""
        paid = min(answers, self.owed.get(index, 0))
        if paid:
            self._settle(index, paid)
            # The queue drains: the late answers of other joints may come as much later.
            for other in self.owed:
                self._until[other] = max(self._until[other], now + self._span)
        return answers - paid

    def count(self, index: int, lost: int) -> None:
        """Note how many numbers a rolling counter left out, of a joint that owes an answer."""
        if lost:
            self._settle(index, lost)
        else:
            self.queued.add(index)
            self._counted.add(index)

    def takes(self, index: int) -> bool:
        """Return whether the reading of a joint's latest answer is taken."""
        return index not in self.behind and index not in self.queued

    def expire(self, now: float) -> None:
        """Clear the joints whose late answers would have come by `now`, s."""
        for index in [index for index in self.owed
                      if now > self._until[index] and index not in self._counted]:
            self._clear(index)

    def long_cycle(self, once: set[int], late: set[int]) -> None:
        """
        Evaluate a cycle of two periods.

        `once` are the joints with one answer, in time, `late` those with a second answer more
        than a period after SYNC.
        """
        # If all answer twice, it was SYNC that was lost.
        if not once:
            return
        self.behind |= dict.fromkeys(late, 0)
        self.unproven |= late
        for index in once:
            self._clear(index)
            good = self.behind.pop(index, CLEARING_CYCLES - 1) + 1
            if good < CLEARING_CYCLES:
                self.behind[index] = good
            else:
                self.unproven.discard(index)

    def _settle(self, index: int, answers: int) -> None:
        left = self.owed[index] - answers
        if left > 0:
            self.owed[index] = left
        else:
            self._clear(index)

    def _clear(self, index: int) -> None:
        self.owed.pop(index, None)
        self.queued.discard(index)
        self._counted.discard(index)
