# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Shared parts of simulated CANopen nodes: NMT states; objects by SDO, read, written, stored.

SDO transfers are expedited ones of CiA 301 (at most four bytes).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import can
from spm_haptic_master.encoders import canopen

# Vendor id of the nodes: 0 is not assigned to any vendor.
VENDOR_ID = 0
# Product code of the nodes: "SPM" in ASCII.
PRODUCT_CODE = 0x53504D
# Revision of the nodes: 1.1.
REVISION = 0x00010001
# Support of storing: on command.
STORES_ON_COMMAND = 1
# Error register of EMCY: bit 0 means that there is some error.
GENERIC_ERROR = 0x01
# NMT state after a command.
STATES = {
    canopen.NMT_START: canopen.OPERATIONAL,
    canopen.NMT_STOP: canopen.STOPPED,
    canopen.NMT_PRE_OPERATIONAL: canopen.PRE_OPERATIONAL,
}
# NMT commands after which a node boots.
RESETS = (canopen.NMT_RESET_NODE, canopen.NMT_RESET_COMMUNICATION)

# An object: index and subindex.
Key = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Entry:
    """
    One object of a node.

    Attributes
    ----------
    value : int
        Its value, unsigned.
    size : int
        Its size, bytes.
    writable : bool
        Whether an SDO may write it.

    """

    value: int
    size: int = 4
    writable: bool = True


class Mapped(NamedTuple):
    """An object in a PDO: its key, and the bytes that it has there."""

    key: Key
    length: int

    @classmethod
    def of(cls, entry: int) -> Mapped:
        """Return the object of an entry of a mapping (CiA 301: index, subindex, bits)."""
        index = entry >> 16
        subindex = entry >> 8 & 0xFF
        bits = entry & 0xFF
        return cls(key=(index, subindex), length=bits // 8)


def heartbeat(node_id: int, state: int) -> can.Message:
    """Return the heartbeat of a node in an NMT state, or its boot-up message."""
    identifier = canopen.HEARTBEAT_BASE + node_id
    return canopen.frame(identifier, bytes((state,)))


def is_nmt_command(
    identifier: int,
    data: bytes,
    node_id: int,
) -> bool:
    """Return whether a frame is an NMT command to a node, or to all nodes."""
    is_command = identifier == canopen.NMT_ID and len(data) == 2
    return is_command and data[1] in (0, node_id)


def is_sdo_request(
    identifier: int,
    data: bytes,
    node_id: int,
) -> bool:
    """Return whether a frame is an SDO request to a node."""
    is_to_node = identifier == canopen.SDO_REQUEST_BASE + node_id
    return is_to_node and len(data) == canopen.SDO_LENGTH


class SdoAbortError(Exception):
    """A request that the node aborts; its argument is the abort code."""


def identity(device_type: int, serial: int) -> dict[Key, Entry]:
    """
    Return the objects that identify a node: 1000h, 1001h and 1018h.

    Parameters
    ----------
    device_type : int
        Value of 1000h; its low 16 bits are the device profile.
    serial : int
        Serial number (1018h:04).

    Returns
    -------
    dict of (int, int) to Entry
        Objects by index and subindex; none can be written.

    """
    values = {
        canopen.DEVICE_TYPE: device_type,
        canopen.VENDOR_ID: VENDOR_ID,
        canopen.PRODUCT_CODE: PRODUCT_CODE,
        canopen.REVISION: REVISION,
        canopen.SERIAL_NUMBER: serial,
    }
    entries = {key: Entry(value, writable=False) for key, value in values.items()}
    entries[canopen.ERROR_REGISTER] = Entry(
        value=0,
        size=1,
        writable=False,
    )
    return entries


class ObjectStore:
    """
    Objects of one node by index and subindex, and those that it has stored (1010h).

    A subclass may refuse values, and do what follows from them.

    Parameters
    ----------
    entries : dict of (int, int) to Entry
        All objects; these values also count as stored.

    """

    def __init__(self, entries: dict[Key, Entry]):
        self._entries = entries
        self._stored = dict(entries)
        self._derive()

    def restart(self) -> None:
        """Return to the stored values, as after a reset or without power."""
        self._entries = dict(self._stored)
        self._derive()

    def value(self, index: int, subindex: int) -> int:
        """Return the value of an object; 0 for one that the node does not have."""
        entry = self._entries.get((index, subindex))
        return 0 if entry is None else entry.value

    def mapped(self, index: int) -> list[int]:
        """
        Return the entries of a mapping object.

        Parameters
        ----------
        index : int
            Index of the mapping, such as 1A00h.

        Returns
        -------
        list of int
            Index, subindex and length in bits of each mapped object, as one number (CiA 301).

        """
        count = self.value(index, 0)
        return [self.value(index, number) for number in range(1, count + 1)]

    def answer(self, node_id: int, data: bytes) -> can.Message:
        """
        Return the answer to an SDO request.

        Parameters
        ----------
        node_id : int
            Node id in the identifier of the answer.
        data : bytes
            The eight bytes of the request: an upload or an expedited download.

        Returns
        -------
        can.Message
            The value, the confirmation, or an abort with its code.

        """
        key = canopen.sdo_object(data)
        identifier = canopen.SDO_ANSWER_BASE + node_id
        try:
            if data[0] == canopen.SDO_UPLOAD_REQUEST:
                entry = self._entry(key)
                return canopen.sdo_answer(node_id, *key, entry.value, entry.size)
            value = canopen.sdo_download(data)
            if value is None:
                raise SdoAbortError(canopen.SDO_UNKNOWN_COMMAND)
            self._write(key, value)
        except SdoAbortError as abort:
            return canopen.sdo(identifier, canopen.SDO_ABORT, *key, abort.args[0])
        return canopen.sdo(identifier, canopen.SDO_DOWNLOAD_ANSWER, *key)

    def _entry(self, key: Key) -> Entry:
        """Return an object; SdoAbortError differs for a missing object and a missing subindex."""
        entry = self._entries.get(key)
        if entry is None:
            indices = {index for index, _ in self._entries}
            if key[0] in indices:
                raise SdoAbortError(canopen.SDO_NO_SUCH_SUBINDEX)
            raise SdoAbortError(canopen.SDO_NO_SUCH_OBJECT)
        return entry

    def _write(self, key: Key, data: bytes) -> None:
        """Write an object, or store all of them; SdoAbortError with the code of CiA 301."""
        entry = self._entry(key)
        if not entry.writable:
            raise SdoAbortError(canopen.SDO_READ_ONLY)
        if len(data) != entry.size:
            raise SdoAbortError(canopen.SDO_WRONG_LENGTH)
        value = int.from_bytes(data, 'little')
        self._check_state(key, value)
        if key == canopen.STORE:
            if value != canopen.SAVE:
                raise SdoAbortError(canopen.SDO_NOT_STORED)
            self._stored = dict(self._entries)
            return
        self.put(key, value)
        self._written(key, value)

    def put(self, key: Key, value: int) -> None:
        """
        Change the value of an object from inside the device, if it has that.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.
        value : int
            New value; neither access nor state is checked.

        """
        entry = self._entries.get(key)
        if entry is not None:
            self._entries[key] = replace(entry, value=value)
            self._derive()

    def _written(self, key: Key, value: int) -> None:
        """Do what follows from a value that was written."""

    def _check_state(self, key: Key, value: int) -> None:
        """Raise SdoAbortError for a value that the node does not take now."""

    def _derive(self) -> None:
        """Update the state of a subclass that depends on the values, after `put` and `restart`."""
