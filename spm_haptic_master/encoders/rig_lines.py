# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines for rig.yaml of a scan: the bus, and the encoders that were heard on it."""

from __future__ import annotations

from dataclasses import dataclass
import json

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_report import Expected, resolution
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES


@dataclass(frozen=True, slots=True)
class GivenBus:
    """
    What the command line has of the bus.

    Attributes
    ----------
    interface, channel : str
        Names by python-can.
    bitrate : int or None
        Bit rate, bit/s; None where it is not given.
    chosen : bool
        Whether the encoders are given, and their order with them.

    """

    interface: str
    channel: str
    bitrate: int | None
    chosen: bool

    @property
    def text(self) -> str:
        """Return the entries of the bus for a parameter file."""
        bus = f'interface: {json.dumps(self.interface)}, channel: {json.dumps(self.channel)}'
        return bus if self.bitrate is None else f'{bus}, bitrate: {self.bitrate}'


def rig_lines(
    scan: BusScan,
    expected: Expected,
    given: GivenBus,
) -> list[str]:
    """
    Return the lines of a parameter file for all nodes.

    Joints of encoders that are as configured keep their place where these were chosen.

    Parameters
    ----------
    scan : BusScan
        What was heard.
    expected : Expected
        What is configured.
    given : GivenBus
        The bus as the command line has it.

    Returns
    -------
    list of str
        Lines of YAML, or a remark on why there are none.

    """
    identifiers = _identifiers(scan, expected)
    configured: tuple[int, ...] = ()
    if given.chosen and expected.node_ids:
        configured = expected.node_ids
    node_ids = _in_order(identifiers, configured)
    count = len(node_ids)
    if not len(JOINT_NAMES) <= count <= len(ALL_JOINT_NAMES):
        return [f'# none: {_too_few_or_many(scan, count)}']
    of_encoders = [identifiers[node_id] for node_id in node_ids]
    listed = ', '.join(f'0x{identifier:X}' for identifier in of_encoders)
    lines = [
        '/**:',
        '  ros__parameters:',
        '    source: can',
    ]
    if count != len(JOINT_NAMES):
        lines.append(f'    sensors: {count}')
    lines += _of_bus(scan, expected, given)
    lines += [
        '    encoders:',
        f'      # {", ".join(ALL_JOINT_NAMES[:count])}',
        f'      node_id: {node_ids}',
        f'      id: [{listed}]',
    ]
    lines += _lengths(scan, expected, of_encoders)
    lines += _counts_per_turn(scan, expected, node_ids)
    for layout, node_id in expected.axes:
        lines.append(f'    {layout.joint}: {{id: 0x{layout.can_id:X}, node_id: {node_id or 0}}}')
    return lines


def _of_bus(
    scan: BusScan,
    expected: Expected,
    given: GivenBus,
) -> list[str]:
    """Return the lines of the rate and of the bus."""
    # One SYNC has no rate.
    rate = expected.rate
    if scan.master_rate:
        rate = round_rate(scan.master_rate)
    sync = 'produce' if scan.master_sync is None else 'consume'
    return [
        f'    rate: {rate!r}',
        f'    can: {{{given.text}, sync: {sync}}}',
    ]


def _in_order(identifiers: dict[int, int], configured: tuple[int, ...]) -> list[int]:
    """Return the node ids as configured; joints that are not there get the others, ascending."""
    rest = iter(sorted(identifiers.keys() - set(configured)))
    node_ids = [each if each in identifiers else next(rest, 0) for each in configured]
    return [*filter(None, node_ids), *rest]


def _too_few_or_many(scan: BusScan, count: int) -> str:
    """Return why there are no lines for so many encoders."""
    for node_id, node in sorted(scan.nodes.items()):
        if node.devices > 1:
            return canopen.shared_node_id(node_id, node.devices)
    heard = 'one encoder was heard' if count == 1 else f'{count} encoders were heard'
    text = f'{heard}, expected {len(JOINT_NAMES)} to {len(ALL_JOINT_NAMES)}'
    if scan.started:
        return text
    return f'{text}; can_scan --start starts the nodes, and SYNC where no master makes it'


def _lengths(
    scan: BusScan,
    expected: Expected,
    identifiers: list[int],
) -> list[str]:
    """
    Return the lines of the frames' lengths where they are known and not as configured.

    A frame that is too short for the configured word is taken for one word.
    """
    lengths = []
    for identifier in identifiers:
        heard = scan.frames.get((False, identifier))
        if heard is None or len(heard.lengths) != 1:
            return []
        lengths.append(min(heard.lengths))
    if lengths == [each.data_length for each in expected.layouts]:
        return []
    lines = [f'      data_length: {lengths}']
    word = max((each.byte_offset + each.byte_length for each in expected.layouts), default=0)
    if min(lengths) < word:
        bits = [8 * min(length, word) for length in lengths]
        lines.append(f'      bit_length: {bits}   # the whole frame: compare the data sheet')
    return lines


def _counts_per_turn(
    scan: BusScan,
    expected: Expected,
    node_ids: list[int],
) -> list[str]:
    """Return the line of the counts per turn, as the nodes have them; none where they do not."""
    layout = expected.layouts[0]
    counts = []
    for node_id in node_ids:
        node = scan.nodes.get(node_id)
        if node is not None:
            counts.append(resolution(node, layout))
    if len(counts) < len(node_ids) or None in counts:
        return []
    return [f'      counts_per_turn: {counts}']


def round_rate(rate: float) -> float:
    """
    Return a measured rate as a person would have configured it.

    Parameters
    ----------
    rate : float
        Measured rate, Hz.

    Returns
    -------
    float
        Rate of a period of two digits if one is within 1 %, else four digits of the measured one,
        Hz.

    """
    period = float(f'{1.0 / rate:.1e}')
    rounded = rate
    if abs(period * rate - 1.0) <= 0.01:
        rounded = 1.0 / period
    return float(f'{rounded:.4g}')


def _identifiers(scan: BusScan, expected: Expected) -> dict[int, int]:
    """Return the identifier of each encoder's frame by node id."""
    found = _as_configured(scan, expected)
    foreign = _foreign(scan, expected)
    for identifier in _tpdos(scan):
        node_id = identifier & canopen.NODE_ID_MAXIMUM
        if node_id not in foreign and identifier not in found.values():
            found.setdefault(node_id, identifier)
    for node_id, node in scan.nodes.items():
        if node.profile == canopen.ENCODER_PROFILE and node_id not in foreign:
            # Not heard: that of the predefined connection set.
            found.setdefault(node_id, canopen.TPDO_BASES[0] + node_id)
    return found


def _as_configured(scan: BusScan, expected: Expected) -> dict[int, int]:
    """Return the configured identifiers that were heard, by node id."""
    found = {}
    for layout, node_id in zip(expected.layouts, expected.node_ids or (), strict=True):
        if not layout.extended and (False, layout.can_id) in scan.frames:
            found[node_id] = layout.can_id
    return found


def _tpdos(scan: BusScan) -> list[int]:
    """Return the identifiers that were heard and belong to the TPDO of a node."""
    found = []
    standard = sorted(identifier for extended, identifier in scan.frames if not extended)
    for identifier in standard:
        node_id = identifier & canopen.NODE_ID_MAXIMUM
        if node_id and identifier - node_id in canopen.TPDO_BASES:
            found.append(identifier)
    return found


def _foreign(scan: BusScan, expected: Expected) -> set[int]:
    """Return the nodes that are no encoders: the drives, and those of another profile."""
    found = set(expected.others)
    for _, node_id in expected.axes:
        if node_id is not None:
            found.add(node_id)
    for node_id, node in scan.nodes.items():
        if node.profile not in (None, canopen.ENCODER_PROFILE):
            found.add(node_id)
    return found
