# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""SYNC made by this driver: on an absolute grid, in a thread that nothing else delays."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import threading
import time

import can

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.meters import LatencyMeter

# s after another master's SYNC during which none is made here: CANopen knows one SYNC producer.
QUIET = 1.0
# s of listening before the first SYNC, so that another master is heard first.
LISTEN = 0.1
# s after the first SYNC within which its echo comes, if the interface gives any.
PROBE = 0.05
# s; the longest sleep, so that the thread sees its end.
NAP = 0.05
# SYNCs whose cycle waits to be opened; more is a second without a frame at 1 kHz.
WAITING = 1000


class SyncProducer:
    """
    Sends SYNC at a rate from a thread of its own, and remembers when.

    Most interfaces do not give a sender its own frames. Then the time of sending is SYNC's time.
    Where they do (an echo), it carries the receive time, and that is taken.

    Parameters
    ----------
    send : callable
        Sends one frame; raises CanError or OSError.
    sync_id : int
        Identifier of SYNC.
    period : float
        s from one SYNC to the next.

    Attributes
    ----------
    lateness : LatencyMeter
        ns that each SYNC was sent behind its grid time.
    producing : bool
        It sends at its rate, rather than listens first or stands back.
    sent, failed, foreign : int
        SYNCs sent, refused by the interface, and heard from another master.

    """

    def __init__(self, send: Callable[[can.Message], None], sync_id: int, period: float):
        self._send = send
        self._message = canopen.frame(sync_id)
        self._grid = DeadlineGrid(period)
        # Times of sending, s since the epoch, whose cycle is not opened yet. This thread appends,
        # the receiving one takes from the left.
        self._waiting: deque[float] = deque(maxlen=WAITING)
        self._echoed = threading.Event()
        self.producing = False
        self._foreign_at = float('-inf')
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.lateness = LatencyMeter()
        self.sent = self.failed = self.foreign = 0

    @property
    def missed(self) -> int:
        """Grid times that passed without a SYNC because the thread woke too late."""
        return self._grid.missed

    @property
    def stands_back(self) -> bool:
        """Whether another master makes SYNC at present, and this one therefore does not."""
        return time.monotonic() - self._foreign_at < QUIET

    def heard(self, stamp: float) -> None:
        """Take a SYNC from the bus: the echo of one sent here, or another master's."""
        if self._due(stamp):
            self._echoed.set()
        else:
            self.foreign += 1
            self._foreign_at = time.monotonic()

    def openings(self, stamp: float) -> list[float]:
        """Return the times of SYNCs that open cycles before a frame received at `stamp`."""
        # Where there are echoes, they open the cycles.
        return self._due(stamp) if self.producing and not self._echoed.is_set() else []

    def _due(self, stamp: float) -> list[float]:
        """Take the times of the SYNCs sent up to `stamp`."""
        taken = []
        try:
            while self._waiting[0] <= stamp:
                taken.append(self._waiting.popleft())
        except IndexError:
            pass  # there are no more, or the other thread just cleared them
        return taken

    def start(self) -> None:
        """Begin, on a bus just opened: listen, then send."""
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name='SYNC', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread, if it runs."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while not self._stop.wait(LISTEN):
            if self.stands_back:
                continue
            # Whether the interface echoes is not known beforehand (udp_multicast does, unasked),
            # and an echo must not be taken for another master.
            self._echoed.clear()
            self._emit()
            self._echoed.wait(PROBE)
            self._waiting.clear()
            self._produce()

    def _produce(self) -> None:
        self._grid.restart()
        self.producing = True
        while not self._stop.is_set() and not self.stands_back:
            if self._grid.wait(NAP):
                self.lateness.add(round(self._grid.lateness * 1e9))
                self._emit()
        self.producing = False
        self._waiting.clear()

    def _emit(self) -> None:
        self._waiting.append(time.time())
        try:
            self._send(self._message)
            self.sent += 1
        except (can.CanError, OSError):
            # What is wrong with the bus tells who reads from it; the grid goes on.
            self.failed += 1
