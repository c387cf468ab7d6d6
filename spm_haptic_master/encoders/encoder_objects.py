# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Wanted objects of an encoder (CiA 301, 406), and which of them its other objects answer.

Devices differ in the objects that they have; the rules list the differences that are harmless.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
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
from spm_haptic_master.exceptions import InputError

# Largest value of an UNSIGNED16 (ms).
TIME_MAXIMUM = 0xFFFF


@dataclass(frozen=True, slots=True)
class EncoderRules(Rules):
    """
    Rules for the objects of an encoder: its resolution and its timers.

    Attributes
    ----------
    counts_per_turn : int
        Wanted counts per turn.
    timer : int
        Wanted time between two frames, ms; 0 on a bus with SYNC.
    event_timer : tuple of 2 int, or None
        Event timer of the TPDO, where that is also the one of the cyclic timer (6200h).

    """

    counts_per_turn: int
    timer: int
    event_timer: Key | None

    def resolution(self, value: Present) -> int | None:
        """
        Return the counts per turn that are in effect.

        6001h counts where the scaling is on (6000h, bit 2) or cannot be switched, and otherwise
        the disc's own, 6501h (CiA 406).

        Parameters
        ----------
        value : callable
            Present value of an object by index and subindex; None for an object it lacks.

        Returns
        -------
        int or None
            Counts per turn; None where no object has them.

        """
        operating = value(*canopen.OPERATING_PARAMETERS)
        scaled = operating is None or bool(operating & canopen.SCALING_ON)
        units = value(*canopen.UNITS_PER_TURN)
        disc = value(*canopen.DISC_UNITS_PER_TURN)
        if units is None or not scaled:
            return disc
        return units

    def excused(self, value: Present) -> set[Key]:
        """
        Return the objects whose values do not matter, as others are right.

        Parameters
        ----------
        value : callable
            Present value of an object by index and subindex; None for an object it lacks.

        Returns
        -------
        set of (int, int)
            Index and subindex of each.

        """
        units = value(*canopen.UNITS_PER_TURN)
        # Without units per turn there is nothing to scale: the disc's own count.
        excused = {canopen.OPERATING_PARAMETERS if units is None else canopen.DISC_UNITS_PER_TURN}
        if self.resolution(value) == self.counts_per_turn:
            excused |= {canopen.OPERATING_PARAMETERS, canopen.UNITS_PER_TURN}
            operating = value(*canopen.OPERATING_PARAMETERS)
            if operating is not None and not operating & canopen.SCALING_ON:
                # The total range is that of the scaled position.
                excused.add(canopen.TOTAL_RANGE)
        # Both timers may be one value (CiA 406 from version 3.0 on).
        if value(*canopen.CYCLIC_TIMER) == self.timer:
            excused.add(canopen.CYCLIC_TIMER)
        return excused

    def adapted(self, wanted: WantedObjects, value: Present) -> WantedObjects:
        """Return the wanted objects of a device: without an event timer the cyclic one sends."""
        if self.event_timer is None or value(*self.event_timer) is not None:
            return wanted
        return replace(
            wanted,
            others=tuple(
                replace(each, value=self.timer) if each.key == canopen.CYCLIC_TIMER else each
                for each in wanted.others
            ),
        )

    def remarks(self, value: Present) -> list[str]:
        """Return in lines what no object of this encoder says or does."""
        found = []
        if self.resolution(value) is None:
            found.append(
                'no object has its counts per turn: compare encoders.counts_per_turn '
                f'({self.counts_per_turn}) with its data sheet'
            )
        if value(*canopen.HEARTBEAT_TIME) is None:
            found.append('no heartbeat (0x1017): that it is gone shows by its missing frames only')
        return found

    def hint(self, key: Key, value: Present) -> str:
        """
        Return what to do about an object that cannot be written.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.
        value : callable
            Present value of an object by index and subindex; None for an object it lacks.

        Returns
        -------
        str
            The settings that fit the device; empty if nothing is known.

        """
        if key in SCALING:
            resolution = self.resolution(value)
            if resolution is None:
                return ''
            if resolution != self.counts_per_turn:
                return f'set encoders.counts_per_turn: {resolution}'
            return f'it counts turns: set encoders.mask: 0x{resolution - 1:X}'
        if canopen.TPDO_MAPPING <= key[0] < canopen.TPDO_MAPPING + len(canopen.TPDO_BASES):
            return _mapping_hint(key[0], value)
        return ''


# Objects of the resolution.
SCALING = (
    canopen.OPERATING_PARAMETERS,
    canopen.UNITS_PER_TURN,
    canopen.TOTAL_RANGE,
    canopen.DISC_UNITS_PER_TURN,
)


def _mapping_hint(index: int, value: Present) -> str:
    """Return the layout of a frame with a mapping that cannot be changed."""
    entries = [value(index, number) or 0 for number in range(1, (value(index, 0) or 0) + 1)]
    place = 0
    words = []
    offset = None
    for entry in entries:
        if entry >> 8 == canopen.POSITION[0] << 8 | canopen.POSITION[1]:
            offset = place // 8
        name = canopen.object_name(entry >> 16, entry >> 8 & 0xFF)
        words.append(f'{name} with {entry & 0xFF} bits')
        place += entry & 0xFF
    if offset is None:
        return f'it sends {", ".join(words) or "nothing"}, and no position'
    # A PDO is filled up to whole bytes.
    length = (place + 7) // 8
    return (
        f'it sends {", ".join(words)}: set encoders.data_length: {length} and '
        f'encoders.byte_offset: {offset}'
    )


def wanted_objects(
    layout: EncoderLayout,
    node_id: int,
    sync_id: int | None,
    period: float,
    heartbeat: float,
    is_linear: bool = False,
) -> WantedObjects:
    """
    Return the wanted objects of an encoder.

    Parameters
    ----------
    layout
        Its frame, which its TPDO has to send.
    node_id
        Its node id; an identifier of the predefined connection set belongs to TPDO1 to TPDO4.
    sync_id
        Identifier of SYNC; None where it sends by itself.
    period
        Time between two frames without SYNC, s.
    heartbeat
        Time between two heartbeats, s.
    is_linear
        Whether it is a slide, which has no counts per turn: its scaling is left as it is.

    Raises
    ------
    InputError
        For a time that no object can hold.

    """
    base = layout.can_id - node_id
    known = not layout.extended and base in canopen.TPDO_BASES
    if known:
        number = canopen.TPDO_BASES.index(base)
    else:
        number = 0
    if sync_id is not None:
        timer = 0
    else:
        timer = milliseconds('1 / rate', period)
    event_timer = canopen.TPDO_PARAMETERS + number, canopen.TPDO_EVENT_TIMER
    return WantedObjects(
        pdos=(_position_pdo(layout, number, sync_id is not None, timer),),
        others=(
            *other_tpdos_off(number),
            *_sync_objects(sync_id),
            WantedObject(
                *canopen.HEARTBEAT_TIME,
                2,
                'heartbeat time, ms',
                milliseconds('--heartbeat', heartbeat),
                optional=True,
            ),
            *([] if is_linear else _scaling_objects(layout)),
            # The cyclic timer is that of TPDO1.
            *(
                [WantedObject(*canopen.CYCLIC_TIMER, 2, 'cyclic timer, ms', 0, optional=True)]
                if number == 0
                else []
            ),
        ),
        rules=EncoderRules(
            counts_per_turn=layout.counts_per_turn,
            timer=timer,
            event_timer=event_timer if number == 0 else None,
        ),
    )


def _position_pdo(
    layout: EncoderLayout,
    number: int,
    synchronised: bool,
    timer: int,
) -> WantedPdo:
    """Return the wanted TPDO, counted from 0, with the position; `timer` in ms."""
    name = f'TPDO{number + 1}'
    index = canopen.TPDO_PARAMETERS + number
    inhibit = WantedObject(
        index=index,
        subindex=canopen.TPDO_INHIBIT_TIME,
        size=2,
        name=f'{name} inhibit time',
        value=0,
        optional=True,
    )
    event = WantedObject(
        index=index,
        subindex=canopen.TPDO_EVENT_TIMER,
        size=2,
        name=f'{name} event timer, ms',
        value=timer,
        optional=True,
    )
    # A frame with nothing but the 32 bits of the position has a known mapping.
    plain = (
        layout.data_length == 4
        and layout.byte_offset == 0
        and layout.bit_length == 32
        and layout.byte_order == 'little'
    )
    position, subindex = canopen.POSITION
    pdo = wanted_pdo(
        index=index,
        name=name,
        identifier=layout.can_id | (canopen.TPDO_EXTENDED if layout.extended else 0),
        transmission=canopen.EVERY_SYNC if synchronised else canopen.EVENT_DRIVEN,
        times=(inhibit, event),
        entries=[position << 16 | subindex << 8 | 32] if plain else [],
    )
    # A mapping that cannot be read is fixed; the frames show it.
    return replace(pdo, mapping=tuple(replace(each, optional=True) for each in pdo.mapping))


def _sync_objects(sync_id: int | None) -> list[WantedObject]:
    """Return what decides whether an encoder answers each SYNC, and stays when one is missing."""
    supervised = WantedObject(
        *canopen.SYNC_PERIOD, 4, 'supervised period of SYNC, us', 0, optional=True
    )
    if sync_id is None:
        return [supervised]
    return [
        WantedObject(
            *canopen.SYNC_IDENTIFIER,
            4,
            'identifier of SYNC',
            sync_id,
            canopen.SYNC_PRODUCED | canopen.TPDO_EXTENDED | canopen.TPDO_ID_MASK,
            optional=True,
            hexadecimal=True,
        ),
        supervised,
        WantedObject(*canopen.SYNC_COUNTER, 1, 'counter in SYNC', 0, optional=True),
    ]


def _scaling_objects(layout: EncoderLayout) -> list[WantedObject]:
    """Return the scaling: units per turn, and the total range of a single turn."""
    counts = layout.counts_per_turn
    found = [
        WantedObject(
            *canopen.OPERATING_PARAMETERS,
            2,
            'scaling on (bit 2)',
            canopen.SCALING_ON,
            canopen.SCALING_ON,
            optional=True,
        ),
        WantedObject(*canopen.UNITS_PER_TURN, 4, 'units per turn', counts, optional=True),
        WantedObject(
            *canopen.DISC_UNITS_PER_TURN,
            4,
            'units per turn of the disc',
            counts,
            optional=True,
            of_device=True,
        ),
    ]
    # Where a mask selects the turn, the position may also count turns.
    if not layout.mask:
        found.append(
            WantedObject(
                *canopen.TOTAL_RANGE,
                4,
                'total range',
                counts,
                # Many devices keep the largest position there.
                also=(counts - 1,),
                optional=True,
            )
        )
    return found


def milliseconds(name: str, seconds: float) -> int:
    """
    Return a time as an object of 16 bits holds it.

    Parameters
    ----------
    name : str
        Name of the time, for the error.
    seconds : float
        Time, s.

    Returns
    -------
    int
        Time, ms.

    Raises
    ------
    InputError
        It is no whole number of ms from 1 to TIME_MAXIMUM.

    """
    value = 1e3 * seconds
    if not (1.0 <= value <= TIME_MAXIMUM and abs(value - round(value)) < 1e-6 * value):
        raise InputError(
            f'{name} {seconds:g} s; expected whole milliseconds, 0.001 to '
            f'{1e-3 * TIME_MAXIMUM:g} s'
        )
    return round(value)
