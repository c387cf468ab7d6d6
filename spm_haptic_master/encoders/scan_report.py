# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Report of a scan, in lines: what was heard, and what is wrong.

Nothing is sent here: the record of the bus is compared with the configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, HeardFrame, HeardNode
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.encoders.encoder_objects import EncoderRules

# Largest relative deviation of a rate from the expected one (unit 1).
RATE_TOLERANCE = 0.05
# Largest share of the answers to SYNC that a bus as configured may lose (unit 1).
LOST_SHARE = 0.005
# Number of answers that may be under way when a scan ends.
UNDER_WAY = 1
# Time without a heartbeat, in its own periods, after which a node has ended.
HEARTBEATS_MISSED = 3.0
# Rates that this machine is asked to try where it is too busy for another one (Hz).
LOWER_RATES = (500, 250, 200, 100, 50, 20, 10)


@dataclass(frozen=True, slots=True)
class Expected:
    """
    Configuration that a scan is compared with.

    Attributes
    ----------
    layouts : tuple of N EncoderLayout
        Encoders of the joints.
    node_ids : tuple of N int, or None
        Their CANopen node ids; None if they are no CANopen nodes.
    rate : float
        Rate of the sets, Hz.
    axes : tuple of (EncoderLayout, int or None)
        Encoders beside the set, insertion and gripper: frame and node id.
    heartbeat_timeout : float or None
        Time without a heartbeat after which the driver does not trust an encoder any more, s.
    others : mapping of int to str
        Names of further nodes that are configured, by node id: the drives.
    frames : mapping of int to str
        Names of their frames, and of those sent to them, by identifier.

    """

    layouts: tuple[EncoderLayout, ...]
    node_ids: tuple[int, ...] | None
    rate: float
    axes: tuple[tuple[EncoderLayout, int | None], ...] = ()
    heartbeat_timeout: float | None = None
    others: Mapping[int, str] = field(default_factory=dict)
    frames: Mapping[int, str] = field(default_factory=dict)

    @property
    def encoders(self) -> list[tuple[EncoderLayout, int | None]]:
        """Return frame and node id of each encoder, those of the axes behind the joints'."""
        node_ids = self.node_ids or (None,) * len(self.layouts)
        return [*zip(self.layouts, node_ids, strict=True), *self.axes]


def listing(scan: BusScan, expected: Expected) -> list[str]:
    """
    Return what was heard, without comparing it.

    Parameters
    ----------
    scan : BusScan
        What was heard.
    expected : Expected
        What is configured, for the names.

    Returns
    -------
    list of str
        One line for each identifier and node, and for what was sent.

    """
    names: dict[tuple[bool, int | None], str] = {}
    for layout, _ in expected.encoders:
        names[layout.extended, layout.can_id] = layout.joint
    for identifier, name in expected.frames.items():
        names[False, identifier] = name
    names[False, scan.sync_id] = 'SYNC'
    found = []
    for key, heard in sorted(scan.frames.items()):
        extended, identifier = key
        digits = 8 if extended else 3
        lengths = '/'.join(map(str, sorted(heard.lengths)))
        name = names.get(key) or _frame_name(extended, identifier)
        found.append(
            f'  0x{identifier:0{digits}X}  {heard.rate:8.1f} Hz  {lengths:>3} '
            f'bytes  {heard.count:7} frames  {name}'
        )
    for node_id, node in sorted(scan.nodes.items()):
        found.append(f'  node {node_id:3}: {_node_words(node)}')
    if scan.remote:
        found.append(f'  remote frames: {scan.remote}')
    if scan.own_sync is not None:
        found.append(
            f'  sent from here: {scan.own_sync.count} x SYNC 0x{scan.sync_id:X}, '
            f'{scan.own_sync.rate:.1f} Hz'
        )
    if scan.started:
        started = ', '.join(map(str, sorted(scan.started)))
        found.append(f'  sent from here: NMT start to node {started}')
    return found


def _frame_name(extended: bool, identifier: int) -> str:
    """Return the name of a frame that is not configured."""
    if extended:
        return '29-bit frame'
    return canopen.frame_name(identifier) or 'foreign'


def _node_words(node: HeardNode) -> str:
    """Return state, identity and emergencies of a node in one line."""
    parts = []
    if node.state is None:
        parts.append('no heartbeat')
    else:
        parts.append(canopen.state_word(node.state))
    if node.boot_ups:
        parts.append(f'booted {node.boot_ups} x')
    if node.profile is not None:
        kind = canopen.PROFILES.get(node.profile)
        profile = f'CiA {node.profile}'
        if kind:
            profile += f', {kind}'
        device_type = node.objects[canopen.DEVICE_TYPE]
        parts.append(f'device type 0x{device_type:08X} ({profile})')
    for key, name in canopen.IDENTITY.items():
        if key in node.objects:
            parts.append(f'{name} 0x{node.objects[key]:X}')
    for words, count in node.emergencies.items():
        parts.append(f'{words} ({count} x)')
    return ', '.join(parts)


def problems(scan: BusScan, expected: Expected) -> list[str]:
    """
    Return what is missing, wrong or unexpected.

    Parameters
    ----------
    scan : BusScan
        What was heard.
    expected : Expected
        What is configured.

    Returns
    -------
    list of str
        One line for each problem; empty if the bus is as configured.

    """
    shared = {node_id: node for node_id, node in scan.nodes.items() if node.devices > 1}
    found = []
    for shared_id, node in sorted(shared.items()):
        found.append(canopen.shared_node_id(shared_id, node.devices))
    found += _silence(scan)
    found += _sync_problems(scan, expected)
    for layout, node_id in expected.encoders:
        if node_id in shared:
            continue
        for words in _encoder_problems(scan, layout, node_id, expected):
            found.append(f'{layout.joint}: {words}')
    found += _phase_problem(scan, expected)
    found += _other_problems(scan, expected)
    found += _unexpected(scan, expected)
    for words, count in scan.errors.items():
        found.append(f'error frames: {count} x {words}')
    for words, count in scan.unsent.items():
        found.append(f'{count} frames not sent: {words} (does any other node acknowledge?)')
    return found


def _other_problems(scan: BusScan, expected: Expected) -> list[str]:
    """Return which further nodes, the drives, were not heard, or have an emergency."""
    found = []
    for node_id, name in expected.others.items():
        node = scan.nodes.get(node_id)
        words = ['not heard']
        if node is not None:
            words = list(node.emergencies)
        found += [f'{name}: {word}' for word in words]
    return found


def _silence(scan: BusScan) -> list[str]:
    """Return what to do where no frame but answers to SDO was heard."""
    if scan.frames:
        return []
    answered = sorted(node_id for node_id, node in scan.nodes.items() if node.devices < 2)
    if answered:
        listed = ', '.join(map(str, answered))
        nodes = f'no frames, but answers to SDO of node {listed}: '
        if scan.started:
            return [f'{nodes}started, they send nothing. Set them up (can_setup --write)']
        return [
            f'{nodes}they do not send yet. Start them (can_scan --start), and set them up '
            '(can_setup --write)'
        ]
    if scan.nodes:
        return []  # devices with one node id, which are named before
    return ['no frames at all: check bit rate, termination, power, and that the interface is up']


def _sync_problems(scan: BusScan, expected: Expected) -> list[str]:
    """Return that SYNC is missing, or comes at another rate."""
    if scan.sync_id is None or scan.own_sync is not None:
        return []
    if scan.master_sync is None:
        return [
            f'no SYNC 0x{scan.sync_id:X}: let the driver make it (can.sync: '
            'produce), or start its master'
        ]
    if _agrees(scan.master_rate, expected.rate):
        return []
    return [
        f'SYNC 0x{scan.sync_id:X} comes at {scan.master_rate:.1f} Hz, rate is '
        f"{expected.rate:g} Hz: give the bus's rate to all nodes"
    ]


def busy(scan: BusScan, rate: float) -> str | None:
    """
    Return that this machine sent SYNC below its rate.

    Parameters
    ----------
    scan : BusScan
        What was heard and sent.
    rate : float
        Configured rate, Hz.

    Returns
    -------
    str or None
        One line; None if it sent SYNC at its rate, or sent none.

    """
    own = scan.own_sync
    if own is None or not own.rate or own.rate >= rate * (1.0 - RATE_TOLERANCE):
        return None
    remedy = ''
    lower = [each for each in LOWER_RATES if each < own.rate]
    if lower:
        remedy = f'. Give a lower rate: -p rate:={lower[0]}.0'
    return (
        f'this machine is too busy: SYNC was sent at {own.rate:.1f} Hz instead of {rate:g} '
        f"Hz; the encoders' rates are not compared{remedy}"
    )


def _agrees(rate: float, expected: float) -> bool:
    """Return whether a rate is the expected one, within RATE_TOLERANCE."""
    return abs(rate / expected - 1.0) <= RATE_TOLERANCE


def _encoder_problems(
    scan: BusScan,
    layout: EncoderLayout,
    node_id: int | None,
    expected: Expected,
) -> list[str]:
    """Return what is wrong with one encoder: its frames, their counts, its node."""
    identifier = f'0x{layout.can_id:X}'
    key = layout.extended, layout.can_id
    heard = scan.frames.get(key)
    node = None
    if node_id is not None:
        node = scan.nodes.get(node_id)
    found = []
    if heard is None:
        found.append(f'{identifier} missing{_missing_because(scan, layout, node_id)}')
    else:
        if heard.lengths != {layout.data_length}:
            lengths = ', '.join(map(str, sorted(heard.lengths)))
            found.append(f'{identifier} has {lengths} bytes, configured {layout.data_length}')
        wrong_rate = _rate_problem(scan, heard, expected.rate)
        if wrong_rate:
            found.append(f'{identifier} {wrong_rate}')
        wrong_counts = scan.watches[key].problem() if key in scan.watches else None
        if wrong_counts:
            found.append(f'{identifier}: {wrong_counts}')
    if node is not None:
        found += _node_problems(scan, node, layout, expected, heard is None)
    return found


def _node_problems(
    scan: BusScan,
    node: HeardNode,
    layout: EncoderLayout,
    expected: Expected,
    missing: bool,
) -> list[str]:
    """Return what a node reports, but for emergencies where it is missing, and its objects."""
    found: list[str] = []
    if not missing:
        found += node.emergencies
    register = node.objects.get(canopen.ERROR_REGISTER)
    if register:
        found.append(canopen.register_words(register))
    # An axis may be a linear encoder, whose counts are none per turn.
    counts = None
    if layout in expected.layouts:
        counts = resolution(node, layout)
    if counts not in (None, layout.counts_per_turn):
        found.append(
            f'it has {counts} counts per turn, encoders.counts_per_turn is '
            f'{layout.counts_per_turn}'
        )
    return found + _heartbeat_problems(scan, node, expected.heartbeat_timeout)


def _heartbeat_problems(
    scan: BusScan,
    node: HeardNode,
    timeout: float | None,
) -> list[str]:
    """Return that the heartbeat of a node ended, or comes too seldom for the driver."""
    period = node.heartbeat_period
    if not period or node.heartbeat is None:
        return []
    age = scan.latest - node.heartbeat
    if age > HEARTBEATS_MISSED * period:
        return [
            f'its last heartbeat came {age:.2f} s before the end, after one each {period:.2f} s'
        ]
    if timeout is not None and period > timeout:
        return [
            f'its heartbeats come {period:.2f} s apart, can.heartbeat_timeout is {timeout:g} s: '
            'set 0x1017 (can_setup)'
        ]
    return []


def resolution(node: HeardNode, layout: EncoderLayout) -> int | None:
    """
    Return the counts per turn of an encoder by its objects.

    Parameters
    ----------
    node : HeardNode
        Its node, with the values that were read.
    layout : EncoderLayout
        Its configured layout.

    Returns
    -------
    int or None
        Counts per turn; None where the objects do not have them.

    """
    rules = EncoderRules(
        counts_per_turn=layout.counts_per_turn,
        timer=0,
        event_timer=None,
    )
    return rules.resolution(lambda index, subindex: node.objects.get((index, subindex)))


def _rate_problem(
    scan: BusScan,
    heard: HeardFrame,
    rate: float,
) -> str | None:
    """Return how an encoder's frames differ from one to each SYNC, or from the configured rate."""
    if busy(scan, rate) is not None:
        return None
    if scan.own_sync is None and scan.master_sync is None:
        if _agrees(heard.rate, rate):
            return None
        return f'comes at {heard.rate:.1f} Hz, configured {rate:g} Hz'
    # To the end of the scan: an encoder may have ended meanwhile.
    cycles = scan.cycles - heard.first_cycle + (heard.first_cycle > 0)
    lost = cycles - heard.count
    tolerated = max(UNDER_WAY, LOST_SHARE * cycles)
    if -tolerated <= lost <= tolerated:
        return None
    times = 'once' if heard.count == 1 else f'{heard.count} times'
    if lost < 0:
        of_sync = '1 cycle' if cycles == 1 else f'{cycles} cycles'
        return f'comes {times} in {of_sync} of SYNC; expected one answer to each'
    return f'answers {heard.count} of {cycles} SYNC{_ended(scan, heard)}'


def _ended(scan: BusScan, heard: HeardFrame) -> str:
    """Return when the last frame came, if that was long before the end of the scan."""
    age = scan.latest - heard.last
    if heard.count < 2 or age < 0.1 * (scan.latest - heard.first):
        return ''
    return f', the last one {age:.2f} s before the end'


def phases(scan: BusScan, expected: Expected) -> dict[str, int]:
    """
    Return when each encoder's frames come in a period.

    Parameters
    ----------
    scan : BusScan
        What was heard.
    expected : Expected
        What is configured.

    Returns
    -------
    dict of str to int
        Time after the first encoder's frame, us, by joint; empty if none was heard.

    """
    period = round(1e6 / expected.rate)
    heard = {}
    for layout in expected.layouts:
        frame = scan.frames.get((layout.extended, layout.can_id))
        if frame is not None:
            heard[layout.joint] = round(1e6 * frame.last) % period
    if not heard:
        return {}
    # The first one is the one behind the longest pause.
    ordered = sorted(heard.values())
    last = ordered[-1]
    pauses = []
    for before, at in pairwise([last, *ordered]):
        pauses.append((at - before) % period)
    first = ordered[pauses.index(max(pauses))]
    return {joint: (at - first) % period for joint, at in heard.items()}


def _phase_problem(scan: BusScan, expected: Expected) -> list[str]:
    """Return that encoders without SYNC send at phases of which no set can be made."""
    if scan.sync_id is not None:
        return []
    found = phases(scan, expected)
    if not found or max(found.values()) <= 0.5e6 / expected.rate:
        return []
    return [
        f'{_phases_text(found, expected)}: no set is complete within half a period. {SYNC_NEEDED}'
    ]


SYNC_NEEDED = (
    'Encoders without SYNC have phases that change with each power-up: SYNC is needed '
    '(encoders.sync_id: 0x80, and can_setup)'
)


def remark_on_phases(scan: BusScan, expected: Expected) -> str | None:
    """Return the phases of encoders without SYNC that make sets at present; None with SYNC."""
    if scan.sync_id is not None:
        return None
    found = phases(scan, expected)
    if not found or _phase_problem(scan, expected):
        return None
    return f'{_phases_text(found, expected)} at present. {SYNC_NEEDED}'


def _phases_text(found: dict[str, int], expected: Expected) -> str:
    """Return the phases in words, with the period."""
    shown = ', '.join(f'{joint} {1e-3 * phase:.1f}' for joint, phase in found.items())
    return f'without SYNC the frames come at phases of {shown} ms in {1e3 / expected.rate:g} ms'


def _missing_because(
    scan: BusScan,
    layout: EncoderLayout,
    node_id: int | None,
) -> str:
    """Return why the frame of an encoder is missing, behind a semicolon."""
    if (not layout.extended, layout.can_id) in scan.frames:
        bits = 11 if layout.extended else 29
        return f'; it comes with {bits} bits instead'
    if node_id is None:
        return ''
    node = scan.nodes.get(node_id)
    if node is None:
        return f'; its node {node_id} was not heard either'
    return f'; its {_node_without_frames(scan, node_id, node)}'


def _node_without_frames(
    scan: BusScan,
    node_id: int,
    node: HeardNode,
) -> str:
    """Return what is known of a node whose frame is missing."""
    if node.emergencies:
        return f'node {node_id} reports {", ".join(node.emergencies)}'
    others = []
    for extended, identifier in sorted(scan.frames):
        if not extended and identifier - node_id in canopen.TPDO_BASES:
            others.append(f'0x{identifier:X}')
    if others:
        return f'node sends on {", ".join(others)}'
    if node.state not in (None, canopen.OPERATIONAL):
        return f'node {node_id} is {canopen.state_word(node.state)}'
    return f'node {node_id} is present: does it answer SYNC (0x1800:02, 0x1005)? can_setup'


def _unexpected(scan: BusScan, expected: Expected) -> list[str]:
    """Return frames and nodes that are not configured."""
    ours = {(layout.extended, layout.can_id) for layout, _ in expected.encoders}
    ours.add((False, canopen.NMT_ID))
    ours |= {(False, identifier) for identifier in expected.frames}
    if scan.sync_id is not None:
        ours.add((False, scan.sync_id))
    # Heartbeats, emergencies and SDO answers are listed with their nodes.
    for node_id in scan.nodes:
        for base in canopen.NODE_FRAMES:
            if base not in canopen.TPDO_BASES:
                ours.add((False, base + node_id))
    found = [
        f'unexpected: 0x{key[1]:X} ({_frame_name(*key)})'
        for key in sorted(scan.frames.keys() - ours)
    ]
    return found + _unexpected_nodes(scan, expected)


def _unexpected_nodes(scan: BusScan, expected: Expected) -> list[str]:
    """Return the nodes that are not configured; none where the encoders are no nodes."""
    if expected.node_ids is None:
        return []
    known = {node_id for _, node_id in expected.encoders} | expected.others.keys()
    return [
        f'unexpected: node {node_id} ({_node_words(scan.nodes[node_id])})'
        for node_id in sorted(scan.nodes.keys() - known)
    ]
