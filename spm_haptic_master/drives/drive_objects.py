# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Required objects of a drive, for can_setup and for the check at the start."""

from __future__ import annotations

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.plan import DrivePlan, Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.node_setup import (
    other_tpdos_off,
    wanted_pdo,
    WantedObject,
    WantedObjects,
    WantedPdo,
)

# Transmission type of a PDO that is used at once, or sent by its timer (CiA 301).
AT_ONCE = 255
# Index of a data type in a mapping: so many bits of a frame that a drive leaves out.
INTEGER16 = 0x0003
# Value of the error behaviour: the loss of a heartbeat leaves the NMT state, so that the status
# frames continue.
KEEP_STATE = 1
# Exponent of a time in ms, as an INTEGER8.
MILLI = 0xFD


def drive_objects(plan: Plan, drive: DrivePlan) -> WantedObjects:
    """Return the required objects of a drive."""
    control, torque, status, shown, mode = (
        (index << 16 | subindex << 8 | bits)
        for (index, subindex), bits in (
            (cia402.CONTROLWORD, 16),
            (cia402.TARGET_TORQUE, 16),
            (cia402.STATUSWORD, 16),
            (cia402.TORQUE_ACTUAL, 16),
            (cia402.MODE_DISPLAY, 8),
        )
    )
    # Times in ms: the settings have only whole ones.
    timer, status_period, heartbeat, heartbeat_timeout = (
        round(1e3 * seconds)
        for seconds in (
            plan.event_timer,
            plan.status_period,
            plan.heartbeat,
            plan.heartbeat_timeout,
        )
    )
    rpdo, tpdo = canopen.RPDO_PARAMETERS, canopen.TPDO_PARAMETERS
    if plan.combined:
        mapped = [torque if each is drive else INTEGER16 << 16 | 16 for each in plan.drives]
        received = [
            _pdo(rpdo, 'RPDO1', drive.control_id, [control]),
            _pdo(rpdo + 1, 'RPDO2', plan.combined_id, mapped, timer),
        ]
    else:
        received = [_pdo(rpdo, 'RPDO1', drive.control_id, [control, torque], timer)]
    # The unit of an inhibit time is 100 us.
    sent = _pdo(
        tpdo, 'TPDO1', drive.status_id, [status, shown, mode], status_period, 10 * status_period
    )
    others = [
        *other_tpdos_off(0),
        WantedObject(
            *cia402.HEARTBEAT_CONSUMER,
            4,
            "master's heartbeat",
            plan.master_id << 16 | heartbeat_timeout,
            hexadecimal=True,
        ),
        WantedObject(*canopen.HEARTBEAT_TIME, 2, 'heartbeat time, ms', heartbeat),
        WantedObject(*cia402.ERROR_BEHAVIOUR, 1, 'error behaviour', KEEP_STATE, optional=True),
        WantedObject(
            *cia402.ABORT_OPTION, 2, 'abort connection option', cia402.DISABLE_VOLTAGE_ON_ABORT
        ),
        WantedObject(*cia402.QUICK_STOP_OPTION, 2, 'quick stop option', cia402.FREE),
        WantedObject(*cia402.FAULT_OPTION, 2, 'fault reaction option', cia402.FREE),
        WantedObject(*cia402.MAXIMUM_TORQUE, 2, 'maximum torque, per mille', drive.cap),
    ]
    if plan.torque_unit:
        others.append(
            WantedObject(
                *cia402.RATED_TORQUE,
                4,
                'rated torque',
                round(drive.rated_torque / plan.torque_unit),
                of_device=True,
            )
        )
    if drive.speed_limit:
        others.append(
            WantedObject(
                *cia402.MAXIMUM_MOTOR_SPEED, 4, 'maximum motor speed, 1/min', drive.speed_limit
            )
        )
    # A drive need not have the period of the torques; it is written in whole ms only.
    period = round(1e3 * plan.period)
    if 1 <= period <= 0xFF and abs(1e3 * plan.period - period) <= 1e-6:
        others += [
            WantedObject(*cia402.PERIOD_VALUE, 1, 'period of the torques', period, optional=True),
            WantedObject(*cia402.PERIOD_EXPONENT, 1, 'its power of ten', MILLI, optional=True),
        ]
    return WantedObjects((*received, sent), tuple(others))


def _pdo(
    index: int, name: str, identifier: int, entries: list[int], timer: int = 0, inhibit: int = 0
) -> WantedPdo:
    """Return a PDO that is used at once, with event timer, ms, and inhibit time, 100 us."""
    return wanted_pdo(
        index,
        name,
        identifier,
        AT_ONCE,
        [
            WantedObject(index, subindex, 2, f'{name} {words}', value)
            for subindex, words, value in (
                (canopen.TPDO_INHIBIT_TIME, 'inhibit time', inhibit),
                (canopen.TPDO_EVENT_TIMER, 'event timer, ms', timer),
            )
            if value
        ],
        entries,
    )
