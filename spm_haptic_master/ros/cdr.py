# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Joint samples and orientations in their serialized form (CDR, little-endian).

rclpy builds a message of a dozen Python objects for each `measured_js`, and reads one for each
`orientation`, which takes half as long again as the forward model. These two are therefore read
and written by `struct`. A `measured_js` that differs from the layout of `encoder_driver`
(velocities, the other byte order) is deserialized by rclpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, isinf, isnan
from struct import error as StructError
from struct import Struct

from geometry_msgs.msg import QuaternionStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.timing import SECOND

# Encapsulation identifier of little-endian CDR.
LITTLE_ENDIAN = b'\x00\x01'


def text_field(text: str) -> bytes:
    """Return a string as it stands in CDR: length, characters and 0."""
    characters = text.encode() + b'\x00'
    return len(characters).to_bytes(4, 'little') + characters


def aligned(fields: Sequence[bytes], size: int) -> tuple[str, int]:
    """Return the layout of fields at multiples of 4 bytes behind `size` bytes, and their end."""
    layout = ''
    for field in fields:
        padding = -size % 4
        layout += f'{padding}x{len(field)}s'
        size += padding + len(field)
    return layout, size


class JointsFormat:
    """
    Layout of a JointState of the first N joints.

    Encapsulation, two bytes of options, stamp, frame_id; count and names; count and positions;
    counts of velocities and efforts. Padding is not initialized and ignored.

    Parameters
    ----------
    sensors : int
        Number of joints: 4, 5 or 6.
    frame_id : str
        Frame of the samples that are written; those that are read may have any.

    """

    def __init__(self, sensors: int, frame_id: str = '') -> None:
        self._names = ALL_JOINT_NAMES[:sensors]
        self._arrange(text_field(frame_id))

    def _arrange(self, frame: bytes) -> None:
        """Have the layout with a frame_id, in CDR."""
        names = tuple(map(text_field, self._names))
        count = len(self._names).to_bytes(4, 'little')
        self._before = (frame, count, *names, count)
        texts, size = aligned(self._before, 8)
        layout = Struct(f'<2s2xiI{texts}{-size % 8}x{len(names)}d8s')
        self._pack = layout.pack
        self._unpack = layout.unpack_from
        self._after = bytes(8)
        # Indices of the first position among the unpacked fields, and behind the last one.
        self._first = 3 + len(self._before)
        self._last = self._first + len(names)

    def write(self, stamp: int, angles: tuple[float, ...]) -> bytes:
        """
        Serialize a sample.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of float
            Angles of the joints, rad; NaN is a joint without a reading.

        Returns
        -------
        bytes
            The JointState.

        """
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._pack(LITTLE_ENDIAN, seconds, nanoseconds, *self._before, *angles, self._after)

    def read(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """
        Read a serialized JointState.

        Parameters
        ----------
        data : bytes
            The message.

        Returns
        -------
        tuple of int and tuple of float
            Stamp (ns) and angles (rad).

        Raises
        ------
        RejectedError
            The names are not those of the joints, positions are missing or too many, one is
            infinite, or fewer than four are numbers.

        """
        stamp, angles = self._read(data)
        if not isfinite(sum(angles)):
            _check_readings(angles)
        return stamp, angles

    def _read(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """Read a sample of the usual layout; any other is read by rclpy."""
        try:
            fields = self._unpack(data)
        except StructError:  # too short
            return self._read_any(data)
        first = self._first
        last = self._last
        if (
            fields[0] != LITTLE_ENDIAN
            or fields[3:first] != self._before
            or fields[last] != self._after
        ):
            return self._read_any(data)
        return fields[1] * SECOND + fields[2], fields[first:last]

    def _read_any(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """Read a sample by rclpy, and take its frame_id for the layout of the next ones."""
        joints = deserialize_message(data, JointState)
        names = list(self._names)
        if joints.name != names:
            given = len(joints.name)
            is_sample = joints.name == list(ALL_JOINT_NAMES[:given])
            if is_sample and given >= len(JOINT_NAMES):
                raise RejectedError(
                    'sample of another number of sensors',
                    f'{given}, expected {len(names)}: give `sensors` for all nodes, /**',
                )
            raise RejectedError('misnamed sample', f'{joints.name}, expected {names}')
        if len(joints.position) != len(names):
            raise RejectedError(
                'incomplete sample', f'{len(joints.position)} positions, expected {len(names)}'
            )
        # The next one of this publisher is read by the layout, if it is only another frame_id.
        self._arrange(text_field(joints.header.frame_id))
        stamp = joints.header.stamp
        return stamp.sec * SECOND + stamp.nanosec, tuple(joints.position)


def _check_readings(angles: tuple[float, ...]) -> None:
    """Raise RejectedError for angles that are no sample: NaN is a joint without a reading."""
    names = ALL_JOINT_NAMES[: len(angles)]
    infinite = []
    missing = []
    for name, angle in zip(names, angles, strict=True):
        if isinf(angle):
            infinite.append(name)
        elif isnan(angle):
            missing.append(name)
    if infinite:
        raise RejectedError('angle not finite', f'infinite: {", ".join(infinite)}')
    if len(names) - len(missing) < len(JOINT_NAMES):
        raise RejectedError(
            'angle not finite',
            f'no reading of {", ".join(missing)}; expected at least {len(JOINT_NAMES)}',
        )


def _stamped_layout(frame: int, numbers: int) -> Struct:
    """Return the layout of a header and numbers: size of its frame_id, bytes; count of these."""
    return Struct(f'<2s2xiI{frame}s{-frame % 8}x{numbers}d')


class OrientationReader:
    """Reads serialized QuaternionStamped messages of one publisher after the other."""

    def __init__(self) -> None:
        self._arrange(text_field(''))

    def _arrange(self, frame: bytes) -> None:
        """Have the layout with a frame_id, in CDR."""
        self._frame = frame
        layout = _stamped_layout(len(frame), 4)
        self._unpack = layout.unpack
        self._size = layout.size

    def read(self, data: bytes) -> tuple[int, Quaternion[float]]:
        """Return stamp (ns) and quaternion x, y, z, w of a message."""
        if len(data) == self._size:
            order, seconds, nanoseconds, frame, x, y, z, w = self._unpack(data)
            if order == LITTLE_ENDIAN and frame == self._frame:
                return seconds * SECOND + nanoseconds, (x, y, z, w)
        message = deserialize_message(data, QuaternionStamped)
        self._arrange(text_field(message.header.frame_id))
        stamp = message.header.stamp
        q = message.quaternion
        return stamp.sec * SECOND + stamp.nanosec, (q.x, q.y, q.z, q.w)


class OrientationWriter:
    """Serializes QuaternionStamped messages in the frame `frame_id`."""

    def __init__(self, frame_id: str) -> None:
        self._frame = text_field(frame_id)
        self._pack = _stamped_layout(len(self._frame), 4).pack

    def write(self, stamp: int, quaternion: Quaternion[float]) -> bytes:
        """Return the serialized message: stamp in ns, quaternion x, y, z, w."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._pack(LITTLE_ENDIAN, seconds, nanoseconds, self._frame, *quaternion)


class PoseWriter:
    """Serializes PoseStamped messages in the frame `frame_id`."""

    def __init__(self, frame_id: str) -> None:
        self._frame = text_field(frame_id)
        self._pack = _stamped_layout(len(self._frame), 7).pack

    def write(
        self,
        stamp: int,
        position: Vector[float],
        quaternion: Quaternion[float],
    ) -> bytes:
        """Return the serialized message: stamp in ns, position in m, quaternion x, y, z, w."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        return self._pack(LITTLE_ENDIAN, seconds, nanoseconds, self._frame, *position, *quaternion)
