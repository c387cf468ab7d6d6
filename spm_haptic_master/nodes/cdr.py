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
from spm_haptic_master.joints import JOINT_NAMES

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


# Layout of a JointState: encapsulation, two bytes of options, stamp, frame_id; count and names;
# count and positions; counts of velocities and efforts. Padding is not initialized and ignored.
_NO_FRAME = _text('')
_NAMES = tuple(map(_text, JOINT_NAMES))
_COUNT = len(JOINT_NAMES).to_bytes(4, 'little')
_JOINTS = Struct(
    f'<2s2xiI{len(_NO_FRAME)}s{_aligned(len(_NO_FRAME), 4)}4s'
    + ''.join(f'{len(name)}s{_aligned(len(name), 4)}' for name in _NAMES) + '4s4d8s')
_BEFORE = (_NO_FRAME, _COUNT, *_NAMES, _COUNT)
_AFTER = bytes(8)
# Index of the first position among the unpacked fields.
_FIRST = 3 + len(_BEFORE)
# Index behind the last position. The positions need no padding: the names and counts before them
# fill a multiple of 8 bytes.
_LAST = _FIRST + len(JOINT_NAMES)


def write_joints(stamp: int, angles: tuple[float, float, float, float]) -> bytes:
    """Return a JointState of the four joints, stamped in ns, angles in rad."""
    seconds, nanoseconds = divmod(stamp, SECOND)
    return _JOINTS.pack(LITTLE_ENDIAN, seconds, nanoseconds, *_BEFORE, *angles, _AFTER)


def read_joints(data: bytes) -> tuple[int, tuple[float, float, float, float]]:
    """
    Return stamp (ns) and angles (rad) of a serialized JointState.

    Raises
    ------
    RejectedError
        If the names are not those of the four joints, or positions are missing or too many.

    """
    try:
        fields = _JOINTS.unpack_from(data)
    except StructError:  # too short
        return _read_any(data)
    if fields[0] != LITTLE_ENDIAN or fields[3:_FIRST] != _BEFORE or fields[_LAST] != _AFTER:
        return _read_any(data)
    return fields[1] * SECOND + fields[2], fields[_FIRST:_LAST]


def _read_any(data: bytes) -> tuple[int, tuple[float, float, float, float]]:
    joints = deserialize_message(data, JointState)
    names = list(JOINT_NAMES)
    if joints.name != names:
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
