# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The loops that connect the simulated encoders and drives to a CAN bus, in real time.

The simulated devices know neither bus nor clock: these loops give them frames and times.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
import threading
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.can_bus import BUS_ERRORS, first_line
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_drive import SimulatedDrives
from spm_haptic_master.timing import DeadlineGrid

# Time between two updates of faults and heartbeats (s).
TEND_PERIOD = 0.002
# Longest wait of the drives for a frame (s): their grid of time.
STEP = 0.0005
# Largest age of a received frame (s): a frame that seems older has a clock with another epoch.
LONGEST_WAIT = 0.1
# Time to listen for another program before the encoders boot (s): two heartbeats, and some.
LISTEN = 0.25

# Takes the time of a cycle, ns, and the true orientation.
Record = Callable[[int, tuple[float, float, float, float]], None]


class BusRunner:
    """
    Carries frames between an open bus and the simulated encoders.

    Parameters
    ----------
    bus : can.BusABC
        Open bus.
    encoders : SimulatedBus
        Encoders that answer.
    sync_id : int or None
        Identifier of SYNC; None if the encoders send by themselves.
    grid : DeadlineGrid or None
        Times at which to send SYNC, or the encoders' frames without SYNC; None if SYNC comes from
        the bus.
    record : callable, optional
        Called at each cycle with its time, ns since the Unix epoch, and the true orientation,
        quaternion x, y, z, w.

    Attributes
    ----------
    cycles : int
        Number of cycles that were answered.

    """

    def __init__(
        self,
        bus: can.BusABC,
        encoders: SimulatedBus,
        sync_id: int | None,
        grid: DeadlineGrid | None,
        record: Record | None = None,
    ):
        self._bus = bus
        self._encoders = encoders
        self._sync_id = sync_id
        self._grid = grid
        self._record = record
        self.cycles = 0

    def listen(self) -> list[int]:
        """
        Return which of the encoders' identifiers another program uses; to be called before `boot`.

        Returns
        -------
        list of int
            Identifiers heard within LISTEN, ascending.

        """
        own = set(self._encoders.identifiers())
        heard = set()
        end = time.monotonic() + LISTEN
        while True:
            left = end - time.monotonic()
            if left <= 0.0:
                break
            message = self._bus.recv(left)
            if message is None or message.is_error_frame:
                continue
            identifier = message.arbitration_id
            if (message.is_extended_id, identifier) in own:
                heard.add(identifier)
        return sorted(heard)

    def boot(self) -> None:
        """Switch the encoders on."""
        _send(self._bus, self._encoders.boot())

    def step(self) -> tuple[str, ...]:
        """
        Do the next step that is due: a cycle, the waiting frames, and heartbeats.

        Returns
        -------
        tuple of str
            Faults that began or ended, in words.

        Raises
        ------
        can.CanError
            The bus cannot be used; python-can raises one of BUS_ERRORS.

        """
        timeout = 0.0
        if self._grid is None:
            timeout = TEND_PERIOD
        elif self._grid.wait(TEND_PERIOD):
            self._send_sync()
        # Take all waiting frames: only the first is waited for.
        while (message := self._bus.recv(timeout)) is not None:
            self._receive(message)
            timeout = 0.0
        now = time.monotonic()
        _send(self._bus, self._encoders.tend(now))
        return self._encoders.faults.take_news()

    def _send_sync(self) -> None:
        """Send SYNC, where there is one, and have the encoders answer."""
        now = time.monotonic()
        if self._sync_id:
            sync = canopen.frame(self._sync_id)
            self._bus.send(sync)
        self._cycle(now)

    def _receive(self, message: can.Message) -> None:
        """Have the encoders answer a frame; another master's SYNC, where none is made here."""
        if not self._is_sync(message):
            answers = self._encoders.receive(message)
            _send(self._bus, answers)
        elif self._grid is None:
            # The encoders sample when SYNC comes, not when this process is woken by it.
            waited = time.time() - message.timestamp
            age = min(max(waited, 0.0), LONGEST_WAIT)
            self._cycle(time.monotonic() - age)

    def _is_sync(self, message: can.Message) -> bool:
        """Return whether a frame is SYNC."""
        is_other = message.is_error_frame or message.is_extended_id or message.is_remote_frame
        return message.arbitration_id == self._sync_id and not is_other

    def _cycle(self, now: float) -> None:
        """
        Send the answers of a cycle, and record its true orientation.

        Parameters
        ----------
        now : float
            Monotonic time of SYNC, s.

        """
        answers = self._encoders.cycle(now)
        _send(self._bus, answers)
        self.cycles += bool(answers)
        if not answers or self._record is None:
            return
        truth = self._encoders.orientation(now)
        if truth is not None:
            elapsed = time.monotonic() - now
            stamp = time.time_ns() - round(elapsed * 1e9)
            self._record(stamp, truth)


class DriveLoop:
    """
    Carries frames between an open bus and the simulated drives, in a thread, until it is closed.

    Parameters
    ----------
    bus : can.BusABC
        Open bus; nothing else may receive from it.
    drives : SimulatedDrives
        Drives that answer.

    Attributes
    ----------
    error : str or None
        Why the bus ended the loop; None while it runs.

    """

    def __init__(self, bus: can.BusABC, drives: SimulatedDrives):
        self._bus = bus
        self._drives = drives
        self.error: str | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='drives')
        self._thread.start()

    def close(self) -> None:
        """End the thread; the bus stays open."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        """Boot the drives, then carry frames until the loop is closed or the bus fails."""
        try:
            _send(self._bus, self._drives.boot())
            while not self._stop.is_set():
                timeout = STEP
                # Take all waiting frames before a time-out counts: the machine may be busy.
                while (message := self._bus.recv(timeout)) is not None:
                    now = time.monotonic()
                    answers = self._drives.receive(message, now)
                    _send(self._bus, answers)
                    timeout = 0.0
                now = time.monotonic()
                _send(self._bus, self._drives.tend(now))
        except BUS_ERRORS as error:
            self.error = first_line(error)


def _send(bus: can.BusABC, messages: Iterable[can.Message]) -> None:
    """Send messages, in their order."""
    for message in messages:
        bus.send(message)
