# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An object of a CANopen node and the value that it has to have."""

from __future__ import annotations

from dataclasses import dataclass

# Bits of an object that all count.
ALL = (1 << 32) - 1


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
        Its name, in a few words.
    value : int
        Wanted value.
    mask : int
        Bits that count; the others are left as they are.
    optional : bool
        Whether a node without this object is as wanted, too.
    hexadecimal : bool
        Whether its value is usually written so.
    of_device : bool
        Whether the value belongs to the device: it is compared and never written.

    """

    index: int
    subindex: int
    size: int
    name: str
    value: int
    mask: int = ALL
    optional: bool = False
    hexadecimal: bool = False
    of_device: bool = False

    def text(self, value: int) -> str:
        """Return the bits of a value that count, as such a value is usually written."""
        return f'0x{value & self.mask:X}' if self.hexadecimal else str(value & self.mask)

    def holds(self, present: int | None) -> bool:
        """Return whether a value is as wanted; None stands for no such object."""
        return self.optional if present is None else not (present ^ self.value) & self.mask

    def changed(self, present: int) -> int:
        """Return the value to write in place of a present one."""
        return present & ~self.mask | self.value

    def difference(self, present: int | None) -> str:
        """Return the object, a value that is not as wanted, and the wanted one, in words."""
        shown = 'missing' if present is None else self.text(present)
        return (f'0x{self.index:04X}:{self.subindex:02X} {self.name}: {shown}, '
                f'wanted {self.text(self.value)}')


@dataclass(frozen=True, slots=True)
class WantedPdo:
    """
    The objects of one PDO.

    Attributes
    ----------
    identifier : WantedObject
        Its identifier, which is off while the others are written.
    parameters : tuple of WantedObject
        Its other parameters.
    mapping : tuple of WantedObject
        Its mapping, first the number of its entries; empty where it cannot be derived.

    """

    identifier: WantedObject
    parameters: tuple[WantedObject, ...]
    mapping: tuple[WantedObject, ...]

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (self.identifier, *self.parameters, *self.mapping)


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

    """

    pdos: tuple[WantedPdo, ...]
    others: tuple[WantedObject, ...]

    @property
    def every(self) -> tuple[WantedObject, ...]:
        """Return all objects in the order of their report."""
        return (*(each for pdo in self.pdos for each in pdo.every), *self.others)
