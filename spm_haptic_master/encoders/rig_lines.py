# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines of a parameter file that describe a scanned bus."""

from __future__ import annotations

import json

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.scan_problems import Expected
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Significant digits of a period of SYNC that a master is set to, and how far it may be from the
# measured one (unit 1); a period that is not as round is taken as measured.
PERIOD_DIGITS, PERIOD_TOLERANCE = 2, 0.01
# Significant digits of a measured rate.
RATE_DIGITS = 4


def rig_lines(scan: BusScan, expected: Expected, known: bool, interface: str, channel: str,
              bitrate: int | None) -> list[str]:
    """
    Return the lines of a parameter file for all nodes, or a remark on why there are none.

    Joints of encoders that are as configured keep their place where the configuration is `known`,
    and not the defaults. `bitrate`, bit/s, is written unless it is None.
    """
    identifiers = _identifiers(scan, expected)
    node_ids = _order(identifiers, expected.node_ids or () if known else ())
    count = len(node_ids)
    if not len(JOINT_NAMES) <= count <= len(ALL_JOINT_NAMES):
        return [f'# none: {count} encoders heard, expected {len(JOINT_NAMES)} to '
                f'{len(ALL_JOINT_NAMES)}' + ('' if scan.started else '; can_scan --start starts '
                                             'the nodes, and SYNC where no master makes it')]
    master = scan.master_sync
    # One SYNC has no rate.
    rate = round_rate(scan.master_rate) if scan.master_rate else expected.rate
    can = [f'interface: {json.dumps(interface)}', f'channel: {json.dumps(channel)}',
           *([] if bitrate is None else [f'bitrate: {bitrate}']),
           f'sync: {"produce" if master is None else "consume"}']
    lengths = _lengths(scan, [identifiers[node_id] for node_id in node_ids])
    return [
        '/**:', '  ros__parameters:', '    source: can',
        *([] if count == len(JOINT_NAMES) else [f'    sensors: {count}']),
        f'    rate: {rate!r}', f'    can: {{{", ".join(can)}}}', '    encoders:',
        f'      # {", ".join(ALL_JOINT_NAMES[:count])}', f'      node_id: {node_ids}',
        f'      id: [{", ".join(f"0x{identifiers[node_id]:X}" for node_id in node_ids)}]',
        *([] if lengths is None or lengths == [each.data_length for each in expected.layouts]
          else [f'      data_length: {lengths}'])]


def round_rate(rate: float) -> float:
    """Return the rate that a master is set to, Hz, from a measured one: its period is round."""
    period = float(f'{1.0 / rate:.{PERIOD_DIGITS - 1}e}')
    near = abs(period * rate - 1.0) <= PERIOD_TOLERANCE
    return float(f'{1.0 / period if near else rate:.{RATE_DIGITS}g}')


def _identifiers(scan: BusScan, expected: Expected) -> dict[int, int]:
    """Return the identifier of each encoder's frame by node id."""
    found = {}
    for layout, node_id in zip(expected.layouts, expected.node_ids or (), strict=True):
        if not layout.extended and (False, layout.can_id) in scan.frames:
            found[node_id] = layout.can_id
    for extended, identifier in sorted(scan.frames):
        node_id = identifier & 0x7F
        if not extended and node_id and identifier - node_id in canopen.TPDO_BASES \
                and node_id not in expected.others \
                and _may_be_encoder(scan, node_id) and identifier not in found.values():
            found.setdefault(node_id, identifier)
    for node_id, node in scan.nodes.items():
        if node.profile == canopen.ENCODER_PROFILE:
            # Not heard: that of the predefined connection set.
            found.setdefault(node_id, canopen.TPDO_BASES[0] + node_id)
    return found


def _may_be_encoder(scan: BusScan, node_id: int) -> bool:
    node = scan.nodes.get(node_id)
    return node is None or node.profile in (None, canopen.ENCODER_PROFILE)


def _order(found: dict[int, int], configured: tuple[int, ...]) -> list[int]:
    """Return node ids in the order of the joints: as configured, and ascending where not."""
    rest = iter(sorted(found.keys() - set(configured)))
    kept = [node_id if node_id in found else next(rest, None) for node_id in configured]
    return [*(node_id for node_id in kept if node_id is not None), *rest]


def _lengths(scan: BusScan, identifiers: list[int]) -> list[int] | None:
    """Return the data length of each encoder's frames; None where one has not one length."""
    found = [list(heard.lengths) if (heard := scan.frames.get((False, identifier))) else []
             for identifier in identifiers]
    return [each[0] for each in found] if all(len(each) == 1 for each in found) else None
