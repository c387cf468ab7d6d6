# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The drives that checked settings describe."""

from __future__ import annotations

from functools import partial
from math import pi
from typing import Any

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.drives.plan import DrivePlan, Plan
from spm_haptic_master.drives.traffic import check_traffic, encoder_traffic
from spm_haptic_master.encoders.bus_errors import bus_name
from spm_haptic_master.encoders.can_source import check_interface, open_bus
from spm_haptic_master.encoders.decoder_factory import make_layouts
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.setting import Values

# Fewest samples within the event timer of the torque frames.
SAMPLES_WITHIN = 3

# Times that objects have in whole ms.
MILLISECONDS = ('drives.status_period', 'drives.heartbeat', 'drives.heartbeat_timeout',
                'drives.event_timer')


def make_plan(values: Values) -> Plan:
    """
    Return what the drives are configured to be.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Raises
    ------
    SettingError
        Settings contradict each other.

    """
    node_ids = values['drives.node_id']
    count = len(node_ids)
    ids = {*node_ids, values['drives.master_id']}
    if len(ids) <= count:
        raise SettingError('drives.node_id', list(node_ids),
                           f'different node ids, none that of drives.master_id '
                           f'({values["drives.master_id"]})')
    if count > len(JOINT_NAMES):
        raise SettingError('drives.node_id', list(node_ids), f'at most {len(JOINT_NAMES)} drives')
    rated, gears, directions = (_each(values, f'drives.{name}', count)
                                for name in ('rated_torque', 'gear', 'direction'))
    if 0.0 in rated:
        raise SettingError('drives.rated_torque', list(values['drives.rated_torque']),
                           "the motors' rated torque, N m, above 0: torques on the bus are per "
                           'mille of it')
    _check_times(values)
    drives = []
    for joint, node_id, torque, gear, direction in zip(
            JOINT_NAMES, node_ids, rated, gears, directions, strict=False):
        scale = cia402.PER_MILLE * direction / (gear * torque)
        cap = int(abs(scale) * values['drives.torque_limit'])
        if not 1 <= cap <= cia402.LARGEST:
            raise SettingError('drives.torque_limit', values['drives.torque_limit'],
                               f'1 to {cia402.LARGEST} per mille of the rated torque {torque:g} '
                               f'N m for {joint}; it is {cap}')
        drives.append(DrivePlan(
            f'drive of {joint} (node {node_id})', node_id, torque, scale, cap,
            round(values['drives.speed_limit'] * gear * 60.0 / (2.0 * pi))))
    return Plan(
        tuple(drives), values['drives.combined'], values['drives.mode'],
        values['drives.master_id'], values['drives.torque_unit'],
        1.0 / values['rate'], values['drives.status_period'], values['drives.status_timeout'],
        values['drives.heartbeat'], values['drives.heartbeat_timeout'],
        values['drives.event_timer'])


def make_drives(values: Values) -> Drives | None:
    """
    Return the drives of checked settings; None without `drives.channel`.

    Nothing is sent, and the bus is not opened, before the first step.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`.

    Raises
    ------
    SettingError
        Settings contradict each other, python-can has no such interface, or the bus cannot carry
        the frames.

    """
    interface, channel = values['drives.interface'], values['drives.channel']
    if not channel:
        return None
    check_interface(interface, 'drives.interface')
    plan = make_plan(values)
    bitrate = values['drives.bitrate']
    check_traffic(plan, bitrate)
    return Drives(plan, partial(open_bus, interface, channel, bitrate),
                  bus_name(interface, channel))


def is_shared(drives: Values, encoders: Values) -> bool:
    """Return whether the drives are on the bus of the encoders, by checked values of both."""
    return bool(drives['drives.channel']) and all(
        drives[f'drives.{name}'] == encoders[f'can.{name}'] for name in ('interface', 'channel'))


def check_shared_bus(drives: Values, encoders: Values) -> None:
    """
    Refuse drives that do not fit on the bus of the encoders; nothing where it is another bus.

    Parameters
    ----------
    drives : Values
        Checked values of DRIVE_SETTINGS, and `rate`.
    encoders : Values
        Checked values of the source `can`.

    Raises
    ------
    SettingError
        Two nodes or frames have one number, or the bus cannot carry all frames.

    """
    if not is_shared(drives, encoders):
        return
    plan = make_plan(drives)
    node_ids = [*drives['drives.node_id'], plan.master_id]
    taken = set(encoders['encoders.node_id']) & set(node_ids)
    if taken and encoders['can.protocol'] == 'canopen':
        raise SettingError('drives.node_id', node_ids[:-1], 'node ids that no encoder has '
                           f'({min(taken)} is in encoders.node_id), nor drives.master_id')
    frames = {plan.status_id(drive) for drive in plan.drives} \
        | {plan.control_id(drive) for drive in plan.drives} | {plan.combined_id}
    layouts = make_layouts(encoders)
    for layout in layouts:
        if not layout.extended and layout.can_id in frames:
            raise SettingError('encoders.id', list(encoders['encoders.id']),
                               f'identifiers that no drive uses (0x{layout.can_id:X} of '
                               f'{layout.joint} is one of drives.node_id)')
    check_traffic(plan, drives['drives.bitrate'] or encoders['can.bitrate'],
                  encoder_traffic(layouts, bool(encoders['encoders.sync_id']), encoders['rate']))


def _each(values: Values, name: str, count: int) -> tuple[Any, ...]:
    """Return a value for each drive; SettingError where there is another number of them."""
    found: tuple[Any, ...] = values[name]
    if len(found) == 1:
        return found * count
    if len(found) != count:
        raise SettingError(name, list(found), f'one value, or {count} (drives.node_id)')
    return found


def _check_times(values: Values) -> None:
    for name in MILLISECONDS:
        value = 1e3 * values[name]
        if abs(value - round(value)) > 1e-6:
            raise SettingError(name, values[name], 'whole milliseconds')
    period, timer = 1.0 / values['rate'], values['drives.event_timer']
    for name, shortest, why in (
            ('drives.event_timer', SAMPLES_WITHIN * period if timer else 0.0,
             f'{SAMPLES_WITHIN} samples at rate {values["rate"]:g} Hz'),
            ('drives.status_timeout', 2.0 * values['drives.status_period'],
             'two of drives.status_period'),
            ('drives.heartbeat_timeout', 2.0 * values['drives.heartbeat'],
             'two of drives.heartbeat')):
        if values[name] < shortest - 1e-9:
            raise SettingError(name, values[name], f'at least {shortest:g} s: {why}')
