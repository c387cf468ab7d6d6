# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The library canopen on an open bus: objects by SDO, states by NMT, settings by LSS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import logging
import threading
import time
from typing import Any

import can
from spm_haptic_master.encoders import canopen as protocol
from spm_haptic_master.encoders.bus_errors import BUS_ERRORS
from spm_haptic_master.exceptions import InputError, SetupError

# Longest wait for the answer to a request (s), and for that to storing into flash memory.
ANSWER_TIMEOUT, STORE_TIMEOUT = 0.5, 5.0
# Number of requests by SDO until an encoder does not answer: a frame may get lost.
REQUESTS = 2
# Longest wait for an answer by LSS (s), which is asked for once.
LSS_TIMEOUT = REQUESTS * ANSWER_TIMEOUT
# Longest wait for the boot-up message of a node that was reset (s).
BOOT_TIMEOUT = 5.0
# Time between two requests to all node ids (s): they fit into any interface's queue.
SEARCH_PERIOD = 0.002
# Time after the last of these requests in which an answer is valid (s).
SEARCH_TIMEOUT = 0.2
# Longest wait of the receiving thread for a frame (s), and so of the end for that thread.
RECEIVE_TIMEOUT = 0.1
# Abort codes that mean that there is no such object.
MISSING = (protocol.SDO_NO_SUCH_OBJECT, protocol.SDO_NO_SUCH_SUBINDEX)


def import_canopen() -> Any:
    """Return the library canopen; raise InputError if it is not installed."""
    try:
        import canopen
    except ImportError as error:
        raise InputError('setting encoders up needs canopen (sudo apt install '
                         "python3-canopen; in a virtual environment: pip install '.[setup]'): "
                         f'{error}') from error
    # It logs what it raises.
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    return canopen


@contextmanager
def network_on(bus: can.BusABC) -> Iterator[Any]:
    """Put the library's network on an open bus; the bus stays open afterwards."""
    network = import_canopen().Network(bus)
    network.NOTIFIER_CYCLE = RECEIVE_TIMEOUT
    network.connect()
    network.lss.RESPONSE_TIMEOUT = LSS_TIMEOUT
    try:
        yield network
    finally:
        network.notifier.stop()


@contextmanager
def heard_by(network: Any, identifiers: Iterable[int],
             take: Callable[[int, bytes], object]) -> Iterator[None]:
    """Have identifier and data of the frames with some identifiers taken meanwhile."""
    def heard(identifier: int, data: bytes, _: float) -> None:
        take(identifier, bytes(data))

    every = tuple(identifiers)
    for each in every:
        network.subscribe(each, heard)
    try:
        yield
    finally:
        for each in every:
            network.unsubscribe(each, heard)


class Node:
    """One encoder, as the master sees it; SetupError if it does not answer, or refuses."""

    def __init__(self, network: Any, node_id: int):
        self._canopen = import_canopen()
        self._network = network
        self.node_id = node_id
        self._sdo = network.add_node(
            self._canopen.RemoteNode(node_id, self._canopen.ObjectDictionary())).sdo
        self._sdo.RESPONSE_TIMEOUT, self._sdo.MAX_RETRIES = ANSWER_TIMEOUT, REQUESTS

    def read(self, index: int, subindex: int) -> int | None:
        """Return the value of an object, None if the encoder has none."""
        return self.read_sized(index, subindex)[0]

    def read_sized(self, index: int, subindex: int) -> tuple[int | None, int]:
        """Return the value of an object and its size, bytes, as `read` does."""
        try:
            data = self._sdo.upload(index, subindex)
        except self._canopen.SdoAbortedError as abort:
            if abort.code in MISSING:
                return None, 0
            raise SetupError(f'node {self.node_id} refuses to read 0x{index:04X}:{subindex:02X}: '
                             f'{abort}') from abort
        except self._canopen.SdoCommunicationError as error:
            self._check_bus()
            raise SetupError(f'node {self.node_id} does not answer SDO ({error})') from error
        return int.from_bytes(data, 'little'), len(data)

    def write(self, index: int, subindex: int, value: int, size: int) -> None:
        """Write an object of a size in bytes."""
        try:
            self._sdo.download(index, subindex, value.to_bytes(size, 'little'))
        except self._canopen.SdoAbortedError as abort:
            raise SetupError(f'node {self.node_id} refuses 0x{value:X} for '
                             f'0x{index:04X}:{subindex:02X}: {abort}') from abort
        except self._canopen.SdoCommunicationError as error:
            self._check_bus()
            raise SetupError(f'node {self.node_id} does not answer while '
                             f'0x{index:04X}:{subindex:02X} is written ({error})') from error

    def store(self) -> None:
        """Store all parameters."""
        self._sdo.RESPONSE_TIMEOUT, self._sdo.MAX_RETRIES = STORE_TIMEOUT, 1
        try:
            self.write(*protocol.STORE, protocol.SAVE, 4)
        finally:
            self._sdo.RESPONSE_TIMEOUT, self._sdo.MAX_RETRIES = ANSWER_TIMEOUT, REQUESTS

    def command(self, command: int) -> None:
        """Send an NMT command."""
        self._network.send_message(protocol.NMT_ID, bytes((command, self.node_id)))

    def reset(self) -> None:
        """Reset it and wait for its boot-up message."""
        await_boot_up(self._network, self.node_id,
                      lambda: self.command(protocol.NMT_RESET_NODE))

    def _check_bus(self) -> None:
        """Raise the error of a bus that has failed, which the receiving thread has met."""
        if isinstance(self._network.notifier.exception, BUS_ERRORS):
            raise self._network.notifier.exception


def await_boot_up(network: Any, node_id: int, cause: Callable[[], object]) -> None:
    """Cause a boot-up message, and wait for it; SetupError if it does not come."""
    booted = threading.Event()

    def take(_: int, data: bytes) -> None:
        if data == bytes((protocol.BOOT_UP,)):
            booted.set()

    with heard_by(network, [protocol.HEARTBEAT_BASE + node_id], take):
        cause()
        if not booted.wait(BOOT_TIMEOUT):
            raise SetupError(f'node {node_id} has not booted within {BOOT_TIMEOUT:g} s of its '
                             'reset')


def heard_within(network: Any, identifier: int, seconds: float) -> bool:
    """Return whether a frame with an identifier comes within a time, s."""
    heard = threading.Event()
    with heard_by(network, [identifier], lambda *_: heard.set()):
        return heard.wait(seconds)


def nodes_on(network: Any) -> list[int]:
    """Return the ids of the nodes that answer SDO."""
    found: set[int] = set()
    every = range(1, protocol.NODE_ID_MAXIMUM + 1)
    with heard_by(network, (protocol.SDO_ANSWER_BASE + node_id for node_id in every),
                  lambda identifier, _: found.add(identifier - protocol.SDO_ANSWER_BASE)):
        for node_id in every:
            request = protocol.sdo_upload(node_id, *protocol.DEVICE_TYPE)
            network.send_message(request.arbitration_id, request.data)
            time.sleep(SEARCH_PERIOD)
        time.sleep(SEARCH_TIMEOUT)
    return sorted(found)
