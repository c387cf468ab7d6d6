# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Recorded messages, from the bytes in which DDS carries them (CDR)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import struct
from typing import Any

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Encapsulation kinds of plain CDR, the first two bytes, with the byte order of struct.
BYTE_ORDERS = {b'\x00\x00': '>', b'\x00\x01': '<'}
# Length of the encapsulation (bytes); fields are aligned to what follows it.
ENCAPSULATION = 4


class Cdr:
    """Reads the fields of a message one after the other; ValueError where it is not plain CDR."""

    def __init__(self, content: bytes) -> None:
        order = BYTE_ORDERS.get(content[:2])
        if order is None:
            raise ValueError(f'encapsulation {content[:2].hex() or "missing"}; expected plain CDR')
        self._order = order
        self._body = memoryview(content)[ENCAPSULATION:]
        self._at = 0

    def numbers(self, code: str, count: int) -> tuple[Any, ...]:
        """Return `count` numbers of one of struct's types."""
        size = struct.calcsize(f'={code}')
        begin = self._at + -self._at % size
        self._at = begin + count * size
        if self._at > len(self._body):
            raise ValueError(f'{len(self._body)} bytes')
        return struct.unpack_from(f'{self._order}{count}{code}', self._body, begin)

    def count(self) -> int:
        """Return the length of a sequence."""
        (count,) = self.numbers('I', 1)
        return int(count)

    def string(self) -> str:
        """Return a text; its length includes the zero at its end."""
        return b''.join(self.numbers('s', self.count())).rstrip(b'\0').decode()

    def stamp(self) -> float:
        """Return the stamp of a header, s, and skip its frame."""
        (seconds,), (nanoseconds,) = self.numbers('i', 1), self.numbers('I', 1)
        self.string()
        return seconds + 1e-9 * nanoseconds


def joints_among(names: Sequence[str]) -> tuple[str, ...]:
    """
    Return the joints of the four, five or six sensors that have names, in their order.

    ValueError where one is missing: the readings of those behind it would be taken for others.
    """
    count = max((number for number, name in enumerate(ALL_JOINT_NAMES, 1) if name in names),
                default=0)
    expected = ALL_JOINT_NAMES[:max(count, len(JOINT_NAMES))]
    missing = [name for name in expected if name not in names]
    if missing:
        raise ValueError(f'no {", ".join(missing)} among {", ".join(names) or "no joints"}; '
                         f'expected {", ".join(expected)}')
    return expected


def _joint_angles(cdr: Cdr) -> Sequence[float]:
    """Return the joint angles of the four, five or six sensors, in their order."""
    names = [cdr.string() for _ in range(cdr.count())]
    angles = dict(zip(names, cdr.numbers('d', cdr.count()), strict=True))
    return [angles[name] for name in joints_among(names)]


# Decoders of what follows the header, by type; a pose has its position before its orientation.
Decoder = Callable[[Cdr], Sequence[float]]
ORIENTATIONS: dict[str, Decoder] = {
    'geometry_msgs/msg/QuaternionStamped': lambda cdr: cdr.numbers('d', 4),
    'geometry_msgs/msg/PoseStamped': lambda cdr: cdr.numbers('d', 7)[3:]}
JOINT_ANGLES: dict[str, Decoder] = {'sensor_msgs/msg/JointState': _joint_angles}


def decode(content: bytes, decoder: Decoder) -> list[float]:
    """Return the stamp of a message, s, and its values; ValueError where it has none."""
    cdr = Cdr(content)
    return [cdr.stamp(), *decoder(cdr)]
