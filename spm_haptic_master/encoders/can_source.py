# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Live encoders on any bus that python-can drives."""

from __future__ import annotations

from functools import partial
import logging
import threading
import time
from typing import Any

import can

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_nodes import CanopenNodes
from spm_haptic_master.encoders.frame_decoder import FrameDecoder, recent
from spm_haptic_master.encoders.receive_clock import ReceiveClock
from spm_haptic_master.encoders.source import EncoderSource, JointSample
from spm_haptic_master.encoders.sync_producer import SyncProducer
from spm_haptic_master.exceptions import SettingError

# s between attempts to open a bus that is not there: doubled from the first to the last.
REOPEN_FIRST = 0.1
REOPEN_LAST = 2.0
# s without a single frame after which the bus is opened anew: an interface may have come back
# under the same name without telling the old socket.
REOPEN_SILENT = 2.0
# s between two looks at who is silent.
POLL_PERIOD = 0.02
# s for which a reason stands before another takes its place: what is lost changes by the frame.
REASON_HOLD = 0.5
# s; a send that blocks longer has failed.
SEND_TIMEOUT = 0.01


# What python-can raises, interface by interface, when a bus cannot be opened or used.
BUS_ERRORS = (can.CanError, OSError, ValueError, ImportError)


def check_interface(interface: str) -> None:
    """Raise SettingError where python-can has no such interface."""
    if interface not in can.VALID_INTERFACES:
        raise SettingError('can.interface', interface,
                           'one of ' + ', '.join(sorted(can.VALID_INTERFACES)))


def open_bus(interface: str, channel: str, bitrate: int, own: bool = False) -> can.BusABC:
    """
    Open a bus of python-can.

    Parameters
    ----------
    interface, channel : str
        As python-can names them ('socketcan' and 'can0' on a rig). What else an interface takes,
        python-can reads from its own configuration files and from CAN_CONFIG.
    bitrate : int
        bit/s, for interfaces that set it themselves; 0 leaves it to the system.
    own : bool
        Ask for the frames sent here too, where the interface can.

    Raises
    ------
    can.CanError, OSError, ValueError, ImportError
        It cannot be opened, each interface in its own way: BUS_ERRORS.

    """
    # python-can logs what it also raises.
    logging.getLogger('can').setLevel(logging.CRITICAL)
    settings: dict[str, Any] = {'interface': interface, 'channel': channel}
    if bitrate:
        settings['bitrate'] = bitrate
    if own:
        try:
            return can.Bus(**settings, receive_own_messages=True)
        except (NotImplementedError, TypeError):
            pass  # not this interface; it opens without
    return can.Bus(**settings)


class CanSource(EncoderSource):
    """
    Reads the four encoders from a CAN bus, in the caller's thread.

    A bus that is missing or breaks is opened again, with back-off; nodes that boot or keep silent
    are started again. The reason why there are no sets stands in `fault`.

    Parameters
    ----------
    interface, channel, bitrate
        As for `open_bus`.
    decoder : FrameDecoder
        Frames to sets; with a `network`, its nodes are started.
    timeout : float
        s without a set, or without an encoder's frame, after which that is a fault.
    produce : float or None
        s from one SYNC to the next made here; None where another master makes it.
    stop_nodes : bool
        NMT stop to the nodes at the end.

    Raises
    ------
    SettingError
        python-can has no such interface.

    """

    def __init__(self, interface: str, channel: str, bitrate: int, decoder: FrameDecoder,
                 timeout: float, produce: float | None = None, stop_nodes: bool = False):
        check_interface(interface)
        self._open_bus = partial(open_bus, interface, channel, bitrate, produce is not None)
        self._name = f'{interface} {channel}'
        self._decoder = decoder
        self._timeout = timeout
        self._stop_nodes = stop_nodes
        self._bus: can.BusABC | None = None
        self._broken: str | None = f'{self._name}: not opened yet'
        self._backoff = REOPEN_FIRST
        self._retry_at = 0.0
        self._opened = 0
        self._opened_at = 0.0
        self._clock = ReceiveClock()
        self._sync: SyncProducer | None = None
        if produce is not None and decoder.sync_id is not None:
            self._sync = SyncProducer(self._send, decoder.sync_id, produce)
        # The SYNC thread and the reading one both send.
        self._sending = threading.Lock()
        self._refused: str | None = None
        self._poll_at = 0.0
        # s, monotonic; s since the epoch.
        self._last_frame: float | None = None
        self._last_set: float | None = None
        self._told: str | None = None
        self._told_at = float('-inf')

    def read(self, timeout: float) -> JointSample | None:
        """Return the next set that the bus completes within `timeout` seconds."""
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
            sample = self._take(message)
            if sample is not None:
                return sample
        return None

    @property
    def fault(self) -> str | None:
        """Why no sets come: the bus, its silence, or what is wrong with which encoder."""
        if self._broken:
            return self._broken
        found = self._find_fault()
        now = time.monotonic()
        if found is None:
            self._told_at = float('-inf')
        elif now - self._told_at >= REASON_HOLD:
            self._told, self._told_at = found, now
        return found and self._told

    def _find_fault(self) -> str | None:
        now = time.time()
        if recent(self._last_set, now, self._timeout):
            return None
        decoder = self._decoder
        if decoder.bus_off:
            return f'{self._name}: bus-off'
        if decoder.network and decoder.emcy_stops and decoder.network.emergencies():
            return decoder.network.caution(now)
        silent = decoder.silent(now, self._timeout)
        if not recent(self._last_frame, time.monotonic(), self._timeout):
            reason = f'no frames on {self._name}'
            return f'{reason} (sending: {self._refused})' if self._refused else reason
        if decoder.bus_error and len(silent) == len(decoder.encoders):
            return f'{self._name}: {decoder.bus_error}'
        if decoder.sync_id and not recent(decoder.sync_heard, now, self._timeout):
            return self._no_sync()
        return decoder.explain(silent, now, self._timeout) \
            or f'frames on {self._name}, but no set of four encoders'

    @property
    def caution(self) -> str | None:
        """What is wrong although sets come: a node's heartbeat or emergency, a second master."""
        if self._sync and self._sync.stands_back:
            return 'another master makes SYNC: this driver follows it and makes none'
        network = self._decoder.network
        return None if network is None else network.caution(time.time())

    def statistics(self) -> dict[str, object]:
        """Return the decoder's counters and figures, and those of the bus."""
        found = {'bus': self._name, 'bus opened': self._opened,
                 **self._decoder.statistics(time.time())}
        if self._refused:
            found['last send refused'] = self._refused
        sync = self._sync
        if sync:
            found |= {'SYNC sent': sync.sent, 'SYNC not sent': sync.failed,
                      'SYNC deadlines missed': sync.missed,
                      "another master's SYNC": sync.foreign}
            lateness = sync.lateness.percentiles(0.5, 0.99, 1.0)
            if lateness:
                found['SYNC sent late p50 / p99 / max (us)'] = \
                    ' / '.join(f'{value:.0f}' for value in lateness)
        return found

    def close(self) -> None:
        """Leave the bus, its nodes stopped where that is asked for."""
        if self._bus is None:
            return
        if self._stop_nodes and self._decoder.network:
            for node in self._decoder.network.nodes:
                self._command(canopen.NMT_STOP, node.node_id)
        self._leave()

    def _no_sync(self) -> str:
        if self._sync is None:
            reason = 'no other master makes it, and can.sync is consume'
        elif self._refused:
            reason = f'sending: {self._refused}'
        elif self._sync.producing:
            reason = 'this machine is too busy to make it in time'
        else:
            reason = 'listening for another master first'
        return f'no SYNC 0x{self._decoder.sync_id:X} on {self._name}: {reason}'

    def _take(self, message: can.Message) -> JointSample | None:
        """Give a frame to the decoder, its time on our clock, and what it calls for to the bus."""
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
                    decoder.open_cycle(sent)
        sample = decoder.feed(message)
        if sample is not None:
            self._last_set = arrived
        elif decoder.network and decoder.network.booted:
            self._start(decoder.network, ())
        return sample

    def _poll(self, now: float) -> None:
        """Start the nodes that are silent, and leave a bus that has died without a word."""
        network = self._decoder.network
        if network:
            self._start(network, self._decoder.silent(time.time(), self._timeout))
        if now - (self._last_frame or self._opened_at) > REOPEN_SILENT:
            self._leave()

    def _start(self, network: CanopenNodes, silent: tuple[int, ...]) -> None:
        for node in network.to_start(time.time(), silent):
            self._command(canopen.NMT_START, node.node_id)

    def _command(self, command: int, node_id: int) -> None:
        try:
            self._send(canopen.nmt(command, node_id))
        except BUS_ERRORS:
            pass  # said in `fault` and sent again when it is still silent

    def _send(self, message: can.Message) -> None:
        with self._sending:
            try:
                # Nothing sends while there is no bus: its threads stop before it is left.
                self._bus.send(message, SEND_TIMEOUT)  # type: ignore[union-attr]
                self._refused = None
            except BUS_ERRORS as error:
                self._refused = _line(error)
                raise

    def _open(self, now: float) -> can.BusABC | None:
        """Return the bus opened, None where it is not yet time for that or it failed."""
        if now < self._retry_at:
            return None
        try:
            bus = self._bus = self._open_bus()
        except BUS_ERRORS as error:
            self._fail(error)
            return None
        self._decoder.reset()
        self._clock = ReceiveClock()
        self._opened += 1
        self._broken = None
        self._last_frame = None
        self._opened_at = self._poll_at = now
        if self._sync:
            self._sync.start()
        return bus

    def _fail(self, error: Exception) -> None:
        """Note the error, drop the bus, and set when to try again."""
        self._broken = f'{self._name}: {_line(error)}'
        self._retry_at = time.monotonic() + self._backoff
        self._backoff = min(2.0 * self._backoff, REOPEN_LAST)
        self._leave()

    def _leave(self) -> None:
        if self._sync:
            self._sync.stop()
        if self._bus is not None:
            try:
                self._bus.shutdown()
            except BUS_ERRORS:
                pass  # it is broken already, and said so
            self._bus = None


def _line(error: Exception) -> str:
    """Return what an error says in one line: some of python-can's carry a traceback."""
    return (str(error) or type(error).__name__).splitlines()[0]
