# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated drives of all motors on a bus, and their loop in a thread of its own."""

from __future__ import annotations

from collections.abc import Iterable
import threading
import time

import can
from spm_haptic_master.drives.plan import Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, first_line
from spm_haptic_master.simulation.fault_injection import Fault
from spm_haptic_master.simulation.simulated_drive import SimulatedDrive

# Longest wait for a frame (s): the drives' grid of time.
STEP = 0.0005


class SimulatedDrives:
    """
    Drives and their faults, which are timed from the first start of a node.

    Parameters
    ----------
    plan : Plan
        What they are configured to be.
    faults : tuple of Fault
        Faults of DRIVE_KINDS.
    factory : bool
        Whether they are not set up yet.

    Attributes
    ----------
    drives : tuple of N SimulatedDrive
        The drives.
    news : list of str
        Faults that began or ended since the list was last emptied.

    """

    def __init__(self, plan: Plan, faults: tuple[Fault, ...] = (), factory: bool = False):
        self.drives = tuple(SimulatedDrive(plan, own, factory) for own in plan.drives)
        self._faults = faults
        self._began: float | None = None
        self.news: list[str] = []

    def boot(self) -> list[can.Message]:
        """Switch the drives on, and return their boot-up messages."""
        return [message for drive in self.drives for message in drive.boot()]

    def receive(self, message: can.Message, now: float) -> list[can.Message]:
        """Return the answers to a frame that comes at a time, s."""
        if message.is_error_frame or message.is_remote_frame or message.is_extended_id:
            return []
        return [answer for drive in self.drives for answer in drive.receive(message, now)]

    def tend(self, now: float) -> list[can.Message]:
        """Let time go on to `now`, s; return the frames that are due."""
        if self._began is None and any(drive.nmt == canopen.OPERATIONAL for drive in self.drives):
            self._began = now
        if self._began is not None:
            for fault in self._faults:
                self._switch(fault, fault.active(now - self._began))
        return [message for drive in self.drives for message in drive.tend(now)]

    def take_news(self) -> list[str]:
        """Return the faults that began or ended since the last call."""
        found, self.news = self.news, []
        return found

    def _switch(self, fault: Fault, active: bool) -> None:
        if fault.joint is None or fault.joint >= len(self.drives):
            return
        present = self.drives[fault.joint].faults
        if active == (fault.kind in present):
            return
        if active:
            present[fault.kind] = fault.value
        else:
            del present[fault.kind]
        self.news.append(f'{fault.text} {"begins" if active else "ends"}')


class DriveLoop:
    """
    Carries frames between a bus and the simulated drives, in a thread, until it is closed.

    Parameters
    ----------
    bus : can.BusABC
        Open bus.
    drives : SimulatedDrives
        The drives.

    Attributes
    ----------
    error : str or None
        Why the bus has ended the loop.

    """

    def __init__(self, bus: can.BusABC, drives: SimulatedDrives):
        self._bus, self._drives = bus, drives
        self.error: str | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name='drives', daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread; the bus stays open."""
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            self._send(self._drives.boot())
            while not self._stop.is_set():
                timeout = STEP
                # All that waits is taken before a time-out counts: the machine may be busy.
                while (message := self._bus.recv(timeout)) is not None:
                    self._send(self._drives.receive(message, time.monotonic()))
                    timeout = 0.0
                self._send(self._drives.tend(time.monotonic()))
        except BUS_ERRORS as error:
            self.error = first_line(error)

    def _send(self, messages: Iterable[can.Message]) -> None:
        for message in messages:
            self._bus.send(message)
