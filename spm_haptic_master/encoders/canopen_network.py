# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Nodes by the library canopen: objects by SDO, states by NMT, node id and bit rate by LSS.

LSS are the layer setting services (CiA 305).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
import logging
import threading
import time
from typing import Any, NamedTuple

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
# Time in which a second device would answer the same request by LSS (s).
SECOND_ANSWER = 0.2
# Requests by LSS for vendor id, product code, revision and serial number.
ASK_IDENTITY = (0x5A, 0x5B, 0x5C, 0x5D)
# Index of each bit rate (bit/s) in the table of CiA 305.
BIT_RATES = {1_000_000: 0, 800_000: 1, 500_000: 2, 250_000: 3, 125_000: 4, 50_000: 6, 20_000: 7,
             10_000: 8}
# Abort codes that mean that there is no such object.
MISSING = (protocol.SDO_NO_SUCH_OBJECT, protocol.SDO_NO_SUCH_SUBINDEX)

# Vendor id, product code, revision, serial number of a device.
Identity = tuple[int, ...]


class Device(NamedTuple):
    """A device found by LSS."""

    identity: Identity
    node_id: int | None


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
    """A node, as the master sees it; SetupError if it does not answer, or refuses."""

    def __init__(self, network: Any, node_id: int):
        self._canopen = import_canopen()
        self._network = network
        self.node_id = node_id
        self._sdo = network.add_node(
            self._canopen.RemoteNode(node_id, self._canopen.ObjectDictionary())).sdo
        self._sdo.RESPONSE_TIMEOUT, self._sdo.MAX_RETRIES = ANSWER_TIMEOUT, REQUESTS

    def read(self, index: int, subindex: int) -> tuple[int | None, int]:
        """Return the value of an object and its size, bytes; None and 0 if the node has none."""
        with self._request(f'to read 0x{index:04X}:{subindex:02X}', 'SDO'):
            try:
                data = self._sdo.upload(index, subindex)
            except self._canopen.SdoAbortedError as abort:
                if abort.code in MISSING:
                    return None, 0
                raise
        return int.from_bytes(data, 'little'), len(data)

    def write(self, index: int, subindex: int, value: int, size: int) -> None:
        """Write an object of a size in bytes."""
        name = f'0x{index:04X}:{subindex:02X}'
        with self._request(f'0x{value:X} for {name}', f'while {name} is written'):
            self._sdo.download(index, subindex, value.to_bytes(size, 'little'))

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

    @contextmanager
    def _request(self, refused: str, unanswered: str) -> Iterator[None]:
        """Have an error of the library reported; a failed bus raises its own error."""
        try:
            yield
        except self._canopen.SdoAbortedError as abort:
            raise SetupError(f'node {self.node_id} refuses {refused}: {abort}') from abort
        except self._canopen.SdoCommunicationError as error:
            failure = self._network.notifier.exception  # met by the receiving thread
            if isinstance(failure, BUS_ERRORS):
                raise failure from error
            raise SetupError(
                f'node {self.node_id} does not answer {unanswered} ({error})') from error


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


def find(network: Any, selected: Identity | None) -> Device:
    """Return the only device on the bus, or that of an identity; all wait afterwards."""
    lss = network.lss
    try:
        _switch(network, selected)
        return _inquire(network)
    finally:
        lss.send_switch_state_global(lss.WAITING_STATE)


def assign(network: Any, device: Device, selected: Identity | None, node_id: int,
           bit_rate: int | None) -> None:
    """
    Give a device a node id, and a bit rate; both are stored.

    The node id is verified by a reset, after which the device has to answer under it. A bit rate
    is in effect when the device is switched on next. `selected` is its identity among several.
    """
    lss = network.lss
    error_type = import_canopen().lss.LssError

    def configure() -> None:
        _switch(network, selected)
        try:
            lss.configure_node_id(node_id)
            if bit_rate is not None:
                lss.configure_bit_timing(BIT_RATES[bit_rate])
            lss.RESPONSE_TIMEOUT = STORE_TIMEOUT
            lss.store_configuration()
        except error_type as error:
            raise SetupError(f'the device refuses node id {node_id}'
                             + (f' or {bit_rate} bit/s' if bit_rate else '')
                             + f', or does not store it: {error}') from error
        finally:
            lss.RESPONSE_TIMEOUT = LSS_TIMEOUT
            lss.send_switch_state_global(lss.WAITING_STATE)

    if device.node_id is None:
        # It boots by itself when it has got its first node id.
        await_boot_up(network, node_id, configure)
    else:
        configure()
    if bit_rate is not None:
        return
    await_boot_up(network, node_id, lambda: network.send_message(
        protocol.NMT_ID, bytes((protocol.NMT_RESET_NODE, device.node_id or node_id))))
    serial, _ = Node(network, node_id).read(*protocol.SERIAL_NUMBER)
    if serial != device.identity[-1]:
        shown = 'none' if serial is None else f'0x{serial:X}'
        raise SetupError(f'node {node_id} has serial number {shown}; expected '
                         f'0x{device.identity[-1]:X}')


def check_free(network: Any, device: Device, node_id: int, alone: bool) -> None:
    """Raise SetupError if another node has an id, or a device that has to be alone is not."""
    others = [other for other in nodes_on(network) if other != device.node_id]
    if node_id in others:
        raise SetupError(f'node id {node_id} is taken by another node on the bus')
    if alone and others:
        shown = ('node ' if len(others) == 1 else 'nodes ') + ', '.join(map(str, others))
        raise SetupError(f'{shown} on the bus, too: connect one encoder only, or select it by '
                         '--identity')


def _switch(network: Any, selected: Identity | None) -> None:
    lss = network.lss
    if selected is None:
        lss.send_switch_state_global(lss.CONFIGURATION_STATE)
        return
    try:
        found = lss.send_switch_state_selective(*selected)
    except import_canopen().lss.LssError:
        found = False
    if not found:
        raise SetupError('no device with the identity '
                         + ' '.join(f'0x{part:X}' for part in selected) + ' answers LSS')


def _inquire(network: Any) -> Device:
    """Return the device that takes settings; raise SetupError if it is none, or several."""
    lss = network.lss
    answers: list[bytes] = []

    try:
        with heard_by(network, [lss.LSS_RX_COBID], lambda _, data: answers.append(data)):
            parts = []
            for command in ASK_IDENTITY:
                answers.clear()
                parts.append(lss.inquire_lss_address(command))
                time.sleep(SECOND_ANSWER)
                if len(answers) > 1:
                    raise SetupError(f'{len(answers)} devices answer LSS: connect one encoder '
                                     'only, or select it by --identity')
            node_id = lss.inquire_node_id()
    except import_canopen().lss.LssError as error:
        raise SetupError(f'no device answers LSS ({error}); some encoders have switches, or '
                         'objects at 0x2000 and above instead') from error
    return Device(tuple(parts), node_id if 1 <= node_id <= protocol.NODE_ID_MAXIMUM else None)
