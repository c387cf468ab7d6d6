# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The loop of a bus scan: listen, ask the nodes for their identity, start them on request."""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Callable, Iterator
import time

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, first_line
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid

# Time between two SDO requests (s): they take a tenth of a 1 Mbit/s bus at most.
REQUEST_PERIOD = 0.002
# Time between two reports of the progress (s).
PROGRESS_PERIOD = 1.0
# Time of listening for a master's SYNC before one is sent here (s): a period of the lowest
# `rate`, 1 Hz, and some.
SYNC_LISTEN = 1.1
# Most frames that are read before it is time to send again: more wait on a machine that is too
# busy only, and that is to show in the rate of SYNC.
FRAMES_AT_ONCE = 32
# Time between two NMT starts to a node that is not operational (s).
START_PERIOD = 0.5
# Interface of python-can that returns the frames sent, without a mark.
ECHOING = 'udp_multicast'
# Longest time from a frame to its echo (s): a lost echo is forgotten after it.
ECHO_TIMEOUT = 1.0


class OwnFrames:
    """Matches received frames with those sent, each of which an echoing interface returns once."""

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


class BusScanner:
    """
    Feeds what is on a bus to a scan; asks, starts and synchronises the nodes on request.

    `rate` is that of the bus's cycle, Hz; `echoes` is whether the interface returns the frames
    sent; `report` takes a line on what the scanner does on the bus.
    """

    def __init__(self, bus: can.BusABC, scan: BusScan, rate: float, echoes: bool,
                 report: Callable[[str], None]):
        self._bus = bus
        self._scan = scan
        self._rate = rate
        self._own = OwnFrames(echoes)
        self._report = report
        self._sync_grid: DeadlineGrid | None = None
        # Time of the latest NMT start to each node, s.
        self._started_at: dict[int, float] = {}

    def listen(self, seconds: float, ask: bool, start: tuple[int, ...] | None = None) -> None:
        """
        Listen for some seconds, and ask every node for its type, each one heard for its identity.

        With `start`, the nodes of these ids are started, and every other one that is heard; where
        no master makes SYNC it is then sent here at the rate, for some seconds, until a master
        appears.
        """
        # Monotonic time from which SYNC is sent, s.
        sync_at = None if start is None else time.monotonic() + SYNC_LISTEN
        for node_id in start or ():
            self._start_node(node_id, time.monotonic())
        end = max(time.monotonic() + seconds, sync_at or 0.0)
        requests = self._identity_requests() if ask else iter(())
        request_grid = DeadlineGrid(REQUEST_PERIOD)
        timeout = REQUEST_PERIOD
        shown = time.monotonic()
        while (now := time.monotonic()) < end or (sync_at or now) < now:
            if request_grid.wait(0.0):
                if request := next(requests, None):
                    self._send(request)
                if sync_at is not None:
                    self._start_nodes(now)
            if sync_at is not None and now > sync_at:
                sync_at = float('inf')
                if self._begin_sync():
                    end = now + seconds
                    timeout = min(REQUEST_PERIOD, 0.5 / self._rate)
            self._send_sync()
            self._receive(timeout)
            if now - shown >= PROGRESS_PERIOD:
                shown = now
                self._report(f'{end - now:.0f} s left, {len(self._scan.frames)} identifiers')

    def _receive(self, timeout: float) -> None:
        """Feed the frames that are waiting, or the first one within a time, s."""
        for _ in range(FRAMES_AT_ONCE):
            message = self._bus.recv(timeout)
            if message is None:
                return
            if not self._own.is_own(message, time.monotonic()):
                self._scan.feed(message)
            timeout = 0.0

    def _begin_sync(self) -> bool:
        """Begin to send SYNC, if the bus has SYNC and no master makes it; return whether."""
        if self._scan.sync_id is None or self._scan.master_sync is not None:
            return False
        self._report(f'no SYNC on the bus: SYNC 0x{self._scan.sync_id:X} is sent from here, at '
                     f'{self._rate:g} Hz')
        self._sync_grid = DeadlineGrid(1.0 / self._rate)
        return True

    def _send_sync(self) -> None:
        """Send SYNC, if it is due; end that for good where a master makes it."""
        if self._sync_grid is None or self._scan.sync_id is None:
            return
        if self._scan.master_sync is not None:
            self._sync_grid = None
            self._report('another master makes SYNC: none is sent from here any more')
        elif self._sync_grid.wait(0.0) and self._send(canopen.frame(self._scan.sync_id)):
            self._scan.sent_sync(time.monotonic())

    def _start_nodes(self, now: float) -> None:
        """Send NMT start to the nodes heard that are not operational, now and then."""
        for node_id, node in self._scan.nodes.items():
            if node.state != canopen.OPERATIONAL \
                    and now - self._started_at.get(node_id, float('-inf')) > START_PERIOD:
                self._start_node(node_id, now)

    def _start_node(self, node_id: int, now: float) -> None:
        self._started_at[node_id] = now
        if self._send(canopen.nmt(canopen.NMT_START, node_id)):
            self._scan.started.add(node_id)

    def _send(self, message: can.Message) -> bool:
        """
        Send a frame and return whether the interface took it; a scan goes on where it did not.

        On a bus on which nobody acknowledges every frame is refused once its queue is full.
        """
        # Before it is sent: the echo may be there before the interface returns.
        self._own.sent(message, time.monotonic())
        try:
            self._bus.send(message)
        except BUS_ERRORS as error:
            self._own.is_own(message, time.monotonic())
            self._scan.unsent[first_line(error)] += 1
            return False
        return True

    def _identity_requests(self) -> Iterator[can.Message]:
        """Yield requests for the type to every node id, then for the rest to those heard."""
        for entry in canopen.IDENTITY:
            for node_id in range(1, canopen.NODE_ID_MAXIMUM + 1):
                if entry == canopen.DEVICE_TYPE or node_id in self._scan.nodes:
                    yield canopen.sdo_upload(node_id, *entry)
