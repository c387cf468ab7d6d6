# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Receive times carried into ROS time."""

from __future__ import annotations

# s; a receive time further from this machine's clock has an epoch of its own (the device's start).
# No frame waits so long in a queue.
OWN_EPOCH = 86400.0
# s; the offset to such an epoch is the least delay seen in this and the span before. Crystals
# drift by some 50 ppm, so it is at most 0.1 ms old news.
SPAN = 1.0


class ReceiveClock:
    """
    Maps an interface's receive times to the Unix epoch.

    The kernel's times are on it already. Those of a device that counts from its own start are
    moved by the least difference between arrival and receive time, the one with the least delay.
    An interface that gives no times gets those of arrival.
    """

    def __init__(self) -> None:
        self._span_began = 0.0
        self._least = self._least_before = float('inf')

    def epoch(self, received: float, arrived: float) -> float:
        """
        Return a frame's receive time since the Unix epoch.

        Parameters
        ----------
        received : float
            As the interface gives it, s; 0 where it gives none.
        arrived : float
            When the frame was read, s since the Unix epoch.

        """
        if not received:
            return arrived
        delay = arrived - received
        if abs(delay) < OWN_EPOCH:
            return received
        if abs(delay - self._least) > OWN_EPOCH:  # the first, or the device began anew
            self._least = self._least_before = delay
            self._span_began = arrived
        elif not 0.0 <= arrived - self._span_began < SPAN:
            self._least_before, self._least = self._least, delay
            self._span_began = arrived
        elif delay < self._least:
            self._least = delay
        return received + min(self._least, self._least_before)
