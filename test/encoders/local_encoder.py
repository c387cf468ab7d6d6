# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An encoder of canopen's LocalNode: another implementation than sim_bus's."""

from __future__ import annotations

from copy import deepcopy

import canopen
from canopen import objectdictionary as od

U8, U16, U32 = od.datatypes.UNSIGNED8, od.datatypes.UNSIGNED16, od.datatypes.UNSIGNED32
# Index, subindex, type, maker's default and access of each object: of an encoder of 13 bits that
# sends its position and speed on TPDO1 by a timer, and its position on TPDO2 after every SYNC.
OBJECTS = (
    (0x1000, 0, U32, 0x00010196, 'ro'), (0x1010, 0, U8, 1, 'ro'), (0x1010, 1, U32, 1, 'rw'),
    (0x1017, 0, U16, 0, 'rw'),
    (0x1018, 0, U8, 4, 'ro'), (0x1018, 1, U32, 0x59, 'ro'), (0x1018, 2, U32, 0x41, 'ro'),
    (0x1018, 3, U32, 3, 'ro'), (0x1018, 4, U32, 777, 'ro'),
    (0x1800, 0, U8, 5, 'ro'), (0x1800, 1, U32, 0x40000180, 'rw'), (0x1800, 2, U8, 254, 'rw'),
    (0x1800, 5, U16, 10, 'rw'),
    (0x1801, 0, U8, 2, 'ro'), (0x1801, 1, U32, 0x40000280, 'rw'), (0x1801, 2, U8, 1, 'rw'),
    (0x1A00, 0, U8, 2, 'rw'), (0x1A00, 1, U32, 0x60040020, 'rw'),
    (0x1A00, 2, U32, 0x60300110, 'rw'),
    (0x1A01, 0, U8, 1, 'rw'), (0x1A01, 1, U32, 0x60040020, 'rw'),
    (0x6000, 0, U16, 0x0001, 'rw'), (0x6001, 0, U32, 8192, 'rw'), (0x6002, 0, U32, 8192, 'rw'),
    (0x6004, 0, U32, 0, 'ro'), (0x6200, 0, U16, 10, 'rw'), (0x6501, 0, U32, 8192, 'ro'),
)
RESET = 0x81
PRE_OPERATIONAL = 0x80


def dictionary(node_id, without=(), read_only=()):
    """Return the object dictionary, without some objects, and with some that refuse writing."""
    found = od.ObjectDictionary()
    for index, subindex, kind, value, access in OBJECTS:
        if (index, subindex) in without:
            continue
        if subindex == 0 and index in (0x1000, 0x1017) or index >= 0x6000:
            entry = od.ODVariable(f'o{index:x}', index, 0)
            found.add_object(entry)
        else:
            if index not in found:
                found.add_object(od.ODRecord(f'o{index:x}', index))
            entry = od.ODVariable(f'o{index:x}s{subindex}', index, subindex)
            found[index].add_member(entry)
        entry.data_type = kind
        entry.access_type = 'ro' if (index, subindex) in read_only else access
        entry.default = value + node_id if (index & 0xFFFC, subindex) == (0x1800, 1) else value
    return found


class LocalEncoder:
    """
    A node with a memory that a reset returns to.

    Attributes
    ----------
    writes : list of (int, int, int)
        Index, subindex and value of each write.

    """

    def __init__(self, network, node_id, forgets=False, **changes):
        self._forgets = forgets
        self.writes = []
        self._node = network.create_node(
            canopen.LocalNode(node_id, dictionary(node_id, **changes)))
        self._node.add_write_callback(self._on_write)
        self._stored = {}
        network.subscribe(0, self._on_command)

    def value(self, index, subindex):
        """Return the value of an object."""
        return int.from_bytes(self._node.get_data(index, subindex), 'little')

    def _on_write(self, index, subindex, data, **_):
        self.writes.append((index, subindex, int.from_bytes(data, 'little')))
        if (index, subindex) == (0x1010, 1) and bytes(data) == b'save' and not self._forgets:
            self._stored = deepcopy(self._node.data_store)

    def _on_command(self, _, data, __):
        if data[0] == RESET and data[1] in (0, self._node.id):
            self._node.data_store.clear()
            self._node.data_store.update(deepcopy(self._stored))
            self._node.nmt.send_command(RESET)
            self._node.nmt.send_command(PRE_OPERATIONAL)
