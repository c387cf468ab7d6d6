# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What is missing, wrong or unexpected on a scanned bus, against the configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, frame_name, HeardFrame
from spm_haptic_master.encoders.encoder_layout import EncoderLayout

# Largest relative deviation of a rate from the expected one (unit 1).
RATE_TOLERANCE = 0.05


@dataclass(frozen=True, slots=True)
class Expected:
    """Configuration that a scan is compared with."""

    layouts: tuple[EncoderLayout, ...]
    # CANopen node ids, None if the encoders are not CANopen nodes.
    node_ids: tuple[int, ...] | None
    rate: float  # of the sets, Hz
    # Names of further nodes that are configured, by node id: the drives.
    others: Mapping[int, str] = field(default_factory=dict)
    # Names of their frames, and of those sent to them, by identifier.
    frames: Mapping[int, str] = field(default_factory=dict)


def problems(scan: BusScan, expected: Expected) -> list[str]:
    """Return what is missing, wrong or unexpected, in lines."""
    found = [] if scan.frames else ['no frames at all: check bit rate, termination, power, '
                                    'and that the interface is up']
    found += _sync_problems(scan, expected.rate)
    for index, layout in enumerate(expected.layouts):
        found += _encoder_problems(
            scan, layout, expected.node_ids[index] if expected.node_ids else None, expected.rate)
    for node_id, name in expected.others.items():
        node = scan.nodes.get(node_id)
        found += [f'{name}: not heard'] if node is None else [
            f'{name}: {words}' for words in node.emergencies]
    found += _unexpected(scan, expected)
    found += [f'error frames: {words}' for words in scan.errors]
    found += [f'sending: {words} (does any other node acknowledge?)' for words in scan.unsent]
    return found


def busy(scan: BusScan, rate: float) -> str | None:
    """Return that this machine sent SYNC below its rate, Hz, in one line; None if it did not."""
    own = scan.own_sync
    if own is None or not own.rate or own.rate >= rate * (1.0 - RATE_TOLERANCE):
        return None
    return (f'this machine is too busy: SYNC was sent at {own.rate:.1f} Hz instead of {rate:g} '
            "Hz; the encoders' rates are not compared. Give a lower rate: -p rate:=100.0")


def _sync_problems(scan: BusScan, rate: float) -> list[str]:
    if scan.sync_id is None or scan.own_sync is not None:
        return []
    if scan.master_sync is None:
        return [f'no SYNC 0x{scan.sync_id:X}: let the driver make it (can.sync: produce), or '
                'start its master']
    if _agrees(scan.master_rate, rate):
        return []
    return [f'SYNC 0x{scan.sync_id:X} comes at {scan.master_rate:.1f} Hz, rate is {rate:g} Hz: '
            "give the bus's rate to all nodes"]


def _agrees(rate: float, expected: float) -> bool:
    return abs(rate / expected - 1.0) <= RATE_TOLERANCE


def _encoder_problems(scan: BusScan, layout: EncoderLayout, node_id: int | None,
                      rate: float) -> list[str]:
    heard = scan.frames.get((layout.extended, layout.can_id))
    if heard is None:
        return [f'{layout.joint}: 0x{layout.can_id:X} missing'
                + _missing_because(scan, layout, node_id)]
    found = []
    if set(heard.lengths) != {layout.data_length}:
        lengths = ', '.join(str(length) for length in sorted(heard.lengths))
        found.append(f'{layout.joint}: 0x{layout.can_id:X} has {lengths} bytes, '
                     f'configured {layout.data_length}')
    if wrong := _rate_problem(scan, heard, rate):
        found.append(f'{layout.joint}: 0x{layout.can_id:X} {wrong}')
    if node_id is not None and (node := scan.nodes.get(node_id)) is not None:
        found += [f'{layout.joint}: {words}' for words in node.emergencies]
    return found


def _rate_problem(scan: BusScan, heard: HeardFrame, rate: float) -> str | None:
    """Return how the rate of an encoder's frames differs from SYNC's, or from the configured."""
    if busy(scan, rate) is not None:
        return None
    cycles = heard.last_cycle - heard.first_cycle
    if scan.own_sync is None and scan.master_sync is None:
        return None if _agrees(heard.rate, rate) else \
            f'comes at {heard.rate:.1f} Hz, configured {rate:g} Hz'
    if heard.count > 1 and cycles and _agrees((heard.count - 1) / cycles, 1.0):
        return None
    return f'comes {heard.count} times in {cycles + 1} cycles of SYNC; expected one answer each'


def _missing_because(scan: BusScan, layout: EncoderLayout, node_id: int | None) -> str:
    """Return why an encoder's frame is missing, as far as the scan shows it."""
    if (not layout.extended, layout.can_id) in scan.frames:
        return f'; it comes with {11 if layout.extended else 29} bits instead'
    if node_id is None:
        return ''
    node = scan.nodes.get(node_id)
    if node is None:
        return f'; its node {node_id} was not heard either'
    others = sorted(identifier for extended, identifier in scan.frames
                    if not extended and identifier - node_id in canopen.TPDO_BASES)
    if others:
        return '; its node sends on ' + ', '.join(f'0x{i:X}' for i in others)
    if node.state not in (None, canopen.OPERATIONAL):
        return f'; its node {node_id} is {canopen.state_word(node.state)}'
    return f'; its node {node_id} is present: does 0x1800:02 answer SYNC?'


def _unexpected(scan: BusScan, expected: Expected) -> list[str]:
    ours = {(layout.extended, layout.can_id) for layout in expected.layouts}
    ours |= {(False, each) for each in (canopen.NMT_ID, scan.sync_id, *expected.frames)
             if each is not None}
    # Heartbeats, emergencies and SDO answers are listed with their nodes.
    ours |= {(False, base + node_id) for node_id in scan.nodes
             for base in canopen.NODE_FRAMES if base not in canopen.TPDO_BASES}
    found = [f'unexpected: 0x{key[1]:X} ({frame_name(*key)})'
             for key in sorted(scan.frames.keys() - ours)]
    if expected.node_ids is not None:
        found += [f'unexpected: node {node_id} ({scan.nodes[node_id].words()})'
                  for node_id in sorted(
                      scan.nodes.keys() - set(expected.node_ids) - expected.others.keys())]
    return found
