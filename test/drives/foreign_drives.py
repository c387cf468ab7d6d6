# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Drives of other makers by canopen-python's LocalNode: which objects they have.

Facts as a table of ours: what maxon EPOS4 Module 50/5 (revision 0x0170), maxon EPOS2, Technosoft
iPOS (1.04), Faulhaber 327 and MCDC lack by their EDS files is what docs/force.md lists; other
objects are taken to be as CiA 402 has them. No value of a maker's file is here.
"""

from contextlib import contextmanager
import logging

import can
from foreign_nodes import canopen, dictionary_of, Held

DEVICE_TYPE = 0x00020192
# Node ids of three drives, and the serial number of the first one.
NODES = 11, 12, 13
FIRST_SERIAL = 0x2001
# Node id of the master, and its heartbeat time-out, ms.
MASTER = 126
TIMEOUT = 60


def common(node_id):
    """Return what drives of CiA 402 have that are set up for three motors of 0.5 N m."""
    return {
        (0x1000, 0): Held(DEVICE_TYPE, access='ro'),
        (0x1001, 0): Held(0, 1, 'ro'),
        (0x1010, 1): Held(1),
        (0x1017, 0): Held(20, 2),
        (0x1018, 1): Held(0xFB, access='ro'),
        (0x1018, 2): Held(0x6550, access='ro'),
        (0x1018, 3): Held(0x170, access='ro'),
        (0x1018, 4): Held(FIRST_SERIAL + node_id - NODES[0], access='ro'),
        (0x1400, 1): Held(0x200 + node_id),
        (0x1400, 2): Held(255, 1),
        (0x1600, 0): Held(2, 1),
        (0x1600, 1): Held(0x60400010),
        (0x1600, 2): Held(0x60710010),
        (0x1800, 1): Held(0x180 + node_id),
        (0x1800, 2): Held(255, 1),
        (0x1800, 3): Held(40, 2),
        (0x1A00, 0): Held(3, 1),
        (0x1A00, 1): Held(0x60410010),
        (0x1A00, 2): Held(0x60770010),
        (0x1A00, 3): Held(0x60610008),
        **{(0x1801 + number, 1): Held(1 << 31 | 0x280 + node_id) for number in range(3)},
        **{(0x1A01 + number, 0): Held(0, 1) for number in range(3)},
        (0x6007, 0): Held(2, 2),
        (0x6040, 0): Held(0, 2),
        (0x6041, 0): Held(0x0250, 2, 'ro'),
        (0x605A, 0): Held(0, 2),
        (0x605E, 0): Held(0, 2),
        (0x6060, 0): Held(0, 1),
        (0x6061, 0): Held(0, 1, 'ro'),
        (0x6071, 0): Held(0, 2),
        (0x6077, 0): Held(0, 2, 'ro'),
        (0x60C2, 1): Held(1, 1),
        (0x60C2, 2): Held(0xFD, 1),
        (0x6502, 0): Held(0x209, access='ro'),
    }


def epos4(node_id):
    """Return the objects of an EPOS4: no 6072h, no 1800h:05, no 1400h:05."""
    return {
        **common(node_id),
        (0x1016, 1): Held(MASTER << 16 | TIMEOUT),
        (0x1029, 1): Held(1, 1),
        (0x3001, 2): Held(5000),
        (0x6076, 0): Held(500, access='ro'),
        (0x6080, 0): Held(5000),
    }


def ipos(node_id):
    """Return the objects of an iPOS: no 1016h, 6072h, 6076h, 1400h:05."""
    return {**common(node_id), (0x1800, 5): Held(4, 2)}


def faulhaber(node_id):
    """Return the objects of a Faulhaber 327 or MCDC: no 6071h, which no PDO has then."""
    return {
        **without(epos4(node_id), 0x6071),
        (0x1600, 0): Held(1, 1),
        (0x1600, 2): Held(0),
    }


def epos2(node_id):
    """Return the objects of an EPOS2: none of a torque."""
    return {
        **without(faulhaber(node_id), 0x6076, 0x6077),
        (0x1A00, 0): Held(1, 1),
        (0x1A00, 2): Held(0),
        (0x1A00, 3): Held(0),
    }


def without(objects, *indices):
    """Return objects without those of some indices."""
    return {key: held for key, held in objects.items() if key[0] not in indices}


@contextmanager
def foreign_drives(channel, objects, on_read=None):
    """
    Run three drives with such objects on a virtual bus; yield the nodes.

    `on_read` is called with index, subindex and variable before a value is given; it may raise
    canopen.SdoAbortedError.
    """
    logging.getLogger('canopen').setLevel(logging.CRITICAL)
    with can.Bus(interface='virtual', channel=channel) as bus:
        network = canopen.Network(bus)
        network.NOTIFIER_CYCLE = 0.005
        network.connect()
        nodes = []
        for node_id in NODES:
            node = canopen.LocalNode(node_id, dictionary_of(objects(node_id)))
            if on_read is not None:
                node.add_read_callback(on_read)
            network.add_node(node)
            nodes.append(node)
        try:
            yield nodes
        finally:
            network.notifier.stop()
