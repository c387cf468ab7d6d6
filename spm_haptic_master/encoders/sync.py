# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
SYNC: its producer, on an absolute grid and in a thread of its own, and a check of its rate.

A bus has one SYNC producer (CiA 301): this one yields to any other.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from math import nan
import threading
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_bus import BUS_ERRORS
from spm_haptic_master.timing import DeadlineGrid, LatencyMeter

# Pause after another master's SYNC (s): CANopen allows one SYNC producer only.
QUIET = 1.0
# Time of listening for another master before the first SYNC (s).
LISTEN = 0.1
# Longest time from the first SYNC to its echo, if the interface provides one (s).
PROBE = 0.05
# Longest sleep (s), so that the thread ends in time.
NAP = 0.05
# Number of SYNCs remembered until their cycle is opened: a second without a frame at 1 kHz.
WAITING = 1000
# Time over which SYNC is counted (s), and the fewest that show a rate.
SPAN = 1.0
FEWEST = 10
# Largest relative deviation of the time between two SYNCs that are one period apart (unit 1).
TOLERANCE = 0.25
# Smallest share of such SYNCs (unit 1): where SYNCs come late or are lost on a busy machine, many
# are still one period apart; on a bus of another rate hardly any is.
SHARE = 0.1


def percentiles_text(meter: LatencyMeter) -> str:
    """
    Return median, 99th percentile and maximum of the latest latencies.

    Parameters
    ----------
    meter : LatencyMeter
        The latencies.

    Returns
    -------
    str
        The three figures in us; empty if there are none.

    """
    return ' / '.join(f'{value:.0f}' for value in meter.percentiles(0.5, 0.99, 1.0) or ())


class SyncProducer:
    """
    Sends SYNC periodically from a thread of its own, and records the times.

    Most interfaces do not return the frames sent: then the time of sending opens a cycle. If they
    do (an echo), the receive time of the echo does.

    Parameters
    ----------
    send : callable
        Sends one frame, or raises one of BUS_ERRORS.
    sync_id : int
        Identifier of SYNC.
    period : float
        Time between two, s.

    Attributes
    ----------
    producing : bool
        Whether it sends at its rate, as opposed to listening or yielding.
    lateness : LatencyMeter
        Time from each SYNC's deadline to its sending, ns.
    sent, failed, foreign, skipped : int
        Numbers of SYNCs sent, refused by the interface, received from another master, left out.
    lost : float
        Time by which SYNCs were more than a period late, s; not those that had to wait for a bus
        that refused the one before.

    """

    def __init__(
        self,
        send: Callable[[can.Message], None],
        sync_id: int,
        period: float,
    ):
        self._send = send
        self._message = canopen.frame(sync_id)
        self._period = period
        self._grid = DeadlineGrid(period)
        # Times of sending whose cycles are not yet open, s since the Unix epoch. The SYNC thread
        # appends, the receiving thread pops from the left.
        self._waiting: deque[float] = deque(maxlen=WAITING)
        self._echoed = threading.Event()
        self.producing = False
        self._foreign_at = float('-inf')
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.lateness = LatencyMeter()
        self.sent = self.failed = self.foreign = self.skipped = 0
        self.lost = 0.0
        self._skip = False

    def statistics(self) -> dict[str, object]:
        """Return counters and figures by name; missed deadlines are those that passed asleep."""
        found: dict[str, object] = {
            'SYNC sent': self.sent,
            'SYNC not sent': self.failed,
            'SYNC deadlines missed': self._grid.missed,
            'SYNC left out': self.skipped,
            "another master's SYNC": self.foreign,
        }
        if text := percentiles_text(self.lateness):
            found['SYNC sent late p50 / p99 / max (us)'] = text
        return found

    @property
    def yielding(self) -> bool:
        """Whether no SYNC is sent because another master produces it at present."""
        return time.monotonic() - self._foreign_at < QUIET

    def skip(self) -> bool:
        """
        Leave one SYNC out, and return whether one is: none is while another master makes it.

        An encoder that is late by whole cycles answers twice in the long cycle.
        """
        self._skip = self.producing
        return self._skip

    def heard(self, stamp: float) -> None:
        """
        Handle a SYNC that was received: the echo of one sent here, or another master's.

        Parameters
        ----------
        stamp : float
            Receive time, s since the Unix epoch.

        """
        if self._due(stamp):
            self._echoed.set()
        else:
            self.foreign += 1
            self._foreign_at = time.monotonic()

    def openings(self, stamp: float) -> list[float]:
        """
        Return the SYNCs sent here whose cycles open before a frame.

        Parameters
        ----------
        stamp : float
            Receive time of that frame, s since the Unix epoch.

        Returns
        -------
        list of float
            Times of sending, s since the Unix epoch; empty where echoes open the cycles.

        """
        # Echoes, if there are any, open the cycles.
        if self.producing and not self._echoed.is_set():
            return self._due(stamp)
        return []

    def _due(self, stamp: float) -> list[float]:
        """Remove and return the times of the SYNCs sent up to `stamp`, s."""
        taken = []
        try:
            while self._waiting[0] <= stamp:
                taken.append(self._waiting.popleft())
        except IndexError:
            pass  # no more, or just cleared by the other thread
        return taken

    def start(self) -> None:
        """Start the thread, on a bus just opened: listen, then send."""
        self._stop.clear()
        self._thread = threading.Thread(target=self._run, name='SYNC', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the thread, if it is running."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _run(self) -> None:
        """Listen for another master, probe for an echo, then produce, until `stop`."""
        while not self._stop.wait(LISTEN):
            if self.yielding:
                continue
            # Probe whether the interface echoes (udp_multicast does, unasked): an echo must not
            # pass for another master's SYNC.
            self._echoed.clear()
            self._emit()
            self._echoed.wait(PROBE)
            self._waiting.clear()
            self._produce()

    def _produce(self) -> None:
        """Send SYNC on the grid until another master is heard, or the thread is to end."""
        self._grid.restart()
        self.producing = True
        is_sent = True
        while not self._stop.is_set() and not self.yielding:
            if not self._grid.wait(NAP):
                continue
            late = self._grid.lateness
            if self._skip:
                self._skip = False
                self.skipped += 1
                continue
            self.lateness.add(round(late * 1e9))
            if is_sent and late > self._period:
                self.lost += late
            is_sent = self._emit()
        self.producing = False
        self._waiting.clear()

    def _emit(self) -> bool:
        """Send one SYNC and note its time; return whether the interface took it."""
        self._waiting.append(time.time())
        try:
            self._send(self._message)
            self.sent += 1
        except BUS_ERRORS:
            # The reader of the bus reports its failure; the grid continues.
            self.failed += 1
            return False
        return True


class SyncRate:
    """
    Compares the times between SYNCs with the configured ones, in spans of a second.

    Parameters
    ----------
    period : float
        Configured time between two SYNCs, s.

    Attributes
    ----------
    measured : float or None
        Rate of the latest span, Hz, if that is another than the configured one.

    """

    def __init__(self, period: float):
        self._period = period
        # Begin of the span; time of the latest SYNC, s. In the span, numbers of SYNCs and of those
        # one period after the one before.
        self._began = self._last = nan
        self._count = self._fits = 0
        self.measured: float | None = None

    def heard(self, stamp: float) -> None:
        """Count a SYNC received at `stamp`, s."""
        if not 0.0 <= stamp - self._last <= SPAN:
            self._begin(stamp)
            return
        self._count += 1
        self._fits += (
            self._period * (1.0 - TOLERANCE)
            < stamp - self._last
            < self._period * (1.0 + TOLERANCE)
        )
        self._last = stamp
        span = stamp - self._began
        if span >= SPAN and self._count >= FEWEST:
            other = self._fits < SHARE * self._count
            self.measured = self._count / span if other else None
            self._begin(stamp)

    def text(self) -> str | None:
        """Return that the rate is another one, in words; None if it is not."""
        measured = self.measured
        if measured is None:
            return None
        return (
            f'SYNC comes at {measured:.0f} Hz, rate is {1.0 / self._period:g} Hz: give '
            'rate, as '
            'it is on the bus, to all nodes (can_scan prints it)'
        )

    def _begin(self, stamp: float) -> None:
        """Begin a span with a SYNC at a time, s."""
        self._began = self._last = stamp
        self._count = self._fits = 0
