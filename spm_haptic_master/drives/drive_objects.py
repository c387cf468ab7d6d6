# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the objects of a drive have to be, for can_setup and for the check at the start."""

from __future__ import annotations

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.plan import DrivePlan, Plan
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.node_setup import WantedObject, WantedObjects, WantedPdo

# Transmission type of a PDO that is used at once, or sent by its timer (CiA 301).
AT_ONCE = 255
# Index of a data type in a mapping: so many bits of a frame that a drive leaves out.
INTEGER16 = 0x0003
# Value of the error behaviour: the loss of a heartbeat leaves the NMT state, so that the status
# frames go on.
KEEP_STATE = 1
# Exponent of a time in ms, as an INTEGER8.
MILLI = 0xFD


def drive_objects(plan: Plan, drive: DrivePlan) -> WantedObjects:
    """Return what the objects of a drive have to be."""
    control, torque = _entry(cia402.CONTROLWORD, 16), _entry(cia402.TARGET_TORQUE, 16)
    rpdo, timer = canopen.RPDO_PARAMETERS, plan.event_timer
    if plan.combined:
        mapped = [torque if each is drive else INTEGER16 << 16 | 16 for each in plan.drives]
        received = [_pdo(rpdo, 'RPDO1', drive.control_id, [control]),
                    _pdo(rpdo + 1, 'RPDO2', plan.combined_id, mapped, timer)]
    else:
        received = [_pdo(rpdo, 'RPDO1', drive.control_id, [control, torque], timer)]
    status = _pdo(canopen.TPDO_PARAMETERS, 'TPDO1', drive.status_id, [
        _entry(cia402.STATUSWORD, 16), _entry(cia402.TORQUE_ACTUAL, 16),
        _entry(cia402.MODE_DISPLAY, 8)], plan.status_period, inhibit=True)
    return WantedObjects((*received, status), (
        *(WantedObject(canopen.TPDO_PARAMETERS + number, canopen.TPDO_IDENTIFIER, 4,
                       f'TPDO{number + 1} off', canopen.TPDO_OFF, canopen.TPDO_OFF,
                       optional=True, hexadecimal=True) for number in (1, 2, 3)),
        WantedObject(*canopen.HEARTBEAT_CONSUMER, 4, "master's heartbeat",
                     plan.master_id << 16 | _milliseconds(plan.heartbeat_timeout),
                     hexadecimal=True),
        WantedObject(*canopen.HEARTBEAT_TIME, 2, 'heartbeat time, ms',
                     _milliseconds(plan.heartbeat)),
        WantedObject(*canopen.ERROR_BEHAVIOUR, 1, 'error behaviour', KEEP_STATE, optional=True),
        WantedObject(*cia402.ABORT_OPTION, 2, 'abort connection option',
                     cia402.DISABLE_VOLTAGE_ON_ABORT),
        WantedObject(*cia402.QUICK_STOP_OPTION, 2, 'quick stop option', cia402.FREE),
        WantedObject(*cia402.FAULT_OPTION, 2, 'fault reaction option', cia402.FREE),
        WantedObject(*cia402.MAXIMUM_TORQUE, 2, 'maximum torque, per mille', drive.cap),
        *([WantedObject(*cia402.RATED_TORQUE, 4, 'rated torque',
                        round(drive.rated_torque / plan.torque_unit), of_device=True)]
          if plan.torque_unit else ()),
        *([WantedObject(*cia402.MAXIMUM_MOTOR_SPEED, 4, 'maximum motor speed, 1/min',
                        drive.speed_limit)] if drive.speed_limit else ()),
        *_period(plan.period)))


def _milliseconds(seconds: float) -> int:
    """Return a time in ms; the settings have only whole ones."""
    return round(1e3 * seconds)


def _entry(key: tuple[int, int], bits: int) -> int:
    """Return the entry of a mapping for an object, whose subindex is 0."""
    return key[0] << 16 | bits


def _pdo(index: int, name: str, identifier: int, entries: list[int], timer: float = 0.0,
         inhibit: bool = False) -> WantedPdo:
    """
    Return a PDO, used at once, by the index of its parameters.

    `timer` is its event timer, s; 0: none. `inhibit`: it is the inhibit time as well.
    """
    mapping = index - canopen.RPDO_PARAMETERS + canopen.RPDO_MAPPING
    time = _milliseconds(timer)
    # The unit of an inhibit time is 100 us.
    times = ((canopen.TPDO_INHIBIT_TIME, 'inhibit time', 10 * time if inhibit else 0),
             (canopen.TPDO_EVENT_TIMER, 'event timer, ms', time))
    return WantedPdo(
        WantedObject(index, canopen.TPDO_IDENTIFIER, 4, f'{name} identifier', identifier,
                     canopen.TPDO_OFF | canopen.TPDO_EXTENDED | canopen.TPDO_ID_MASK,
                     hexadecimal=True),
        (WantedObject(index, canopen.TPDO_TYPE, 1, f'{name} transmission type', AT_ONCE),
         *(WantedObject(index, subindex, 2, f'{name} {words}', value)
           for subindex, words, value in times if value)),
        (WantedObject(mapping, 0, 1, f'{name} mapped objects', len(entries)),
         *(WantedObject(mapping, number, 4, f'{name} mapping', entry, hexadecimal=True)
           for number, entry in enumerate(entries, start=1))))


def _period(period: float) -> tuple[WantedObject, ...]:
    """Return the period of the torques, which a drive need not have; left if not in whole ms."""
    value = _milliseconds(period)
    if not 1 <= value <= 0xFF or abs(1e3 * period - value) > 1e-6:
        return ()
    return (WantedObject(*cia402.PERIOD_VALUE, 1, 'period of the torques', value, optional=True),
            WantedObject(*cia402.PERIOD_EXPONENT, 1, 'its power of ten', MILLI, optional=True))
