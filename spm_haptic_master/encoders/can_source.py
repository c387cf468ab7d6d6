# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Joint samples from encoders on a CAN bus, by any interface of python-can.

The bus is read in the caller's thread; SYNC has a thread of its own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
import threading
import time

import can
from spm_haptic_master.encoders import can_bus, canopen
from spm_haptic_master.encoders.frame_decoder import FrameDecoder, recent, WITHOUT_SYNC
from spm_haptic_master.encoders.single_axis import AxisReading
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.encoders.sync import SyncProducer
from spm_haptic_master.timing import Periodic

# Time between the first two attempts to open a bus (s), doubled each time up to the last.
REOPEN_FIRST = 0.1
REOPEN_LAST = 2.0
# Time without any frame after which the bus is reopened (s): an interface that was removed and
# came back under the same name leaves the old socket silent.
REOPEN_SILENT = 2.0
# Time between two polls for silent encoders (s).
POLL_PERIOD = 0.02
# Shortest time for which a reason is reported (s): the encoder that is missed may change with
# every frame.
REASON_HOLD = 0.5
# Time between two SYNCs that are left out (s): of 1000 sets a second, it costs one.
SKIP_PERIOD = 1.0
# Longest time for which sending may block (s).
SEND_TIMEOUT = 0.01


class CanSource(EncoderSource):
    """
    Source that reads the encoders from a CAN bus, in the caller's thread.

    A bus that is missing or fails is reopened, with back-off. Nodes of the decoder's network that
    boot or are silent are started (NMT).

    Parameters
    ----------
    interface, channel : str
        Bus by python-can's names; see `can_bus.open_bus`.
    bitrate : int
        Bit rate, bit/s; 0 leaves it to the system.
    decoder : FrameDecoder
        What makes sets of frames.
    timeout : float
        Time without a set, or without a frame of an encoder, after which `fault` reports it, s.
    produce : float or None
        Period of SYNC, if it is produced here, s; None if another master produces it.
    stop_nodes : bool
        Whether `close` stops the nodes (NMT).

    Raises
    ------
    SettingError
        python-can has no such interface.

    """

    def __init__(
        self,
        interface: str,
        channel: str,
        bitrate: int,
        decoder: FrameDecoder,
        timeout: float,
        produce: float | None,
        stop_nodes: bool,
    ):
        can_bus.check_interface(interface)
        self._open_bus = partial(
            can_bus.open_bus, interface, channel, bitrate, produce is not None
        )
        self._name = can_bus.bus_name(interface, channel)
        self._decoder = decoder
        self.axes = decoder.axes
        self._timeout = timeout
        self._stop_nodes = stop_nodes
        self._bus: can.BusABC | None = None
        self._failure: str | None = f'{self._name}: not opened yet'
        self._backoff = REOPEN_FIRST
        self._retry_at = 0.0
        self._opened = 0
        if produce is None or decoder.sync_id is None:
            self._sync = None
        else:
            self._sync = SyncProducer(
                send=self._send,
                sync_id=decoder.sync_id,
                period=produce,
            )
        # Held to send: the SYNC thread and the reading thread both do.
        self._sending = threading.Lock()
        self._send_error: str | None = None  # of the latest send
        # Clock of the open bus; monotonic times of its opening, of the next poll and of the
        # latest frame, s. All are set by `_open`.
        self._clock: can_bus.ReceiveClock
        self._opened_at: float
        self._poll_at: float
        self._last_frame: float | None = None
        self._ready: deque[JointSample] = deque()  # sets that `read` has not returned yet
        self._skips = Periodic(SKIP_PERIOD)
        self._keep: Callable[[can.Message], None] | None = None
        self._last_set: float | None = None  # its time, s since the Unix epoch
        self._reason: str | None = None  # reported by `fault` since a monotonic time, s
        self._reason_since = float('-inf')

    def keep(self, take: Callable[[can.Message], None]) -> None:
        """
        Pass each frame, and the SYNC sent here, to a function: their replay yields the same sets.

        Parameters
        ----------
        take : callable
            Takes a frame, stamped in s since the Unix epoch.

        """
        self._keep = take

    def read(self, timeout: float) -> JointSample | None:
        """
        Return the next set.

        Parameters
        ----------
        timeout : float
            Longest wait, s.

        Returns
        -------
        JointSample or None
            None if no set is completed meanwhile, or if there is a reading of an axis.

        """
        deadline = time.monotonic() + timeout
        readings = self._decoder.readings
        while not (self._ready or readings) and (now := time.monotonic()) <= deadline:
            if self._bus is None:
                bus = self._open(now)
            else:
                bus = self._bus
            if bus is None:
                time.sleep(max(0.0, min(self._retry_at, deadline) - now))
                continue
            if now >= self._poll_at:
                self._poll_at = now + POLL_PERIOD
                self._poll(now)
                if self._bus is None:
                    continue
            self._receive(bus, min(deadline, self._poll_at) - now)
        if self._ready:
            return self._ready.popleft()
        return None

    def _receive(self, bus: can.BusABC, timeout: float) -> None:
        """Take the next frame within `timeout`, s; a bus that fails is closed."""
        try:
            message = bus.recv(timeout)
        except can_bus.BUS_ERRORS as error:
            self._fail(error)
            return
        if message is not None:
            self._take(message)

    def take_readings(self) -> list[AxisReading]:
        """Return the readings of the axes since the last call."""
        readings = list(self._decoder.readings)
        self._decoder.readings.clear()
        return readings

    @property
    def fault(self) -> str | None:
        """Reason why no sets come: the bus, missing frames, or the encoders at fault; or None."""
        # What other threads change is read once, here and below.
        if failure := self._failure:
            return failure
        found = self._find_fault()
        now = time.monotonic()
        if found is None:
            self._reason_since = float('-inf')
        elif now - self._reason_since >= REASON_HOLD:
            self._reason = found
            self._reason_since = now
        return found and self._reason

    def _find_fault(self) -> str | None:
        """Return why there is no set, None if there is one: the bus first, the encoders last."""
        now = time.time()
        if recent(self._last_set, now, self._timeout):
            return None
        decoder = self._decoder
        if decoder.bus_off:
            return f'{self._name}: bus-off'
        if not recent(self._last_frame, time.monotonic(), self._timeout):
            refused = self._send_error
            return f'no frames on {self._name}' + (f' (sending: {refused})' if refused else '')
        if (error := decoder.bus_error) and len(decoder.silent(now, self._timeout)) == len(
            decoder.encoders
        ):
            return f'{self._name}: {error}'
        if decoder.sync_id and not recent(decoder.sync_heard, now, self._timeout):
            return f'no SYNC 0x{decoder.sync_id:X} on {self._name}: {self._why_no_sync()}'
        return (
            decoder.explain(now, self._timeout)
            or f'frames on {self._name}, but no set of {decoder.words}'
        )

    def _why_no_sync(self) -> str:
        """Return why there is no SYNC, and what to do."""
        if self._sync is None:
            return 'no other master makes it, and can.sync is consume; ' + (
                WITHOUT_SYNC
                if self._decoder.sends_without_sync
                else 'give -p can.sync:=produce to make it here'
            )
        if refused := self._send_error:
            return f'sending: {refused}'
        if self._sync.producing:
            return 'this machine is too busy to make it in time'
        return 'listening for another master first'

    @property
    def caution(self) -> str | None:
        """Problem although sets come: of the encoders, or a second SYNC master; or None."""
        if self._sync and self._sync.yielding:
            return 'another master makes SYNC: this driver follows it and makes none'
        return self._decoder.caution(time.time())

    @property
    def lost(self) -> float:
        """Time by which the thread of SYNC has missed its deadlines, s."""
        if self._sync:
            return self._sync.lost
        return 0.0

    def statistics(self) -> dict[str, object]:
        """Return the counters and figures of the decoder, the bus and SYNC."""
        refused = self._send_error
        return {
            'bus': self._name,
            'bus opened': self._opened,
            **self._decoder.statistics(time.time()),
            **({'last send refused': refused} if refused else {}),
            **(self._sync.statistics() if self._sync else {}),
        }

    def close(self) -> None:
        """Stop the nodes, if that is configured, and close the bus."""
        if self._bus is not None and self._stop_nodes and self._decoder.network:
            for node in self._decoder.network.every:
                self._request(canopen.nmt(canopen.NMT_STOP, node.node_id))
        self._close_bus()

    def _take(self, message: can.Message) -> None:
        """Decode a frame, its time mapped to ROS time, and before it the SYNCs sent until then."""
        arrived = time.time()
        self._last_frame = time.monotonic()
        self._backoff = REOPEN_FIRST
        stamp = message.timestamp = self._clock.epoch(message.timestamp, arrived)
        if self._sync and self._decoder.is_sync(message):
            self._sync.heard(stamp)
        elif self._sync:
            for sent in self._sync.openings(stamp):
                self._decode(canopen.frame(self._decoder.sync_id or 0, stamp=sent))
        self._decode(message)
        if self._ready:
            self._last_set = arrived

    def _decode(self, message: can.Message) -> None:
        """Pass a frame on to the log and to the decoder; keep the set that it completes."""
        if self._keep:
            self._keep(message)
        if (sample := self._decoder.feed(message)) is not None:
            self._ready.append(sample)

    def _poll(self, now: float) -> None:
        """Start silent nodes, and close a bus that is silent for too long."""
        silent = self._decoder.silent_nodes(time.time(), self._timeout)
        if network := self._decoder.network:
            for node in network.to_start(time.time(), silent):
                self._request(canopen.nmt(canopen.NMT_START, node.node_id))
            for node, wanted in network.to_ask(time.time(), silent):
                self._request(canopen.sdo_upload(node.node_id, *wanted))
        self._leave_sync_out(now)
        if now - (self._last_frame or self._opened_at) > REOPEN_SILENT:
            self._close_bus()

    def _leave_sync_out(self, now: float) -> None:
        """Leave a SYNC out where that shows which encoders are late, unless one minds it."""
        network = self._decoder.network
        if (
            self._sync is None
            or not self._decoder.assembler.late.unproven
            or (network is not None and network.supervise_sync)
            or not self._skips.is_due(now)
        ):
            return
        if self._sync.skip() and network is not None:
            network.left_out_sync(time.time())

    def _request(self, message: can.Message) -> None:
        """Send a frame to a node; an error is reported by `fault`, and the frame repeated."""
        with suppress(*can_bus.BUS_ERRORS):
            self._send(message)

    def _send(self, message: can.Message) -> None:
        """Send a frame from any thread; one of BUS_ERRORS is kept for `fault`, and raised."""
        with self._sending:
            try:
                # The bus is open: the threads that send stop before it is closed.
                self._bus.send(message, SEND_TIMEOUT)  # type: ignore[union-attr]
                self._send_error = None
            except can_bus.BUS_ERRORS as error:
                self._send_error = can_bus.first_line(error)
                raise

    def _open(self, now: float) -> can.BusABC | None:
        """Open the bus; return None before the time of the next attempt, or if it fails."""
        if now < self._retry_at:
            return None
        try:
            bus = self._bus = self._open_bus()
        except can_bus.BUS_ERRORS as error:
            self._fail(error)
            return None
        self._decoder.assembler.reset()
        self._ready.clear()
        self._clock = can_bus.ReceiveClock()
        self._opened += 1
        self._failure = None
        self._last_frame = None
        self._opened_at = self._poll_at = now
        if self._sync:
            self._sync.start()
        return bus

    def _fail(self, error: Exception) -> None:
        """Close the bus after an error; try again after the back-off, which doubles each time."""
        self._failure = f'{self._name}: {can_bus.first_line(error)}'
        self._retry_at = time.monotonic() + self._backoff
        self._backoff = min(2.0 * self._backoff, REOPEN_LAST)
        self._close_bus()

    def _close_bus(self) -> None:
        """End the thread of SYNC, and close the bus."""
        if self._sync:
            self._sync.stop()
        if self._bus is not None:
            with suppress(*can_bus.BUS_ERRORS):  # the failure that closes it is already reported
                self._bus.shutdown()
            self._bus = None
