# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Recordings of orientations, joint angles and motion capture, from CSV files and rosbag2 (MCAP).

A CSV file has a header with these columns, in any order, and may have others; times in s:

=============  ==================================================================
orientation    time, qx, qy, qz, qw: unit quaternion of R_base_platform
joint angles   time, joint_1a, joint_1b, joint_1c, joint_3a: rad
captured pose  time, qx, qy, qz, qw: of any body fixed to the platform, in any frame
markers        time, ax, ay, az, bx, by, bz, cx, cy, cz, dx, dy, dz: any unit of length
=============  ==================================================================

Markers A and B are on the platform's axis Z_E, B farther out; C and D are beside it.

A row of markers with an empty field (a marker was hidden) is skipped, and so is a captured pose
with a zero or empty quaternion. In a recording of topics the times are the header stamps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import csv
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

import numpy as np
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.joints import JOINT_NAMES

# Columns of a CSV file.
TIME = 'time'
QUATERNION = ('qx', 'qy', 'qz', 'qw')
MARKERS = tuple(f'{marker}{axis}' for marker in 'abcd' for axis in 'xyz')
# Largest |norm - 1| of a recorded quaternion: the rounding of a few printed digits.
NORM_TOLERANCE = 1e-2
# Least number of complete rows: fewer cannot be compared.
ROWS_MINIMUM = 10


@dataclass(frozen=True, slots=True)
class Track:
    """
    Values at increasing times.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Times, s.
    values : ndarray, shape (n, k)
        Quaternions x, y, z, w (k = 4), joint angles A, B, C, 3A in rad (4), or coordinates of the
        markers A, B, C, D (12).

    """

    time: np.ndarray
    values: np.ndarray


def read_orientation(path: Path, topic: str) -> Track:
    """
    Return recorded orientations.

    Parameters
    ----------
    path : Path
        A CSV file, an .mcap file or a rosbag2 directory.
    topic : str
        Topic of QuaternionStamped or PoseStamped, in a recording of topics.

    Raises
    ------
    InputError
        The file cannot be read, or does not contain orientations.

    """
    rows = _topic_rows(path, topic, _quaternion) if _is_bag(path) else _csv_rows(path, QUATERNION)
    return _quaternions(path, rows)


def read_joints(path: Path, topic: str) -> Track | None:
    """
    Return recorded joint angles, or None if a recording of topics has none.

    Parameters
    ----------
    path : Path
        A CSV file, an .mcap file or a rosbag2 directory.
    topic : str
        Topic of JointState, in a recording of topics.

    Raises
    ------
    InputError
        The file cannot be read, or a CSV file does not contain joint angles.

    """
    if _is_bag(path):
        rows = _topic_rows(path, topic, _joint_angles, optional=True)
        return _track(path, rows) if rows else None
    return _track(path, _csv_rows(path, JOINT_NAMES))


def read_capture(path: Path, topic: str | None) -> Track:
    """
    Return motion capture: markers (12 columns) or poses of a body (quaternions, 4 columns).

    Parameters
    ----------
    path : Path
        A CSV file of either, or a recording of topics with a PoseStamped.
    topic : str or None
        Topic of the pose, in a recording of topics.

    Raises
    ------
    InputError
        The file cannot be read, or does not contain motion capture.

    """
    if _is_bag(path):
        if topic is None:
            raise InputError(f'{path}: give the topic of the pose with --capture-topic')
        return _quaternions(path, _topic_rows(path, topic, _quaternion))
    columns = _header(path)
    if set(MARKERS) <= set(columns):
        return _track(path, _csv_rows(path, MARKERS))
    if set(QUATERNION) <= set(columns):
        return _quaternions(path, _csv_rows(path, QUATERNION))
    raise InputError(f'{path}: columns {", ".join(columns)}; expected time and either '
                     f'{", ".join(MARKERS)} (markers) or {", ".join(QUATERNION)} (a pose)')


def _is_bag(path: Path) -> bool:
    return path.is_dir() or path.suffix == '.mcap'


def _quaternions(path: Path, rows: list[list[float]]) -> Track:
    track = _track(path, [row for row in rows if any(row[1:])])
    norm = np.linalg.norm(track.values, axis=-1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if wrong.size:
        raise InputError(f'{path}: at time {track.time[wrong[0]]:.6f} s the quaternion has norm '
                         f'{norm[wrong[0]]:.4g}; expected 1')
    return Track(track.time, track.values / norm[:, None])


def _track(path: Path, rows: list[list[float]]) -> Track:
    known = np.array([row for row in rows if not any(map(math.isnan, row))])
    if len(known) < ROWS_MINIMUM:
        raise InputError(f'{path}: {len(known)} complete rows; expected {ROWS_MINIMUM} or more')
    if not np.isfinite(known).all():
        raise InputError(f'{path}: a value is not finite')
    time, values = known[:, 0], known[:, 1:]
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        raise InputError(f'{path}: time does not increase after {time[back[0]]:.6f} s')
    return Track(time, values)


# CSV ------------------------------------------------------------------------------------------

def _lines(path: Path) -> Iterator[list[str]]:
    try:
        with open(path, newline='', encoding='utf-8-sig') as file:
            yield from csv.reader(file)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error


def _header(path: Path) -> list[str]:
    return [name.strip().lower() for name in next(_lines(path), [])]


def _csv_rows(path: Path, columns: tuple[str, ...]) -> list[list[float]]:
    """Return the rows of `time` and these columns; NaN where a field is empty."""
    header = _header(path)
    missing = [name for name in (TIME, *columns) if name not in header]
    if missing:
        raise InputError(f'{path}: no column {", ".join(missing)}; expected '
                         f'{", ".join((TIME, *columns))}')
    places = [header.index(name) for name in (TIME, *columns)]
    rows = []
    for number, line in enumerate(_lines(path), start=1):
        if number == 1 or not line:
            continue
        try:
            rows.append([float(line[place]) if line[place].strip() else math.nan
                         for place in places])
        except (ValueError, IndexError) as error:
            raise InputError(f'{path}, line {number}: not numbers in the columns '
                             f'{", ".join((TIME, *columns))}') from error
    return rows


# rosbag2 --------------------------------------------------------------------------------------

def _quaternion(message: Any) -> list[float]:
    """Return the quaternion of a QuaternionStamped or a PoseStamped."""
    q = message.quaternion if hasattr(message, 'quaternion') else message.pose.orientation
    return [q.x, q.y, q.z, q.w]


def _joint_angles(message: Any) -> list[float]:
    """Return the four joint angles of a JointState, in the order of JOINT_NAMES."""
    angles = dict(zip(message.name, message.position, strict=True))
    return [angles[name] for name in JOINT_NAMES]


def _topic_rows(path: Path, topic: str, values: Callable[[Any], list[float]],
                optional: bool = False) -> list[list[float]]:
    """Return the rows (header stamp in s, values) of a topic; [] if it is optional and missing."""
    found: dict[str, list[list[float]]] = {}
    topics: set[str] = set()
    for name, message in _messages(path, topic, topics):
        stamp = message.header.stamp
        try:
            row = values(message)
        except (AttributeError, KeyError, ValueError) as error:
            raise InputError(f'{path}: a message on {name} is not of the expected '
                             f'type ({error})') from error
        found.setdefault(name, []).append([stamp.sec + 1e-9 * stamp.nanosec, *row])
    if len(found) > 1:
        raise InputError(f'{path}: {topic} is ambiguous: {", ".join(sorted(found))}; name one')
    if not found and not optional:
        raise InputError(f'{path}: nothing on topic {topic}; it has '
                         + (', '.join(sorted(topics)) or 'no messages'))
    return next(iter(found.values()), [])


def _messages(path: Path, topic: str, topics: set[str]) -> Iterator[tuple[str, Any]]:
    """Yield (topic, message) of the topics that match `topic`; add all names to `topics`."""
    try:
        from mcap.reader import make_reader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError as error:
        raise InputError(f'{path}: reading rosbag2 needs mcap-ros2-support ({error}): '
                         "in a virtual environment: pip install '.[validate]'") from error
    files = sorted(path.glob('*.mcap')) if path.is_dir() else [path]
    if not files:
        raise InputError(f'{path}: no .mcap file in it')
    wanted = '/' + topic.strip('/')
    for each in files:
        try:
            with open(each, 'rb') as file:
                factory = DecoderFactory()
                for schema, channel, record in make_reader(file).iter_messages():
                    topics.add(channel.topic)
                    if ('/' + channel.topic.strip('/')).endswith(wanted):
                        decode = factory.decoder_for(channel.message_encoding, schema)
                        if decode is None:
                            raise InputError(f'{each}: {channel.topic} is not a ROS 2 topic')
                        yield channel.topic, decode(record.data)
        except (InputError, GeneratorExit):
            raise
        except Exception as error:
            # The readers of MCAP and of its compressions have no common exception.
            raise InputError(f'{each}: cannot be read as MCAP: '
                             f'{type(error).__name__}: {error}') from error
