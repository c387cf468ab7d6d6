# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Receive times of any interface, mapped to ROS time."""

from __future__ import annotations

# Difference between receive time and this machine's clock (s) beyond which the device has an epoch
# of its own, such as its start: no frame waits a day in a queue.
OWN_EPOCH = 86400.0
# Span for which the least delay is collected (s). The offset is the least of this span and the one
# before; at a crystal's drift of 50 ppm it is wrong by 0.1 ms at most.
SPAN = 1.0


class ReceiveClock:
    """
    Maps an interface's receive times to the Unix epoch.

    The kernel's times already have this epoch. Times of a device that counts from its own start
    are shifted by the least difference between arrival and receive time: the frame with the least
    delay. Without receive times, the times of arrival are used.
    """

    def __init__(self) -> None:
        # Start of the span, s since the Unix epoch; set with the first offset.
        self._span_began: float
        self._least = self._least_before = float('inf')

    def epoch(self, received: float, arrived: float) -> float:
        """
        Return a frame's receive time, s since the Unix epoch.

        `received` is that of the interface, s, 0 if it has none; `arrived` the time of reading.
        """
        if not received:
            return arrived
        delay = arrived - received
        if abs(delay) < OWN_EPOCH:
            return received
        if abs(delay - self._least) > OWN_EPOCH:  # the first, or the device restarted
            self._least = self._least_before = delay
            self._span_began = arrived
        elif not 0.0 <= arrived - self._span_began < SPAN:
            self._least_before, self._least = self._least, delay
            self._span_began = arrived
        elif delay < self._least:
            self._least = delay
        return received + min(self._least, self._least_before)
