# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the objects of an encoder have to be, so that it sends what the driver expects."""

from __future__ import annotations

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.encoders.wanted_object import WantedObject, WantedObjects, WantedPdo
from spm_haptic_master.exceptions import InputError

# Entry of a mapping object: the position, 32 bits.
POSITION_ENTRY = canopen.POSITION[0] << 16 | canopen.POSITION[1] << 8 | 32
# Largest value of an UNSIGNED16 (ms).
TIME_MAXIMUM = 0xFFFF


def wanted_objects(layout: EncoderLayout, node_id: int, synchronised: bool, period: float,
                   heartbeat: float) -> WantedObjects:
    """
    Return what the objects of an encoder have to be.

    Parameters
    ----------
    layout : EncoderLayout
        Layout of its frame.
    node_id : int
        Its node id.
    synchronised : bool
        Whether it answers SYNC; otherwise it sends by itself.
    period : float
        Time between two frames that it sends by itself, s.
    heartbeat : float
        Time between heartbeats, s.

    Raises
    ------
    InputError
        A time is not a whole number of milliseconds that an object can hold.

    """
    base = layout.can_id - node_id
    known = not layout.extended and base in canopen.TPDO_BASES
    number = canopen.TPDO_BASES.index(base) if known else 0
    name = f'TPDO{number + 1}'
    parameters = canopen.TPDO_PARAMETERS + number
    identifier = layout.can_id | (canopen.TPDO_EXTENDED if layout.extended else 0)
    timer = 0 if synchronised else milliseconds('1 / rate', period)
    return WantedObjects(
        pdos=(WantedPdo(
            identifier=WantedObject(
                parameters, canopen.TPDO_IDENTIFIER, 4, f'{name} identifier', identifier,
                canopen.TPDO_OFF | canopen.TPDO_EXTENDED | canopen.TPDO_ID_MASK,
                hexadecimal=True),
            parameters=(
                WantedObject(parameters, canopen.TPDO_TYPE, 1, f'{name} transmission type',
                             canopen.EVERY_SYNC if synchronised else canopen.EVENT_DRIVEN),
                WantedObject(parameters, canopen.TPDO_INHIBIT_TIME, 2, f'{name} inhibit time', 0,
                             optional=True),
                WantedObject(parameters, canopen.TPDO_EVENT_TIMER, 2, f'{name} event timer', 0,
                             optional=True)),
            mapping=_mapping(layout, canopen.TPDO_MAPPING + number, name)),),
        others=(
            *(WantedObject(canopen.TPDO_PARAMETERS + other, canopen.TPDO_IDENTIFIER, 4,
                           f'TPDO{other + 1} off', canopen.TPDO_OFF, canopen.TPDO_OFF,
                           optional=True, hexadecimal=True)
              for other in range(len(canopen.TPDO_BASES)) if other != number),
            WantedObject(*canopen.HEARTBEAT_TIME, 2, 'heartbeat time, ms',
                         milliseconds('--heartbeat', heartbeat)),
            WantedObject(*canopen.OPERATING_PARAMETERS, 2, 'scaling on (bit 2)',
                         canopen.SCALING_ON, canopen.SCALING_ON),
            WantedObject(*canopen.UNITS_PER_TURN, 4, 'units per turn', layout.counts_per_turn),
            # Where a mask selects the turn, the position may count turns, too.
            *([] if layout.mask else [WantedObject(
                *canopen.TOTAL_RANGE, 4, 'total range', layout.counts_per_turn)]),
            WantedObject(*canopen.CYCLIC_TIMER, 2, 'cyclic timer, ms', timer,
                         optional=synchronised)))


def milliseconds(name: str, seconds: float) -> int:
    """
    Return a time in whole milliseconds.

    Raises
    ------
    InputError
        It is none, or none that an object can hold.

    """
    value = 1e3 * seconds
    if not (1.0 <= value <= TIME_MAXIMUM and abs(value - round(value)) < 1e-6 * value):
        raise InputError(f'{name} {seconds:g} s; expected whole milliseconds, 0.001 to '
                         f'{1e-3 * TIME_MAXIMUM:g} s')
    return round(value)


def _mapping(layout: EncoderLayout, index: int, name: str) -> tuple[WantedObject, ...]:
    """Return the mapping of a frame with nothing but the 32 bits of the position."""
    if (layout.data_length, layout.byte_offset, layout.bit_length, layout.byte_order) \
            != (4, 0, 32, 'little'):
        return ()
    return (WantedObject(index, 0, 1, f'{name} mapped objects', 1),
            WantedObject(index, 1, 4, f'{name} mapping', POSITION_ENTRY, hexadecimal=True))
