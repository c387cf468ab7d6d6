# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Recordings of orientations, joint angles and motion capture, from CSV files and rosbag2.

A CSV file has a header with these columns, in any order, and may have others; times in s:

=============  ==========================================================================
orientation    time, qx, qy, qz, qw: unit quaternion of R_base_platform
joint angles   time, joint_1a, joint_1b, joint_1c, joint_3a: rad; more: joint_3b, joint_3c
captured pose  time, qx, qy, qz, qw: of any body fixed to the platform, in any frame
markers        time, ax, ay, az, bx, by, bz, cx, cy, cz, dx, dy, dz: any unit of length
=============  ==========================================================================

Markers A and B are on the platform's axis Z_E, B farther out; C and D are beside it. The CSV files
of Motive and Vicon, and the TSV or CSV files of QTM, are read by their headers: a rigid body, or
markers of these names.

A directory of `recorder` is taken for its table. The column of times may be called stamp, and a
file may be compressed (.csv.gz).

An empty or NaN angle is a joint without a reading; a row with fewer than four readings is left
out and counted. A row of markers with an empty field (a marker was hidden) is left out, and so is
a captured pose with a zero or empty quaternion. In a recording of topics the times are the header
stamps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import csv
from dataclasses import dataclass
import gzip
import math
from pathlib import Path
from typing import Any
import zlib

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.encoders.recording_files import JOINTS_NAME, ORIENTATION_NAME
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.validation import bags, capture_files
from spm_haptic_master.validation.capture_headers import Sheet

# Columns of a CSV file, and another name for that of the times.
TIME = 'time'
STAMP = 'stamp'
QUATERNION = ('qx', 'qy', 'qz', 'qw')
MARKERS = tuple(f'{marker}{axis}' for marker in 'abcd' for axis in 'xyz')
# Largest |norm - 1| of a recorded quaternion: the rounding of a few printed digits.
NORM_TOLERANCE = 1e-2
# Longest part of a header that is quoted (characters).
QUOTED = 120
# Least number of complete rows: fewer cannot be compared.
ROWS_MINIMUM = 10


@dataclass(frozen=True, slots=True)
class Track:
    """
    Values at n increasing times.

    Attributes
    ----------
    time : ndarray, shape (n,)
        Times, s.
    values : ndarray, shape (n, k)
        Quaternions x, y, z, w (k = 4); joint angles, rad, NaN without a reading (k = N); or
        coordinates of the markers A, B, C, D (k = 12).
    left_out : int
        Number of rows with too few values.

    """

    time: np.ndarray
    values: np.ndarray
    left_out: int = 0


def read_orientation(path: Path, topic: str) -> Track:
    """
    Return recorded orientations.

    Parameters
    ----------
    path : Path
        A CSV file, a directory of `recorder`, or a rosbag2 (directory, .mcap or .db3).
    topic : str
        Topic of QuaternionStamped, PoseStamped or TransformStamped in a rosbag2.

    Returns
    -------
    Track
        Unit quaternions x, y, z, w of R_base_platform.

    Raises
    ------
    InputError
        The file cannot be read, or has no orientations.

    """
    path = _table_in(path, ORIENTATION_NAME)
    if bags.is_bag(path):
        rows = _topic_rows(path, topic, ORIENTATIONS)
    else:
        rows = _csv_rows(path, _csv_table(path), QUATERNION)
    return _quaternions(path, rows)


def read_joints(
    path: Path,
    topic: str,
    option: str = '--topic',
) -> Track | None:
    """
    Return recorded joint angles.

    Parameters
    ----------
    path : Path
        A CSV file, a directory of `recorder`, or a rosbag2 (directory, .mcap or .db3).
    topic : str
        Topic of JointState in a rosbag2.
    option : str, optional
        Option of the program that names a topic, for the error.

    Returns
    -------
    Track or None
        Angles, rad, (n, N); None if a rosbag2 or a directory of `recorder` has none.

    Raises
    ------
    InputError
        The file cannot be read, a table has no joint angles, or their number changes.

    """
    path = _table_in(path, JOINTS_NAME)
    if _table_in(path, ORIENTATION_NAME) != path:
        return None  # of `recorder`, without joint angles
    if bags.is_bag(path):
        rows = _topic_rows(
            path,
            topic,
            JOINT_ANGLES,
            optional=True,
            option=option,
        )
        numbers = sorted({len(row) - 1 for row in rows})
        if len(numbers) > 1:
            raise InputError(
                f'{path}: joint angles of {" and of ".join(map(str, numbers))} '
                'sensors; expected one number of them'
            )
        if rows:
            return _track(path, rows, len(JOINT_NAMES))
        return None
    table = _csv_table(path)
    try:
        names = _joints_among(table[0])
    except ValueError as error:
        raise InputError(f'{path}: {error}') from error
    return _track(path, _csv_rows(path, table, names), len(JOINT_NAMES))


def read_axis_times(
    path: Path,
    axis: str,
) -> NDArray[np.float64]:
    """
    Return the times of the readings of insertion or gripper.

    Parameters
    ----------
    path : Path
        A directory of `recorder`, or a rosbag2.
    axis : str
        Name of the axis.

    Returns
    -------
    ndarray, shape (n,)
        Times, s; empty where the recording has no such axis.

    """
    table = path / f'{axis}.csv'
    if table.is_file():
        rows = _csv_rows(table, _csv_table(table), (axis,))
    elif _table_in(path, JOINTS_NAME) == path and bags.is_bag(path):
        rows = _topic_rows(path, f'{axis}/measured_js', AXIS_POSITIONS, optional=True)
    else:
        rows = []
    return np.array([time for time, position in rows if math.isfinite(position)])


def read_capture(path: Path, topic: str | None) -> Track:
    """
    Return motion capture: markers (12 columns) or poses of a body (quaternions).

    Parameters
    ----------
    path : Path
        A table, an export of Motive, Vicon or QTM, or a rosbag2 with a pose.
    topic : str or None
        Topic of the pose in a rosbag2, or name of the rigid body in an export; None if not given.

    Returns
    -------
    Track
        Coordinates of the markers, or unit quaternions x, y, z, w.

    Raises
    ------
    InputError
        The file cannot be read, or has neither.

    """
    if bags.is_bag(path):
        if topic is None:
            raise InputError(f'{path}: give the topic of the pose with --capture-topic')
        rows = _topic_rows(path, topic, ORIENTATIONS, option='--capture-topic')
        return _quaternions(path, rows)
    export = capture_files.export_rows(Sheet(path, _fields(path)), topic)
    if export is not None:
        of_poses, rows = export
        if of_poses:
            return _quaternions(path, rows)
        return _track(path, rows)
    table = _csv_table(path)
    if set(MARKERS) <= set(table[0]):
        return _track(path, _csv_rows(path, table, MARKERS))
    if set(QUATERNION) <= set(table[0]):
        return _quaternions(path, _csv_rows(path, table, QUATERNION))
    named = ', '.join(table[0])
    raise InputError(
        f'{path}: columns {named[:QUOTED]!r}; expected time and either '
        f'{", ".join(MARKERS)} (markers) or {", ".join(QUATERNION)} (a pose)'
    )


def _joints_among(names: Sequence[str]) -> tuple[str, ...]:
    """
    Return the joints of four, five or six sensors.

    Parameters
    ----------
    names : sequence of str
        Names of columns or of the joints of a message.

    Returns
    -------
    tuple of str
        Joints in the order of ALL_JOINT_NAMES, up to the last one that is named.

    Raises
    ------
    ValueError
        One of them is missing.

    """
    count = len(JOINT_NAMES)
    for number, name in enumerate(ALL_JOINT_NAMES, 1):
        if name in names:
            count = max(count, number)
    expected = ALL_JOINT_NAMES[:count]
    missing = [name for name in expected if name not in names]
    if missing:
        found = ', '.join(names)[:QUOTED] or 'no joints'
        raise ValueError(f'no {", ".join(missing)} among {found}; expected {", ".join(expected)}')
    return expected


def _table_in(path: Path, name: str) -> Path:
    """Return a table of `recorder` in its directory; any other path as it is."""
    table = path / name
    return table if table.is_file() else path


def _quaternions(
    path: Path,
    rows: list[list[float]],
) -> Track:
    """
    Return rows of quaternions as unit quaternions; a row of zeros is left out.

    Parameters
    ----------
    path : Path
        The file, for the error.
    rows : list of list of float
        Time, s, and x, y, z, w of each row.

    Returns
    -------
    Track
        Unit quaternions.

    Raises
    ------
    InputError
        A quaternion's norm differs from 1 by more than `NORM_TOLERANCE`, or as of `_track`.

    """
    with_value = [row for row in rows if any(row[1:])]
    track = _track(path, with_value)
    with np.errstate(over='ignore'):
        norm = np.linalg.norm(track.values, axis=1)
    wrong = np.flatnonzero(np.abs(norm - 1.0) > NORM_TOLERANCE)
    if wrong.size:
        raise InputError(
            f'{path}: at time {track.time[wrong[0]]:.6f} s the quaternion has norm '
            f'{norm[wrong[0]]:.4g}; expected 1'
        )
    return Track(
        time=track.time,
        values=track.values / norm[:, None],
        left_out=len(rows) - len(track.time),
    )


def _track(
    path: Path,
    rows: list[list[float]],
    least: int | None = None,
) -> Track:
    """
    Return the rows with enough values, as a track.

    Parameters
    ----------
    path : Path
        The file, for the error.
    rows : list of list of float
        Time, s, and values of each row; NaN without a value.
    least : int or None, optional
        Least number of values of a row; by default all.

    Returns
    -------
    Track
        Times and values.

    Raises
    ------
    InputError
        Too few rows are left, a value is infinite, or the time does not increase.

    """
    complete = []
    for row in rows:
        moment, *numbers = row
        wanted = len(numbers) if least is None else least
        # NaN is not equal to itself.
        given = sum(number == number for number in numbers)
        if given >= wanted and not math.isnan(moment):
            complete.append(row)
    known = np.array(complete)
    if len(known) < ROWS_MINIMUM:
        raise InputError(f'{path}: {len(known)} complete rows; expected {ROWS_MINIMUM} or more')
    if np.isinf(known).any():
        raise InputError(f'{path}: a value is not finite')
    time = known[:, 0]
    values = known[:, 1:]
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        raise InputError(f'{path}: time does not increase after {time[back[0]]:.6f} s')
    return Track(
        time=time,
        values=values,
        left_out=len(rows) - len(known),
    )


def _csv_table(path: Path) -> list[list[str]]:
    """Return the lines of a CSV file, of which the first is the header in small letters."""
    header, *lines = _fields(path) or [[]]
    return [[name.strip().lower() for name in header], *lines]


def _fields(path: Path) -> list[list[str]]:
    """Return the lines of a CSV file by their fields, between commas or tabs."""
    try:
        opener = gzip.open if path.suffix == '.gz' else open
        with opener(
            path, 'rt', newline='', encoding='utf-8-sig', errors='backslashreplace'
        ) as file:
            begin = file.readline()
            file.seek(0)
            delimiter = '\t' if '\t' in begin else ','
            return list(csv.reader(file, delimiter=delimiter))
    except (OSError, EOFError, zlib.error, csv.Error) as error:
        raise InputError(f'{path}: cannot be read: {error}') from error


def _csv_rows(
    path: Path,
    table: list[list[str]],
    columns: tuple[str, ...],
) -> list[list[float]]:
    """
    Return the rows of `time` and these columns; NaN where a field is empty.

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : list of list of str
        Its lines by their fields, the header first.
    columns : tuple of str
        Names of the columns beside the time.

    Returns
    -------
    list of list of float
        Time, s, and values of each row.

    Raises
    ------
    InputError
        A column is missing, or a field is no number.

    """
    header, *lines = table
    if TIME not in header and STAMP in header:
        header[header.index(STAMP)] = TIME
    names = (TIME, *columns)
    places = _places(path, header, names)
    rows = []
    for number, line in enumerate(lines, start=2):
        if not line:
            continue
        try:
            rows.append([_number(line[place]) for place in places])
        except (ValueError, IndexError) as error:
            raise InputError(
                f'{path}, line {number}: not numbers in the columns {", ".join(names)}'
            ) from error
    return rows


def _places(
    path: Path,
    header: list[str],
    names: Sequence[str],
) -> list[int]:
    """Return the places of columns in the header; InputError where one is missing."""
    missing = [name for name in names if name not in header]
    if missing:
        raise InputError(f'{path}: no column {", ".join(missing)}; expected {", ".join(names)}')
    return [header.index(name) for name in names]


def _number(field: str) -> float:
    """Return the number in a field; NaN where it is empty."""
    return float(field.strip() or 'nan')


def _joint_angles(message: Any) -> Sequence[float]:
    """Return the joint angles of the four, five or six sensors, in their order."""
    positions = message.position.tolist()
    angles = dict(zip(message.name, positions, strict=True))
    return [angles[name] for name in _joints_among(message.name)]


def _components(quaternion: Any) -> Sequence[float]:
    """Return the components x, y, z, w of a message's quaternion."""
    return [quaternion.x, quaternion.y, quaternion.z, quaternion.w]


# Takes the values of a message, by its type.
Taker = Callable[[Any], Sequence[float]]
ORIENTATIONS: dict[str, Taker] = {
    'geometry_msgs/msg/QuaternionStamped': lambda message: _components(message.quaternion),
    'geometry_msgs/msg/PoseStamped': lambda message: _components(message.pose.orientation),
    'geometry_msgs/msg/TransformStamped': lambda message: _components(message.transform.rotation),
}
JOINT_ANGLES: dict[str, Taker] = {'sensor_msgs/msg/JointState': _joint_angles}
AXIS_POSITIONS: dict[str, Taker] = {
    'sensor_msgs/msg/JointState': lambda message: [float(message.position[0])]
}


def _topic_rows(
    path: Path,
    topic: str,
    takers: Mapping[str, Taker],
    optional: bool = False,
    option: str = '--topic',
) -> list[list[float]]:
    """
    Return the rows of a topic: header stamp, s, and values.

    Parameters
    ----------
    path : Path
        The recording.
    topic : str
        Name of the topic, or its last parts.
    takers : mapping of str to Taker
        Takes the values of a message, by type.
    optional : bool, optional
        Whether the recording may lack the topic.
    option : str, optional
        Option of the program that names a topic, for the error.

    Returns
    -------
    list of list of float
        Empty if the topic is optional and missing.

    Raises
    ------
    InputError
        The topic has another type, a message cannot be read, or all stamps are 0.

    """
    found = bags.read_topic(path, topic, optional, option)
    if found is None:
        return []
    name, kind, messages = found
    if kind not in takers:
        raise InputError(f'{path}: {name} is of type {kind}; expected {" or ".join(takers)}')
    rows = []
    for number, message in enumerate(messages, start=1):
        try:
            stamp = message.header.stamp
            seconds = stamp.sec + 1e-9 * stamp.nanosec
            rows.append([seconds, *takers[kind](message)])
        except ValueError as error:
            raise InputError(
                f'{path}: message {number} on {name}: not as expected: {error}'
            ) from error
    if rows and not any(row[0] for row in rows):
        raise InputError(f'{path}: the header stamps on {name} are all 0; expected times')
    return rows
