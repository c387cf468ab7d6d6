# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One cycle of the encoders: who has answered so far, and what."""

from __future__ import annotations


class Cycle:
    """
    Answers of the open cycle; one object serves all cycles in turn.

    Parameters
    ----------
    joints : int
        Number of joints.

    Attributes
    ----------
    start : float
        Time of SYNC, or of the first frame without SYNC, s.
    expected : int
        Number of joints that are waited for.
    angles : list of float or None
        Latest angle of each joint, rad; NaN for an answer without a reading, None before the
        first answer.
    answered : int
        Number of joints that have answered, of those that are waited for.
    first : float
        Time of the first answer, s.
    leader : int or None
        Joint that answered first.
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

    """

    __slots__ = ('_joints', 'angles', 'answered', 'done', 'expected', 'first', 'further',
                 'leader', 'paid', 'refused', 'returned', 'start', 'tardy')

    def __init__(self, joints: int):
        self._joints = joints
        self.start: float
        self.first: float
        self.expected: int
        self.angles: list[float | None]
        self.answered: int
        self.leader: int | None
        self.done: bool
        self.refused: dict[int, str] = {}
        self.further: dict[int, int] = {}
        self.tardy: set[int] = set()
        self.paid: set[int] = set()
        self.returned: dict[int, int | None] = {}

    def begin(self, start: float, expected: int) -> None:
        """Begin the next cycle, at a time in s; `expected` joints are waited for."""
        self.start = start
        self.expected = expected
        self.angles = [None] * self._joints
        self.answered = 0
        self.leader = None
        self.done = False
        if self.refused or self.further or self.tardy or self.returned or self.paid:
            for each in (self.refused, self.further, self.tardy, self.returned, self.paid):
                each.clear()

    @property
    def missing(self) -> list[int]:
        """Joints that have not answered."""
        return [index for index, angle in enumerate(self.angles) if angle is None]

    @property
    def once(self) -> set[int]:
        """Joints with one answer, in time; also where that was taken for a late one."""
        answered = {index for index, angle in enumerate(self.angles) if angle is not None}
        return (answered ^ self.paid) - self.further.keys() - self.tardy
