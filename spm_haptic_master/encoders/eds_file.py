# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A maker's EDS file (CiA 306): what a device can be set to, before anything is sent to it.

The answer is only as good as the file: the device itself is compared by `node_setup`.
"""

from __future__ import annotations

import configparser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from spm_haptic_master.encoders.canopen_network import import_canopen
from spm_haptic_master.encoders.node_setup import (
    Comparison,
    Key,
    WantedObject,
    WantedObjects,
    WantedPdo,
)
from spm_haptic_master.exceptions import InputError

# Suffixes of the files that the library reads as an EDS.
SUFFIXES = ('.eds', '.dcf')
# Access of an object that an SDO can write, by CiA 306.
WRITABLE = ('rw', 'wo', 'rwr', 'rww')


@dataclass(frozen=True, slots=True)
class DescribedObject:
    """
    An object as its maker describes it.

    Attributes
    ----------
    size : int
        Its size, bytes.
    access : str
        Access by CiA 306: ro, wo, rw, rwr, rww or const.
    default : int or None
        Its default value; None where the file has none.
    least, greatest : int or None
        Its limits; None where the file has none.

    """

    size: int
    access: str
    default: int | None
    least: int | None
    greatest: int | None

    @property
    def writable(self) -> bool:
        """Return whether an SDO can write it."""
        return self.access in WRITABLE

    def takes(self, value: int) -> bool:
        """Return whether a value is within its limits."""
        if self.least is not None and value < self.least:
            return False
        return self.greatest is None or value <= self.greatest

    @property
    def words(self) -> str:
        """Return access, size and limits."""
        parts = [self.access, f'{self.size} bytes']
        if self.least is not None or self.greatest is not None:
            least = '' if self.least is None else f'{self.least}'
            greatest = '' if self.greatest is None else f'{self.greatest}'
            parts.append(f'{least} .. {greatest}')
        return ', '.join(parts)


class DeviceDescription:
    """
    The objects in an EDS file.

    Parameters
    ----------
    path : str
        The file, with one of SUFFIXES.
    node_id : int
        Node id, for values that depend on it ($NODEID).

    Attributes
    ----------
    name : str
        Vendor and product, or the path.

    Raises
    ------
    InputError
        The file cannot be read, or has no object.

    """

    def __init__(self, path: str, node_id: int):
        if Path(path).suffix.lower() not in SUFFIXES:
            raise InputError(f'{path}: not an EDS file; expected {" or ".join(SUFFIXES)}')
        try:
            self._dictionary: Any = import_canopen().import_od(path, node_id)
        except (OSError, ValueError, KeyError, AttributeError, configparser.Error) as error:
            reason = ' '.join(str(error).split())[:200] or type(error).__name__
            raise InputError(f'{path}: not a readable EDS file ({reason})') from error
        if not len(self._dictionary):
            raise InputError(f'{path}: no object in it; expected an EDS file')
        info = self._dictionary.device_information
        names = filter(None, (info.vendor_name, info.product_name))
        self.name = ' '.join(names) or path

    def find(self, index: int, subindex: int) -> DescribedObject | None:
        """
        Return an object; None if the device has none.

        Parameters
        ----------
        index, subindex : int
            The object.

        """
        variable = self._dictionary.get_variable(index, subindex)
        if variable is None:
            return None
        return DescribedObject(
            size=max(1, len(variable) // 8),
            access=variable.access_type,
            default=_number(variable.value, variable.default),
            least=_number(variable.min),
            greatest=_number(variable.max),
        )

    def typed(self, wanted: WantedObjects) -> WantedObjects:
        """
        Return wanted objects with the sizes that this device has.

        Parameters
        ----------
        wanted : WantedObjects
            Objects; those that the file does not have are left as they are.

        """

        def sized(each: WantedObject) -> WantedObject:
            found = self.find(*each.key)
            if found is None:
                return each
            return replace(each, size=found.size)

        def typed_pdo(pdo: WantedPdo) -> WantedPdo:
            return WantedPdo(
                identifier=sized(pdo.identifier),
                parameters=tuple(map(sized, pdo.parameters)),
                mapping=tuple(map(sized, pdo.mapping)),
            )

        pdos = tuple(map(typed_pdo, wanted.pdos))
        others = tuple(map(sized, wanted.others))
        return replace(wanted, pdos=pdos, others=others)

    def lines(self, wanted: WantedObjects) -> list[str]:
        """
        Return a line for each wanted object: what this device has, and what is wanted.

        Parameters
        ----------
        wanted : WantedObjects
            Required objects.

        """
        lines = []
        for each in wanted.every:
            found = self.find(*each.key)
            words = 'not in the EDS' if found is None else found.words
            lines.append(f'{each.address} {each.name}: {words}; wanted {each.shown(each.value)}')
        return lines

    def impossible(self, wanted: WantedObjects) -> list[str]:
        """
        Return what this device cannot be set to, from access, limits and defaults.

        Parameters
        ----------
        wanted : WantedObjects
            Required objects.

        Returns
        -------
        list of str
            A line for each object that cannot have its value; empty if nothing speaks against it.

        """
        values = {each.key: self._default(each.key) for each in wanted.every}
        defaults = Comparison(wanted, values)
        adapted = wanted.rules.adapted(wanted, defaults.value)
        defaults = replace(defaults, wanted=adapted)
        excused = wanted.rules.excused(defaults.value)
        lines = []
        for each in defaults.wanted.every:
            found = self.find(*each.key)
            if each.key in excused or (found is None and each.optional):
                continue
            if reason := _obstacle(each, found):
                lines.append(
                    f'{each.address} {each.name}: {reason}, wanted '
                    f'{each.shown(each.value)}{defaults.hint(each.key)}'
                )
        return lines

    def _default(self, key: Key) -> int | None:
        """Return the default value of an object; None without object or default."""
        found = self.find(*key)
        return None if found is None else found.default


def _obstacle(wanted: WantedObject, found: DescribedObject | None) -> str | None:
    """Return why an object cannot have the wanted value, None if nothing speaks against it."""
    if found is None:
        return 'not in the EDS'
    if found.default is not None and wanted.holds(found.default):
        return None
    if wanted.of_device or not found.writable:
        # Without a default value only the device can answer.
        if found.default is None:
            return None
        return f'{found.access}, {wanted.shown(found.default)}'
    written = wanted.changed(found.default or 0)
    if found.takes(written):
        return None
    return f'takes {found.words}'


def _number(*values: object) -> int | None:
    """Return the first value that is a number, None without one."""
    for value in values:
        if isinstance(value, int):
            return value
    return None
