# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Joint samples and orientations in their serialized form (CDR, little-endian).

rclpy builds a message of a dozen Python objects for each `measured_js`, and reads one for each
`orientation`, which takes half as long again as the forward model. These two are therefore read
and written by `struct`. A `measured_js` that differs from the layout of `encoder_driver` (a
frame_id, velocities, the other byte order) is deserialized by rclpy.
"""

from __future__ import annotations

from struct import error as StructError
from struct import Struct

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES

# Encapsulation identifier of little-endian CDR.
LITTLE_ENDIAN = b'\x00\x01'
# Nanoseconds per second.
SECOND = 1_000_000_000


def _text(text: str) -> bytes:
    """Return a string in CDR: its length, its characters, a zero byte."""
    characters = text.encode() + b'\x00'
    return len(characters).to_bytes(4, 'little') + characters


def _aligned(size: int, to: int) -> str:
    """Return the `struct` padding after `size` bytes up to a multiple of `to`."""
    return f'{-size % to}x'


# The empty frame_id of a JointState.
_NO_FRAME = _text('')


class JointsFormat:
    """
    Layout of a JointState of the first N joints.

    Encapsulation, two bytes of options, stamp, frame_id; count and names; count and positions;
    counts of velocities and efforts. Padding is not initialized and ignored. The positions need
    none: the names and counts before them fill a multiple of 8 bytes.

    Parameters
    ----------
    sensors : int
        N: 4, 5 or 6.

    """

    def __init__(self, sensors: int) -> None:
        self._names = ALL_JOINT_NAMES[:sensors]
        names, count = tuple(map(_text, self._names)), sensors.to_bytes(4, 'little')
        layout = Struct(
            f'<2s2xiI{len(_NO_FRAME)}s{_aligned(len(_NO_FRAME), 4)}4s'
            + ''.join(f'{len(name)}s{_aligned(len(name), 4)}' for name in names)
            + f'4s{sensors}d8s')
        self._pack, self._unpack = layout.pack, layout.unpack_from
        self._before = (_NO_FRAME, count, *names, count)
        self._after = bytes(8)
        # Indices of the first position among the unpacked fields, and behind the last one.
        self._first = 3 + len(self._before)
        self._last = self._first + sensors

    def write(self, stamp: int, angles: tuple[float, ...]) -> bytes:
        """Return a JointState of the joints, stamped in ns, angles in rad."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._pack(
            LITTLE_ENDIAN, seconds, nanoseconds, *self._before, *angles, self._after)

    def read(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """
        Return stamp (ns) and angles (rad) of a serialized JointState.

        Raises
        ------
        RejectedError
            If the names are not those of the joints, or positions are missing or too many.

        """
        try:
            fields = self._unpack(data)
        except StructError:  # too short
            return self._read_any(data)
        first, last = self._first, self._last
        if fields[0] != LITTLE_ENDIAN or fields[3:first] != self._before \
                or fields[last] != self._after:
            return self._read_any(data)
        return fields[1] * SECOND + fields[2], fields[first:last]

    def _read_any(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        joints, names = deserialize_message(data, JointState), list(self._names)
        if joints.name != names:
            given = len(joints.name)
            if given >= len(JOINT_NAMES) and joints.name == list(ALL_JOINT_NAMES[:given]):
                raise RejectedError(
                    'sample of another number of sensors',
                    f'{given}, expected {len(names)}: give `sensors` for all nodes, /**')
            raise RejectedError('misnamed sample', f'{joints.name}, expected {names}')
        if len(joints.position) != len(names):
            raise RejectedError('incomplete sample',
                                f'{len(joints.position)} positions, expected {len(names)}')
        stamp = joints.header.stamp
        return stamp.sec * SECOND + stamp.nanosec, tuple(joints.position)


class OrientationWriter:
    """
    Serializes QuaternionStamped messages.

    Parameters
    ----------
    frame_id : str
        Reference (base) frame.

    """

    def __init__(self, frame_id: str) -> None:
        self._frame = _text(frame_id)
        stamp = 8
        self._pack = Struct(
            f'<2s2xiI{len(self._frame)}s{_aligned(stamp + len(self._frame), 8)}4d').pack

    def write(self, stamp: int, quaternion: tuple[float, float, float, float]) -> bytes:
        """Return the serialized message: stamp in ns, quaternion x, y, z, w."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._pack(LITTLE_ENDIAN, seconds, nanoseconds, self._frame, *quaternion)
