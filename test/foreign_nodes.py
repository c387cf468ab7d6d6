# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Encoders that another stack simulates: canopen-python's LocalNode on a virtual bus."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
import logging

import can
import pytest

canopen = pytest.importorskip('canopen')

# Types of an object by its size in bytes, by CiA 301.
TYPES = {1: 0x05, 2: 0x06, 4: 0x07}
DEVICE_TYPE = 0x00010196
# Objects with subindices, also where a device has only the first of them.
RECORDS = (
    0x1010,
    0x1016,
    0x1018,
    0x1029,
    0x1400,
    0x1600,
    *range(0x1800, 0x1804),
    *range(0x1A00, 0x1A04),
)
COUNTS = 16384


@dataclass(frozen=True)
class Held:
    """An object as the device has it: value, size in bytes, and access as in an EDS."""

    value: int
    size: int = 4
    access: str = 'rw'


def objects_of(node_id, **changes):
    """
    Return the objects of an encoder that is set up; `changes` replace some, None removes one.

    The name of a change is its index, or index and subindex: `o6001`, `o1800_05`.
    """
    held = {
        (0x1000, 0): Held(DEVICE_TYPE, access='ro'),
        (0x1001, 0): Held(0, 1, 'ro'),
        (0x1005, 0): Held(0x80),
        (0x1006, 0): Held(0),
        (0x1010, 1): Held(1),
        (0x1017, 0): Held(100, 2),
        (0x1018, 1): Held(0x2A, access='ro'),
        (0x1018, 4): Held(1000 + node_id, access='ro'),
        (0x1019, 0): Held(0, 1),
        (0x1800, 1): Held(0x40000180 + node_id),
        (0x1800, 2): Held(1, 1),
        (0x1800, 3): Held(0, 2),
        (0x1800, 5): Held(0, 2),
        (0x1A00, 0): Held(1, 1),
        (0x1A00, 1): Held(0x60040020),
        (0x6000, 0): Held(4, 2),
        (0x6001, 0): Held(COUNTS),
        (0x6002, 0): Held(COUNTS),
        (0x6004, 0): Held(0, access='ro'),
        (0x6200, 0): Held(0, 2),
        (0x6501, 0): Held(4 * COUNTS, access='ro'),
    }
    for name, change in changes.items():
        index, _, subindex = name.removeprefix('o').partition('_')
        key = int(index, 16), int(subindex or '0', 16)
        if change is None:
            del held[key]
        else:
            held[key] = change
    return held


# Every object that an encoder need not have.
OPTIONAL = (
    *('o1005', 'o1006', 'o1010_01', 'o1017', 'o1018_04', 'o1019', 'o1800_03', 'o1800_05'),
    *('o6000', 'o6001', 'o6002', 'o6200', 'o6501'),
)
BARE = dict.fromkeys(OPTIONAL)


class ForeignEncoder:
    """
    An encoder by LocalNode: it answers SYNC while it is operational, stores, and boots.

    `on_write` is called with index, subindex and data before a value is taken; it may raise
    canopen.SdoAbortedError. `counts` is its position.
    """

    def __init__(self, network, node_id, held, on_write=None):
        self.node_id = node_id
        self.held = held
        self.counts = 100 * node_id
        self.syncs = 0
        self.network = network
        self.stored = {}
        network.subscribe(0, self._on_nmt)
        self.node = canopen.LocalNode(node_id, dictionary_of(held))
        if on_write:
            self.node.add_write_callback(on_write)
        self.node.add_write_callback(self._on_store)
        self.on_sync = self._answer
        network.add_node(self.node)
        network.subscribe(self.value(0x1005) & 0x7FF or 0x80, lambda *_: self.on_sync())

    def value(self, index, subindex=0):
        """Return the value of an object, 0 without it."""
        if (index, subindex) not in self.held:
            return 0
        return int.from_bytes(self.node.get_data(index, subindex), 'little')

    def put(self, value, index, subindex=0):
        """Change an object from inside the device."""
        self.node.data_store.setdefault(index, {})[subindex] = value.to_bytes(
            self.held[index, subindex].size, 'little'
        )

    def boot(self):
        """Switch on, or reset: with the stored values, pre-operational."""
        for index, values in list(self.node.data_store.items()):
            for subindex in list(values):
                if (index, subindex) in self.stored:
                    values[subindex] = self.stored[index, subindex]
                else:
                    del values[subindex]
        self.network.send_message(0x700 + self.node_id, [0])
        self.node.nmt._state = 0x7F
        self.node.nmt.start_heartbeat(self.value(0x1017))

    def leave(self):
        """Leave OPERATIONAL, as after an error."""
        self.node.nmt._state = 0x7F
        self.node.nmt.update_heartbeat()

    @property
    def operational(self):
        """Whether it answers SYNC."""
        return self.node.nmt.state == 'OPERATIONAL'

    def _answer(self):
        self.syncs += 1
        identifier = self.value(0x1800, 1)
        if self.operational and not identifier >> 31 and self.value(0x1800, 2) == 1:
            self.send()

    def send(self):
        """Send the position."""
        self.network.send_message(
            self.value(0x1800, 1) & 0x7FF, list(self.counts.to_bytes(4, 'little'))
        )

    def _on_nmt(self, _, data, __):
        if data[0] in (0x81, 0x82) and data[1] in (0, self.node_id):
            self.boot()

    def _on_store(self, index, subindex, data, **_):
        if (index, subindex) == (0x1010, 1):
            if bytes(data) != b'save':
                raise canopen.SdoAbortedError(0x08000020)
            self.stored = {
                (at, place): value
                for at, values in self.node.data_store.items()
                for place, value in values.items()
                if at != 0x1010
            }


def dictionary_of(held):
    """Return the object dictionary of a device that holds such objects."""
    dictionary = canopen.ObjectDictionary()
    for (index, subindex), entry in held.items():
        single = (
            len({place for at, place in held if at == index}) == 1
            and subindex == 0
            and index not in RECORDS
        )
        variable = canopen.objectdictionary.ODVariable(f'{index:X}:{subindex}', index, subindex)
        variable.data_type = TYPES[entry.size]
        variable.access_type = entry.access
        variable.default = entry.value
        if single:
            dictionary.add_object(variable)
        else:
            if index not in dictionary:
                dictionary.add_object(canopen.objectdictionary.ODRecord(f'{index:X}', index))
            dictionary[index].add_member(variable)
    return dictionary


@contextmanager
def foreign_bus(channel, *encoders, boots=True, interface='virtual'):
    """Run encoders, each as node id, objects and `on_write`, on a bus of their own."""
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    with can.Bus(interface=interface, channel=channel) as bus:
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = 0.005
        network.connect()
        # A second node with one id needs a network of its own.
        made = [ForeignEncoder(network, *encoder) for encoder in encoders]
        try:
            if boots:
                for encoder in made:
                    encoder.boot()
            yield made
        finally:
            for encoder in made:
                encoder.node.nmt.stop_heartbeat()
            network.notifier.stop()
