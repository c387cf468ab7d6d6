# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The objects of a simulated CANopen encoder: read and written by SDO, stored, in effect."""

from __future__ import annotations

from dataclasses import replace

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.simulation.object_store import (
    Entry,
    identity,
    Key,
    ObjectStore,
    SdoAbortError,
    STORES_ON_COMMAND,
)

# Device type of the nodes: an encoder with absolute single-turn resolution (CiA 406).
DEVICE_TYPE = 1 << 16 | canopen.ENCODER_PROFILE
# Units of the disc to one configured count: without scaling the counts go beyond a turn.
DISC_UNITS = 4
# Mapped position: index, subindex and 32 bits, as in an entry of a mapping object.
MAPPED_POSITION = canopen.POSITION[0] << 16 | canopen.POSITION[1] << 8 | 32
# Mapped speed (16 bits), which the maker's defaults put behind the position.
MAPPED_SPEED = 0x6030_01_10
# Entries of the mapping object.
MAPPING_ENTRIES = 4


class SimulatedObjects(ObjectStore):
    """
    Objects of one encoder, and what follows from their values.

    `layout` is that of its TPDO once it is set up; then it answers SYNC, or sends by itself, and
    `heartbeat` is the time between heartbeats, s. From the `factory` it is not set up yet.
    """

    layout: EncoderLayout  # of the frames sent at present
    identifier: int  # of the TPDO
    sends: bool  # whether the TPDO goes out in the cycle of the bus
    more: int  # number of bytes mapped behind the position
    heartbeat: float | None  # time between heartbeats, s; None for no heartbeat

    def __init__(self, layout: EncoderLayout, node_id: int, synchronised: bool,
                 heartbeat: float, factory: bool):
        self._layout = layout
        self._type = canopen.EVERY_SYNC if synchronised else canopen.EVENT_DRIVEN
        base = layout.can_id - node_id
        number = canopen.TPDO_BASES.index(base) if base in canopen.TPDO_BASES else 0
        self._parameters = parameters = canopen.TPDO_PARAMETERS + number
        self._mapping = mapping = canopen.TPDO_MAPPING + number
        if factory:
            identifier, kind = canopen.TPDO_BASES[0] + node_id, canopen.EVENT_DRIVEN
            mapped, heartbeat, scaling = [MAPPED_POSITION, MAPPED_SPEED], 0.0, 0
        else:
            identifier = layout.can_id | (canopen.TPDO_EXTENDED if layout.extended else 0)
            kind, mapped, scaling = self._type, [MAPPED_POSITION], canopen.SCALING_ON
        disc = DISC_UNITS * layout.counts_per_turn
        units = disc if factory else layout.counts_per_turn
        entries = mapped + [0] * (MAPPING_ENTRIES - len(mapped))
        super().__init__(identity(DEVICE_TYPE, node_id) | {
            canopen.STORE: Entry(STORES_ON_COMMAND),
            canopen.HEARTBEAT_TIME: Entry(round(heartbeat * 1e3), 2),
            (parameters, canopen.TPDO_IDENTIFIER): Entry(identifier | canopen.TPDO_NO_REQUEST),
            (parameters, canopen.TPDO_TYPE): Entry(kind, 1),
            (parameters, canopen.TPDO_INHIBIT_TIME): Entry(0, 2),
            (parameters, canopen.TPDO_EVENT_TIMER): Entry(0, 2),
            (mapping, 0): Entry(len(mapped), 1),
            **{(mapping, place): Entry(entry) for place, entry in enumerate(entries, start=1)},
            canopen.OPERATING_PARAMETERS: Entry(scaling, 2),
            canopen.UNITS_PER_TURN: Entry(units),
            canopen.TOTAL_RANGE: Entry(units),
            canopen.POSITION: Entry(0, writable=False),
            canopen.CYCLIC_TIMER: Entry(0, 2),
            canopen.DISC_UNITS_PER_TURN: Entry(disc, writable=False)})

    def _check_state(self, key: Key, value: int) -> None:
        """Refuse a wrong value, and what CiA 301 does not allow while the TPDO is in use."""
        index, subindex = key
        off = bool(self._value(self._parameters, canopen.TPDO_IDENTIFIER) & canopen.TPDO_OFF)
        if index == self._mapping:
            if not subindex and value > MAPPING_ENTRIES:
                raise SdoAbortError(canopen.SDO_WRONG_VALUE)
            if not off or (subindex and self._value(self._mapping, 0)):
                raise SdoAbortError(canopen.SDO_WRONG_STATE)
        elif key == (self._parameters, canopen.TPDO_IDENTIFIER) and not off \
                and (self._value(*key) ^ value) & canopen.TPDO_ID_MASK:
            raise SdoAbortError(canopen.SDO_WRONG_STATE)
        elif key == canopen.UNITS_PER_TURN and not value:
            raise SdoAbortError(canopen.SDO_WRONG_VALUE)

    def _derive(self) -> None:
        identifier = self._value(self._parameters, canopen.TPDO_IDENTIFIER)
        self.identifier = identifier & canopen.TPDO_ID_MASK
        mapped = [self._value(self._mapping, number)
                  for number in range(1, self._value(self._mapping, 0) + 1)]
        self.sends = not identifier & canopen.TPDO_OFF and MAPPED_POSITION in mapped[:1] \
            and self._value(self._parameters, canopen.TPDO_TYPE) == self._type
        self.more = sum(entry & 0xFF for entry in mapped[1:]) // 8
        milliseconds = self._value(*canopen.HEARTBEAT_TIME)
        self.heartbeat = 1e-3 * milliseconds if milliseconds else None
        scaled = self._value(*canopen.OPERATING_PARAMETERS) & canopen.SCALING_ON
        units = self._value(*(canopen.UNITS_PER_TURN if scaled
                              else canopen.DISC_UNITS_PER_TURN))
        layout = self._layout
        self.layout = layout if units == layout.counts_per_turn else replace(
            layout, counts_per_turn=units,
            zero_count=layout.zero_count * units // layout.counts_per_turn)
