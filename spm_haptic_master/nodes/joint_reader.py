# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The angle or length of one joint, from a JointState."""

from __future__ import annotations

from math import isfinite
from struct import error as StructError
from struct import Struct

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.ros.cdr import aligned, LITTLE_ENDIAN, text_field
from spm_haptic_master.timing import SECOND

# The counts of no velocities and no efforts.
NOTHING_ELSE = bytes(8)
# A sequence of one element begins with its count.
ONE = (1).to_bytes(4, 'little')


class JointReader:
    """
    Reads serialized JointState messages of one joint, of one publisher after the other.

    rclpy builds a dozen Python objects for each. Those of the layout of the last message are
    unpacked instead: stamp, frame_id, one name, one position, nothing else. Padding is not
    initialized, and ignored.

    Parameters
    ----------
    name
        Name of the joint; a message of another joint has no position.

    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._arrange('')

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
        try:
            order, seconds, nanoseconds, *repeated, position, rest = self._unpack(data)
        except StructError:  # too short
            return self._read_any(data)
        if order != LITTLE_ENDIAN or repeated != self._repeated or rest != NOTHING_ELSE:
            return self._read_any(data)
        if isfinite(position):
            return (seconds * SECOND + nanoseconds, position)
        return None

    def _read_any(self, data: bytes) -> tuple[int, float] | None:
        """Read a message of any layout, and expect the layout of its publisher from now on."""
        message = deserialize_message(data, JointState)
        # The next one of this publisher is read by the layout, if it is only another frame_id.
        self._arrange(message.header.frame_id)
        if list(message.name) != [self._name] or len(message.position) != 1:
            return None
        position = float(message.position[0])
        stamp = message.header.stamp
        if isfinite(position):
            return (stamp.sec * SECOND + stamp.nanosec, position)
        return None

    def _arrange(self, frame_id: str) -> None:
        """Have the layout of messages with a frame_id."""
        self._repeated = [text_field(frame_id), ONE, text_field(self._name), ONE]
        layout, size = aligned(self._repeated, 8)
        self._unpack = Struct(f'<2s2xiI{layout}{-size % 8}xd8s').unpack_from
