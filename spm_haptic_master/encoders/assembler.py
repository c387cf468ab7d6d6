"""
Frames in, coherent sets out: the one decoder behind the live bus and the recordings.

With SYNC, a set is the four answers to one SYNC and carries its time. Without, it is four frames
inside a window and carries the first one's time. A set is never put together from two cycles:
where that cannot be excluded the set is dropped, and counted by reason.
"""

from __future__ import annotations

from collections import Counter

import can

from spm_haptic_master.encoders.layout import EncoderLayout
from spm_haptic_master.encoders.sample import JointSample

# CiA 301, 7.2.5: SYNC is empty or carries a one-byte counter.
SYNC_MAXIMUM_LENGTH = 1


class SetAssembler:
    """
    Puts the frames of four encoders together into sets of one cycle.

    Parameters
    ----------
    layouts : sequence of 4 EncoderLayout
        In the order of JOINT_NAMES.
    sync_id : int or None
        11-bit identifier of SYNC; None where the bus has none.
    window : float
        s; with SYNC, how long after it an answer still counts; without, how far apart the four
        frames of a set may be.

    Attributes
    ----------
    counters : collections.Counter
        'frames', 'sets', and what was rejected or dropped, by reason.
    dropped : str or None
        Why the latest cycle gave no set, None when it gave one.

    """

    def __init__(self, layouts: tuple[EncoderLayout, ...], sync_id: int | None, window: float):
        self._layouts = {layout.can_id: (index, layout) for index, layout in enumerate(layouts)}
        self._joints = tuple(layout.joint for layout in layouts)
        self._sync_id = sync_id
        self._window = window
        self.counters: Counter[str] = Counter()
        self.dropped: str | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the cycle under way, as after a reconnection or at a recording's beginning."""
        self._start: float | None = None
        self._angles: list[float | None] = [None] * len(self._joints)
        self._answered = 0
        # Why this cycle's set may not go out, None while it may.
        self._spoiled: str | None = None

    def feed(self, message: can.Message) -> JointSample | None:
        """Take one frame; return the set that it completes, if it does."""
        self.counters['frames'] += 1
        # An error frame's identifier is a set of error bits and may equal an encoder's, and so
        # may a 29-bit one: what kind of frame it is comes before whose it is.
        if message.is_error_frame:
            self.counters['rejected: error frame'] += 1
            return None
        if message.is_remote_frame:
            self.counters['rejected: remote frame'] += 1
            return None
        identifier = message.arbitration_id
        if identifier == self._sync_id and not message.is_extended_id:
            if len(message.data) > SYNC_MAXIMUM_LENGTH:
                self.counters['rejected: SYNC of wrong length'] += 1
                return None
            return self._begin(message.timestamp)
        found = self._layouts.get(identifier)
        if found is None:
            self.counters['rejected: foreign identifier'] += 1
            return None
        index, layout = found
        if message.is_extended_id != layout.extended:
            self.counters[f'rejected: {layout.joint} identifier width'] += 1
            return None
        if len(message.data) != layout.data_length:
            self.counters[f'rejected: {layout.joint} data length'] += 1
            return None
        counts = layout.counts(message.data)
        if counts is None:
            self.counters[f'rejected: {layout.joint} counts beyond a turn'] += 1
            return None
        return self._answer(index, layout.angle(counts), message.timestamp)

    def _begin(self, stamp: float) -> None:
        """Open SYNC's cycle and judge the one before."""
        late = None
        if self._start is not None and self._answered < len(self._joints):
            missing = [j for j, a in zip(self._joints, self._angles, strict=True) if a is None]
            self._drop(f'no answer from {", ".join(missing)}')
            # The missing answer may still come, in this cycle, and nothing in it tells.
            late = 'the cycle before was incomplete'
        self._start = stamp
        self._angles = [None] * len(self._joints)
        self._answered = 0
        self._spoiled = late

    def _answer(self, index: int, angle: float, stamp: float) -> JointSample | None:
        joint = self._joints[index]
        if self._sync_id is None:
            self._slide(index, stamp)
        elif self._start is None:
            self.counters['rejected: before the first SYNC'] += 1
            return None
        elif not 0.0 <= stamp - self._start <= self._window:
            self._spoiled = f'answer from {joint} outside the window'
        if self._angles[index] is not None:
            self.counters[f'rejected: {joint} doubled'] += 1
            self._spoiled = f'two answers from {joint}'
            return None
        self._angles[index] = angle
        self._answered += 1
        if self._answered < len(self._joints):
            return None
        if self._spoiled is not None:
            self._drop(self._spoiled)
            return None
        self.counters['sets'] += 1
        self.dropped = None
        sample = JointSample(round(self._start * 1e9), tuple(self._angles))
        if self._sync_id is None:
            self.reset()
        return sample

    def _slide(self, index: int, stamp: float) -> None:
        """Without SYNC: begin anew where this frame cannot belong with those collected."""
        if self._start is not None:
            if self._angles[index] is not None:
                self._drop(f'{self._joints[index]} came again before the set was complete')
            elif not 0.0 <= stamp - self._start <= self._window:
                self._drop('four frames did not fit into the window')
            else:
                return
            self.reset()
        self._start = stamp

    def _drop(self, reason: str) -> None:
        self.counters['dropped sets'] += 1
        self.counters[f'dropped: {reason}'] += 1
        self.dropped = reason
