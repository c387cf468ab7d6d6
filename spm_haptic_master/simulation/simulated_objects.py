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

    Parameters
    ----------
    layout : EncoderLayout
        Layout of its TPDO, once it is set up.
    node_id, serial : int
        Node id and serial number.
    synchronised : bool
        Whether it answers SYNC once it is set up; otherwise it sends by itself.
    heartbeat : float
        Time between heartbeats, s, once it is set up.
    factory : bool
        Whether it has its maker's defaults, and is not set up yet.

    Attributes
    ----------
    layout : EncoderLayout
        Layout of the frames sent at present.
    identifier : int
        Identifier of the TPDO.
    sends : bool
        Whether the TPDO goes out in the cycle of the bus.
    more : int
        Number of bytes mapped behind the position.
    heartbeat : float or None
        Time between heartbeats, s; None for no heartbeat.

    """

    def __init__(self, layout: EncoderLayout, node_id: int, serial: int, synchronised: bool,
                 heartbeat: float, factory: bool):
        self._layout = layout
        self._type = canopen.EVERY_SYNC if synchronised else canopen.EVENT_DRIVEN
        base = layout.can_id - node_id
        number = canopen.TPDO_BASES.index(base) if base in canopen.TPDO_BASES else 0
        self._parameters = canopen.TPDO_PARAMETERS + number
        self._mapping = canopen.TPDO_MAPPING + number
        # What follows from the values; set by `_derive`.
        self.layout: EncoderLayout
        self.identifier: int
        self.sends: bool
        self.more: int
        self.heartbeat: float | None
        super().__init__(identity(DEVICE_TYPE, serial)
                         | self._communication(node_id, factory, heartbeat)
                         | self._profile(factory))

    def _communication(self, node_id: int, factory: bool,
                       heartbeat: float) -> dict[Key, Entry]:
        layout = self._layout
        identifier = canopen.TPDO_BASES[0] + node_id if factory else \
            layout.can_id | (canopen.TPDO_EXTENDED if layout.extended else 0)
        mapped = [MAPPED_POSITION, *([MAPPED_SPEED] if factory else [])]
        parameters, mapping = self._parameters, self._mapping
        return {
            canopen.STORE: Entry(STORES_ON_COMMAND),
            canopen.HEARTBEAT_TIME: Entry(0 if factory else round(heartbeat * 1e3), 2),
            (parameters, canopen.TPDO_IDENTIFIER): Entry(identifier | canopen.TPDO_NO_REQUEST),
            (parameters, canopen.TPDO_TYPE): Entry(
                canopen.EVENT_DRIVEN if factory else self._type, 1),
            (parameters, canopen.TPDO_INHIBIT_TIME): Entry(0, 2),
            (parameters, canopen.TPDO_EVENT_TIMER): Entry(0, 2),
            (mapping, 0): Entry(len(mapped), 1),
            **{(mapping, number): Entry(dict(enumerate(mapped, start=1)).get(number, 0))
               for number in range(1, MAPPING_ENTRIES + 1)},
        }

    def _profile(self, factory: bool) -> dict[Key, Entry]:
        units = self._layout.counts_per_turn
        disc = DISC_UNITS * units
        return {
            canopen.OPERATING_PARAMETERS: Entry(0 if factory else canopen.SCALING_ON, 2),
            canopen.UNITS_PER_TURN: Entry(disc if factory else units),
            canopen.TOTAL_RANGE: Entry(disc if factory else units),
            canopen.POSITION: Entry(0, writable=False),
            canopen.CYCLIC_TIMER: Entry(0, 2),
            canopen.DISC_UNITS_PER_TURN: Entry(disc, writable=False),
        }

    def _check_state(self, key: Key, value: int) -> None:
        """Refuse what CiA 301 does not allow while the TPDO, or its mapping, is in use."""
        index, subindex = key
        off = bool(self._value(self._parameters, canopen.TPDO_IDENTIFIER) & canopen.TPDO_OFF)
        if index == self._mapping:
            if not off or (subindex and self._value(self._mapping, 0)):
                raise SdoAbortError(canopen.SDO_WRONG_STATE)
        elif key == (self._parameters, canopen.TPDO_IDENTIFIER) and not off:
            present = self._value(*key)
            if (present ^ value) & canopen.TPDO_ID_MASK:
                raise SdoAbortError(canopen.SDO_WRONG_STATE)

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
