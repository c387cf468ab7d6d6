# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Simulated CANopen encoders (CiA 301, 406): frames in, frames out; without clock and bus.

What they send follows from their objects, so that set-up and scan can be tested.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import can
from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.simulation.device_quirks import NO_QUIRKS, Quirks
from spm_haptic_master.simulation.object_store import (
    Entry,
    heartbeat,
    identity,
    is_nmt_command,
    is_sdo_request,
    Key,
    ObjectStore,
    RESETS,
    SdoAbortError,
    STATES,
    STORES_ON_COMMAND,
)

# Device type of the nodes: an encoder with absolute single-turn resolution (CiA 406).
DEVICE_TYPE = 1 << 16 | canopen.ENCODER_PROFILE
# Units of the disc to one configured count: without scaling the counts go beyond a turn.
DISC_UNITS = 4
# Mapped position (32 bits): index, subindex and bits, as in an entry of a mapping object.
MAPPED_POSITION = 0x6004_00_20
# Mapped speed (16 bits), which the maker's defaults put behind the position.
MAPPED_SPEED = 0x6030_01_10
# Entries of the mapping object.
MAPPING_ENTRIES = 4
# The two timers that some devices have as one value.
TIMERS = ((canopen.TPDO_PARAMETERS, canopen.TPDO_EVENT_TIMER), canopen.CYCLIC_TIMER)
# Time after a SYNC, in supervised periods, after which a node leaves OPERATIONAL; its emergency.
SYNC_PATIENCE = 1.5
NO_SYNC_CODE = 0x8100
NO_SYNC_REGISTER = 0x11


@dataclass(frozen=True, slots=True)
class NodeOptions:
    """
    How simulated encoders behave.

    Attributes
    ----------
    synchronised : bool
        Whether they answer SYNC; otherwise they send by themselves.
    factory : bool
        Whether they have their maker's defaults, and are not set up.
    heartbeat : float
        Time between heartbeats, s; 0 for none.
    period : float
        Time between two cycles of the bus, s.

    """

    synchronised: bool = True
    factory: bool = False
    heartbeat: float = 0.1
    period: float = 1e-3


class SimulatedNode(ObjectStore):
    """
    One encoder with NMT states, objects by SDO, heartbeat and a TPDO on SYNC.

    Parameters
    ----------
    layout : EncoderLayout
        Frame that its TPDO has once it is set up.
    node_id : int or None
        CANopen node id; None for an encoder that only answers SYNC.
    options : NodeOptions
        How it behaves.
    quirks : Quirks
        What it does as other makers' devices do.

    Attributes
    ----------
    layout : EncoderLayout
        Frame that it sends at present, by its objects.
    heartbeat_period : float
        Time between heartbeats, s; 0 for none.
    node_id : int or None
        Its node id; a quirk may make it another one than configured.
    state : int
        NMT state.
    _identifier : int
        Identifier of the TPDO.
    _sends : bool
        Whether the TPDO goes out in the cycle of the bus.
    _more : int
        Number of bytes mapped behind the position.

    """

    layout: EncoderLayout
    heartbeat_period: float
    _identifier: int
    _sends: bool
    _more: int

    def __init__(
        self,
        layout: EncoderLayout,
        node_id: int | None,
        options: NodeOptions,
        quirks: Quirks = NO_QUIRKS,
    ):
        serial = node_id or 0
        if node_id is not None:
            other = quirks.value('node_id', node_id)
            layout = replace(layout, can_id=layout.can_id - node_id + other)
            node_id = other
        self.node_id = node_id
        self.state = canopen.PRE_OPERATIONAL
        if node_id is None:
            self.state = canopen.OPERATIONAL
        self._quirks = quirks
        self._sent = 0
        # Time of the latest SYNC, s; None before the first, and after it left because of one.
        self._synced: float | None = None
        # The layout once it is set up.
        self._layout = layout
        self._type = canopen.EVENT_DRIVEN
        if options.synchronised:
            self._type = canopen.EVERY_SYNC
        base = layout.can_id - (node_id or 0)
        number = 0
        if base in canopen.TPDO_BASES:
            number = canopen.TPDO_BASES.index(base)
        self._parameters = canopen.TPDO_PARAMETERS + number
        self._mapping = canopen.TPDO_MAPPING + number
        objects = identity(DEVICE_TYPE, serial)
        objects |= self._pdo(options)
        objects |= self._others(options)
        super().__init__(_as_of_maker(objects, quirks))
        self.put(canopen.ERROR_REGISTER, quirks.value('error', 0))

    def _pdo(self, options: NodeOptions) -> dict[Key, Entry]:
        """Return the objects of the TPDO with the position."""
        layout = self._layout
        parameters = self._parameters
        mapping = self._mapping
        if options.factory:
            identifier = canopen.TPDO_BASES[0] + (self.node_id or 0)
            kind = canopen.EVENT_DRIVEN
            mapped = [MAPPED_POSITION, MAPPED_SPEED]
        else:
            identifier = layout.can_id
            if layout.extended:
                identifier |= canopen.TPDO_EXTENDED
            kind = self._type
            mapped = [MAPPED_POSITION]
        entries = {
            (parameters, canopen.TPDO_IDENTIFIER): Entry(identifier | canopen.TPDO_NO_REQUEST),
            (parameters, canopen.TPDO_TYPE): Entry(kind, size=1),
            (parameters, canopen.TPDO_INHIBIT_TIME): Entry(0, size=2),
            (parameters, canopen.TPDO_EVENT_TIMER): Entry(0, size=2),
            (mapping, 0): Entry(len(mapped), size=1),
        }
        for place in range(1, MAPPING_ENTRIES + 1):
            entries[mapping, place] = Entry(0)
        for place, entry in enumerate(mapped, start=1):
            entries[mapping, place] = Entry(entry)
        return entries

    def _others(self, options: NodeOptions) -> dict[Key, Entry]:
        """Return the objects of SYNC, heartbeat, storing and scaling."""
        counts = self._layout.counts_per_turn
        disc = DISC_UNITS * counts
        units = counts
        scaling = canopen.SCALING_ON
        beat = options.heartbeat
        if options.factory:
            units = disc
            scaling = 0
            beat = 0.0
        supervised = 0.0
        if self._quirks.has('supervises_sync'):
            supervised = options.period
        return {
            canopen.SYNC_IDENTIFIER: Entry(canopen.SYNC_ID),
            canopen.SYNC_PERIOD: Entry(round(1e6 * supervised)),
            canopen.SYNC_COUNTER: Entry(0, size=1),
            canopen.STORE: Entry(STORES_ON_COMMAND),
            canopen.HEARTBEAT_TIME: Entry(round(beat * 1e3), size=2),
            canopen.OPERATING_PARAMETERS: Entry(scaling, size=2),
            canopen.UNITS_PER_TURN: Entry(units),
            canopen.TOTAL_RANGE: Entry(units),
            canopen.POSITION: Entry(0, writable=False),
            canopen.CYCLIC_TIMER: Entry(0, size=2),
            canopen.DISC_UNITS_PER_TURN: Entry(disc, writable=False),
        }

    def boot(self) -> list[can.Message]:
        """Restart with the stored objects; return the boot-up message."""
        if self.node_id is None:
            return []
        self.restart()
        self.put(canopen.ERROR_REGISTER, self._quirks.value('error', 0))
        self._synced = None
        self.state = canopen.PRE_OPERATIONAL
        return [heartbeat(self.node_id, canopen.BOOT_UP)]

    def receive(self, message: can.Message) -> list[can.Message]:
        """
        Obey an NMT command, or answer an SDO request.

        Parameters
        ----------
        message : can.Message
            Any data frame with an 11-bit identifier.

        Returns
        -------
        list of can.Message
            Answer or boot-up message; empty for a frame that is for others.

        """
        identifier = message.arbitration_id
        data = bytes(message.data)
        if self.node_id is None:
            return []
        if is_nmt_command(identifier, data, self.node_id):
            return self._command(data[0])
        if not is_sdo_request(identifier, data, self.node_id):
            return []
        if self.state == canopen.STOPPED or data[0] == canopen.SDO_ABORT:
            return []
        answer = self.answer(self.node_id, data)
        return [answer]

    def sample(self, angle: float, counter_stuck: bool = False) -> list[can.Message]:
        """
        Return the TPDO, if the node is operational and set up to send it.

        Parameters
        ----------
        angle : float
            Reading of the encoder, rad.
        counter_stuck : bool
            Whether the rolling counter stays as it is: a fault.

        """
        if self.state != canopen.OPERATIONAL or not self._sends:
            return []
        if not counter_stuck:
            self._sent += 1
        counts = self.layout.data(angle, self._sent)
        answer = can.Message(
            arbitration_id=self._identifier,
            is_extended_id=self.layout.extended,
            data=counts + bytes(self._more),
        )
        return [answer]

    def sync(self, now: float) -> list[can.Message]:
        """Note a SYNC at a time, s; return the emergency that ends with it."""
        register = self.value(*canopen.ERROR_REGISTER)
        returned = self._synced is None and register == NO_SYNC_REGISTER
        self._synced = now
        if not returned or self.node_id is None:
            return []
        self.put(canopen.ERROR_REGISTER, 0)
        ended = canopen.emcy(self.node_id, canopen.EMCY_ERROR_RESET, 0)
        return [ended]

    def supervise(self, now: float) -> list[can.Message]:
        """Leave OPERATIONAL where SYNC is supervised and missing; return the emergency."""
        patience = 1e-6 * SYNC_PATIENCE * self.value(*canopen.SYNC_PERIOD)
        synced = self._synced
        if not patience or synced is None or self.node_id is None:
            return []
        if now - synced <= patience or self.state != canopen.OPERATIONAL:
            return []
        self.state = canopen.PRE_OPERATIONAL
        self._synced = None
        self.put(canopen.ERROR_REGISTER, NO_SYNC_REGISTER)
        missed = canopen.emcy(self.node_id, NO_SYNC_CODE, NO_SYNC_REGISTER)
        return [missed]

    def _command(self, command: int) -> list[can.Message]:
        """Follow an NMT command; return the boot-up message after a reset."""
        if command in RESETS:
            return self.boot()
        self.state = STATES.get(command, self.state)
        return []

    def _check_state(self, key: Key, value: int) -> None:
        """Refuse a wrong value, and what CiA 301 does not allow while the TPDO is in use."""
        if key == canopen.STORE and self._quirks.has('store_refused'):
            raise SdoAbortError(canopen.SDO_NOT_STORED)
        if key[0] == self._mapping:
            self._check_mapping(key[1], value)
        elif key == (self._parameters, canopen.TPDO_IDENTIFIER):
            changed = (self.value(*key) ^ value) & canopen.TPDO_ID_MASK
            if changed and not self._is_off:
                raise SdoAbortError(canopen.SDO_WRONG_STATE)
        elif key == canopen.UNITS_PER_TURN and not value:
            raise SdoAbortError(canopen.SDO_WRONG_VALUE)

    @property
    def _is_off(self) -> bool:
        """Whether the TPDO is off."""
        identifier = self.value(self._parameters, canopen.TPDO_IDENTIFIER)
        return bool(identifier & canopen.TPDO_OFF)

    def _check_mapping(self, subindex: int, value: int) -> None:
        """Refuse an entry of the mapping while that or the TPDO is in use."""
        if not subindex and value > MAPPING_ENTRIES:
            raise SdoAbortError(canopen.SDO_WRONG_VALUE)
        is_mapped = subindex and self.value(self._mapping, 0)
        if not self._is_off or is_mapped:
            raise SdoAbortError(canopen.SDO_WRONG_STATE)

    def _written(self, key: Key, value: int) -> None:
        """Give both timers one value, if the encoder has only one of them."""
        if self._quirks.has('one_timer') and key in TIMERS:
            for timer in TIMERS:
                self.put(timer, value)

    def _derive(self) -> None:
        """Derive frame, heartbeat and resolution from the objects of the TPDO, 1017h and 6000h."""
        identifier = self.value(self._parameters, canopen.TPDO_IDENTIFIER)
        self._identifier = identifier & canopen.TPDO_ID_MASK
        mapped = self.mapped(self._mapping)
        kind = self.value(self._parameters, canopen.TPDO_TYPE)
        has_position = MAPPED_POSITION in mapped[:1]
        self._sends = not self._is_off and has_position and kind == self._type
        bits_of_others = sum(entry & 0xFF for entry in mapped[1:])
        self._more = bits_of_others // 8
        self.heartbeat_period = 1e-3 * self.value(*canopen.HEARTBEAT_TIME)
        if self.value(*canopen.OPERATING_PARAMETERS) & canopen.SCALING_ON:
            units = self.value(*canopen.UNITS_PER_TURN)
        else:
            units = self.value(*canopen.DISC_UNITS_PER_TURN)
        layout = self._layout
        zero_count = layout.zero_count * units // layout.counts_per_turn
        self.layout = replace(layout, counts_per_turn=units, zero_count=zero_count)


def _as_of_maker(objects: dict[Key, Entry], quirks: Quirks) -> dict[Key, Entry]:
    """Return objects without those that a device lacks, and read-only as it has them."""
    found = {}
    for key, entry in objects.items():
        if quirks.concern('missing', key):
            continue
        if quirks.concern('read_only', key):
            found[key] = replace(entry, writable=False)
        else:
            found[key] = entry
    return found
