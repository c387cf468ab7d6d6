# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Joint samples from encoders on a CAN bus, by any interface of python-can."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
import logging
import threading
import time
from typing import Any

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS, bus_name, first_line
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes
from spm_haptic_master.encoders.frame_decoder import FrameDecoder, recent, WITHOUT_SYNC
from spm_haptic_master.encoders.receive_clock import ReceiveClock
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.encoders.sync_producer import SyncProducer
from spm_haptic_master.exceptions import SettingError

# Time between the first two attempts to open a bus (s); each further time is twice as long ...
REOPEN_FIRST = 0.1
# ... up to this one (s).
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


def check_interface(interface: str, name: str = 'can.interface') -> None:
    """Raise SettingError if python-can has no such interface; `name` is that of the setting."""
    if interface not in can.VALID_INTERFACES:
        raise SettingError(name, interface,
                           'one of ' + ', '.join(sorted(can.VALID_INTERFACES)))


def open_bus(interface: str, channel: str, bitrate: int, own: bool = False) -> can.BusABC:
    """
    Open a bus of python-can.

    Parameters
    ----------
    interface, channel : str
        Names used by python-can ('socketcan' and 'can0' on a rig). python-can reads further
        settings of an interface from its configuration files and from CAN_CONFIG.
    bitrate : int
        Bit rate, bit/s, for interfaces that set it themselves; 0 leaves it to the system.
    own : bool
        Whether to receive the frames sent here, too, if the interface supports that.

    Raises
    ------
    can.CanError, OSError, ValueError, ImportError
        The bus cannot be opened; which of these (BUS_ERRORS) depends on the interface.

    """
    # python-can logs the errors that it raises.
    logging.getLogger('can').setLevel(logging.CRITICAL)
    settings: dict[str, Any] = {'interface': interface, 'channel': channel}
    if bitrate:
        settings['bitrate'] = bitrate
    if own:
        try:
            return can.Bus(**settings, receive_own_messages=True)
        except (NotImplementedError, TypeError):
            pass  # not supported; opened without below
    return can.Bus(**settings)


class CanSource(EncoderSource):
    """
    Source that reads the encoders from a CAN bus, in the caller's thread.

    A bus that is missing or fails is reopened, with back-off. Nodes that boot or are silent are
    started. `fault` is the reason why there are no sets.

    Parameters
    ----------
    interface, channel : str
        See `open_bus`.
    bitrate : int
        See `open_bus`.
    decoder : FrameDecoder
        Decoder of frames into sets; the nodes of its `network` are started.
    timeout : float
        Time without a set, or without an encoder's frame, that is a fault, s.
    produce : float or None
        Period of the SYNC produced here, s; None if another master produces it.
    stop_nodes : bool
        Whether to send NMT stop to the nodes at the end.

    Raises
    ------
    SettingError
        python-can has no such interface.

    """

    def __init__(self, interface: str, channel: str, bitrate: int, decoder: FrameDecoder,
                 timeout: float, produce: float | None, stop_nodes: bool):
        check_interface(interface)
        self._open_bus = partial(open_bus, interface, channel, bitrate, produce is not None)
        self._name = bus_name(interface, channel)
        self._decoder = decoder
        self._timeout = timeout
        self._stop_nodes = stop_nodes
        self._bus: can.BusABC | None = None
        self._failure: str | None = f'{self._name}: not opened yet'
        self._backoff = REOPEN_FIRST
        self._retry_at = 0.0
        self._opened = 0
        self._sync: SyncProducer | None = None
        if produce is not None and decoder.sync_id is not None:
            self._sync = SyncProducer(self._send, decoder.sync_id, produce)
        # Held to send: the SYNC thread and the reading thread both do.
        self._sending = threading.Lock()
        # Error of the latest send, None if it succeeded.
        self._send_error: str | None = None
        # Clock of the open bus; set by `_open`, as are the following.
        self._clock: ReceiveClock
        # Monotonic times of the opening and of the next poll, s.
        self._opened_at: float
        self._poll_at: float
        # Monotonic time of the latest frame, s.
        self._last_frame: float | None = None
        # Sets that frames have completed and `read` has not returned.
        self._ready: deque[JointSample] = deque()
        self._skip_at = 0.0
        self._keep: Callable[[can.Message], None] | None = None
        # Time of the latest set, s since the Unix epoch.
        self._last_set: float | None = None
        # Reason reported by `fault`, and the monotonic time since which it is, s.
        self._reason: str | None = None
        self._reason_since = float('-inf')

    def keep(self, take: Callable[[can.Message], None]) -> None:
        """
        Have each frame taken, with its time in s since the Unix epoch, SYNC sent here included.

        A replay of these frames yields the sets of this source.

        Parameters
        ----------
        take : callable
            Called in the thread that reads; raises nothing.

        """
        self._keep = take

    def read(self, timeout: float) -> JointSample | None:
        """Return the next set completed within `timeout` seconds, None if there is none."""
        if self._ready:
            return self._ready.popleft()
        deadline = time.monotonic() + timeout
        while (now := time.monotonic()) <= deadline:
            bus = self._open(now) if self._bus is None else self._bus
            if bus is None:
                time.sleep(max(0.0, min(self._retry_at, deadline) - now))
                continue
            if now >= self._poll_at:
                self._poll_at = now + POLL_PERIOD
                self._poll(now)
                if self._bus is None:
                    continue
            try:
                message = bus.recv(min(deadline, self._poll_at) - now)
            except BUS_ERRORS as error:
                self._fail(error)
                continue
            if message is None:
                continue
            self._take(message)
            if self._ready:
                return self._ready.popleft()
        return None

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
            self._reason, self._reason_since = found, now
        return found and self._reason

    def _find_fault(self) -> str | None:
        now = time.time()
        if recent(self._last_set, now, self._timeout):
            return None
        decoder = self._decoder
        if decoder.bus_off:
            return f'{self._name}: bus-off'
        silent = decoder.silent(now, self._timeout)
        if not recent(self._last_frame, time.monotonic(), self._timeout):
            reason = f'no frames on {self._name}'
            refused = self._send_error
            return f'{reason} (sending: {refused})' if refused else reason
        if (error := decoder.bus_error) and len(silent) == len(decoder.encoders):
            return f'{self._name}: {error}'
        if decoder.sync_id and not recent(decoder.sync_heard, now, self._timeout):
            return self._no_sync()
        return decoder.explain(silent, now, self._timeout) \
            or f'frames on {self._name}, but no set of {decoder.words}'

    @property
    def caution(self) -> str | None:
        """Problem although sets come: of the encoders, or a second SYNC master; or None."""
        if self._sync and self._sync.yielding:
            return 'another master makes SYNC: this driver follows it and makes none'
        return self._decoder.caution(time.time())

    @property
    def lost(self) -> float:
        """Time by which the thread of SYNC has missed its deadlines, s."""
        return self._sync.lost if self._sync else 0.0

    def statistics(self) -> dict[str, object]:
        """Return the counters and figures of the decoder and the bus."""
        found = {'bus': self._name, 'bus opened': self._opened,
                 **self._decoder.statistics(time.time())}
        if refused := self._send_error:
            found['last send refused'] = refused
        sync = self._sync
        if sync:
            found |= {'SYNC sent': sync.sent, 'SYNC not sent': sync.failed,
                      'SYNC deadlines missed': sync.missed, 'SYNC left out': sync.skipped,
                      "another master's SYNC": sync.foreign}
            lateness = sync.lateness.percentiles(0.5, 0.99, 1.0)
            if lateness:
                found['SYNC sent late p50 / p99 / max (us)'] = \
                    ' / '.join(f'{value:.0f}' for value in lateness)
        return found

    def close(self) -> None:
        """Stop the nodes, if that is configured, and close the bus."""
        if self._bus is None:
            return
        if self._stop_nodes and self._decoder.network:
            for node in self._decoder.network.nodes:
                self._command(canopen.NMT_STOP, node.node_id)
        self._close_bus()

    def _no_sync(self) -> str:
        if self._sync is None:
            reason = 'no other master makes it, and can.sync is consume; ' + (
                WITHOUT_SYNC if self._decoder.sends_without_sync
                else 'give -p can.sync:=produce to make it here')
        elif refused := self._send_error:
            reason = f'sending: {refused}'
        elif self._sync.producing:
            reason = 'this machine is too busy to make it in time'
        else:
            reason = 'listening for another master first'
        return f'no SYNC 0x{self._decoder.sync_id:X} on {self._name}: {reason}'

    def _take(self, message: can.Message) -> None:
        """Decode a frame, its time mapped to ROS time; start the nodes that booted."""
        arrived = time.time()
        self._last_frame = time.monotonic()
        self._backoff = REOPEN_FIRST
        stamp = message.timestamp = self._clock.epoch(message.timestamp, arrived)
        decoder = self._decoder
        if self._sync:
            if decoder.is_sync(message):
                self._sync.heard(stamp)
            else:
                for sent in self._sync.openings(stamp):
                    if self._keep and decoder.sync_id is not None:
                        sync = canopen.frame(decoder.sync_id)
                        sync.timestamp = sent
                        self._keep(sync)
                    if (ended := decoder.open_cycle(sent)) is not None:
                        self._ready.append(ended)
        if self._keep:
            self._keep(message)
        if (sample := decoder.feed(message)) is not None:
            self._ready.append(sample)
        if self._ready:
            self._last_set = arrived
        elif decoder.network and decoder.network.booted:
            self._start(decoder.network, ())

    def _poll(self, now: float) -> None:
        """Start silent nodes, and close a bus that has received nothing for too long."""
        network = self._decoder.network
        if network:
            self._start(network, self._decoder.silent(time.time(), self._timeout))
        if self._sync and now >= self._skip_at and self._decoder.assembler.late.unproven:
            self._skip_at = now + SKIP_PERIOD
            self._sync.skip()
        if now - (self._last_frame or self._opened_at) > REOPEN_SILENT:
            self._close_bus()

    def _start(self, network: CanopenNodes, silent: tuple[int, ...]) -> None:
        for node in network.to_start(time.time(), silent):
            self._command(canopen.NMT_START, node.node_id)

    def _command(self, command: int, node_id: int) -> None:
        try:
            self._send(canopen.nmt(command, node_id))
        except BUS_ERRORS:
            pass  # reported by `fault`; repeated while the node is silent

    def _send(self, message: can.Message) -> None:
        with self._sending:
            try:
                # The bus is open: the threads that send stop before it is closed.
                self._bus.send(message, SEND_TIMEOUT)  # type: ignore[union-attr]
                self._send_error = None
            except BUS_ERRORS as error:
                self._send_error = first_line(error)
                raise

    def _open(self, now: float) -> can.BusABC | None:
        """Open the bus; return None before the time of the next attempt, or if it fails."""
        if now < self._retry_at:
            return None
        try:
            bus = self._bus = self._open_bus()
        except BUS_ERRORS as error:
            self._fail(error)
            return None
        self._decoder.reset()
        self._ready.clear()
        self._clock = ReceiveClock()
        self._opened += 1
        self._failure = None
        self._last_frame = None
        self._opened_at = self._poll_at = now
        if self._sync:
            self._sync.start()
        return bus

    def _fail(self, error: Exception) -> None:
        """Record the error, close the bus, and set the time of the next attempt."""
        self._failure = f'{self._name}: {first_line(error)}'
        self._retry_at = time.monotonic() + self._backoff
        self._backoff = min(2.0 * self._backoff, REOPEN_LAST)
        self._close_bus()

    def _close_bus(self) -> None:
        if self._sync:
            self._sync.stop()
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except BUS_ERRORS:
                pass  # the failure that closes it is already reported
            self._bus = None
