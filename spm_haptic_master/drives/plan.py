# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What checked settings make of the drives: units, times, and frames of the bus.

Whatever contradicts something else is refused here, before a frame is sent.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from struct import pack, Struct
from typing import Any

from spm_haptic_master.drives import cia402
from spm_haptic_master.encoders import canopen
from spm_haptic_master.exceptions import SettingError
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.parameters.setting import Values

# One turn a minute (rad/s).
TURN_A_MINUTE = 2.0 * pi / 60.0
# Layout of a status frame: statusword, torque actual (per mille), mode of operation.
STATUS = Struct('<Hhb')
# What a drive sends its status by: its event timer, SYNC of this master, SYNC of the encoders.
BY_TIMER = 'timer'
BY_OWN_SYNC = 'sync'
BY_ENCODER_SYNC = 'encoder_sync'
# Largest transmission type of a PDO that is sent with every so many SYNC.
LARGEST_SYNCS = 240
# Event timers of the frames with torques: of a drive with its controlword, and of all drives.
TORQUE_TIMERS = tuple(
    (canopen.RPDO_PARAMETERS + number, canopen.TPDO_EVENT_TIMER) for number in (0, 1)
)
# All objects that may be missing if verified by hand.
VERIFIABLE = (cia402.MAXIMUM_TORQUE, *TORQUE_TIMERS)
# Fewest samples within the event timer of the torque frames.
SAMPLES_WITHIN = 3


@dataclass(frozen=True, slots=True)
class DrivePlan:
    """
    One drive and its motor, as configured.

    Attributes
    ----------
    joint : str
        Joint that the motor turns.
    node_id : int
        CANopen node id.
    direction : int
        Sign of the motor's torque against that of the joint: 1 or -1.
    gear : float
        Turns of the motor for one of the joint.
    rated_torque : float
        Rated torque of the motor, N m.
    cap : int
        Largest torque (6072h), per mille of the rated torque.
    speed_limit : int
        Largest speed of the motor (6080h), 1/min; 0 leaves the drive's own.
    status_id : int
        Identifier of its status frame: TPDO1.
    control_id : int
        Identifier of the frame with its controlword: RPDO1. The torque is in it if no frame has
        the torques of all.

    """

    joint: str
    node_id: int
    direction: int
    gear: float
    rated_torque: float
    cap: int
    speed_limit: int
    status_id: int
    control_id: int

    @property
    def name(self) -> str:
        """Name in texts, with joint and node id."""
        return f'drive of {self.joint} (node {self.node_id})'

    @property
    def scale(self) -> float:
        """Per mille of the rated torque for 1 N m at the joint, with sign."""
        return cia402.PER_MILLE * self.direction / (self.gear * self.rated_torque)

    def per_mille(self, torque: float) -> int:
        """
        Return a joint's torque in the unit of 6071h.

        Parameters
        ----------
        torque : float
            Torque at the joint, N m.

        Returns
        -------
        int
            Per mille of the rated torque, rounded, within the cap.

        """
        return max(-self.cap, min(self.cap, round(self.scale * torque)))


@dataclass(frozen=True, slots=True)
class Plan:
    """
    All drives on their bus, and the times that both sides keep.

    Attributes
    ----------
    drives : tuple of N DrivePlan
        In the order of the motors.
    combined : bool
        Whether one frame has all torques, and the controlwords have frames of their own.
    combined_id : int
        Identifier of that frame: RPDO2 of the first drive.
    mode : int
        Mode of operation (6060h); 0: cyclic synchronous torque, or else profile torque.
    master_id : int
        Node id in this master's heartbeat.
    torque_unit : float
        Unit of 6076h, N m; 0: the drives have no such object.
    period : float
        Time between two samples, s.
    status_period : float
        Time between two status frames, s.
    status_timeout : float
        Time without a status frame that is a fault, s.
    heartbeat : float
        Time between two heartbeats, of this master and of the drives, s.
    heartbeat_timeout : float
        Time without a heartbeat that is a fault, on both sides, s.
    event_timer : float
        Time without a torque frame until a drive frees its motor, s; 0: the drives have no such
        timer.
    status_syncs : int
        SYNC frames from one status frame to the next; 0: the drives send it by their own timer.
    sends_sync : bool
        Whether this master sends SYNC, one for each status frame.
    verified : frozenset of (int, int)
        Objects that the drives lack, and whose effect was verified by hand.

    """

    drives: tuple[DrivePlan, ...]
    combined: bool
    combined_id: int
    mode: int
    master_id: int
    torque_unit: float
    period: float
    status_period: float
    status_timeout: float
    heartbeat: float
    heartbeat_timeout: float
    event_timer: float
    status_syncs: int
    sends_sync: bool
    verified: frozenset[tuple[int, int]]


def torque_frames(
    plan: Plan,
    controlwords: list[int],
    torques: list[int],
    controls: bool,
) -> list[tuple[int, bytes]]:
    """
    Return the frames of a sample.

    Parameters
    ----------
    plan : Plan
        All drives on their bus.
    controlwords : list of N int
        Values for 6040h, in the order of the motors.
    torques : list of N int
        Values for 6071h, per mille of each rated torque.
    controls : bool
        Whether the controlwords go out; without effect unless they have frames of their own.

    Returns
    -------
    list of (int, bytes)
        Identifier and data of each frame.

    """
    if not plan.combined:
        return [
            (drive.control_id, pack('<Hh', word, torque))
            for drive, word, torque in zip(plan.drives, controlwords, torques, strict=True)
        ]
    if controls:
        words = [
            (drive.control_id, pack('<H', word))
            for drive, word in zip(plan.drives, controlwords, strict=True)
        ]
    else:
        words = []
    return [(plan.combined_id, pack(f'<{len(torques)}h', *torques)), *words]


def make_plan(values: Values) -> Plan:
    """
    Return the drives by checked settings.

    Parameters
    ----------
    values : Values
        Checked values of DRIVE_SETTINGS, and `rate`, Hz.

    Returns
    -------
    Plan
        The drives, one for each `drives.node_id`.

    Raises
    ------
    SettingError
        Settings contradict each other, or the torque limit does not fit the motors.

    """
    node_ids = values['drives.node_id']
    master_id = values['drives.master_id']
    count = len(node_ids)
    if len({*node_ids, master_id}) <= count:
        raise SettingError(
            'drives.node_id',
            list(node_ids),
            f'different node ids, none that of drives.master_id ({master_id})',
        )
    if count > len(JOINT_NAMES):
        raise SettingError('drives.node_id', list(node_ids), f'at most {len(JOINT_NAMES)} drives')
    rated, gears, directions = (
        _each(values, f'drives.{name}', count) for name in ('rated_torque', 'gear', 'direction')
    )
    if 0.0 in rated:
        raise SettingError(
            'drives.rated_torque',
            list(values['drives.rated_torque']),
            "the motors' rated torque, N m, above 0: torques on the bus are per mille of it",
        )
    _check_times(values)
    verified = _verified(values['drives.verified_by_hand'])
    drives = [
        _drive_plan(joint, node_id, values, torque, gear, direction)
        for joint, node_id, torque, gear, direction in zip(
            JOINT_NAMES, node_ids, rated, gears, directions, strict=False
        )
    ]
    return Plan(
        drives=tuple(drives),
        combined=values['drives.combined'],
        combined_id=canopen.RPDO_BASES[1] + node_ids[0],
        mode=values['drives.mode'],
        master_id=master_id,
        torque_unit=values['drives.torque_unit'],
        period=1.0 / values['rate'],
        status_period=values['drives.status_period'],
        status_timeout=values['drives.status_timeout'],
        heartbeat=values['drives.heartbeat'],
        heartbeat_timeout=values['drives.heartbeat_timeout'],
        # Drives without that timer have only the heartbeat.
        event_timer=values['drives.event_timer'] if verified.isdisjoint(TORQUE_TIMERS) else 0.0,
        status_syncs=_status_syncs(values),
        sends_sync=values['drives.status_by'] == BY_OWN_SYNC,
        verified=verified,
    )


def _drive_plan(
    joint: str,
    node_id: int,
    values: Values,
    torque: float,
    gear: float,
    direction: int,
) -> DrivePlan:
    """
    Return one drive; its cap is the torque limit in per mille, rounded down.

    Parameters
    ----------
    joint : str
        Joint that its motor turns.
    node_id : int
        CANopen node id.
    values : Values
        Checked values of DRIVE_SETTINGS.
    torque : float
        Rated torque of the motor, N m.
    gear : float
        Turns of the motor for one of the joint.
    direction : int
        Sign of the motor's torque against that of the joint.

    Raises
    ------
    SettingError
        The torque limit is less than one per mille, or more than 16 bits hold; the speed limit is
        less than one turn of the motor a minute.

    """
    limit = values['drives.torque_limit']
    cap = int(cia402.PER_MILLE / (gear * torque) * limit)
    if not 1 <= cap <= cia402.LARGEST:
        raise SettingError(
            'drives.torque_limit',
            limit,
            f'1 to {cia402.LARGEST} per mille of the rated torque {torque:g} '
            f'N m for {joint}; it is {cap}',
        )
    return DrivePlan(
        joint=joint,
        node_id=node_id,
        direction=direction,
        gear=gear,
        rated_torque=torque,
        cap=cap,
        speed_limit=_speed_limit(values['drives.speed_limit'], gear),
        status_id=canopen.TPDO_BASES[0] + node_id,
        control_id=canopen.RPDO_BASES[0] + node_id,
    )


def _speed_limit(limit: float, gear: float) -> int:
    """
    Return 6080h of a motor, 1/min: a limit of its joint in rad/s, rounded; 0 without a limit.

    Raises
    ------
    SettingError
        It would round to 0, which means no limit.

    """
    turns = gear / TURN_A_MINUTE
    if 0.0 < limit * turns < 1.0:
        raise SettingError(
            'drives.speed_limit', limit, f'0, or at least {1.0 / turns:g} rad/s (1/min of a motor)'
        )
    return round(limit * turns)


def _verified(text: str) -> frozenset[tuple[int, int]]:
    """Return the objects that were verified by hand; SettingError for any other text."""
    found = set()
    for word in text.replace(',', ' ').split():
        index, _, subindex = word.partition(':')
        try:
            key = int(index, 16), int(subindex or '0', 16)
        except ValueError:
            key = 0, 0
        if key not in VERIFIABLE:
            raise SettingError(
                'drives.verified_by_hand',
                text,
                'objects out of ' + ', '.join(canopen.object_name(*key) for key in VERIFIABLE),
            )
        found.add(key)
    return frozenset(found)


def _status_syncs(values: Values) -> int:
    """Return the SYNC frames from one status frame to the next; SettingError: not whole."""
    source = values['drives.status_by']
    if source == BY_TIMER:
        return 0
    if source == BY_OWN_SYNC:
        return 1
    period = values['drives.status_period']
    syncs: float = period * values['rate']
    if abs(syncs - round(syncs)) > 1e-6 or not 1 <= round(syncs) <= LARGEST_SYNCS:
        raise SettingError(
            'drives.status_period',
            period,
            f'1 to {LARGEST_SYNCS} whole periods of the SYNC of the encoders '
            f'({1e3 / values["rate"]:g} ms)',
        )
    return round(syncs)


def _each(
    values: Values,
    name: str,
    count: int,
) -> tuple[Any, ...]:
    """Return a value for each drive; SettingError where there is another number of them."""
    found: tuple[Any, ...] = values[name]
    if len(found) == 1:
        return found * count
    if len(found) != count:
        raise SettingError(name, list(found), f'one value, or {count} (drives.node_id)')
    return found


def _check_times(values: Values) -> None:
    """
    Refuse times that CANopen cannot hold, and time-outs shorter than what they wait for.

    Raises
    ------
    SettingError
        A time is no whole number of ms; the event timer is shorter than SAMPLES_WITHIN samples, or
        a time-out shorter than two periods.

    """
    for name in (
        'drives.status_period',
        'drives.heartbeat',
        'drives.heartbeat_timeout',
        'drives.event_timer',
    ):
        value = 1e3 * values[name]
        if abs(value - round(value)) > 1e-6:
            raise SettingError(name, values[name], 'whole milliseconds')
    period = 1.0 / values['rate']
    timer = values['drives.event_timer']
    for name, shortest, why in (
        (
            'drives.event_timer',
            SAMPLES_WITHIN * period if timer else 0.0,
            f'{SAMPLES_WITHIN} samples at rate {values["rate"]:g} Hz',
        ),
        (
            'drives.status_timeout',
            2.0 * values['drives.status_period'],
            'two of drives.status_period',
        ),
        ('drives.heartbeat_timeout', 2.0 * values['drives.heartbeat'], 'two of drives.heartbeat'),
    ):
        if values[name] < shortest - 1e-9:
            raise SettingError(name, values[name], f'at least {shortest:g} s: {why}')
