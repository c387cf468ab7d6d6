# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lists the frames and nodes on the CAN bus, and reports what is missing or unexpected."""

from __future__ import annotations

from functools import partial
import sys

from spm_haptic_master.drives.plan import is_shared, make_plan
from spm_haptic_master.encoders import canopen, scan_report
from spm_haptic_master.encoders.bus_scan import BusScan, BusScanner, ECHOING
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.nodes import DRIVE_NAMES, DRIVE_SETTINGS, DRIVER_NAMES
from spm_haptic_master.parameters.resolver import DRIVER
from spm_haptic_master.parameters.setting import RATE_SETTING, Values
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Listens to the bus of the driver's parameters, asks every node for its device type and identity by
SDO, compares the answers and frames with the configuration, and prints the lines for rig.yaml.
Exit code 0 if the bus is as configured, 1 if something is missing or unexpected."""
# Parameters that choose the encoders: without them the joints are in the order of the node ids.
CHOSEN = ('encoders.node_id', 'encoders.id')
IN_ORDER = (
    ', in the order of the node ids: put both lists into that of the joints, as the '
    'device is wired'
)


@command_line.program('can_scan')
def main(args: list[str]) -> int:
    """Scan the bus, and print what is on it."""
    options = _parser().parse(args)
    if options.start and options.passive:
        raise InputError('--start with --passive, which sends nothing; expected one of the two')
    given = command_line.given(options, (DRIVER, 'fkm'), DRIVER_NAMES | DRIVE_NAMES)
    values = command_line.bus_values(given)
    decoder = make_decoder(values)
    expected = scan_report.Expected(
        decoder.layouts,
        values['encoders.node_id'] if decoder.network else None,
        values['rate'],
        *_drives(given, values),
    )
    scan = BusScan(decoder.sync_id)
    interface, channel = values['can.interface'], values['can.channel']
    with command_line.bus_of(values) as bus:
        scanner = BusScanner(
            bus,
            scan,
            expected.rate,
            interface == ECHOING,
            partial(print, 'can_scan:', file=sys.stderr),
        )
        scanner.listen(
            options.seconds,
            not options.passive,
            (expected.node_ids or ()) if options.start else None,
        )
    print(f'{command_line.bus_name(values)}, {options.seconds:g} s:')
    print('\n'.join(scan_report.listing(scan, expected)) or '  nothing')
    found = scan_report.problems(scan, expected)
    if found:
        print('not as configured:\n  ' + '\n  '.join(found))
    else:
        print(f'all {decoder.words} are there, as configured')
    if (text := scan_report.busy(scan, expected.rate)) is not None:
        print(text)
    if expected.node_ids is not None:
        known = any(name in given for name in CHOSEN)
        print('lines for rig.yaml' + ('' if known else IN_ORDER) + ':')
        print(
            '\n'.join(
                scan_report.rig_lines(
                    scan,
                    expected,
                    known,
                    interface,
                    channel,
                    values['can.bitrate'] if 'can.bitrate' in given else None,
                )
            )
        )
    return 1 if found else 0


def _drives(given: Values, values: Values) -> tuple[dict[int, str], dict[int, str]]:
    """Return the names of the drives by node id, and of frames, where they are on this bus."""
    drives = command_line.checked(given, (*DRIVE_SETTINGS, RATE_SETTING))
    if not is_shared(drives, values):
        return {}, {}
    plan = make_plan(drives)
    names = {drive.node_id: drive.name for drive in plan.drives}
    frames = {plan.combined_id: 'torques of all drives'} if plan.combined else {}
    for drive in plan.drives:
        frames |= {
            drive.status_id: f'status of the {drive.name}',
            drive.control_id: f'command to the {drive.name}',
        }
    frames[canopen.HEARTBEAT_BASE + plan.master_id] = 'heartbeat of the master of the drives'
    return names, frames


def _parser() -> Parser:
    parser = Parser('can_scan', DESCRIPTION)
    parser.add_argument(
        '--seconds', type=positive, default=3.0, metavar='S', help='time to listen, s (default 3)'
    )
    parser.add_argument(
        '--passive', action='store_true', help='send nothing, not even SDO requests'
    )
    parser.add_argument(
        '--start',
        action='store_true',
        help='send NMT start to every node that is heard, and SYNC at `rate` as '
        'long as no master makes it',
    )
    return parser
