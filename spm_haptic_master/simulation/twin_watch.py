# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether another program sends the frames of the simulated encoders, too; without a clock."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import can

# Time over which frames are counted (s).
WINDOW = 1.0
# Frames received beyond those of the own that a window may contain by chance: on their way at its
# limits (unit 1), and as a share of those sent (the program may have been held up).
TOLERATED, TOLERATED_SHARE = 3, 0.5

# Whether an identifier has 29 bits, and the identifier.
Key = tuple[bool, int]


class TwinWatch:
    """
    Compares the frames received with those sent, by identifier.

    Parameters
    ----------
    identifiers : iterable of (bool, int)
        Identifiers of the simulated encoders.
    echoes : bool
        Whether the bus returns the frames sent, as udp_multicast does.

    """

    def __init__(self, identifiers: Iterable[Key], echoes: bool):
        self._identifiers = frozenset(identifiers)
        self._echoes = echoes
        self._sent: Counter[Key] = Counter()
        self._received: Counter[Key] = Counter()
        self._end: float | None = None
        self._reported = False

    def sent(self, message: can.Message) -> None:
        """Count a frame that is sent."""
        self._sent[message.is_extended_id, message.arbitration_id] += 1

    def received(self, message: can.Message) -> None:
        """Count a frame received that no interface marks as its own."""
        if message.is_rx and not message.is_error_frame:
            self._received[message.is_extended_id, message.arbitration_id] += 1

    def poll(self, now: float) -> list[int]:
        """
        Return the identifiers that another program sends, once when it begins.

        Parameters
        ----------
        now : float
            Present time, s.

        """
        if self._end is None:
            self._end = now + WINDOW
        if now < self._end:
            return []
        self._end = now + WINDOW
        foreign = sorted(key[1] for key in self._identifiers if self._received[key] > TOLERATED
                         + (self._sent[key] * (1.0 + TOLERATED_SHARE) if self._echoes else 0.0))
        self._sent.clear()
        self._received.clear()
        news = [] if self._reported else foreign
        self._reported = bool(foreign)
        return news
