# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The lines of `can_scan --watch`: one an encoder, as an arm of the device is turned."""

from __future__ import annotations

from math import degrees

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.counts_watch import CountsWatch
from spm_haptic_master.encoders.scan_report import Expected


def watch_lines(scan: BusScan, expected: Expected) -> list[str]:
    """
    Return a line for each encoder: node, counts, angle, span, age, status, and which moves now.

    Parameters
    ----------
    scan : BusScan
        What was heard; it follows the counts of all expected encoders.
    expected : Expected
        What is configured.

    """
    watches = [scan.watches[layout.extended, layout.can_id] for layout, _ in expected.encoders]
    moved = [watch.moved() for watch in watches]
    most = max(moved)
    lines = []
    for index, (watch, (_, node_id)) in enumerate(zip(watches, expected.encoders, strict=True)):
        parts = [f'{watch.layout.joint:9}', f'0x{watch.layout.can_id:03X}', *_reading(scan, watch)]
        if node_id is not None:
            parts.insert(1, f'node {node_id:3}')
            parts.append(_register(scan, node_id))
        if moved[index]:
            parts.append('<- moves now' if moved[index] == most else '   moves, too')
        if problem := watch.problem():
            parts.append(f'({problem})')
        lines.append('  '.join(parts).rstrip())
    return lines


def _reading(scan: BusScan, watch: CountsWatch) -> list[str]:
    """Return counts, angle, span, age and status bits of an encoder."""
    angle = watch.angle
    heard = watch.heard
    if heard is None:
        if watch.other_length is None:
            return ['no frames']
        length = watch.layout.data_length
        return [f'frames of {watch.other_length} bytes, encoders.data_length is {length}']
    age = max(0.0, scan.latest - heard)
    shown = 'beyond a turn' if angle is None else f'{degrees(angle):7.2f} deg'
    return [
        f'counts {"-" if watch.track.latest is None else watch.track.latest:>7}',
        shown,
        f'span {degrees(watch.span):7.2f} deg',
        f'age {1e3 * age:5.0f} ms',
        *([f'status {"good" if watch.healthy else "ERROR"}'] if watch.layout.status_mask else []),
    ]


def _register(scan: BusScan, node_id: int) -> str:
    """Return the error register of a node, as it was read."""
    node = scan.nodes.get(node_id)
    if node is None:
        value = None
    else:
        value = node.objects.get(canopen.ERROR_REGISTER)
    if value is None:
        return 'error register not read'
    if value:
        return canopen.register_words(value)
    return 'error register 0x00'
