# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Nodes by the library canopen: objects by SDO, states by NMT.

For set-up, where waiting for an answer is allowed; the driver itself never blocks like that.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import logging
import threading
import time
from typing import Any

import can
from spm_haptic_master.encoders import canopen as protocol
from spm_haptic_master.encoders.can_bus import BUS_ERRORS
from spm_haptic_master.exceptions import InputError, SetupError

# Longest wait for the answer to a request (s), and for that to storing into flash memory.
ANSWER_TIMEOUT = 0.5
STORE_TIMEOUT = 15.0
# Time after the first answer to a request in which further devices with that node id answer (s).
ALL_ANSWER = 0.05
# Number of requests by SDO until an encoder does not answer: a frame may get lost.
REQUESTS = 2
# Longest wait for the boot-up message of a node that was reset (s).
BOOT_TIMEOUT = 5.0
# Longest wait of the receiving thread for a frame (s), and so of the end for that thread.
RECEIVE_TIMEOUT = 0.1


def import_canopen() -> Any:
    """Return the library canopen; raise InputError if it is not installed."""
    try:
        import canopen
    except ImportError as error:
        raise InputError(
            'setting encoders up needs canopen (sudo apt install '
            "python3-canopen; in a virtual environment: pip install '.[setup]'): "
            f'{error}'
        ) from error
    # It logs what it raises.
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    return canopen


@contextmanager
def network_on(bus: can.BusABC) -> Iterator[Any]:
    """
    Put the library's network on an open bus; the bus stays open afterwards.

    Parameters
    ----------
    bus : can.BusABC
        Open bus, from which a thread of the network receives.

    Yields
    ------
    canopen.Network
        The network.

    Raises
    ------
    InputError
        The library is not installed.

    """
    network = import_canopen().Network(bus)
    network.NOTIFIER_CYCLE = RECEIVE_TIMEOUT
    network.connect()
    try:
        yield network
    finally:
        network.notifier.stop()


@contextmanager
def awaited(
    network: Any,
    identifier: int,
    data: bytes | None = None,
) -> Iterator[threading.Event]:
    """
    Give an event that is set when a frame is heard.

    Parameters
    ----------
    network : canopen.Network
        Network that receives.
    identifier : int
        Identifier of the frame.
    data : bytes, optional
        Data that it has to have; by default any.

    Yields
    ------
    threading.Event
        The event.

    """
    heard = threading.Event()

    def take(
        _: int,
        received: bytes,
        __: float,
    ) -> None:
        if data in (None, bytes(received)):
            heard.set()

    network.subscribe(identifier, take)
    try:
        yield heard
    finally:
        network.unsubscribe(identifier, take)


class RefusedError(SetupError):
    """A node answers a request with an SDO abort (CiA 301)."""


class NodeClient:
    """
    Access to one node, as the master sees it.

    Each request raises SetupError if the node does not answer, RefusedError if it aborts, and one
    of BUS_ERRORS if the bus has failed.

    Parameters
    ----------
    network : canopen.Network
        Network that it is on.
    node_id : int
        CANopen node id.

    Attributes
    ----------
    node_id : int
        As given.

    """

    def __init__(self, network: Any, node_id: int):
        self._canopen = import_canopen()
        self._network = network
        self.node_id = node_id
        self._sdo = network.add_node(
            self._canopen.RemoteNode(node_id, self._canopen.ObjectDictionary())
        ).sdo
        self._sdo.RESPONSE_TIMEOUT = ANSWER_TIMEOUT
        self._sdo.MAX_RETRIES = REQUESTS

    def read(self, index: int, subindex: int) -> tuple[int | None, int]:
        """
        Read an object by SDO upload.

        Parameters
        ----------
        index, subindex : int
            The object.

        Returns
        -------
        value : int or None
            Unsigned value; None if the node has no such object.
        size : int
            Its size, bytes; 0 where the answer does not have it, and for no object.

        Raises
        ------
        SetupError
            The node does not answer, or (RefusedError) refuses for another reason.

        """
        with self._request(f'to read {protocol.object_name(index, subindex)}', 'SDO'):
            try:
                with self._sdo.open(index, subindex, buffering=0) as answer:
                    size = answer.size
                    data = answer.read()
            except self._canopen.SdoAbortedError as abort:
                if abort.code not in (protocol.SDO_NO_SUCH_OBJECT, protocol.SDO_NO_SUCH_SUBINDEX):
                    raise
                return None, 0
        return int.from_bytes(data, 'little'), size or 0

    def write(
        self,
        index: int,
        subindex: int,
        value: int,
        size: int,
    ) -> None:
        """
        Write an object by SDO download.

        Parameters
        ----------
        index, subindex : int
            The object.
        value : int
            Unsigned value.
        size : int
            Its size, bytes.

        Raises
        ------
        RefusedError
            The node aborts.
        SetupError
            The node does not answer.

        """
        name = protocol.object_name(index, subindex)
        with self._request(f'0x{value:X} for {name}', f'while {name} is written'):
            self._sdo.download(index, subindex, value.to_bytes(size, 'little'))

    def can_store(self) -> bool:
        """Return whether it stores its parameters, on command or by itself."""
        try:
            support, _ = self.read(*protocol.STORE)
        except RefusedError:
            return False
        return support is not None and bool(support & protocol.STORES)

    def check_alone(self) -> None:
        """
        Refuse a node id that several devices have: each answers a request for the serial number.

        Raises
        ------
        SetupError
            More than one answer came.

        """
        answers: list[bytes] = []
        answered = threading.Event()
        identifier = protocol.SDO_ANSWER_BASE + self.node_id

        def take(
            _: int,
            data: bytes,
            __: float,
        ) -> None:
            answers.append(bytes(data))
            answered.set()

        self._network.subscribe(identifier, take)
        try:
            request = protocol.sdo_upload(self.node_id, *protocol.SERIAL_NUMBER)
            self._network.send_message(request.arbitration_id, bytes(request.data))
            if answered.wait(ANSWER_TIMEOUT):
                time.sleep(ALL_ANSWER)
        finally:
            self._network.unsubscribe(identifier, take)
        if len(answers) > 1:
            raise SetupError(protocol.shared_node_id(self.node_id, len(answers)))

    def store(self) -> None:
        """Store all parameters, which takes a device some seconds; errors as `write`."""
        self._sdo.RESPONSE_TIMEOUT = STORE_TIMEOUT
        self._sdo.MAX_RETRIES = 1
        try:
            self.write(*protocol.STORE, protocol.SAVE, 4)
        finally:
            self._sdo.RESPONSE_TIMEOUT = ANSWER_TIMEOUT
            self._sdo.MAX_RETRIES = REQUESTS

    def command(self, command: int) -> None:
        """Send an NMT command, one of the NMT constants of `canopen`; there is no answer to it."""
        self._network.send_message(protocol.NMT_ID, bytes((command, self.node_id)))

    def reset(self) -> None:
        """
        Reset the node and wait for its boot-up message.

        Raises
        ------
        SetupError
            It has not come within BOOT_TIMEOUT.

        """
        with awaited(
            self._network, protocol.HEARTBEAT_BASE + self.node_id, bytes((protocol.BOOT_UP,))
        ) as booted:
            self.command(protocol.NMT_RESET_NODE)
            if not booted.wait(BOOT_TIMEOUT):
                raise SetupError(
                    f'node {self.node_id} has not booted within {BOOT_TIMEOUT:g} s of its reset'
                )

    @contextmanager
    def _request(self, refused: str, unanswered: str) -> Iterator[None]:
        """
        Report errors of the library as ours; a failed bus raises its own error.

        Parameters
        ----------
        refused : str
            What the node refuses, for the text of RefusedError.
        unanswered : str
            What the node does not answer, for the text of SetupError.

        """
        try:
            yield
        except self._canopen.SdoAbortedError as abort:
            raise RefusedError(f'node {self.node_id} refuses {refused}: {abort}') from abort
        except self._canopen.SdoCommunicationError as error:
            failure = self._network.notifier.exception  # met by the receiving thread
            if isinstance(failure, BUS_ERRORS):
                raise failure from error
            raise SetupError(
                f'node {self.node_id} does not answer {unanswered} ({error})'
            ) from error
