# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lists the frames and nodes on the CAN bus, and reports what is missing or unexpected."""

from __future__ import annotations

import sys

from spm_haptic_master.arguments import Parser, positive
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_scan import BusScan
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.scan_loop import listen, send
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Listens to the bus of the driver's parameters, asks every node for its device type and identity by
SDO, and compares the answers and frames with the configuration. Exit code 0 if the bus is as
configured, 1 if something is missing or unexpected."""


def main(args: list[str] | None = None) -> int:
    """Scan the bus, and print what is on it."""
    return command_line.run('can_scan', _run, args)


def _run(args: list[str]) -> int:
    options = _parser().parse(args)
    values = command_line.bus_values(options)
    decoder = make_decoder(values)
    layouts = tuple(encoder.layout for encoder in decoder.encoders)
    node_ids = values['encoders.node_id'] if decoder.network else None
    scan = BusScan()
    with command_line.bus_of(values) as bus:
        if options.start:
            for node_id in node_ids or ():
                send(bus, canopen.nmt(canopen.NMT_START, node_id), scan)
        listen(bus, scan, options.seconds, values['rate'], not options.passive,
               decoder.sync_id if options.start else None, lambda left: print(
                   f'can_scan: {left:.0f} s left, {len(scan.frames)} identifiers',
                   file=sys.stderr))
    print(f'{command_line.bus_name(values)}, {options.seconds:g} s:')
    print('\n'.join(scan.lines(layouts, decoder.sync_id)) or '  nothing')
    problems = scan.problems(layouts, decoder.sync_id, node_ids, values['rate'], options.start)
    if problems:
        print('not as configured:\n  ' + '\n  '.join(problems))
        return 1
    print(f'all {decoder.words} are there, as configured')
    return 0


def _parser() -> Parser:
    parser = Parser('can_scan', DESCRIPTION)
    parser.add_argument('--seconds', type=positive, default=3.0, metavar='S',
                        help='time to listen, s (default 3)')
    parser.add_argument('--passive', action='store_true',
                        help='send nothing, not even SDO requests')
    parser.add_argument('--start', action='store_true',
                        help='send NMT start to the configured nodes, then SYNC at `rate`: for a '
                        'bus without a running master')
    return parser
