# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Wanted objects of a CANopen node: compare, write, store and verify them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_network import Node
from spm_haptic_master.encoders.encoder_layout import EncoderLayout
from spm_haptic_master.exceptions import InputError, SetupError

# Largest value of an UNSIGNED16 (ms).
TIME_MAXIMUM = 0xFFFF


@dataclass(frozen=True, slots=True)
class WantedObject:
    """An object and the value that it is wanted to have."""

    index: int
    subindex: int
    size: int  # bytes
    name: str  # a few words
    value: int
    mask: int = 0xFFFFFFFF  # bits that count; the others are left as they are
    optional: bool = False  # a node without this object is also as wanted
    hexadecimal: bool = False  # its value is usually written so
    of_device: bool = False  # the value belongs to the device: compared and never written

    def holds(self, present: int | None) -> bool:
        """Return whether a value is as wanted; None stands for no such object."""
        return self.optional if present is None else not (present ^ self.value) & self.mask

    def changed(self, present: int) -> int:
        """Return the value to write in place of a present one."""
        return present & ~self.mask | self.value

    def difference(self, present: int | None) -> str:
        """Return the object, a value that is not as configured, and the wanted one, in words."""
        form = '0x{:X}' if self.hexadecimal else '{}'
        shown = 'missing' if present is None else form.format(present & self.mask)
        return (
            f'0x{self.index:04X}:{self.subindex:02X} {self.name}: {shown}, '
            f'wanted {form.format(self.value)}'
        )


@dataclass(frozen=True, slots=True)
class WantedPdo:
    """The objects of one PDO."""

    identifier: WantedObject  # it is off while the others are written
    parameters: tuple[WantedObject, ...]
    # First the number of its entries; empty where it cannot be derived.
    mapping: tuple[WantedObject, ...]

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (self.identifier, *self.parameters, *self.mapping)


@dataclass(frozen=True, slots=True)
class WantedObjects:
    """The objects of one node."""

    pdos: tuple[WantedPdo, ...]
    others: tuple[WantedObject, ...]

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (*(each for pdo in self.pdos for each in pdo.every), *self.others)


def wanted_objects(
    layout: EncoderLayout, node_id: int, synchronised: bool, period: float, heartbeat: float
) -> WantedObjects:
    """
    Return the wanted objects of an encoder.

    Unless `synchronised` by SYNC it sends by itself with a `period`, s; its heartbeats are
    `heartbeat` s apart. InputError for a time that no object can hold.
    """
    base = layout.can_id - node_id
    known = not layout.extended and base in canopen.TPDO_BASES
    number = canopen.TPDO_BASES.index(base) if known else 0
    name, parameters = f'TPDO{number + 1}', canopen.TPDO_PARAMETERS + number
    timer = 0 if synchronised else milliseconds('1 / rate', period)
    # A frame with nothing but the 32 bits of the position has a known mapping.
    plain = (layout.data_length, layout.byte_offset, layout.bit_length, layout.byte_order) == (
        4,
        0,
        32,
        'little',
    )
    index, subindex = canopen.POSITION
    return WantedObjects(
        pdos=(
            wanted_pdo(
                parameters,
                name,
                layout.can_id | (canopen.TPDO_EXTENDED if layout.extended else 0),
                canopen.EVERY_SYNC if synchronised else canopen.EVENT_DRIVEN,
                (
                    WantedObject(
                        parameters,
                        canopen.TPDO_INHIBIT_TIME,
                        2,
                        f'{name} inhibit time',
                        0,
                        optional=True,
                    ),
                    WantedObject(
                        parameters,
                        canopen.TPDO_EVENT_TIMER,
                        2,
                        f'{name} event timer',
                        0,
                        optional=True,
                    ),
                ),
                [index << 16 | subindex << 8 | 32] if plain else [],
            ),
        ),
        others=(
            *other_tpdos_off(number),
            WantedObject(
                *canopen.HEARTBEAT_TIME,
                2,
                'heartbeat time, ms',
                milliseconds('--heartbeat', heartbeat),
            ),
            WantedObject(
                *canopen.OPERATING_PARAMETERS,
                2,
                'scaling on (bit 2)',
                canopen.SCALING_ON,
                canopen.SCALING_ON,
            ),
            WantedObject(*canopen.UNITS_PER_TURN, 4, 'units per turn', layout.counts_per_turn),
            # Where a mask selects the turn, the position may also count turns.
            *(
                []
                if layout.mask
                else [WantedObject(*canopen.TOTAL_RANGE, 4, 'total range', layout.counts_per_turn)]
            ),
            WantedObject(
                *canopen.CYCLIC_TIMER, 2, 'cyclic timer, ms', timer, optional=synchronised
            ),
        ),
    )


def milliseconds(name: str, seconds: float) -> int:
    """Return a time in ms; InputError if it is not whole, or no object can hold it."""
    value = 1e3 * seconds
    if not (1.0 <= value <= TIME_MAXIMUM and abs(value - round(value)) < 1e-6 * value):
        raise InputError(
            f'{name} {seconds:g} s; expected whole milliseconds, 0.001 to '
            f'{1e-3 * TIME_MAXIMUM:g} s'
        )
    return round(value)


def wanted_pdo(
    index: int,
    name: str,
    identifier: int,
    transmission: int,
    times: Iterable[WantedObject],
    entries: list[int],
) -> WantedPdo:
    """Return a PDO by the index of its parameters and the entries of its mapping, if known."""
    mapping = index - canopen.RPDO_PARAMETERS + canopen.RPDO_MAPPING
    return WantedPdo(
        WantedObject(
            index,
            canopen.TPDO_IDENTIFIER,
            4,
            f'{name} identifier',
            identifier,
            canopen.TPDO_OFF | canopen.TPDO_EXTENDED | canopen.TPDO_ID_MASK,
            hexadecimal=True,
        ),
        (
            WantedObject(index, canopen.TPDO_TYPE, 1, f'{name} transmission type', transmission),
            *times,
        ),
        (
            WantedObject(mapping, 0, 1, f'{name} mapped objects', len(entries)),
            *(
                WantedObject(mapping, number, 4, f'{name} mapping', entry, hexadecimal=True)
                for number, entry in enumerate(entries, start=1)
            ),
        )
        if entries
        else (),
    )


def other_tpdos_off(used: int) -> list[WantedObject]:
    """Return the identifiers of all TPDOs but one, counted from 0: off."""
    return [
        WantedObject(
            canopen.TPDO_PARAMETERS + number,
            canopen.TPDO_IDENTIFIER,
            4,
            f'TPDO{number + 1} off',
            canopen.TPDO_OFF,
            canopen.TPDO_OFF,
            optional=True,
            hexadecimal=True,
        )
        for number in range(len(canopen.TPDO_BASES))
        if number != used
    ]


def identity(node: Node, profile: int) -> str:
    """Return device type and identity of a node in words; SetupError for another profile."""
    kind = canopen.PROFILES[profile]
    device_type, _ = node.read(*canopen.DEVICE_TYPE)
    if device_type is None or device_type & 0xFFFF != profile:
        shown = 'none' if device_type is None else f'0x{device_type:08X}'
        raise SetupError(
            f'node {node.node_id} has device type {shown}; expected profile {profile} ({kind})'
        )
    known = {name: node.read(*key)[0] for key, name in canopen.IDENTITY.items()}
    return f'{kind} 0x{device_type:08X}, ' + ', '.join(
        f'{name} 0x{value:X}' for name, value in known.items() if value is not None
    )


def differences(node: Node, wanted: WantedObjects) -> dict[WantedObject, int | None]:
    """Return the values of the objects that are not as configured; None for no such object."""
    values = {each: node.read(each.index, each.subindex)[0] for each in wanted.every}
    return {each: value for each, value in values.items() if not each.holds(value)}


def words(found: dict[WantedObject, int | None]) -> list[str]:
    """Return a line for each object that is not as configured."""
    return [each.difference(value) for each, value in found.items()]


def write(node: Node, wanted: WantedObjects, found: dict[WantedObject, int | None]) -> None:
    """Write, store, reset and read back what differs, or SetupError; ends pre-operational."""
    missing = words(
        {each: value for each, value in found.items() if value is None or each.of_device}
    )
    if missing:
        raise SetupError(f'node {node.node_id}: {"; ".join(missing)}')
    node.command(canopen.NMT_PRE_OPERATIONAL)
    for pdo in wanted.pdos:
        if found.keys() & set(pdo.every):
            _write_pdo(node, pdo)
    for each in wanted.others:
        _write(node, each)
    _verify(node, wanted, 'after they were written')
    node.store()
    node.reset()
    _verify(node, wanted, 'after storing and a reset')


def _write_pdo(node: Node, wanted: WantedPdo) -> None:
    """Write a PDO in the order of CiA 301: off, parameters, mapping, on again."""
    identifier = wanted.identifier
    present, size = node.read(identifier.index, identifier.subindex)
    if present is None:
        raise SetupError(f'node {node.node_id}: no {identifier.name}')
    node.write(identifier.index, identifier.subindex, present | canopen.TPDO_OFF, size)
    for each in wanted.parameters:
        _write(node, each)
    if any(not each.holds(node.read(each.index, each.subindex)[0]) for each in wanted.mapping):
        count, *entries = wanted.mapping
        node.write(count.index, count.subindex, 0, count.size)
        for each in (*entries, count):
            node.write(each.index, each.subindex, each.value, each.size)
    # The identifier must not change while the PDO is on: first the identifier, then the bit.
    changed = identifier.changed(present)
    node.write(identifier.index, identifier.subindex, changed | canopen.TPDO_OFF, size)
    node.write(identifier.index, identifier.subindex, changed, size)


def _write(node: Node, wanted: WantedObject) -> None:
    """Write an object that the node has and that is not as configured."""
    present, size = node.read(wanted.index, wanted.subindex)
    if present is not None and not wanted.holds(present):
        node.write(wanted.index, wanted.subindex, wanted.changed(present), size)


def _verify(node: Node, wanted: WantedObjects, when: str) -> None:
    if found := words(differences(node, wanted)):
        raise SetupError(f'node {node.node_id}: not as configured {when}: ' + '; '.join(found))
