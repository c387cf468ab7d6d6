# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The layer setting services of a simulated CANopen encoder (CiA 305): its node id."""

from __future__ import annotations

import can
from spm_haptic_master.encoders import canopen

# Node id of a device that has none yet.
UNCONFIGURED = 0xFF
# Commands: switch all; switch the device of an identity, part by part, and its answer; set and
# store; ask for a part of the identity, and for the node id.
SWITCH_ALL = 0x04
SWITCH_SELECTED = (0x40, 0x41, 0x42, 0x43)
SELECTED = 0x44
SET_NODE_ID, SET_BIT_TIMING, STORE = 0x11, 0x13, 0x17
ASK_IDENTITY = (0x5A, 0x5B, 0x5C, 0x5D)
ASK_NODE_ID = 0x5E
# Largest index of the table of bit timings: 10 kbit/s.
LAST_BIT_TIMING = 8
# Answers of a command that sets something: done, value out of range.
DONE, OUT_OF_RANGE = 0, 1


class LssDevice:
    """
    One device as the LSS master sees it, by its vendor id, product code, revision, serial number.

    `node_id` is the one that it has from its next restart on, UNCONFIGURED for none. While it is
    `configuring` it takes settings; otherwise it waits.
    """

    def __init__(self, identity: tuple[int, int, int, int], node_id: int):
        self._identity = identity
        self._node_id = self._stored = self.node_id = node_id
        self.configuring = False
        # Parts of the identity received in a row.
        self._selected: list[int] = []

    def restart(self, stored: bool) -> int:
        """Return the node id after a restart: the stored one, or the one set last."""
        if stored:
            self.node_id = self._stored
        self._node_id = self.node_id
        self.configuring = False
        return self._node_id

    def receive(self, data: bytes) -> list[can.Message]:
        """Return the answers to a request."""
        command, value = data[0], int.from_bytes(data[1:5], 'little')
        if command == SWITCH_ALL:
            self.configuring = bool(data[1])
        elif command in SWITCH_SELECTED:
            number = SWITCH_SELECTED.index(command)
            self._selected = [*(self._selected if number else []), value]
            if command == SWITCH_SELECTED[-1] and tuple(self._selected) == self._identity:
                self.configuring = True
                return [_answer(SELECTED)]
        elif not self.configuring:
            return []
        elif command in ASK_IDENTITY:
            part = self._identity[ASK_IDENTITY.index(command)]
            return [_answer(command, part.to_bytes(4, 'little'))]
        elif command == ASK_NODE_ID:
            return [_answer(command, bytes((self._node_id,)))]
        elif command in (SET_NODE_ID, SET_BIT_TIMING, STORE):
            return [_answer(command, bytes((self._set(command, data),)))]
        return []

    def _set(self, command: int, data: bytes) -> int:
        if command == SET_NODE_ID:
            if not (1 <= data[1] <= canopen.NODE_ID_MAXIMUM or data[1] == UNCONFIGURED):
                return OUT_OF_RANGE
            self.node_id = data[1]
        elif command == SET_BIT_TIMING:
            return DONE if data[1] == 0 and data[2] <= LAST_BIT_TIMING else OUT_OF_RANGE
        else:
            self._stored = self.node_id
        return DONE


def _answer(command: int, data: bytes = b'') -> can.Message:
    return canopen.frame(canopen.LSS_ANSWER_ID,
                         (bytes((command,)) + data).ljust(canopen.LSS_LENGTH, b'\0'))
