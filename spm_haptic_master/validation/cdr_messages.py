# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded messages, from the bytes in which DDS carries them (CDR)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import struct

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Encapsulation kinds of plain CDR, the first two bytes, with the byte order of struct.
BYTE_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
# Length of the encapsulation (bytes); fields are aligned to what follows it.
ENCAPSULATION = 4
# Position of a pose's orientation among its seven numbers: it follows x, y and z.
ORIENTATION = 3


class Cdr:
    """
    Reads the fields of a message one after the other.

    Parameters
    ----------
    content : bytes
        The message, with its encapsulation.

    Raises
    ------
    ValueError
        It is not encapsulated as plain CDR.

    """

    def __init__(self, content: bytes) -> None:
        order = BYTE_ORDERS.get(content[:2])
        if order is None:
            raise ValueError(f'encapsulation {content[:2].hex() or "missing"}; expected plain CDR')
        self._order = order
        self._body = memoryview(content)[ENCAPSULATION:]
        self._at = 0

    def numbers(self, code: str, count: int) -> tuple[float, ...]:
        """Return `count` numbers of one of struct's types."""
        size = struct.calcsize(f'={code}')
        self._at += -self._at % size
        values = struct.unpack_from(f'{self._order}{count}{code}', self._body, self._at)
        self._at += count * size
        return values

    def count(self) -> int:
        """Return the length of a sequence."""
        (count,) = struct.unpack(f'{self._order}I', self._take(4, aligned=4))
        return int(count)

    def string(self) -> str:
        """Return a text; its length includes the zero at its end."""
        return bytes(self._take(self.count())).rstrip(b'\0').decode()

    def stamp(self) -> float:
        """Return the stamp of a header, s, and skip its frame."""
        (seconds,), (nanoseconds,) = self.numbers('i', 1), self.numbers('I', 1)
        self.string()
        return seconds + 1e-9 * nanoseconds

    def _take(self, size: int, aligned: int = 1) -> memoryview:
        begin = self._at + -self._at % aligned
        if begin + size > len(self._body):
            raise ValueError(f'{len(self._body)} bytes')
        self._at = begin + size
        return self._body[begin:self._at]


def _quaternion(cdr: Cdr) -> list[float]:
    return list(cdr.numbers('d', 4))


def _orientation(cdr: Cdr) -> list[float]:
    return list(cdr.numbers('d', ORIENTATION + 4)[ORIENTATION:])


def joints_among(names: Sequence[str]) -> tuple[str, ...]:
    """
    Return the joints of the four, five or six sensors that have names, in their order.

    Raises
    ------
    ValueError
        A joint is missing: the readings of those behind it would be taken for others.

    """
    count = max((number for number, name in enumerate(ALL_JOINT_NAMES, 1) if name in names),
                default=0)
    expected = ALL_JOINT_NAMES[:max(count, len(JOINT_NAMES))]
    missing = [name for name in expected if name not in names]
    if missing:
        raise ValueError(f'no {", ".join(missing)} among {", ".join(names) or "no joints"}; '
                         f'expected {", ".join(expected)}')
    return expected


def _joint_angles(cdr: Cdr) -> list[float]:
    """Return the joint angles of the four, five or six sensors, in their order."""
    names = [cdr.string() for _ in range(cdr.count())]
    angles = dict(zip(names, cdr.numbers('d', cdr.count()), strict=True))
    return [angles[name] for name in joints_among(names)]


Decoder = Callable[[Cdr], list[float]]
# Decoders of what follows the header, by type.
ORIENTATIONS: dict[str, Decoder] = {
    'geometry_msgs/msg/QuaternionStamped': _quaternion,
    'geometry_msgs/msg/PoseStamped': _orientation}
JOINT_ANGLES: dict[str, Decoder] = {'sensor_msgs/msg/JointState': _joint_angles}


def decode(content: bytes, decoder: Decoder) -> list[float]:
    """
    Return the stamp of a message, s, and its values.

    Raises
    ------
    InputError
        It is not what the decoder expects.

    """
    try:
        cdr = Cdr(content)
        return [cdr.stamp(), *decoder(cdr)]
    except (struct.error, ValueError) as error:
        raise InputError(f'not as expected: {error}') from error
