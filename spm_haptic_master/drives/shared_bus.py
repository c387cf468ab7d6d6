# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Whether the drives fit on their bus, and on that of the encoders: SYNC, identifiers, load."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from spm_haptic_master.drives.plan import (
    BY_ENCODER_SYNC,
    BY_OWN_SYNC,
    make_plan,
    Plan,
    STATUS,
    torque_frames,
)
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.decoder_factory import cycle_bits, frame_bits, make_layouts
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.parameters.axes import AXES
from spm_haptic_master.parameters.setting import Values

# Largest share of a bus with drives (unit 1): torque frames wait for all that has a smaller
# identifier, and emergencies and SDO come beside them.
MAXIMUM_LOAD = 0.7


class Load(NamedTuple):
    """Frames of one kind on a bus."""

    name: str
    bits: int  # of one cycle
    rate: float  # cycles, Hz


def is_shared(drives: Values, encoders: Values) -> bool:
    """
    Return whether the drives are on the bus of the encoders.

    Parameters
    ----------
    drives, encoders : Values
        Checked values of the settings of both.

    """
    return bool(drives['drives.channel']) and all(
        drives[f'drives.{name}'] == encoders[f'can.{name}'] for name in ('interface', 'channel')
    )


def check_shared_bus(drives: Values, encoders: Values) -> None:
    """
    Refuse drives that do not fit on the bus of the encoders, if they share it.

    Parameters
    ----------
    drives, encoders : Values
        Checked values of the settings of both.

    Raises
    ------
    SettingError
        Two sources of SYNC or none, a node id or an identifier that both have, or too much load.

    """
    _check_sync(drives, encoders)
    if not is_shared(drives, encoders):
        return
    plan = make_plan(drives)
    layouts = make_layouts(encoders)
    _check_node_ids(drives, encoders)
    _check_identifiers(plan, layouts, encoders)
    bitrate = drives['drives.bitrate'] or encoders['can.bitrate']
    check_load(plan, bitrate, _encoder_loads(encoders, layouts))


def _encoder_loads(encoders: Values, layouts: tuple[EncoderLayout, ...]) -> list[Load]:
    """Return the frames of a cycle of the encoders, insertion and gripper among them."""
    rate = encoders['rate']
    has_sync = bool(encoders['encoders.sync_id'])
    name = 'SYNC and encoders' if has_sync else 'encoders'
    loads = [Load(name, cycle_bits(layouts, has_sync), rate)]
    for axis in AXES:
        if encoders[f'{axis}.id']:
            bits = frame_bits(encoders[f'{axis}.data_length'], encoders[f'{axis}.extended'])
            loads.append(Load(axis, bits, rate))
    return loads


def _check_sync(drives: Values, encoders: Values) -> None:
    """Refuse two sources of SYNC on one bus, or none: SettingError."""
    source = drives['drives.status_by']
    sync_id = encoders['encoders.sync_id']
    if not is_shared(drives, encoders):
        if source == BY_ENCODER_SYNC:
            raise SettingError('drives.status_by', source, 'drives on the bus of the encoders')
        return
    if source == BY_OWN_SYNC and sync_id:
        raise SettingError(
            'drives.status_by', source, f"'{BY_ENCODER_SYNC}' on a bus that has SYNC already"
        )
    if source == BY_ENCODER_SYNC and sync_id != canopen.SYNC_ID:
        raise SettingError('encoders.sync_id', sync_id, 'the SYNC that the drives know (0x80)')


def _check_node_ids(drives: Values, encoders: Values) -> None:
    """Refuse a node id of a drive, or of this master, that an encoder has: SettingError."""
    node_ids = {*drives['drives.node_id'], drives['drives.master_id']}
    nodes = {f'{axis}.node_id': (encoders[f'{axis}.node_id'],) for axis in AXES}
    if encoders['can.protocol'] == 'canopen':
        nodes['encoders.node_id'] = encoders['encoders.node_id']
    for setting, others in nodes.items():
        taken = node_ids.intersection(others)
        if taken:
            raise SettingError(
                'drives.node_id',
                list(drives['drives.node_id']),
                f'node ids that no encoder has ({min(taken)} is in {setting}), nor '
                'drives.master_id',
            )


def _check_identifiers(
    plan: Plan,
    layouts: tuple[EncoderLayout, ...],
    encoders: Values,
) -> None:
    """Refuse an identifier of an encoder that drives or this master use: SettingError."""
    used = _identifiers(plan)
    for layout in layouts:
        if not layout.extended and layout.can_id in used:
            raise SettingError(
                'encoders.id',
                list(encoders['encoders.id']),
                f'identifiers that no drive uses, nor this master (0x{layout.can_id:X} of '
                f'{layout.joint} is one of them)',
            )
    for axis in AXES:
        identifier = encoders[f'{axis}.id']
        if not encoders[f'{axis}.extended'] and identifier in used:
            raise SettingError(
                f'{axis}.id',
                identifier,
                f'an identifier that no drive uses, nor this master (0x{identifier:X})',
            )


def _identifiers(plan: Plan) -> set[int]:
    """
    Return the identifiers of all frames that drives send or take, and of this master's.

    All RPDOs are among them: the data of a foreign frame would be a command.
    """
    bases = (
        canopen.EMCY_BASE,
        canopen.TPDO_BASES[0],
        *canopen.RPDO_BASES,
        canopen.SDO_ANSWER_BASE,
        canopen.SDO_REQUEST_BASE,
        canopen.HEARTBEAT_BASE,
    )
    used = {base + drive.node_id for base in bases for drive in plan.drives}
    used.add(canopen.HEARTBEAT_BASE + plan.master_id)
    if plan.sends_sync:
        used.add(canopen.SYNC_ID)
    return used


def check_load(
    plan: Plan,
    bitrate: int,
    encoders: Sequence[Load] = (),
) -> None:
    """
    Refuse a bus that cannot carry the worst case of the drives' frames.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    bitrate : int
        Bit rate, bit/s; nothing is checked at 0.
    encoders : sequence of Load
        Frames of encoders on the same bus.

    Raises
    ------
    SettingError
        The load is beyond MAXIMUM_LOAD; the text has the arithmetic.

    """
    if not bitrate:
        return
    loads = [*encoders, *_drive_loads(plan)]
    share = sum(load.bits * load.rate for load in loads) / bitrate
    if share <= MAXIMUM_LOAD:
        return
    remedies = ['a lower rate']
    if not plan.combined:
        remedies.insert(0, 'one frame with all torques (drives.combined)')
    if encoders:
        remedies.insert(0, 'a second bus (drives.channel)')
    shown = ' + '.join(f'{load.name} {load.bits} bits x {load.rate:g} Hz' for load in loads)
    raise SettingError(
        'drives.bitrate',
        bitrate,
        f'{" or ".join(remedies)}: {shown} = {100.0 * share:.0f} % '
        f'bus load, beyond {100.0 * MAXIMUM_LOAD:.0f} %',
    )


def _drive_loads(plan: Plan) -> list[Load]:
    """Return the frames of the drives and of this master."""
    count = len(plan.drives)
    torques = torque_frames(
        plan=plan,
        controlwords=[0] * count,
        torques=[0] * count,
        controls=False,
    )
    torque_bits = sum(frame_bits(len(data), False) for _, data in torques)
    heartbeat_bits = (count + 1) * frame_bits(canopen.HEARTBEAT_LENGTH, False)
    loads = [
        Load('torque', torque_bits, 1.0 / plan.period),
        Load('status', count * frame_bits(STATUS.size, False), 1.0 / plan.status_period),
        Load('heartbeats', heartbeat_bits, 1.0 / plan.heartbeat),
    ]
    if plan.sends_sync:
        loads.append(Load('SYNC', frame_bits(0, False), 1.0 / plan.status_period))
    if plan.combined:
        loads.append(Load('controlwords', count * frame_bits(2, False), 1.0 / plan.heartbeat))
    return loads
