# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The angle or length of one joint, from a JointState."""

from __future__ import annotations

from math import isfinite
from struct import Struct

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.timing import SECOND

# Bytes of the encapsulation and of the stamp, before everything that a publisher repeats.
HEAD = 12


class JointReader:
    """
    Reads serialized JointState messages of one joint, of one publisher after the other.

    rclpy builds a dozen Python objects for each. Messages of a publisher differ in stamp and
    position only: where all other bytes are those of the last message, these two are unpacked.

    Parameters
    ----------
    name
        Name of the joint; a message of another joint has no position.

    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._stamp = Struct('<4xiI')
        self._known_size = 0
        self._known_middle = self._known_tail = b''
        self._position = Struct('<d')
        self._offset = 0

    def read(self, data: bytes) -> tuple[int, float] | None:
        """
        Read a message.

        Parameters
        ----------
        data
            Serialized JointState (CDR).

        Returns
        -------
        tuple of int and float, or None
            Stamp, ns, and position, rad or m; None where the message has another joint, another
            number of positions, or one that is not finite.

        """
        if not self._is_like_last(data):
            return self._read_any(data)
        (position,) = self._position.unpack_from(data, self._offset)
        seconds, nanoseconds = self._stamp.unpack_from(data)
        if not isfinite(position):
            return None
        return seconds * SECOND + nanoseconds, position

    def _is_like_last(self, data: bytes) -> bool:
        """Return whether a message differs from the last one in stamp and position only."""
        end = self._offset + self._position.size
        return (
            len(data) == self._known_size
            and data[HEAD : self._offset] == self._known_middle
            and data[end:] == self._known_tail
        )

    def _read_any(self, data: bytes) -> tuple[int, float] | None:
        message = deserialize_message(data, JointState)
        if list(message.name) != [self._name] or len(message.position) != 1:
            return None
        self._learn(data, message)
        position = float(message.position[0])
        if not isfinite(position):
            return None
        stamp = message.header.stamp
        return stamp.sec * SECOND + stamp.nanosec, position

    def _learn(self, data: bytes, message: JointState) -> None:
        """Find where the position is: at the last place where two positions differ."""
        size = len(data)
        first, second = (
            serialize_message(
                JointState(header=message.header, name=message.name, position=[position])
            )
            for position in (0.0, -1.0)
        )
        differing = [
            index for index, (a, b) in enumerate(zip(first, second, strict=True)) if a != b
        ]
        # A double of -1.0 differs from 0.0 in its two highest bytes.
        offset = differing[-1] - self._position.size + 1
        is_plain = len(first) == size and not (message.velocity or message.effort)
        if not is_plain or first[:4] != data[:4]:
            return
        self._known_size = size
        self._offset = offset
        self._known_middle = data[HEAD:offset]
        self._known_tail = data[offset + self._position.size :]
