# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Required objects of a drive, for can_setup and for the check at the start.

Some drives lack objects that others have: EPOS4 has no 6072h, 1400h:05 and 1800h:05. What then has
to be verified by hand is said with the object, and asked for once.
"""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.drives import cia402
from spm_haptic_master.drives.plan import DrivePlan, Plan, TORQUE_TIMERS
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.node_setup import (
    Key,
    other_tpdos_off,
    Present,
    Rules,
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
# Event timer of the status frame.
STATUS_TIMER = (canopen.TPDO_PARAMETERS, canopen.TPDO_EVENT_TIMER)
# Objects of the torque, without which a drive cannot be used here.
TORQUES = {cia402.TARGET_TORQUE: 'target torque', cia402.TORQUE_ACTUAL: 'torque actual'}
# What to do about further objects that a drive lacks.
HINTS = {
    STATUS_TIMER: "its status needs SYNC: give drives.status_by: 'sync'",
    cia402.RATED_TORQUE: 'verify by hand that 1000 per mille are drives.rated_torque, then give '
    'drives.torque_unit: 0.0',
    cia402.HEARTBEAT_CONSUMER: 'the drive does not notice a master that hangs: it cannot be used '
    'here',
    **dict.fromkeys(
        TORQUES, 'the drive has no torque to command or to compare: it cannot be used here'
    ),
}


@dataclass(frozen=True, slots=True)
class DriveRules(Rules):
    """
    Rules for objects that a drive lacks: can_setup and the check at the start ask them.

    Attributes
    ----------
    plan : Plan
        All drives on their bus.
    drive : DrivePlan
        The drive that is compared.

    """

    plan: Plan
    drive: DrivePlan

    def remarks(self, value: Present) -> list[str]:
        """
        Return what was verified by hand, so that the table of can_setup shows it.

        Parameters
        ----------
        value : callable
            Present value of an object; not used.

        Returns
        -------
        list of str
            One line for each object of `drives.verified_by_hand`.

        """
        return [
            f'{canopen.object_name(*key)} was verified by hand (drives.verified_by_hand)'
            for key in sorted(self.plan.verified)
        ]

    def hint(self, key: Key, value: Present) -> str:
        """
        Return what to do about an object that the drive lacks.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.
        value : callable
            Present value of an object by index and subindex; None for an object it lacks.

        Returns
        -------
        str
            The remedy; empty if the drive has the object, or if no remedy is known.

        """
        if value(*key) is not None:
            return ''
        plan = self.plan
        to_verify = f'then give drives.verified_by_hand: {canopen.object_name(*key)}'
        if key == cia402.MAXIMUM_TORQUE:
            return (
                'the drive has no cap of this kind: verify by hand that its limit of the current '
                f'(EPOS4: 0x3001:02) allows at most {self.drive.cap} per mille of the rated '
                f'torque, {to_verify}'
            )
        if key in TORQUE_TIMERS:
            return (
                'torque frames that stop then end the torque by the heartbeat alone, within '
                f'{1e3 * plan.heartbeat_timeout:.0f} ms: verify by hand that the device may have '
                f'its last torque for so long, {to_verify}'
            )
        return HINTS.get(key, '')


def drive_objects(plan: Plan, drive: DrivePlan) -> WantedObjects:
    """
    Return the required objects of a drive.

    They are its PDOs, its reaction to a lost master or to a fault, its limits, and the period of
    its torques.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    drive : DrivePlan
        The one of them.

    Returns
    -------
    WantedObjects
        The objects with their values, and the rules for those that the drive lacks.

    """
    others = (
        *_torques(),
        *other_tpdos_off(0),
        *_losses(plan),
        *_limits(plan, drive),
        *_period(plan),
    )
    pdos = (*_received(plan, drive), _status(plan, drive))
    return WantedObjects(
        pdos=pdos,
        others=others,
        rules=DriveRules(plan, drive),
    )


def _received(plan: Plan, drive: DrivePlan) -> list[WantedPdo]:
    """
    Return the RPDOs of a drive: controlword and torque, together or apart.

    With one frame for all torques, RPDO1 has the controlword alone. RPDO2 is the shared frame, in
    which a drive maps its own torque and leaves out 16 bits for each other drive.
    """
    control = _entry(cia402.CONTROLWORD, 16)
    torque = _entry(cia402.TARGET_TORQUE, 16)
    if not plan.combined:
        return [_rpdo(0, drive.control_id, [control, torque], plan.event_timer)]
    left_out = INTEGER16 << 16 | 16
    torques = [torque if other is drive else left_out for other in plan.drives]
    return [
        _rpdo(0, drive.control_id, [control], event_timer=0.0),
        _rpdo(1, plan.combined_id, torques, plan.event_timer),
    ]


def _rpdo(
    number: int,
    identifier: int,
    entries: list[int],
    event_timer: float,
) -> WantedPdo:
    """Return an RPDO, counted from 0, that is used at once; time of its event timer, s, or 0."""
    name = f'RPDO{number + 1}'
    return wanted_pdo(
        index=canopen.RPDO_PARAMETERS + number,
        name=name,
        identifier=identifier,
        transmission=AT_ONCE,
        times=_timer(TORQUE_TIMERS[number], name, event_timer),
        entries=entries,
    )


def _status(plan: Plan, drive: DrivePlan) -> WantedPdo:
    """
    Return the TPDO with the status of a drive: sent by its timer, or on SYNC.

    It has statusword (16 bits), torque actual (16 bits) and mode of operation display (8 bits).
    With the timer an inhibit time keeps it from coming more often.
    """
    index = canopen.TPDO_PARAMETERS
    transmission = plan.status_syncs
    times = []
    if not plan.status_syncs:
        transmission = AT_ONCE
        # The unit of an inhibit time is 100 us.
        inhibit = WantedObject(
            index=index,
            subindex=canopen.TPDO_INHIBIT_TIME,
            size=2,
            name='TPDO1 inhibit time',
            value=10 * _milliseconds(plan.status_period),
        )
        times = [inhibit, *_timer(STATUS_TIMER, 'TPDO1', plan.status_period)]
    return wanted_pdo(
        index=index,
        name='TPDO1',
        identifier=drive.status_id,
        transmission=transmission,
        times=times,
        entries=[
            _entry(cia402.STATUSWORD, 16),
            _entry(cia402.TORQUE_ACTUAL, 16),
            _entry(cia402.MODE_DISPLAY, 8),
        ],
    )


def _torques() -> list[WantedObject]:
    """Return the objects of the torque: they only have to be there."""
    return [
        WantedObject(*key, 2, name, 0, mask=0, of_device=True) for key, name in TORQUES.items()
    ]


def _losses(plan: Plan) -> list[WantedObject]:
    """
    Return what a drive does if its master is lost, or after a fault: the motor is free.

    The objects are 1016h (the heartbeat that it expects), 1017h (its own), 1029h, 6007h, 605Ah and
    605Eh of CiA 301 and 402.
    """
    consumer = plan.master_id << 16 | _milliseconds(plan.heartbeat_timeout)
    heartbeat = _milliseconds(plan.heartbeat)
    disable = cia402.DISABLE_VOLTAGE_ON_ABORT
    return [
        WantedObject(
            *cia402.HEARTBEAT_CONSUMER, 4, "master's heartbeat", consumer, hexadecimal=True
        ),
        WantedObject(*canopen.HEARTBEAT_TIME, 2, 'heartbeat time, ms', heartbeat),
        WantedObject(*cia402.ERROR_BEHAVIOUR, 1, 'error behaviour', KEEP_STATE, optional=True),
        WantedObject(*cia402.ABORT_OPTION, 2, 'abort connection option', disable),
        WantedObject(*cia402.QUICK_STOP_OPTION, 2, 'quick stop option', cia402.FREE),
        WantedObject(*cia402.FAULT_OPTION, 2, 'fault reaction option', cia402.FREE),
    ]


def _limits(plan: Plan, drive: DrivePlan) -> list[WantedObject]:
    """
    Return the limits of torque (6072h) and speed (6080h), and the rated torque (6076h).

    6076h is only compared, as it belongs to the device. It is left out if the drives have no such
    object (`torque_unit` 0), and 6080h if no limit of speed is configured.
    """
    found = [
        WantedObject(
            *cia402.MAXIMUM_TORQUE,
            2,
            'maximum torque, per mille',
            drive.cap,
            optional=cia402.MAXIMUM_TORQUE in plan.verified,
        )
    ]
    if plan.torque_unit:
        rated = round(drive.rated_torque / plan.torque_unit)
        found.append(WantedObject(*cia402.RATED_TORQUE, 4, 'rated torque', rated, of_device=True))
    if drive.speed_limit:
        found.append(
            WantedObject(
                *cia402.MAXIMUM_MOTOR_SPEED, 4, 'maximum motor speed, 1/min', drive.speed_limit
            )
        )
    return found


def _period(plan: Plan) -> list[WantedObject]:
    """
    Return the period of the torques (60C2h), in whole ms.

    A drive need not have it: both objects are optional. A period that is no whole number of ms, or
    that a byte cannot hold, is not set.
    """
    period = round(1e3 * plan.period)
    is_whole = abs(1e3 * plan.period - period) <= 1e-6
    if not is_whole or not 1 <= period <= 0xFF:
        return []
    return [
        WantedObject(*cia402.PERIOD_VALUE, 1, 'period of the torques', period, optional=True),
        WantedObject(*cia402.PERIOD_EXPONENT, 1, 'its power of ten', MILLI, optional=True),
    ]


def _timer(
    key: Key,
    name: str,
    seconds: float,
) -> list[WantedObject]:
    """
    Return the event timer of a PDO.

    Parameters
    ----------
    key : tuple of 2 int
        Index and subindex of the timer.
    name : str
        Name of the PDO, in texts.
    seconds : float
        Its time, s.

    Returns
    -------
    list of WantedObject
        Empty for a time of 0.

    """
    timer = WantedObject(*key, 2, f'{name} event timer, ms', _milliseconds(seconds))
    return [timer] if seconds else []


def _entry(key: Key, bits: int) -> int:
    """Return the entry of a mapping for an object: index, subindex and length in bits."""
    index, subindex = key
    return index << 16 | subindex << 8 | bits


def _milliseconds(seconds: float) -> int:
    """Return a time in ms: the settings have only whole ones."""
    return round(1e3 * seconds)
