# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Lists the frames and nodes on the CAN bus, and reports what is missing or unexpected."""

from __future__ import annotations

import argparse
from functools import partial
import sys

from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.drives.shared_bus import is_shared
from spm_haptic_master.encoders import (
    canopen,
    dbc_file,
    rig_lines,
    scan_report,
    watch_table,
)
from spm_haptic_master.encoders.bus_scan import BusScan, BusScanner, ECHOING
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.nodes import DRIVE_NAMES, DRIVE_SETTINGS, DRIVER_NAMES
from spm_haptic_master.parameters.resolver import DRIVER
from spm_haptic_master.parameters.setting import RATE_SETTING, Values
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Listens to the bus of the driver's parameters, asks every node for its device type and identity by
SDO, compares the answers and frames with the configuration, and prints the lines for rig.yaml.
With --watch it shows the encoders while somebody turns an arm: which node is which joint.
Exit code 0 if the bus is as configured, 1 if something is missing or unexpected."""
# Time to listen where none is given (s).
SECONDS = 3.0
# Parameters that choose the encoders: without them the joints are in the order of the node ids.
CHOSEN = ('encoders.node_id', 'encoders.id')
IN_ORDER = (
    ', in the order of the node ids: put the lists into that of the joints, as the '
    'device is wired (can_scan --watch shows which one moves)'
)


# Time between two updates of the lines of --watch, on a terminal and elsewhere (s).
TERMINAL_PERIOD = 0.25
LINE_PERIOD = 1.0


@command_line.program('can_scan')
def main(args: list[str]) -> int:
    """
    Scan the bus, and print what is on it.

    It listens for --seconds, asks every node for its identity (not with --passive), compares with
    the parameters, and prints the lines for rig.yaml. With --watch it prints the encoders again
    and again until Ctrl-C; with --dbc it prints the lines of a file, and opens no bus.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0 if the bus is as configured, 1 if something is missing or unexpected. After an
        error, which is one line on stderr, it is 1.

    """
    options = _parser().parse(args)
    if options.dbc is not None:
        print('\n'.join(dbc_file.rig_lines(dbc_file.read_dbc(options.dbc), options.dbc)))
        return 0
    if options.start and options.passive:
        raise InputError('--start with --passive, which sends nothing; expected one of the two')
    given = command_line.given(options, (DRIVER, 'fkm'), DRIVER_NAMES | DRIVE_NAMES)
    values = command_line.bus_values(given)
    decoder = make_decoder(values)
    expected = _expected(given, values, decoder)
    scan = BusScan(decoder.sync_id, [layout for layout, _ in expected.encoders])
    with command_line.bus_of(values) as bus:
        scanner = BusScanner(
            bus=bus,
            scan=scan,
            rate=expected.rate,
            echoes=values['can.interface'] == ECHOING,
            report=partial(print, 'can_scan:', file=sys.stderr),
        )
        nodes = tuple(node_id for _, node_id in expected.encoders if node_id is not None)
        start = nodes if options.start else None
        if options.watch:
            return _watch(scanner, scan, expected, options, nodes)
        scanner.listen(options.seconds or SECONDS, not options.passive, start)
    return _print_report(scan, expected, decoder.words, given, values, options)


def _expected(
    given: Values,
    values: Values,
    decoder: FrameDecoder,
) -> scan_report.Expected:
    """
    Return the configuration that the bus is compared with.

    Parameters
    ----------
    given : Values
        Given parameters; those of the drives are checked here.
    values : Values
        Checked parameters, by name.
    decoder : FrameDecoder
        Layouts of the encoders.

    Returns
    -------
    scan_report.Expected
        Encoders, axes, rate, heartbeat and drives.

    """
    others, frames = _drives(given, values)
    return scan_report.Expected(
        layouts=decoder.layouts,
        node_ids=values['encoders.node_id'] if decoder.network else None,
        rate=values['rate'],
        axes=tuple(
            (axis.layout, None if axis.node is None else axis.node.node_id)
            for axis in decoder.axes
        ),
        heartbeat_timeout=values['can.heartbeat_timeout'],
        others=others,
        frames=frames,
    )


def _watch(
    scanner: BusScanner,
    scan: BusScan,
    expected: scan_report.Expected,
    options: argparse.Namespace,
    nodes: tuple[int, ...],
) -> int:
    """
    Print a line for each encoder, again and again, until --seconds or Ctrl-C.

    Parameters
    ----------
    scanner : BusScanner
        Reads the bus.
    scan : BusScan
        What was heard so far.
    expected : scan_report.Expected
        The configuration.
    options : argparse.Namespace
        The parsed command line.
    nodes : tuple of int
        Node ids of the encoders.

    Returns
    -------
    int
        Exit code 0.

    """
    terminal = sys.stdout.isatty()
    printed = 0

    def show() -> None:
        """Print the lines; on a terminal over those before."""
        nonlocal printed
        if terminal and printed:
            print(f'\x1b[{printed}A', end='')
        lines = watch_table.watch_lines(scan, expected)
        end = '\x1b[K' if terminal else ''
        print('\n'.join(f'{line}{end}' for line in lines), flush=True)
        printed = len(lines)

    scanner.watch(
        options.seconds or float('inf'),
        show,
        TERMINAL_PERIOD if terminal else LINE_PERIOD,
        () if options.passive else nodes,
        nodes if options.start else None,
    )
    return 0


def _print_report(
    scan: BusScan,
    expected: scan_report.Expected,
    words: str,
    given: Values,
    values: Values,
    options: argparse.Namespace,
) -> int:
    """
    Print what was heard, what is wrong, and the lines for rig.yaml.

    Parameters
    ----------
    scan : BusScan
        What was heard.
    expected : scan_report.Expected
        The configuration.
    words : str
        The encoders, in words.
    given : Values
        Given parameters, by name.
    values : Values
        Checked parameters, by name.
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code: 1 if something is missing or unexpected.

    """
    print(f'{command_line.bus_name(values)}, {options.seconds or SECONDS:g} s:')
    print('\n'.join(scan_report.listing(scan, expected)) or '  nothing')
    found = scan_report.problems(scan, expected)
    if found:
        print('not as configured:\n  ' + '\n  '.join(found))
    else:
        print(f'all {words} are there, as configured')
    for text in (
        scan_report.busy(scan, expected.rate),
        scan_report.remark_on_phases(scan, expected),
    ):
        if text is not None:
            print(text)
    if expected.node_ids is not None:
        _print_rig_lines(scan, expected, given, values)
    return 1 if found else 0


def _print_rig_lines(
    scan: BusScan,
    expected: scan_report.Expected,
    given: Values,
    values: Values,
) -> None:
    """
    Print the lines for rig.yaml.

    Where no parameter chooses the encoders, they are in the order of the node ids.
    """
    known = any(name in given for name in CHOSEN)
    print('lines for rig.yaml' + ('' if known else IN_ORDER) + ':')
    bus = rig_lines.GivenBus(
        interface=values['can.interface'],
        channel=values['can.channel'],
        bitrate=values['can.bitrate'] if 'can.bitrate' in given else None,
        chosen=known,
    )
    print('\n'.join(rig_lines.rig_lines(scan, expected, bus)))


def _drives(
    given: Values,
    values: Values,
) -> tuple[dict[int, str], dict[int, str]]:
    """
    Return what the drives add to the bus of the encoders.

    Parameters
    ----------
    given : Values
        Given parameters, by name.
    values : Values
        Checked parameters, by name.

    Returns
    -------
    names : dict of int to str
        Names of the drives by node id; empty where they are on another bus.
    frames : dict of int to str
        What their frames are, by CAN identifier.

    """
    drives = command_line.checked(given, (*DRIVE_SETTINGS, RATE_SETTING))
    if not is_shared(drives, values):
        return {}, {}
    plan = make_plan(drives)
    names = {drive.node_id: drive.name for drive in plan.drives}
    if plan.combined:
        frames = {plan.combined_id: 'torques of all drives'}
    else:
        frames = {}
    for drive in plan.drives:
        frames |= {
            drive.status_id: f'status of the {drive.name}',
            drive.control_id: f'command to the {drive.name}',
        }
    frames[canopen.HEARTBEAT_BASE + plan.master_id] = 'heartbeat of the master of the drives'
    return names, frames


def _parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser('can_scan', DESCRIPTION)
    parser.add_argument(
        '--seconds',
        type=positive,
        metavar='S',
        help=f'time to listen, s (default {SECONDS:g}; with --watch until Ctrl-C)',
    )
    parser.add_argument(
        '--watch',
        action='store_true',
        help='one line an encoder: counts, angle, span since the start, age, status bits, error '
        'register, and which one moves now',
    )
    parser.add_argument(
        '--dbc',
        metavar='FILE',
        help='print the lines for rig.yaml of the frames that a DBC file describes, and end',
    )
    parser.add_argument(
        '--passive',
        action='store_true',
        help='send nothing, not even SDO requests',
    )
    parser.add_argument(
        '--start',
        action='store_true',
        help='send NMT start to every node that is heard, and SYNC at `rate` as '
        'long as no master makes it',
    )
    return parser
