# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop of a bus scan: listen, ask the nodes for their identity, send SYNC on request."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, first_line
from spm_haptic_master.encoders.bus_scan import BusScan, IDENTITY
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid

# Time between two SDO requests (s): they take a tenth of a 1 Mbit/s bus at most.
REQUEST_PERIOD = 0.002
# Time between two reports of the progress (s).
PROGRESS_PERIOD = 1.0


def listen(bus: can.BusABC, scan: BusScan, seconds: float, rate: float, ask: bool,
           sync_id: int | None, progress: Callable[[float], None]) -> None:
    """
    Feed what is on a bus to a scan.

    Parameters
    ----------
    bus : can.BusABC
        Open bus.
    scan : BusScan
        Collects the frames.
    seconds : float
        Length of the scan, s.
    rate : float
        Rate of the bus's cycle, Hz.
    ask : bool
        Ask every node for its device type, and each one heard for its identity.
    sync_id : int or None
        Identifier of the SYNC to send at `rate`; None to send none.
    progress : callable
        Called once a second with the time left, s.

    """
    end = time.monotonic() + seconds
    requests = _identity_requests(scan) if ask else iter(())
    request_grid = DeadlineGrid(REQUEST_PERIOD)
    sync_grid = DeadlineGrid(1.0 / rate)
    shown = time.monotonic()
    while (now := time.monotonic()) < end:
        if request_grid.wait(0.0) and (request := next(requests, None)):
            send(bus, request, scan)
        if sync_id and sync_grid.wait(0.0):
            send(bus, canopen.frame(sync_id), scan)
        if (message := bus.recv(min(REQUEST_PERIOD, 0.5 / rate))) is not None:
            scan.feed(message)
        if now - shown >= PROGRESS_PERIOD:
            shown = now
            progress(end - now)


def send(bus: can.BusABC, message: can.Message, scan: BusScan) -> None:
    """
    Send a frame; a scan goes on where it cannot be sent, and reports that.

    On a bus on which nobody acknowledges, for which a scan is made above all, every frame is
    refused once the interface's queue is full.
    """
    try:
        bus.send(message)
    except BUS_ERRORS as error:
        scan.unsent[first_line(error)] += 1


def _identity_requests(scan: BusScan) -> Iterator[can.Message]:
    """Yield requests for the device type to every node id, then for the rest to nodes heard."""
    for entry in IDENTITY:
        for node_id in range(1, canopen.NODE_ID_MAXIMUM + 1):
            if entry == canopen.DEVICE_TYPE or node_id in scan.nodes:
                yield canopen.sdo_upload(node_id, *entry)
