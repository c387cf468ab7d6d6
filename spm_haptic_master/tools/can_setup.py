# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Sets CANopen encoders and drives up as they are configured: PDOs, heartbeat, scaling."""

from __future__ import annotations

import argparse
from typing import Any

from spm_haptic_master.drives.drive_objects import drive_objects
from spm_haptic_master.drives.plan import make_plan
from spm_haptic_master.drives.shared_bus import check_shared_bus
from spm_haptic_master.encoders import (
    canopen,
    canopen_network,
    eds_file,
    encoder_objects,
    node_setup,
)
from spm_haptic_master.encoders.decoder_factory import make_decoder
from spm_haptic_master.exceptions import InputError, SettingError, SetupError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.parameters.arguments import Parser, positive
from spm_haptic_master.parameters.axes import AXES, INSERTION
from spm_haptic_master.parameters.nodes import DRIVE_NAMES, DRIVE_SETTINGS, DRIVER_NAMES
from spm_haptic_master.parameters.resolver import DRIVER
from spm_haptic_master.parameters.setting import RATE_SETTING, Values
from spm_haptic_master.tools import command_line

DESCRIPTION = """\
Compares the objects of the encoders with the driver's parameters by SDO: identifier, transmission
type and mapping of the TPDO, heartbeat, scaling. With --write it writes what differs, stores it
(0x1010), resets the encoder and reads everything back. Without --write nothing is changed.
With --drives it does so for the drives of the motors, on the bus drives.channel: PDOs, heartbeats,
event timer, abort and fault options, limits.
Exit code 0 if the encoders are as configured, 1 if not."""
# Time to listen for SYNC before something is written (s): two periods of 10 Hz.
LISTEN = 0.2

# Outcomes of one node.
FAILED = 'failed'
DIFFERENT = 'differs'
AS_WANTED = 'good'
STORED = 'stored'
NOT_STORED = 'not stored'
# What is said where the encoders send without SYNC.
PHASES = (
    'encoders.sync_id is 0: encoders that send without SYNC do so at phases of their own, which '
    'change with each power-up; where they are more than half a period apart there is no set. '
    'SYNC is needed: encoders.sync_id: 0x80'
)

# Joint, node id and wanted objects of each node.
Nodes = list[tuple[str, int, node_setup.WantedObjects]]
# The settings of the bus, the nodes, and the kind and identifier of a master's frames, if known.
Plan = tuple[dict[str, Any], Nodes, tuple[str, int] | None]


@command_line.program('can_setup')
def main(args: list[str]) -> int:
    """
    Compare the encoders or drives with the configuration, and set them up on request.

    Without --write it reads and compares only. With --write it writes what differs, stores it,
    resets the node and reads everything back; it refuses while a master is running. With --eds the
    file is looked at first, and nothing is sent if it shows that a value is impossible.

    Parameters
    ----------
    args : list of str
        Command line without the name of the program.

    Returns
    -------
    int
        Exit code: 0 if all nodes are as configured, 1 if not. After an error, which is one line on
        stderr, it is 1.

    """
    options = _parser().parse(args)
    given = command_line.given(options, (DRIVER, 'fkm'), DRIVER_NAMES | DRIVE_NAMES)
    of, plan = ('drives', _drives) if options.drives else ('can', _encoders)
    values, nodes, master = plan(given, options)
    canopen_network.import_canopen()
    if options.eds is not None:
        nodes = _described(nodes, options.eds)
    with command_line.bus_of(values, of) as bus, canopen_network.network_on(bus) as network:
        if options.write and master is not None:
            kind, identifier = master
            with canopen_network.awaited(network, identifier) as heard:
                running = heard.wait(LISTEN)
            if running:
                raise SetupError(
                    f'{kind} 0x{identifier:X} on the bus: a master is running; stop '
                    'it before anything is written'
                )
        return _set_up(network, command_line.bus_name(values, of), nodes, options)


def _described(nodes: Nodes, path: str) -> Nodes:
    """
    Print what an EDS file says of the wanted objects.

    Parameters
    ----------
    nodes : Nodes
        Nodes to set up.
    path : str
        The EDS file.

    Returns
    -------
    Nodes
        The nodes, with the sizes and types of the device's objects.

    Raises
    ------
    SetupError
        The device cannot be set so: nothing has been sent then.

    """
    described = []
    impossible = []
    for joint, node_id, wanted in nodes:
        device = eds_file.DeviceDescription(path, node_id)
        print(f'{joint}, node {node_id}: {device.name}, by {path}:')
        print('\n'.join(f'  {line}' for line in device.lines(wanted)), flush=True)
        impossible += [f'{joint}: {line}' for line in device.impossible(wanted)]
        described.append((joint, node_id, device.typed(wanted)))
    if impossible:
        print('\n'.join(impossible))
        raise SetupError(
            f'{path}: {len(impossible)} objects cannot have the wanted value; nothing was sent'
        )
    return described


def _encoders(given: Values, options: argparse.Namespace) -> Plan:
    """
    Return how the encoders are to be set up, axes included.

    Parameters
    ----------
    given : Values
        Given parameters, by name.
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    Plan
        Checked parameters, nodes with their wanted objects, and the identifier of SYNC, if any.

    Raises
    ------
    SettingError
        The encoders are no CANopen nodes.

    """
    values = command_line.bus_values(given)
    decoder = make_decoder(values)
    if decoder.network is None:
        raise SettingError(
            name='can.protocol',
            value=values['can.protocol'],
            expected="'canopen': other encoders have no objects",
        )
    encoders = list(zip(decoder.layouts, values['encoders.node_id'], strict=True))
    encoders += [(axis.layout, axis.node.node_id) for axis in decoder.axes if axis.node]
    nodes = [
        (
            layout.joint,
            node_id,
            encoder_objects.wanted_objects(
                layout,
                node_id,
                decoder.sync_id,
                1.0 / values['rate'],
                options.heartbeat,
                layout.joint == INSERTION,
            ),
        )
        for layout, node_id in encoders
    ]
    if decoder.sync_id is None:
        print(PHASES)
    if decoder.sync_id is None:
        master = None
    else:
        master = ('SYNC', decoder.sync_id)
    return values, _chosen(nodes, options.joint, values['sensors']), master


def _chosen(
    nodes: Nodes,
    joints: list[str] | None,
    sensors: int,
) -> Nodes:
    """
    Return the nodes of the joints on the command line.

    Parameters
    ----------
    nodes : Nodes
        All nodes.
    joints : list of str or None
        Names of joints; None for all.
    sensors : int
        Number N of sensors.

    Returns
    -------
    Nodes
        Those to set up.

    Raises
    ------
    InputError
        There is no node of a joint.

    """
    known = [joint for joint, _, _ in nodes]
    for joint in joints or ():
        if joint not in known:
            raise InputError(
                f'joint {joint}; expected one of {", ".join(known)} (sensors: {sensors})'
            )
    return [node for node in nodes if node[0] in (joints or known)]


def _drives(given: Values, options: argparse.Namespace) -> Plan:
    """
    Return how the drives are to be set up.

    Parameters
    ----------
    given : Values
        Given parameters, by name.
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    Plan
        Checked parameters, nodes with their wanted objects, and the identifier of the master's
        heartbeat.

    Raises
    ------
    SettingError
        No channel of the drives is given.
    InputError
        There is no drive of the given joint.

    """
    values = command_line.checked(given, (*DRIVE_SETTINGS, RATE_SETTING))
    if not values['drives.channel']:
        raise SettingError(
            name='drives.channel',
            value='',
            expected="the channel of the drives' bus",
        )
    plan = make_plan(values)
    check_shared_bus(values, command_line.bus_values(given))
    nodes = [
        (joint, drive.node_id, drive_objects(plan, drive))
        for joint, drive in zip(JOINT_NAMES, plan.drives, strict=False)
        if joint in (options.joint or JOINT_NAMES)
    ]
    if not nodes:
        raise InputError(
            f'--joint {options.joint[0]} with --drives; expected one of '
            + ', '.join(JOINT_NAMES[: len(plan.drives)])
        )
    return values, nodes, ('heartbeat', canopen.HEARTBEAT_BASE + plan.master_id)


def _set_up(
    network: Any,
    bus: str,
    nodes: Nodes,
    options: argparse.Namespace,
) -> int:
    """
    Set nodes up one after the other, and print the outcome.

    A node that fails does not keep the others from being set up.

    Parameters
    ----------
    network : object
        The open CANopen network.
    bus : str
        Its name.
    nodes : Nodes
        Nodes to set up.
    options : argparse.Namespace
        The parsed command line.

    Returns
    -------
    int
        Exit code: 1 if a node failed or differs.

    """
    kind, profile = (
        ('drives', canopen.DRIVE_PROFILE)
        if options.drives
        else ('encoders', canopen.ENCODER_PROFILE)
    )
    outcomes = []
    for joint, node_id, objects in nodes:
        try:
            node = canopen_network.NodeClient(network, node_id)
            outcomes.append(_set_up_one(joint, node, objects, options.write, profile))
        except SetupError as error:
            outcomes.append(FAILED)
            print(f'{joint}: {error}', flush=True)
    total = len(nodes)
    if failed := outcomes.count(FAILED):
        print(f'{bus}: {failed} of {total} {kind} not set up')
        return 1
    if different := outcomes.count(DIFFERENT):
        print(
            f'{bus}: {different} of {total} {kind} not as configured; nothing was '
            'written (--write)'
        )
        return 1
    stored = outcomes.count(STORED)
    if stored == total:
        ending = ', stored and read back after a reset'
    elif options.write:
        ending = f', {stored} of them stored and read back after a reset'
    else:
        ending = ''
    print(f'{bus}: {total} of {total} {kind} as configured{ending}')
    return 0


def _set_up_one(
    joint: str,
    node: canopen_network.NodeClient,
    wanted: node_setup.WantedObjects,
    writes: bool,
    profile: int,
) -> str:
    """
    Print and, on request, write what differs of a node.

    Parameters
    ----------
    joint : str
        Its joint.
    node : canopen_network.NodeClient
        The node.
    wanted : node_setup.WantedObjects
        Objects and PDOs that it is to have.
    writes : bool
        Whether to write.
    profile : int
        Device profile that it is to have.

    Returns
    -------
    str
        `differs`, `good`, `stored` or `not stored`.

    Raises
    ------
    SetupError
        The node does not answer, is not alone, or refuses a value.

    """
    node.check_alone()
    print(f'{joint}, node {node.node_id}: {node_setup.identity(node, profile)}', flush=True)
    if not all(pdo.mapping for pdo in wanted.pdos):
        print('  the mapping cannot be derived from this layout: left as it is')
    found = node_setup.compare(node, wanted)
    for line in (*found.hinted, *found.remarks):
        print(f'  {line}')
    if writes:
        outcome = _write(node, found)
    else:
        outcome = DIFFERENT if found.different else AS_WANTED
    different = len(found.different)
    has = sum(found.values[each.key] is not None for each in found.wanted.every)
    missing = sum(value is None for value in found.different.values())
    written = f'; {different} written' if writes and different else ''
    print(f'  {has - different + missing} of {has} objects as configured{written}', flush=True)
    return outcome


def _write(node: canopen_network.NodeClient, found: node_setup.Comparison) -> str:
    """
    Write what differs, and store.

    Parameters
    ----------
    node : canopen_network.NodeClient
        The node.
    found : node_setup.Comparison
        What differs.

    Returns
    -------
    str
        `stored`, or `not stored` if nothing differs and the node cannot store.

    """
    if not found.different and not node.can_store():
        print('  not stored by this run: it cannot store (0x1010:01)')
        return NOT_STORED
    node_setup.write(node, found)
    return STORED


def _parser() -> Parser:
    """Return the parser of the command line."""
    parser = Parser('can_setup', DESCRIPTION)
    parser.add_argument(
        '--write',
        action='store_true',
        help='write, store and verify; without it nothing is changed',
    )
    parser.add_argument(
        '--drives',
        action='store_true',
        help='the drives of drives.* in place of the encoders',
    )
    parser.add_argument(
        '--eds',
        metavar='FILE',
        help="the maker's EDS of these devices: says before anything is sent what they can be set "
        'to, and gives types and access of their objects',
    )
    parser.add_argument(
        '--joint',
        action='append',
        choices=(*ALL_JOINT_NAMES, *AXES),
        metavar='JOINT',
        help='set up the node of this joint; may be repeated (default: all)',
    )
    parser.add_argument(
        '--heartbeat',
        type=positive,
        default=0.1,
        metavar='S',
        help='time between heartbeats, s (default 0.1)',
    )
    return parser
