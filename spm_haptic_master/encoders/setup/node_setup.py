# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compare the objects of a node with what they have to be; write, store and verify them."""

from __future__ import annotations

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.setup.canopen_network import Node
from spm_haptic_master.encoders.wanted_object import WantedObject, WantedObjects, WantedPdo
from spm_haptic_master.exceptions import SetupError

# Mask of a CiA 301 device type: the device profile.
PROFILE_MASK = 0xFFFF


def identity(node: Node, profile: int) -> str:
    """Return device type and identity of a node in words; SetupError for another profile."""
    kind = canopen.PROFILE_WORDS[profile]
    device_type = node.read(*canopen.DEVICE_TYPE)
    if device_type is None or device_type & PROFILE_MASK != profile:
        shown = 'none' if device_type is None else f'0x{device_type:08X}'
        raise SetupError(f'node {node.node_id} has device type {shown}; expected {kind} '
                         f'(profile {profile})')
    known = {name: node.read(*key) for key, name in canopen.IDENTITY.items()
             if key != canopen.DEVICE_TYPE}
    return f'{kind.split()[-1]} 0x{device_type:08X}, ' + ', '.join(
        f'{name} 0x{value:X}' for name, value in known.items() if value is not None)


def differences(node: Node, wanted: WantedObjects) -> dict[WantedObject, int | None]:
    """Return the present values, None for no such object, of what is not as wanted."""
    values = {each: node.read(each.index, each.subindex) for each in wanted.every}
    return {each: value for each, value in values.items() if not each.holds(value)}


def words(found: dict[WantedObject, int | None]) -> list[str]:
    """Return in a line each what is not as wanted."""
    return [each.difference(value) for each, value in found.items()]


def write(node: Node, wanted: WantedObjects, found: dict[WantedObject, int | None]) -> None:
    """
    Write what was found different, store it, reset the node, and read everything back.

    The node is pre-operational afterwards. SetupError if it does not keep a value.
    """
    missing = words({each: value for each, value in found.items()
                     if value is None or each.of_device})
    if missing:
        raise SetupError(f'node {node.node_id}: {"; ".join(missing)}')
    node.command(canopen.NMT_PRE_OPERATIONAL)
    for pdo in wanted.pdos:
        if found.keys() & set(pdo.every):
            _write_pdo(node, pdo)
    for each in wanted.others:
        if each in found:
            _write(node, each)
    _verify(node, wanted, 'after they were written')
    node.store()
    node.reset()
    _verify(node, wanted, 'after storing and a reset')


def _write_pdo(node: Node, wanted: WantedPdo) -> None:
    """Write a PDO in the order of CiA 301: off, parameters, mapping, on again."""
    identifier = wanted.identifier
    present, size = node.read_sized(identifier.index, identifier.subindex)
    if present is None:
        raise SetupError(f'node {node.node_id}: no {identifier.name}')
    node.write(identifier.index, identifier.subindex, present | canopen.TPDO_OFF, size)
    for each in wanted.parameters:
        _write(node, each)
    if any(not each.holds(node.read(each.index, each.subindex)) for each in wanted.mapping):
        count, *entries = wanted.mapping
        node.write(count.index, count.subindex, 0, count.size)
        for each in (*entries, count):
            node.write(each.index, each.subindex, each.value, each.size)
    # The identifier must not change while the PDO is on: first the identifier, then the bit.
    changed = identifier.changed(present)
    node.write(identifier.index, identifier.subindex, changed | canopen.TPDO_OFF, size)
    node.write(identifier.index, identifier.subindex, changed, size)


def _write(node: Node, wanted: WantedObject) -> None:
    """Write an object that the node has and that is not as wanted."""
    present, size = node.read_sized(wanted.index, wanted.subindex)
    if present is not None and not wanted.holds(present):
        node.write(wanted.index, wanted.subindex, wanted.changed(present), size)


def _verify(node: Node, wanted: WantedObjects, when: str) -> None:
    if found := words(differences(node, wanted)):
        raise SetupError(f'node {node.node_id}: not as wanted {when}: ' + '; '.join(found))
