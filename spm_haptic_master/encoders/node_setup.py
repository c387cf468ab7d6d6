# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Wanted objects of a CANopen node: compare, write, store and verify them.

At the end a node is as wanted, stored and read back; otherwise the error names its state.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.canopen_network import NodeClient, RefusedError
from spm_haptic_master.exceptions import SetupError

# Index and subindex of an object, and a function of them that returns its value, None without.
Key = tuple[int, int]
Present = Callable[[int, int], int | None]
# Subindices of a mapping: the number of its entries, and these (CiA 301 allows 64).
ENTRIES = range(9)


@dataclass(frozen=True, slots=True)
class WantedObject:
    """
    An object and the value that it is wanted to have.

    Attributes
    ----------
    index, subindex : int
        The object.
    size : int
        Its size, bytes.
    name : str
        A few words for texts.
    value : int
        Wanted value, unsigned.
    mask : int
        Bits that count; the others are left as they are. With 0 the object only has to be there.
    optional : bool
        Whether a node without this object is also as wanted.
    hexadecimal : bool
        Whether its value is usually written so.
    of_device : bool
        Whether the value belongs to the device: it is compared and never written.
    also : tuple of int
        Further values that are as good.

    """

    index: int
    subindex: int
    size: int
    name: str
    value: int
    mask: int = 0xFFFFFFFF
    optional: bool = False
    hexadecimal: bool = False
    of_device: bool = False
    also: tuple[int, ...] = ()

    @property
    def key(self) -> Key:
        """Return index and subindex."""
        return self.index, self.subindex

    @property
    def address(self) -> str:
        """Return index and subindex as they are usually written, such as '0x1018:04'."""
        return canopen.object_name(*self.key)

    def holds(self, present: int | None) -> bool:
        """Return whether a value is as wanted; None stands for no such object."""
        if present is None:
            return self.optional
        return present in self.also or not (present ^ self.value) & self.mask

    def changed(self, present: int) -> int:
        """Return the value to write in place of a present one."""
        return present & ~self.mask | self.value

    def difference(self, present: int | None) -> str:
        """Return the object, a value that is not as configured, and the wanted one, in words."""
        if present is None:
            shown = 'missing'
        else:
            shown = self.shown(present & self.mask)
        if self.mask:
            wanted = self.shown(self.value)
        else:
            wanted = 'any value'
        return f'{self.address} {self.name}: {shown}, wanted {wanted}'

    def shown(self, value: int) -> str:
        """Return a value as it is usually written."""
        return f'0x{value:X}' if self.hexadecimal else f'{value}'


@dataclass(frozen=True, slots=True)
class WantedPdo:
    """
    The objects of one PDO.

    Attributes
    ----------
    identifier : WantedObject
        Identifier with its bits (1400h:01 or 1800h:01); the PDO is off while the others are
        written.
    parameters : tuple of WantedObject
        Transmission type and times.
    mapping : tuple of WantedObject
        First the number of its entries; empty where it cannot be derived.

    """

    identifier: WantedObject
    parameters: tuple[WantedObject, ...]
    mapping: tuple[WantedObject, ...]

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (self.identifier, *self.parameters, *self.mapping)


class Rules:
    """
    Rules for the objects of a node, taken together; these are none.

    `value` returns the present value of an object by index and subindex, None if the node has
    none.
    """

    def excused(self, value: Present) -> set[Key]:
        """Return the keys of objects whose values do not matter, as others are right."""
        return set()

    def adapted(self, wanted: WantedObjects, value: Present) -> WantedObjects:
        """Return the wanted objects of a device that has these values."""
        return wanted

    def remarks(self, value: Present) -> list[str]:
        """Return in lines what no object of this node says or does."""
        return []

    def hint(self, key: Key, value: Present) -> str:
        """Return what to do about an object that cannot be written; empty if nothing is known."""
        return ''


@dataclass(frozen=True, slots=True)
class WantedObjects:
    """
    The objects of one node.

    Attributes
    ----------
    pdos : tuple of WantedPdo
        Its PDOs.
    others : tuple of WantedObject
        All other objects.
    rules : Rules
        Which differences do not matter, and what to do about the others.

    """

    pdos: tuple[WantedPdo, ...]
    others: tuple[WantedObject, ...]
    rules: Rules

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (*(each for pdo in self.pdos for each in pdo.every), *self.others)


def wanted_pdo(
    index: int,
    name: str,
    identifier: int,
    transmission: int,
    times: Iterable[WantedObject],
    entries: list[int],
) -> WantedPdo:
    """
    Return a PDO.

    Parameters
    ----------
    index : int
        Index of its communication parameters: 1400h or 1800h, plus its number.
    name : str
        Its name in texts, such as 'TPDO1'.
    identifier : int
        Identifier, with the bit for 29 bits.
    transmission : int
        Transmission type (CiA 301).
    times : iterable of WantedObject
        Inhibit time and event timer, if they matter.
    entries : list of int
        Entries of its mapping; empty if they are not known.

    """
    mapping: tuple[WantedObject, ...] = ()
    if entries:
        mapping = _mapping(index, name, entries)
    return WantedPdo(
        identifier=WantedObject(
            index=index,
            subindex=canopen.TPDO_IDENTIFIER,
            size=4,
            name=f'{name} identifier',
            value=identifier,
            mask=canopen.TPDO_OFF | canopen.TPDO_EXTENDED | canopen.TPDO_ID_MASK,
            hexadecimal=True,
        ),
        parameters=(
            WantedObject(
                index=index,
                subindex=canopen.TPDO_TYPE,
                size=1,
                name=f'{name} transmission type',
                value=transmission,
            ),
            *times,
        ),
        mapping=mapping,
    )


def _mapping(
    index: int,
    name: str,
    entries: list[int],
) -> tuple[WantedObject, ...]:
    """Return the objects that map the entries of a PDO, as `wanted_pdo` has them."""
    mapping = index - canopen.RPDO_PARAMETERS + canopen.RPDO_MAPPING
    count = WantedObject(
        index=mapping,
        subindex=0,
        size=1,
        name=f'{name} mapped objects',
        value=len(entries),
    )
    objects = [count]
    for number, entry in enumerate(entries, start=1):
        objects.append(
            WantedObject(
                index=mapping,
                subindex=number,
                size=4,
                name=f'{name} mapping',
                value=entry,
                hexadecimal=True,
            )
        )
    return tuple(objects)


def other_tpdos_off(used: int) -> list[WantedObject]:
    """Return the identifiers of all TPDOs but one, counted from 0: off."""
    return [
        WantedObject(
            index=canopen.TPDO_PARAMETERS + number,
            subindex=canopen.TPDO_IDENTIFIER,
            size=4,
            name=f'TPDO{number + 1} off',
            value=canopen.TPDO_OFF,
            mask=canopen.TPDO_OFF,
            optional=True,
            hexadecimal=True,
        )
        for number in range(len(canopen.TPDO_BASES))
        if number != used
    ]


def identity(node: NodeClient, profile: int) -> str:
    """
    Return device type and identity of a node in words.

    Parameters
    ----------
    node : NodeClient
        The node.
    profile : int
        Device profile that it has to have: 406 or 402.

    Raises
    ------
    SetupError
        It has another profile, or does not answer.

    """
    kind = canopen.PROFILES[profile]
    device_type, _ = node.read(*canopen.DEVICE_TYPE)
    if device_type is None or device_type & 0xFFFF != profile:
        shown = 'none' if device_type is None else f'0x{device_type:08X}'
        raise SetupError(
            f'node {node.node_id} has device type {shown}; expected profile {profile} ({kind})'
        )
    words = []
    for key, name in canopen.IDENTITY.items():
        value, _ = node.read(*key)
        if value is not None:
            words.append(f'{name} 0x{value:X}')
    return f'{kind} 0x{device_type:08X}, {", ".join(words)}'


@dataclass(frozen=True, slots=True)
class Comparison:
    """
    The wanted objects of a node beside those that it has.

    Attributes
    ----------
    wanted : WantedObjects
        Required objects.
    values : dict of (int, int) to (int or None)
        Present values by index and subindex; None for an object that it does not have.

    """

    wanted: WantedObjects
    values: dict[Key, int | None]

    def value(self, index: int, subindex: int) -> int | None:
        """Return the value of an object, None if the node has none."""
        return self.values.get((index, subindex))

    @property
    def different(self) -> dict[WantedObject, int | None]:
        """Return the objects that are not as wanted, and their values."""
        excused = self.wanted.rules.excused(self.value)
        found = {}
        for each in self.wanted.every:
            value = self.values[each.key]
            if each.key not in excused and not each.holds(value):
                found[each] = value
        return found

    @property
    def lines(self) -> list[str]:
        """Return a line for each object that is not as wanted."""
        return [each.difference(value) for each, value in self.different.items()]

    @property
    def hinted(self) -> list[str]:
        """Return these lines, with what is to be done about what cannot be written."""
        lines = []
        for each, value in self.different.items():
            line = each.difference(value)
            if value is None or each.of_device:
                line += self.hint(each.key)
            lines.append(line)
        return lines

    @property
    def remarks(self) -> list[str]:
        """Return in lines what the node does not have and need not have."""
        absent = [each for each in self.wanted.every if self.values[each.key] is None]
        need_not = [each.address for each in absent if each.optional]
        found = []
        if need_not:
            found.append(f'it has no {", ".join(need_not)}, and need not have')
        return found + self.wanted.rules.remarks(self.value)

    def hint(self, key: Key) -> str:
        """
        Return what to do about an object that cannot be written.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.

        Returns
        -------
        str
            The remedy behind a semicolon; empty if nothing is known.

        """
        hint = self.wanted.rules.hint(key, self.value)
        return f'; {hint}' if hint else ''


def compare(node: NodeClient, wanted: WantedObjects) -> Comparison:
    """
    Return the wanted objects beside those that a node has.

    Parameters
    ----------
    node : NodeClient
        The node, which is only read.
    wanted : WantedObjects
        Required objects.

    Raises
    ------
    SetupError
        It does not answer, or refuses to show an object that it has to have.

    """
    values = {each.key: _read(node, each) for each in wanted.every}
    wanted = wanted.rules.adapted(wanted, lambda index, subindex: values[index, subindex])
    return Comparison(wanted, values)


def _read(node: NodeClient, wanted: WantedObject) -> int | None:
    """Return the value of an object; for an optional one, None also where it is refused."""
    if wanted.optional:
        return _read_optional(node, wanted.key)
    return node.read(*wanted.key)[0]


def _read_optional(node: NodeClient, key: Key) -> int | None:
    """Return the value of an object, None where the node has none or refuses to show it."""
    try:
        return node.read(*key)[0]
    except RefusedError:
        return None


def write(node: NodeClient, found: Comparison) -> None:
    """
    Write what differs, store everything, reset the node and read it back.

    It ends pre-operational.

    Parameters
    ----------
    node : NodeClient
        The node.
    found : Comparison
        Its objects as `compare` found them.

    Raises
    ------
    SetupError
        The node does not do all of it: what was written is then undone by a reset, or the error
        says that it is not.

    """
    wanted = found.wanted
    impossible = []
    for each, value in found.different.items():
        if value is None or each.of_device:
            impossible.append(each.difference(value) + found.hint(each.key))
    if impossible:
        raise SetupError(f'node {node.node_id}: {"; ".join(impossible)}; nothing was written')
    if not node.can_store():
        raise SetupError(
            f'node {node.node_id} cannot store (0x1010:01): what is written would be lost without '
            'power; nothing was written'
        )
    node.command(canopen.NMT_PRE_OPERATIONAL)
    try:
        _write_different(node, found)
        _verify(node, wanted, 'after they were written')
        node.store()
    except SetupError as error:
        raise SetupError(f'{error}; {_put_back(node, found)}') from error
    node.reset()
    _verify(node, wanted, 'after storing and a reset')


def _write_different(node: NodeClient, found: Comparison) -> None:
    """Write the objects that are not as wanted, those of the PDOs first."""
    different = found.different
    for pdo in found.wanted.pdos:
        if different.keys() & set(pdo.every):
            _write_pdo(node, pdo, found)
    for each in found.wanted.others:
        # Objects may be two names of one value: what was written may have put this right.
        if each in different and each.key not in _excused(node, found.wanted):
            _write(node, each, found)


def _excused(node: NodeClient, wanted: WantedObjects) -> set[Key]:
    """Return the objects of a node, as it is now, whose values do not matter."""
    return wanted.rules.excused(lambda index, subindex: _read_optional(node, (index, subindex)))


def _put_back(node: NodeClient, before: Comparison) -> str:
    """Reset a node that was not set up; return in words whether it is as before."""
    try:
        node.reset()
        undone = compare(node, before.wanted).values == before.values
    except SetupError:
        undone = False
    if undone:
        return 'not stored: a reset has undone what was written'
    return 'half written, and not stored: power-cycle it'


def _write_pdo(
    node: NodeClient,
    wanted: WantedPdo,
    found: Comparison,
) -> None:
    """Write a PDO in the order of CiA 301: off, parameters, mapping, on again."""
    identifier = wanted.identifier
    present, size = node.read(identifier.index, identifier.subindex)
    if present is None:
        raise SetupError(f'node {node.node_id}: no {identifier.name}')
    size = size or identifier.size
    node.write(identifier.index, identifier.subindex, present | canopen.TPDO_OFF, size)
    for each in wanted.parameters:
        _write(node, each, found)
    if any(not each.holds(_read(node, each)) for each in wanted.mapping):
        _write_mapping(node, wanted, found)
    # The identifier must not change while the PDO is on: first the identifier, then the bit.
    changed = identifier.changed(present)
    node.write(identifier.index, identifier.subindex, changed | canopen.TPDO_OFF, size)
    node.write(identifier.index, identifier.subindex, changed, size)


def _write_mapping(
    node: NodeClient,
    wanted: WantedPdo,
    found: Comparison,
) -> None:
    """
    Write a mapping in the order of CiA 301: no entries, each entry, then their number.

    Raises
    ------
    RefusedError
        The node aborts; the text has the layout of the mapping that it has.

    """
    count, *entries = wanted.mapping
    try:
        node.write(count.index, count.subindex, 0, count.size)
        for each in (*entries, count):
            node.write(each.index, each.subindex, each.value, each.size)
    except RefusedError as error:
        values = dict(compare(node, found.wanted).values)
        for place in ENTRIES:
            key = (count.index, place)
            values[key] = _read_optional(node, key)
        hint = Comparison(found.wanted, values).hint(count.key)
        raise RefusedError(f'{error}{hint}') from error


def _write(
    node: NodeClient,
    wanted: WantedObject,
    found: Comparison,
) -> None:
    """Write an object that the node has and that is not as configured."""
    if _read(node, wanted) is None:
        return
    present, size = node.read(*wanted.key)
    if present is None or wanted.holds(present):
        return
    try:
        # An answer need not have its size.
        node.write(*wanted.key, wanted.changed(present), size or wanted.size)
    except RefusedError as error:
        raise RefusedError(f'{error}{found.hint(wanted.key)}') from error


def _verify(
    node: NodeClient,
    wanted: WantedObjects,
    when: str,
) -> None:
    """Read the node back; SetupError where it is not as configured."""
    lines = compare(node, wanted).lines
    if lines:
        raise SetupError(f'node {node.node_id}: not as configured {when}: ' + '; '.join(lines))
