# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Settings of the drives, and the drives made from them."""

from __future__ import annotations

from functools import partial
from math import pi
from typing import Any

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.drives import Drives
from spm_haptic_master.drives.plan import DrivePlan, Plan
from spm_haptic_master.drives.traffic import check_traffic, encoder_traffic
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.bus_errors import bus_name
from spm_haptic_master.encoders.can_source import check_interface, open_bus
from spm_haptic_master.encoders.decoder_factory import make_layouts
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.parameters.setting import ANY_COUNT, Setting, Values

# Values of a list for several drives.
EACH = 'one value for all drives, or one for each'
# Fewest samples within the event timer of the torque frames.
SAMPLES_WITHIN = 3

DRIVE_SETTINGS = (
    Setting('drives.interface', str, 'python-can interface of the drives', default='socketcan'),
    Setting('drives.channel', str, "channel of that interface, such as 'can1'; that of the "
            'encoders for one bus; empty: no drives', default='', blank=True),
    Setting('drives.bitrate', int, 'bit rate of the bus, bit/s, to set it (if the interface can) '
            'and to check the bus load; 0: unknown', default=0, minimum=0, maximum=1000000),
    Setting('drives.node_id', int, 'CANopen node ids of the drives of th1A, th1B, th1C and, with '
            'four motors, th3A', default=(11, 12, 13), minimum=1,
            maximum=canopen.NODE_ID_MAXIMUM, count=ANY_COUNT),
    Setting('drives.master_id', int, 'node id of this master in its heartbeat', default=126,
            minimum=1, maximum=canopen.NODE_ID_MAXIMUM),
    Setting('drives.combined', bool, 'one frame with all torques, and the controlwords apart: '
            'for a bus with the encoders', default=False),
    Setting('drives.mode', int, 'mode of operation 6060h: 10 cyclic synchronous torque, 4 profile '
            'torque; 0: 10, or 4 where it is missing', default=0,
            allowed=(0, cia402.CYCLIC_TORQUE, cia402.PROFILE_TORQUE)),
    Setting('drives.rated_torque', float, f'rated torque of the motor, N m: torques on the bus '
            f'are per mille of it; {EACH}; has to be given with drives.channel', default=(0.0,),
            minimum=0.0, maximum=100.0, count=ANY_COUNT),
    Setting('drives.torque_unit', float, 'unit of 6076h, rated torque, N m: 0.001 by CiA 402, '
            '0.000001 of drives that have uN m; 0: the drives have no such object, or it is no '
            'torque; drives.rated_torque is not compared then', default=1e-3,
            minimum=0.0, maximum=1.0),
    Setting('drives.gear', float, f'turns of the motor for one of the joint; {EACH}',
            default=(1.0,), minimum=0.01, maximum=1000.0, count=ANY_COUNT),
    Setting('drives.direction', int, 'sign of the torque of a motor against that of the joint; '
            f'{EACH}', default=(1,), allowed=(1, -1), count=ANY_COUNT),
    Setting('drives.torque_limit', float, 'largest torque at a joint, N m: commands are limited '
            'to it, and 6072h of the drives is', default=0.5, minimum=0.001, maximum=100.0),
    Setting('drives.speed_limit', float, 'largest speed of a joint, rad/s, for 6080h in 1/min of '
            'the motor; 0: 6080h is left', default=0.0, minimum=0.0, maximum=1000.0),
    Setting('drives.status_period', float, 'time between two status frames of a drive, s, whole '
            'ms', default=0.004, minimum=0.001, maximum=0.1),
    Setting('drives.status_timeout', float, 'time without a status frame that is a fault, s',
            default=0.02, minimum=0.002, maximum=1.0),
    Setting('drives.heartbeat', float, 'time between two heartbeats, of the drives and of this '
            'master, s, whole ms', default=0.02, minimum=0.001, maximum=1.0),
    Setting('drives.heartbeat_timeout', float, 'time without a heartbeat after which a drive '
            'disables its motor, and which is a fault here, s, whole ms', default=0.06,
            minimum=0.002, maximum=1.0),
    Setting('drives.event_timer', float, 'time without a torque frame after which a drive '
            'disables its motor (1400h:05), s, whole ms; 0: the drives have no such timer, the '
            'heartbeat has to do', default=0.01, minimum=0.0, maximum=1.0),
)

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
