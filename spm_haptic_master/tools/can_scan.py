# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lists what is on the CAN bus, and says what of it is missing or unexpected."""

from __future__ import annotations

import argparse
import sys
import time

import can

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan, IDENTITY
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.source_factory import SOURCE_SETTINGS
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Listens to the bus that the driver's parameters name, asks every node for its device type and
identity by SDO, and holds what it heard against the configuration. Exit code 0 where all is as
configured, 1 where something is missing or unexpected."""
# s between SDO requests: no more than a tenth of a 1 Mbit/s bus.
REQUEST_PERIOD = 0.002


def main(args: list[str] | None = None) -> int:
    """Scan the bus for the seconds asked for, and print what is there."""
    return command_line.run('can_scan', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse_args(args)
    values = command_line.checked(command_line.given(options), SOURCE_SETTINGS['can'], 'can')
    decoder = make_decoder(values)
    layouts = tuple(encoder.layout for encoder in decoder.encoders)
    node_ids = values['encoders.node_id'] if decoder.network else None
    scan = BusScan()
    with command_line.bus_of(values) as bus:
        if options.start:
            for node_id in node_ids or ():
                bus.send(canopen.nmt(canopen.NMT_START, node_id))
        _listen(bus, scan, options, decoder.sync_id, values['rate'])
    print(f'{command_line.bus_name(values)}, {options.seconds:g} s:')
    print('\n'.join(scan.lines(layouts, decoder.sync_id)) or '  nothing')
    problems = scan.problems(layouts, decoder.sync_id, node_ids, values['rate'], options.start)
    if problems:
        print('not as configured:\n  ' + '\n  '.join(problems))
        return 1
    print('all four encoders are there, as configured')
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_line.make_parser('can_scan', DESCRIPTION)
    parser.add_argument('--seconds', type=float, default=3.0, metavar='S',
                        help='s to listen (default 3)')
    parser.add_argument('--passive', action='store_true', help='send nothing, ask nobody')
    parser.add_argument('--start', action='store_true',
                        help='NMT start to the configured nodes, and SYNC at `rate` meanwhile: '
                        'for a bus that no master has started')
    return parser


def _listen(bus: can.BusABC, scan: BusScan, options: argparse.Namespace, sync_id: int | None,
            rate: float) -> None:
    """Take in what comes; ask the nodes one by one, and send SYNC where that is asked for."""
    end = time.monotonic() + options.seconds
    requests = iter(()) if options.passive else (
        canopen.sdo_upload(node_id, *entry) for entry in IDENTITY
        for node_id in range(1, canopen.NODE_ID_MAXIMUM + 1)
        if entry == canopen.DEVICE_TYPE or node_id in scan.nodes)
    ask = DeadlineGrid(REQUEST_PERIOD)
    sync = DeadlineGrid(1.0 / rate) if options.start and sync_id else None
    shown = time.monotonic()
    while (now := time.monotonic()) < end:
        if ask.wait(0.0) and (request := next(requests, None)):
            bus.send(request)
        if sync and sync.wait(0.0):
            bus.send(canopen.frame(sync_id))
        if (message := bus.recv(min(REQUEST_PERIOD, 0.5 / rate))) is not None:
            scan.feed(message)
        if now - shown >= 1.0:
            shown = now
            print(f'can_scan: {end - now:.0f} s left, {len(scan.frames)} identifiers',
                  file=sys.stderr)
