# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recognises the frames that a program sent itself, where the interface returns them."""

from __future__ import annotations

from collections import defaultdict, deque

import can

# Interface of python-can that returns the frames sent, without a mark.
ECHOING = 'udp_multicast'
# Longest time from a frame to its echo (s): a lost echo is forgotten after it.
ECHO_TIMEOUT = 1.0


class OwnFrames:
    """
    Matches received frames with those sent: each frame sent is returned once.

    Parameters
    ----------
    echoes : bool
        Whether the interface returns the frames sent.

    """

    def __init__(self, echoes: bool):
        self._echoes = echoes
        self._sent: defaultdict[tuple[bool, int, bytes], deque[float]] = defaultdict(deque)

    def sent(self, message: can.Message, now: float) -> None:
        """Remember a frame sent at `now`, s."""
        if self._echoes:
            self._sent[_key(message)].append(now)

    def is_own(self, message: can.Message, now: float) -> bool:
        """Return whether a frame received at `now`, s, is the echo of one sent."""
        waiting = self._sent.get(_key(message))
        while waiting:
            if now - waiting.popleft() <= ECHO_TIMEOUT:
                return True
        return False


def _key(message: can.Message) -> tuple[bool, int, bytes]:
    return message.is_extended_id, message.arbitration_id, bytes(message.data)
