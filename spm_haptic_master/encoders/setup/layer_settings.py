# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Node id and bit rate of one encoder, by the layer setting services (CiA 305)."""

from __future__ import annotations

from dataclasses import dataclass
import time
from typing import Any

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.setup.canopen_network import (
    await_boot_up,
    heard_by,
    import_canopen,
    LSS_TIMEOUT,
    Node,
    nodes_on,
    STORE_TIMEOUT,
)
from spm_haptic_master.exceptions import InputError, SetupError

# Index of each bit rate (bit/s) in the table of CiA 305.
BIT_RATES = {1_000_000: 0, 800_000: 1, 500_000: 2, 250_000: 3, 125_000: 4, 50_000: 6, 20_000: 7,
             10_000: 8}
# Requests for vendor id, product code, revision and serial number.
ASK_IDENTITY = (0x5A, 0x5B, 0x5C, 0x5D)
# Time in which a second device would answer the same request (s).
SECOND_ANSWER = 0.2

# Vendor id, product code, revision, serial number of a device.
Identity = tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Device:
    """A device that the layer setting services have found."""

    identity: Identity
    node_id: int | None


def check_bit_rate(bit_rate: int) -> int:
    """Return the index of a bit rate; raise InputError if CiA 305 has none for it."""
    if bit_rate not in BIT_RATES:
        raise InputError(f'--bit-rate {bit_rate}; expected one of '
                         + ', '.join(map(str, BIT_RATES)))
    return BIT_RATES[bit_rate]


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
                lss.configure_bit_timing(check_bit_rate(bit_rate))
            lss.RESPONSE_TIMEOUT = STORE_TIMEOUT
            lss.store_configuration()
        except error_type as error:
            raise SetupError(f'the device refuses node id {node_id}'
                             + (f' or {bit_rate} bit/s' if bit_rate else '')
                             + f', or does not store it: {error}') from error
        finally:
            lss.RESPONSE_TIMEOUT = LSS_TIMEOUT
            lss.send_switch_state_global(lss.WAITING_STATE)

    old = device.node_id
    if old is None:
        # It boots by itself when it has got its first node id.
        await_boot_up(network, node_id, configure)
        if bit_rate is None:
            Node(network, node_id).reset()
    else:
        configure()
        if bit_rate is None:
            await_boot_up(network, node_id, lambda: network.send_message(
                canopen.NMT_ID, bytes((canopen.NMT_RESET_NODE, old))))
    if bit_rate is None:
        serial = Node(network, node_id).read(*canopen.SERIAL_NUMBER)
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
    return Device(tuple(parts), node_id if 1 <= node_id <= canopen.NODE_ID_MAXIMUM else None)
