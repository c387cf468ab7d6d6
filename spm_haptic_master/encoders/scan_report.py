# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Report of a scan, in lines: what was heard, what is wrong, and the lines for rig.yaml."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
import json

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, HeardFrame, HeardNode
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES

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


def listing(scan: BusScan, expected: Expected) -> list[str]:
    """Return one line for each identifier and node, and for what was sent."""
    names = (
        {(layout.extended, layout.can_id): layout.joint for layout in expected.layouts}
        | {(False, identifier): name for identifier, name in expected.frames.items()}
        | {(False, scan.sync_id): 'SYNC'}
    )
    found = []
    for key, heard in sorted(scan.frames.items()):
        lengths = '/'.join(map(str, sorted(heard.lengths)))
        found.append(
            f'  0x{key[1]:0{8 if key[0] else 3}X}  {heard.rate:8.1f} Hz  {lengths:>3} '
            f'bytes  {heard.count:7} frames  {names.get(key) or _frame_name(*key)}'
        )
    found += [
        f'  node {node_id:3}: {_node_words(node)}' for node_id, node in sorted(scan.nodes.items())
    ]
    if scan.remote:
        found.append(f'  remote frames: {scan.remote}')
    if scan.own_sync is not None:
        found.append(
            f'  sent from here: {scan.own_sync.count} x SYNC 0x{scan.sync_id:X}, '
            f'{scan.own_sync.rate:.1f} Hz'
        )
    if scan.started:
        found.append(
            '  sent from here: NMT start to node ' + ', '.join(map(str, sorted(scan.started)))
        )
    return found


def _frame_name(extended: bool, identifier: int) -> str:
    return '29-bit frame' if extended else canopen.frame_name(identifier) or 'foreign'


def _node_words(node: HeardNode) -> str:
    """Return state, identity and emergencies of a node in one line."""
    parts = [canopen.state_word(node.state) if node.state is not None else 'no heartbeat']
    if node.boot_ups:
        parts.append(f'booted {node.boot_ups} x')
    if node.profile is not None:
        kind = canopen.PROFILES.get(node.profile)
        parts.append(
            f'device type 0x{node.objects[canopen.DEVICE_TYPE]:08X} '
            f'(CiA {node.profile}{f", {kind}" if kind else ""})'
        )
    parts += [
        f'{name} 0x{node.objects[key]:X}'
        for key, name in canopen.IDENTITY.items()
        if key in node.objects
    ]
    return ', '.join(parts + [f'{words} ({count} x)' for words, count in node.emergencies.items()])


def problems(scan: BusScan, expected: Expected) -> list[str]:
    """Return what is missing, wrong or unexpected, in lines."""
    found = (
        []
        if scan.frames
        else ['no frames at all: check bit rate, termination, power, and that the interface is up']
    )
    if scan.sync_id is not None and scan.own_sync is None:
        if scan.master_sync is None:
            found.append(
                f'no SYNC 0x{scan.sync_id:X}: let the driver make it (can.sync: '
                'produce), or start its master'
            )
        elif not _agrees(scan.master_rate, expected.rate):
            found.append(
                f'SYNC 0x{scan.sync_id:X} comes at {scan.master_rate:.1f} Hz, rate is '
                f"{expected.rate:g} Hz: give the bus's rate to all nodes"
            )
    for index, layout in enumerate(expected.layouts):
        found += [
            f'{layout.joint}: {words}'
            for words in _encoder_problems(
                scan,
                layout,
                expected.node_ids[index] if expected.node_ids else None,
                expected.rate,
            )
        ]
    for node_id, name in expected.others.items():
        node = scan.nodes.get(node_id)
        found += [
            f'{name}: {words}' for words in (['not heard'] if node is None else node.emergencies)
        ]
    found += _unexpected(scan, expected)
    found += [f'error frames: {count} x {words}' for words, count in scan.errors.items()]
    return found + [
        f'{count} frames not sent: {words} (does any other node acknowledge?)'
        for words, count in scan.unsent.items()
    ]


def busy(scan: BusScan, rate: float) -> str | None:
    """Return that this machine sent SYNC below its rate, Hz, in one line; None if it did not."""
    own = scan.own_sync
    if own is None or not own.rate or own.rate >= rate * (1.0 - RATE_TOLERANCE):
        return None
    return (
        f'this machine is too busy: SYNC was sent at {own.rate:.1f} Hz instead of {rate:g} '
        "Hz; the encoders' rates are not compared. Give a lower rate: -p rate:=100.0"
    )


def _agrees(rate: float, expected: float) -> bool:
    return abs(rate / expected - 1.0) <= RATE_TOLERANCE


def _encoder_problems(
    scan: BusScan, layout: EncoderLayout, node_id: int | None, rate: float
) -> list[str]:
    identifier = f'0x{layout.can_id:X}'
    heard = scan.frames.get((layout.extended, layout.can_id))
    if heard is None:
        return [f'{identifier} missing{_missing_because(scan, layout, node_id)}']
    found = []
    if heard.lengths != {layout.data_length}:
        found.append(
            f'{identifier} has {", ".join(map(str, sorted(heard.lengths)))} bytes, '
            f'configured {layout.data_length}'
        )
    if wrong := _rate_problem(scan, heard, rate):
        found.append(f'{identifier} {wrong}')
    if node_id is not None and (node := scan.nodes.get(node_id)) is not None:
        found += node.emergencies
    return found


def _rate_problem(scan: BusScan, heard: HeardFrame, rate: float) -> str | None:
    """Return how the rate of an encoder's frames differs from SYNC's, or from the configured."""
    if busy(scan, rate) is not None:
        return None
    cycles = heard.last_cycle - heard.first_cycle
    if scan.own_sync is None and scan.master_sync is None:
        return (
            None
            if _agrees(heard.rate, rate)
            else f'comes at {heard.rate:.1f} Hz, configured {rate:g} Hz'
        )
    if heard.count > 1 and cycles and _agrees((heard.count - 1) / cycles, 1.0):
        return None
    return f'comes {heard.count} times in {cycles + 1} cycles of SYNC; expected one answer to each'


def _missing_because(scan: BusScan, layout: EncoderLayout, node_id: int | None) -> str:
    if (not layout.extended, layout.can_id) in scan.frames:
        return f'; it comes with {11 if layout.extended else 29} bits instead'
    if node_id is None:
        return ''
    node = scan.nodes.get(node_id)
    if node is None:
        return f'; its node {node_id} was not heard either'
    others = sorted(
        identifier
        for extended, identifier in scan.frames
        if not extended and identifier - node_id in canopen.TPDO_BASES
    )
    if others:
        return '; its node sends on ' + ', '.join(f'0x{each:X}' for each in others)
    if node.state not in (None, canopen.OPERATIONAL):
        return f'; its node {node_id} is {canopen.state_word(node.state)}'
    return f'; its node {node_id} is present: does 0x1800:02 answer SYNC?'


def _unexpected(scan: BusScan, expected: Expected) -> list[str]:
    ours = {(layout.extended, layout.can_id) for layout in expected.layouts}
    ours |= {
        (False, each)
        for each in (canopen.NMT_ID, scan.sync_id, *expected.frames)
        if each is not None
    }
    # Heartbeats, emergencies and SDO answers are listed with their nodes.
    ours |= {
        (False, base + node_id)
        for node_id in scan.nodes
        for base in canopen.NODE_FRAMES
        if base not in canopen.TPDO_BASES
    }
    found = [
        f'unexpected: 0x{key[1]:X} ({_frame_name(*key)})'
        for key in sorted(scan.frames.keys() - ours)
    ]
    if expected.node_ids is not None:
        found += [
            f'unexpected: node {node_id} ({_node_words(scan.nodes[node_id])})'
            for node_id in sorted(
                scan.nodes.keys() - set(expected.node_ids) - expected.others.keys()
            )
        ]
    return found


def rig_lines(
    scan: BusScan,
    expected: Expected,
    known: bool,
    interface: str,
    channel: str,
    bitrate: int | None,
) -> list[str]:
    """
    Return the lines of a parameter file for all nodes, or a remark on why there are none.

    Joints of encoders that are as configured keep their place where the configuration is `known`,
    and not the defaults. `bitrate`, bit/s, is written unless it is None.
    """
    identifiers = _identifiers(scan, expected)
    # As configured; joints that are not get the other nodes, by ascending node id.
    configured = expected.node_ids or () if known else ()
    rest = iter(sorted(identifiers.keys() - set(configured)))
    node_ids = [each if each in identifiers else next(rest, 0) for each in configured]
    node_ids = [*filter(None, node_ids), *rest]
    count = len(node_ids)
    if not len(JOINT_NAMES) <= count <= len(ALL_JOINT_NAMES):
        return [
            f'# none: {count} encoders heard, expected {len(JOINT_NAMES)} to '
            f'{len(ALL_JOINT_NAMES)}'
            + (
                ''
                if scan.started
                else '; can_scan --start starts the nodes, and SYNC where no master makes it'
            )
        ]
    # One SYNC has no rate.
    rate = round_rate(scan.master_rate) if scan.master_rate else expected.rate
    can = [
        f'interface: {json.dumps(interface)}',
        f'channel: {json.dumps(channel)}',
        *([] if bitrate is None else [f'bitrate: {bitrate}']),
        f'sync: {"produce" if scan.master_sync is None else "consume"}',
    ]
    heard = [scan.frames.get((False, identifiers[node_id])) for node_id in node_ids]
    # None of an encoder whose frames do not have one length.
    lengths = [min(each.lengths) if each and len(each.lengths) == 1 else None for each in heard]
    return [
        '/**:',
        '  ros__parameters:',
        '    source: can',
        *([] if count == len(JOINT_NAMES) else [f'    sensors: {count}']),
        f'    rate: {rate!r}',
        f'    can: {{{", ".join(can)}}}',
        '    encoders:',
        f'      # {", ".join(ALL_JOINT_NAMES[:count])}',
        f'      node_id: {node_ids}',
        f'      id: [{", ".join(f"0x{identifiers[node_id]:X}" for node_id in node_ids)}]',
        *(
            []
            if None in lengths or lengths == [each.data_length for each in expected.layouts]
            else [f'      data_length: {lengths}']
        ),
    ]


def round_rate(rate: float) -> float:
    """Return a measured rate, Hz, as that of a period of two digits if one is within 1 %."""
    period = float(f'{1.0 / rate:.1e}')
    near = abs(period * rate - 1.0) <= 0.01
    return float(f'{1.0 / period if near else rate:.4g}')


def _identifiers(scan: BusScan, expected: Expected) -> dict[int, int]:
    """Return the identifier of each encoder's frame by node id."""
    found = {
        node_id: layout.can_id
        for layout, node_id in zip(expected.layouts, expected.node_ids or (), strict=True)
        if not layout.extended and (False, layout.can_id) in scan.frames
    }
    # Nodes that may be encoders: those of another profile, and the drives, are not.
    foreign = {
        *expected.others,
        *(
            node_id
            for node_id, node in scan.nodes.items()
            if node.profile not in (None, canopen.ENCODER_PROFILE)
        ),
    }
    for extended, identifier in sorted(scan.frames):
        node_id = identifier & 0x7F
        if (
            not extended
            and node_id
            and identifier - node_id in canopen.TPDO_BASES
            and node_id not in foreign
            and identifier not in found.values()
        ):
            found.setdefault(node_id, identifier)
    for node_id, node in scan.nodes.items():
        if node.profile == canopen.ENCODER_PROFILE:
            # Not heard: that of the predefined connection set.
            found.setdefault(node_id, canopen.TPDO_BASES[0] + node_id)
    return found
