# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Simulates the CANopen encoders and drives on any bus of python-can, without hardware."""

from __future__ import annotations

import argparse
from collections.abc import Container, Iterable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
import sys
import time

from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.drives.shared_bus import check_shared_bus
from spm_haptic_master.encoders import recording_files
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.encoders.frame_decoder import FrameDecoder
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters import nodes
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.encoders import sensors_of
from spm_haptic_master.parameters.files import simulated_rig
from spm_haptic_master.parameters.resolver import DRIVER
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.simulation import device_quirks, fault_injection
from spm_haptic_master.simulation.bus_runner import BusRunner, DriveLoop, Record
from spm_haptic_master.simulation.noisy_motion import make_motion, NoisyMotion
from spm_haptic_master.simulation.rig import rig_text
from spm_haptic_master.simulation.simulated_axes import simulated_axis
from spm_haptic_master.simulation.simulated_bus import SimulatedBus
from spm_haptic_master.simulation.simulated_drive import SimulatedDrives
from spm_haptic_master.simulation.simulated_nodes import NodeOptions
from spm_haptic_master.timing import DeadlineGrid
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Simulates the encoders of the driver's parameters: they boot, wait for NMT start, answer SYNC
and SDO identity requests, and send heartbeats. The motion is that of sim.trajectory; it begins
with the first answer. Zero counts and directions are those of config/simulated_rig.yaml (with five
or six `sensors` of simulated_rig_five.yaml, simulated_rig_six.yaml), unless
encoders.zero_count and encoders.direction are given. The rig is as drawn, unless sim.rig_file or
sim.rig_seed is given.

With --drives, or with drives.channel, it simulates the drives of the motors (CiA 402) as well:
NMT, states, objects by SDO, heartbeats and event timer, I2t. Where drives.channel is not given
they are on the bus of the encoders.

Between processes without a CAN interface: -p can.interface:=udp_multicast. One port for each bus,
CAN_CONFIG='{"port": 43114}' in the environment of all its programs: a socket receives every
group (can.channel) that any program of the host has joined on its port."""
# Rated torque of simulated motors where none is given (N m).
SIMULATED_RATED_TORQUE = 0.5
# Counts per turn of config/simulated_rig.yaml and its variants.
SIMULATED_COUNTS = 16384
# What a second program on the bus is, and its cure.
TWIN = (
    'a second sim_bus, or encoders; udp_multicast needs a port for each bus, as in '
    'CAN_CONFIG=\'{"port": 43114}\''
)


@command_line.program('sim_bus')
def main(args: list[str]) -> int:
    """
    Run the simulated bus until Ctrl-C, or for the given time.

    The encoders of the parameters boot and answer; with --drives or drives.channel the drives do
    as well. --fault and --quirk make them fail or differ; with --sync, or where the encoders need
    no SYNC, it keeps time by itself. --ground-truth writes the true orientations.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0. After an error, which is one line on stderr, it is 1.

    """
    options = _parser().parse(args)
    given = command_line.given(options, (DRIVER, 'fkm'), nodes.DRIVER_NAMES | nodes.DRIVE_NAMES)
    sensors = sensors_of(given)
    settings = (*nodes.SOURCE_SETTINGS['can'], *nodes.MOTION_SETTINGS, *nodes.DRIVE_SETTINGS)
    values = command_line.checked(simulated_rig(sensors) | given, settings, 'sim', 'can')
    if 'encoders.zero_count' not in given:
        values['encoders.zero_count'] = _zero_counts(values)
    decoder = make_decoder(values)
    axes = tuple(axis.name for axis in decoder.axes)
    faults = [fault_injection.parse_fault(text, sensors, axes) for text in options.fault]
    motion = make_motion(values)
    encoders = _encoders(values, options, decoder, motion, faults)
    drives = _drives(values, options, _of_kinds(faults, fault_injection.DRIVE_KINDS))
    if options.sync or decoder.sync_id is None:
        grid = DeadlineGrid(1.0 / values['rate'])
    else:
        grid = None
    with ExitStack() as stack:
        record = _recording(options, motion, stack)
        bus = stack.enter_context(command_line.bus_of(values))
        runner = BusRunner(bus, encoders, decoder.sync_id, grid, record)
        _boot(runner, values, decoder)
        if drives is None:
            loop = None
        else:
            loop = _drive_loop(drives, values, stack)
        try:
            _run(runner, drives, loop, options.seconds or float('inf'))
        finally:
            missed = f', {grid.missed} deadlines missed' if grid else ''
            print(f'sim_bus: {runner.cycles} cycles answered{missed}')
    return 0


def _zero_counts(values: Values) -> tuple[int, ...]:
    """Return the zero counts of the simulated rig, in the counts that the encoders have."""
    return tuple(
        zero * counts // SIMULATED_COUNTS
        for zero, counts in zip(
            values['encoders.zero_count'],
            values['encoders.counts_per_turn'],
            strict=True,
        )
    )


def _of_kinds(
    faults: Iterable[fault_injection.Fault],
    kinds: Container[str],
) -> tuple[fault_injection.Fault, ...]:
    """Return the faults of some kinds."""
    return tuple(fault for fault in faults if fault.kind in kinds)


def _encoders(
    values: Values,
    options: argparse.Namespace,
    decoder: FrameDecoder,
    motion: NoisyMotion,
    faults: Iterable[fault_injection.Fault],
) -> SimulatedBus:
    """
    Return the simulated encoders.

    Parameters
    ----------
    values : Values
        Checked parameters, by name.
    options : argparse.Namespace
        The parsed command line.
    decoder : FrameDecoder
        Layouts of the encoders' frames.
    motion : NoisyMotion
        Motion of the device, with the rig's own errors.
    faults : iterable of fault_injection.Fault
        All faults; those of encoders are taken.

    Returns
    -------
    SimulatedBus
        A bus of encoders and axes.

    Raises
    ------
    InputError
        The options contradict the parameters.

    """
    node_ids = values['encoders.node_id'] if decoder.network else None
    if options.factory and node_ids is None:
        raise InputError("--factory with can.protocol 'raw'; expected 'canopen'")
    layouts = decoder.layouts
    if motion.rig.has_harmonics:
        # The rig's are those of its encoders, not the ones that a driver corrects.
        layouts = tuple(replace(layout, harmonics=None) for layout in layouts)
    return SimulatedBus(
        layouts=layouts,
        node_ids=node_ids,
        motion=motion,
        faults=_of_kinds(faults, fault_injection.KINDS),
        seed=values['sim.seed'],
        options=NodeOptions(
            synchronised=decoder.sync_id is not None,
            factory=options.factory,
            heartbeat=options.heartbeat,
            period=1.0 / values['rate'],
        ),
        quirks=_quirks(options, values['sensors'], decoder.sync_id),
        axes=tuple(map(simulated_axis, decoder.axes)),
    )


def _recording(
    options: argparse.Namespace,
    motion: NoisyMotion,
    stack: ExitStack,
) -> Record | None:
    """
    Write the rig, and return what writes the true orientations.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    motion : NoisyMotion
        Motion of the device.
    stack : ExitStack
        Closes the table in the end.

    Returns
    -------
    Record or None
        None where --ground-truth is not given.

    """
    directory = options.ground_truth
    if directory is None:
        return None
    table = recording_files.Table(
        directory / recording_files.GROUND_TRUTH_NAME, recording_files.QUATERNION_COLUMNS
    )
    stack.callback(table.close)
    recording_files.write_new(directory / recording_files.RIG_NAME, rig_text(motion.rig))
    return table.write


def _boot(
    runner: BusRunner,
    values: Values,
    decoder: FrameDecoder,
) -> None:
    """
    Switch the encoders on, and print where they are, and who else is there.

    Parameters
    ----------
    runner : BusRunner
        Runs the bus.
    values : Values
        Checked parameters, by name.
    decoder : FrameDecoder
        Layouts of the encoders' frames.

    """
    name = command_line.bus_name(values)
    if heard := ', '.join(f'0x{each:X}' for each in runner.listen()):
        print(f'sim_bus: another program sends {heard} on {name}, too: {TWIN}', file=sys.stderr)
    runner.boot()
    print(
        f'sim_bus: {decoder.words} on {name}, zero counts '
        f'{list(values["encoders.zero_count"])}, directions '
        f'{list(values["encoders.direction"])}',
        flush=True,
    )


def _drive_loop(
    drives: SimulatedDrives,
    values: Values,
    stack: ExitStack,
) -> DriveLoop:
    """
    Start the drives on their bus, and print where they are.

    Parameters
    ----------
    drives : SimulatedDrives
        The simulated drives.
    values : Values
        Checked parameters, by name.
    stack : ExitStack
        Closes bus and loop in the end.

    Returns
    -------
    DriveLoop
        The loop that answers on the bus.

    """
    of = 'drives' if values['drives.channel'] else 'can'
    loop = DriveLoop(stack.enter_context(command_line.bus_of(values, of)), drives)
    stack.callback(loop.close)
    print(
        f'sim_bus: {len(drives.drives)} drives on {command_line.bus_name(values, of)}, '
        f'nodes {[drive.node_id for drive in drives.drives]}',
        flush=True,
    )
    return loop


def _run(
    runner: BusRunner,
    drives: SimulatedDrives | None,
    loop: DriveLoop | None,
    seconds: float,
) -> None:
    """
    Run the encoders for some seconds, and print the faults that begin and end.

    Parameters
    ----------
    runner : BusRunner
        Runs the bus of the encoders.
    drives : SimulatedDrives or None
        The simulated drives, if there are any.
    loop : DriveLoop or None
        Their loop, if there are any.
    seconds : float
        Time after which it ends, s; inf: until Ctrl-C.

    Raises
    ------
    InputError
        The bus of the drives failed.

    """
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        lines = runner.step()
        if drives is not None:
            lines += drives.faults.take_news()
        if loop is not None and loop.error is not None:
            raise InputError(f'drives: {loop.error}')
        for line in lines:
            print(f'{time.time():.6f} {line}', flush=True)


def _quirks(
    options: argparse.Namespace,
    sensors: int,
    sync_id: int | None,
) -> tuple[device_quirks.Quirk, ...]:
    """
    Return the quirks of the encoders.

    Parameters
    ----------
    options : argparse.Namespace
        The parsed command line.
    sensors : int
        Number N of sensors.
    sync_id : int or None
        CAN identifier of SYNC; None without it.

    Returns
    -------
    tuple of device_quirks.Quirk
        In the order of the command line.

    Raises
    ------
    InputError
        A quirk is unknown, or has phases of the encoders on a bus with SYNC.

    """
    quirks = tuple(device_quirks.parse_quirk(text, sensors) for text in options.quirk)
    if sync_id is not None and any(quirk.kind == 'phases' for quirk in quirks):
        raise InputError(
            f"quirk 'phases' with encoders.sync_id 0x{sync_id:X}; expected -p encoders.sync_id:=0"
        )
    return quirks


def _drives(
    values: Values,
    options: argparse.Namespace,
    faults: tuple[fault_injection.Fault, ...],
) -> SimulatedDrives | None:
    """
    Return the simulated drives.

    --drives N gives them node ids in a row; without a rated torque they have that of
    `SIMULATED_RATED_TORQUE`.

    Parameters
    ----------
    values : Values
        Checked parameters, by name.
    options : argparse.Namespace
        The parsed command line.
    faults : tuple of fault_injection.Fault
        Faults of the drives.

    Returns
    -------
    SimulatedDrives or None
        None without drives.

    Raises
    ------
    InputError
        There are faults without drives.

    """
    if options.drives is None and not values['drives.channel']:
        if faults:
            raise InputError(
                f"fault '{faults[0].text}' without drives; expected --drives or drives.channel"
            )
        return None
    taken = dict(values)
    node_ids = values['drives.node_id']
    if options.drives is not None and options.drives != len(node_ids):
        taken['drives.node_id'] = tuple(range(node_ids[0], node_ids[0] + options.drives))
    if not any(values['drives.rated_torque']):
        taken['drives.rated_torque'] = (SIMULATED_RATED_TORQUE,)
    check_shared_bus(taken, values)
    return SimulatedDrives(
        plan=make_plan(taken),
        faults=faults,
        factory=options.factory,
    )


def _add_devices(parser: Parser) -> None:
    """Add the options of what is simulated beside healthy encoders."""
    parser.add_argument(
        '--drives',
        type=int,
        choices=(1, 2, 3, 4),
        metavar='N',
        help='simulate N drives, too (rated torque '
        f'{SIMULATED_RATED_TORQUE:g} N m unless it is given)',
    )
    parser.add_argument(
        '--fault',
        action='append',
        default=[],
        metavar='FAULT',
        help=f'{fault_injection.SYNTAX}; may be repeated',
    )
    parser.add_argument(
        '--quirk',
        action='append',
        default=[],
        metavar='QUIRK',
        help=f"what other makers' encoders do, {device_quirks.SYNTAX}; may be repeated",
    )


def _parser() -> Parser:
    """Return the parser of the command line; its epilog lists faults and quirks."""
    parser = Parser('sim_bus', DESCRIPTION)
    parser.add_argument(
        '--sync',
        action='store_true',
        help='send SYNC, too, at `rate` (and answer no other SYNC)',
    )
    parser.add_argument(
        '--heartbeat',
        type=positive,
        default=0.1,
        metavar='S',
        help='time between heartbeats, s (default 0.1)',
    )
    parser.add_argument(
        '--seconds',
        type=positive,
        metavar='S',
        help='end after this time, s (default: run until Ctrl-C)',
    )
    parser.add_argument(
        '--factory',
        action='store_true',
        help="with their maker's defaults, for can_setup",
    )
    parser.add_argument(
        '--ground-truth',
        type=Path,
        metavar='DIRECTORY',
        help='write the true orientation of each cycle to '
        f'{recording_files.GROUND_TRUTH_NAME} there, and the rig to '
        f'{recording_files.RIG_NAME}',
    )
    _add_devices(parser)
    every = fault_injection.KINDS | fault_injection.DRIVE_KINDS
    kinds = '\n'.join(
        f'  {kind:13}{what}' + (f' (=VALUE, {unit})' if unit else '')
        for kind, (what, unit) in every.items()
    )
    quirks = '\n'.join(
        f'  {kind:16}{what}' + (f' (=VALUE, {unit})' if unit else '')
        for kind, (what, unit) in device_quirks.KINDS.items()
    )
    parser.epilog = (
        f'faults:\n{kinds}\nexample: --fault offset:joint_3a@5+2=1.5\n\n'
        f'quirks:\n{quirks}\nexample: --quirk read_only:joint_1a=0x6001'
    )
    return parser
