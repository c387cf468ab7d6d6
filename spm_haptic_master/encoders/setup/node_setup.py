# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compare the objects of a node with what they have to be; write, store and verify them."""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.encoders import canopen
from spm_haptic_master.encoders.setup.canopen_network import Node
from spm_haptic_master.encoders.wanted_object import WantedObject, WantedObjects, WantedPdo
from spm_haptic_master.exceptions import SetupError

# Mask of a CiA 301 device type: the device profile.
PROFILE_MASK = 0xFFFF


@dataclass(frozen=True, slots=True)
class Difference:
    """
    An object that is not as wanted.

    Attributes
    ----------
    wanted : WantedObject
        What it has to be.
    present : int or None
        Its value; None if the node has no such object.

    """

    wanted: WantedObject
    present: int | None

    def __str__(self) -> str:
        return self.wanted.difference(self.present)


def identity(node: Node, profile: int = canopen.ENCODER_PROFILE) -> str:
    """
    Return device type and identity of a node in words.

    Parameters
    ----------
    node : Node
        The node.
    profile : int
        Number of the device profile that it has to have: that of an encoder, or of a drive.

    Raises
    ------
    SetupError
        It does not answer, or has another profile.

    """
    kind = canopen.PROFILE_WORDS[profile]
    device_type = node.read(*canopen.DEVICE_TYPE)
    if device_type is None or device_type & PROFILE_MASK != profile:
        shown = 'none' if device_type is None else f'0x{device_type:08X}'
        raise SetupError(f'node {node.node_id} has device type {shown}; expected {kind} '
                         f'(profile {profile})')
    parts = {'vendor': canopen.VENDOR_ID, 'product': canopen.PRODUCT_CODE,
             'revision': canopen.REVISION, 'serial': canopen.SERIAL_NUMBER}
    known = {name: node.read(*key) for name, key in parts.items()}
    return f'{kind.split()[-1]} 0x{device_type:08X}, ' + ', '.join(
        f'{name} 0x{value:X}' for name, value in known.items() if value is not None)


def differences(node: Node, wanted: WantedObjects) -> list[Difference]:
    """
    Return the objects that are not as wanted.

    Raises
    ------
    SetupError
        The node does not answer, or refuses to be read.

    """
    found = []
    for each in wanted.every:
        present = node.read(each.index, each.subindex)
        if not each.holds(present):
            found.append(Difference(each, present))
    return found


def write(node: Node, wanted: WantedObjects, found: list[Difference]) -> None:
    """
    Write what differs, store it, reset the node, and read everything back.

    Parameters
    ----------
    node : Node
        The node; it is pre-operational afterwards.
    wanted : WantedObjects
        What its objects have to be.
    found : list of Difference
        What differs.

    Raises
    ------
    SetupError
        The node does not answer, refuses a value, or does not keep it.

    """
    missing = [str(each) for each in found if each.present is None or each.wanted.of_device]
    if missing:
        raise SetupError(f'node {node.node_id}: {"; ".join(missing)}')
    node.command(canopen.NMT_PRE_OPERATIONAL)
    different = {each.wanted for each in found}
    for pdo in wanted.pdos:
        if different.intersection(pdo.every):
            _write_pdo(node, pdo)
    for each in wanted.others:
        if each in different:
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
    found = differences(node, wanted)
    if found:
        raise SetupError(f'node {node.node_id}: not as wanted {when}: '
                         + '; '.join(map(str, found)))
