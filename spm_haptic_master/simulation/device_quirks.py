# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What simulated encoders do that other makers' devices do: KIND[:JOINT][=VALUE].

Set-up, scan and driver are tested against them, as real devices are not all alike.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
import re

from spm_haptic_master.encoders.canopen import NODE_ID_MAXIMUM
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.simulation.fault_injection import Kind
from spm_haptic_master.simulation.object_store import Key

# Kinds of quirks.
KINDS = {
    'phases': Kind('without SYNC each sends at a phase of its own (encoders.sync_id 0)'),
    'one_timer': Kind('6200h and 1800h:05 are one value'),
    'read_only': Kind(
        'an object cannot be written',
        unit='index or index:subindex, such as 0x6001',
    ),
    'missing': Kind(
        'an object does not exist',
        unit='index or index:subindex, such as 0x1017',
    ),
    'store_refused': Kind('storing (1010h) is refused'),
    'error': Kind(
        'an error stands from before the start',
        unit='error register, such as 0x10',
    ),
    'supervises_sync': Kind('it leaves OPERATIONAL 1.5 periods after a SYNC (1006h)'),
    'node_id': Kind(
        'it has another node id, such as that of others',
        unit=f'1 .. {NODE_ID_MAXIMUM}',
    ),
}
# Syntax of a quirk, for help texts and errors.
SYNTAX = 'KIND[:JOINT][=VALUE], of all encoders without JOINT'
_PATTERN = re.compile(r'(?P<kind>\w+)(:(?P<joint>joint_\w+))?(=(?P<value>\S+))?')


@dataclass(frozen=True, slots=True)
class Quirk:
    """
    One behaviour of one encoder, or of all.

    Attributes
    ----------
    kind : str
        One of KINDS.
    joint : int or None
        Index in ALL_JOINT_NAMES; None for all encoders.
    value : int
        A number, or the index of an object; 0 for a kind without a value.
    subindex : int or None
        Subindex of that object; None for each of its subindices.

    """

    kind: str
    joint: int | None
    value: int
    subindex: int | None = None

    def names(self, key: Key) -> bool:
        """
        Return whether the quirk is about an object.

        Parameters
        ----------
        key : tuple of 2 int
            Index and subindex.

        """
        index, subindex = key
        if index != self.value:
            return False
        return self.subindex in (None, subindex)


@dataclass(frozen=True, slots=True)
class Quirks:
    """
    The quirks of one encoder.

    Attributes
    ----------
    every : tuple of Quirk
        All of them, also those that concern all encoders.

    """

    every: tuple[Quirk, ...] = ()

    def has(self, kind: str) -> bool:
        """Return whether it has a quirk of a kind."""
        return any(quirk.kind == kind for quirk in self.every)

    def value(self, kind: str, default: int) -> int:
        """Return the value of its first quirk of a kind; the default without one."""
        for quirk in self.every:
            if quirk.kind == kind:
                return quirk.value
        return default

    def concern(self, kind: str, key: Key) -> bool:
        """Return whether a quirk of a kind is about an object."""
        return any(quirk.names(key) for quirk in self.every if quirk.kind == kind)


NO_QUIRKS = Quirks()


def quirks_of(quirks: Iterable[Quirk], joint: int) -> Quirks:
    """
    Return the quirks of one encoder, those of all encoders included.

    Parameters
    ----------
    quirks : iterable of Quirk
        Quirks of all encoders.
    joint : int
        Index of the encoder's joint.

    """
    of_joint = [quirk for quirk in quirks if quirk.joint in (None, joint)]
    return Quirks(tuple(of_joint))


def parse_quirk(text: str, sensors: int = len(JOINT_NAMES)) -> Quirk:
    """
    Return the quirk of a text of the command line.

    Parameters
    ----------
    text : str
        Such as 'read_only:joint_1a=0x6001'; see SYNTAX.
    sensors : int
        Number of encoders, which are those of the first joints.

    Raises
    ------
    InputError
        The text does not follow SYNTAX, or its value is impossible.

    """
    found = _PATTERN.fullmatch(text)
    if not found:
        raise InputError(f"quirk '{text}'; expected {SYNTAX}")
    kind = found['kind']
    joint = found['joint']
    joints = ALL_JOINT_NAMES[:sensors]
    _check_name(
        text=text,
        what='kind',
        name=kind,
        known=KINDS,
    )
    index = None
    if joint is not None:
        _check_name(
            text=text,
            what='joint',
            name=joint,
            known=joints,
        )
        index = joints.index(joint)
    number, place = _value(text, kind, found['value'])
    return Quirk(
        kind=kind,
        joint=index,
        value=number,
        subindex=place,
    )


def _check_name(
    text: str,
    what: str,
    name: str,
    known: Collection[str],
) -> None:
    """Raise InputError where a part of a quirk's text is none of the known names."""
    if name not in known:
        raise InputError(f"quirk '{text}': {what} '{name}'; expected one of {', '.join(known)}")


def _value(
    text: str,
    kind: str,
    value: str | None,
) -> tuple[int, int | None]:
    """
    Return number, or index, and subindex of a quirk's value.

    Parameters
    ----------
    text : str
        Text of the quirk, for the error.
    kind : str
        Its kind.
    value : str or None
        What is behind the equals sign; None without one.

    Returns
    -------
    number : int
        The value, or the index of an object; 0 without a value.
    subindex : int or None
        Subindex of that object; None without one.

    Raises
    ------
    InputError
        The kind needs a value, has none, or another one.

    """
    unit = KINDS[kind].unit
    if (unit is None) != (value is None):
        expected = f'=VALUE ({unit})' if unit else f'no value with {kind}'
        raise InputError(f"quirk '{text}'; expected {expected}")
    number, place = _object(text, value or '0', unit)
    if kind == 'node_id' and not 1 <= number <= NODE_ID_MAXIMUM:
        raise InputError(f"quirk '{text}': VALUE is {number}; expected {unit}")
    return number, place


def _object(
    text: str,
    value: str,
    unit: str | None,
) -> tuple[int, int | None]:
    """Return number, or index, and subindex of a value; None without a subindex."""
    index, _, subindex = value.partition(':')
    try:
        number = int(index, 0)
        place = None
        if subindex:
            place = int(subindex, 0)
        return number, place
    except ValueError as error:
        raise InputError(f"quirk '{text}': not a number ({error}); expected {unit}") from error
