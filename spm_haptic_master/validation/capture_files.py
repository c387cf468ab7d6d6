# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Exports of motion capture systems, known by their headers: Motive, Vicon and QTM.

A rigid body gives its orientation in the capture's frame; without one, markers named A, B, C and D
give their positions. Where a system writes zeros or nothing for what it did not see, the row has
no value.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.validation.alignment import nearest_rotation

Table = list[list[str]]
# A row of an export: time, s, and a quaternion x, y, z, w or twelve coordinates; NaN not seen.
Rows = list[list[float]]

# Names of the four markers, in the order of the columns of a table of markers.
MARKER_NAMES = ('a', 'b', 'c', 'd')
# Number of lines of a file in which its header stands.
HEADER_LINES = 40
# Longest list of names that is printed (characters).
QUOTED = 120


@dataclass(frozen=True, slots=True)
class Export:
    """
    What an export says of its columns.

    Attributes
    ----------
    first : int
        Index of the first line of numbers.
    seconds : callable
        Time, s, of the numbers of a line.
    bodies : dict of str to tuple of int
        Columns of the orientation of each rigid body, by name.
    markers : dict of str to tuple of int
        Columns of x, y, z of each marker, by its name.
    quaternion : callable
        Quaternion x, y, z, w of the columns of a body.

    """

    first: int
    seconds: Callable[[Sequence[float]], float]
    bodies: dict[str, tuple[int, ...]]
    markers: dict[str, tuple[int, ...]]
    quaternion: Callable[[np.ndarray], np.ndarray]


def export_rows(path: Path, table: Table, body: str | None) -> tuple[bool, Rows] | None:
    """
    Return the rows of an export of a known system.

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : Table
        Its lines, by their fields.
    body : str or None
        Name of the rigid body, where there are several.

    Returns
    -------
    tuple of bool and list, or None
        Whether the export has poses rather than markers, and its rows; None if it is no known
        export.

    Raises
    ------
    InputError
        Neither a body nor the four markers can be selected, or the export lacks what is needed.

    """
    for read_header in (_motive, _vicon, _qualisys):
        export = read_header(path, table)
        if export is None:
            continue
        if export.bodies:
            columns = export.bodies[_selected(path, export.bodies, body)]
        else:
            columns = _four_markers(path, export.markers)
        return bool(export.bodies), _rows(path, table, export, columns)
    return None


def _selected(path: Path, bodies: dict[str, tuple[int, ...]], body: str | None) -> str:
    """
    Return the name of the rigid body that is wanted, or the only one.

    Parameters
    ----------
    path : Path
        The file, for the error.
    bodies : dict of str to tuple of int
        Columns of each rigid body, by name.
    body : str or None
        The wanted name; None if none is given.

    Returns
    -------
    str
        A key of `bodies`.

    Raises
    ------
    InputError
        There is no such body, or none is named and there are several.

    """
    if body is None and len(bodies) == 1:
        return next(iter(bodies))
    if body in bodies:
        return body
    raise InputError(
        f'{path}: rigid bodies {", ".join(bodies)[:QUOTED]}; name one by --capture-topic'
    )


def _four_markers(path: Path, markers: dict[str, tuple[int, ...]]) -> tuple[int, ...]:
    """
    Return the columns of the markers A, B, C, D.

    What is before the last colon or underscore of a name does not count.

    Parameters
    ----------
    path : Path
        The file, for the error.
    markers : dict of str to tuple of int
        Columns of each marker, by name.

    Returns
    -------
    tuple of int
        Twelve columns: x, y, z of A, B, C, D.

    Raises
    ------
    InputError
        A marker is missing.

    """
    short = {name.replace('_', ':').rpartition(':')[2].lower(): name for name in markers}
    missing = [name.upper() for name in MARKER_NAMES if name not in short]
    if missing:
        raise InputError(
            f'{path}: no rigid body, and no marker {", ".join(missing)} among '
            f'{", ".join(markers)[:QUOTED] or "none"}; expected A, B on the axis, C, D beside it'
        )
    return tuple(column for name in MARKER_NAMES for column in markers[short[name]])


def _rows(path: Path, table: Table, export: Export, columns: Sequence[int]) -> Rows:
    """
    Return the rows of an export, up to the end of its section.

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : Table
        Its lines, by their fields.
    export : Export
        What its header says.
    columns : sequence of int
        Columns of the wanted body or markers.

    Returns
    -------
    Rows
        Time and values of each row; NaN where the system saw nothing.

    Raises
    ------
    InputError
        A field is no number.

    """
    rows: Rows = []
    for number, line in enumerate(table[export.first :], export.first + 1):
        if len([field for field in line if field.strip()]) < 2:
            if rows:
                break  # a further section begins
            continue
        try:
            numbers = [float(field.strip() or 'nan') for field in line]
            values = np.array(
                [numbers[column] if column < len(numbers) else math.nan for column in columns]
            )
        except ValueError as error:
            raise InputError(f'{path}, line {number}: not numbers: {error}') from error
        seen = export.quaternion(values) if len(values) != len('xyz') * 4 else _seen(values)
        rows.append([export.seconds(numbers), *seen.tolist()])
    return rows


def _seen(values: np.ndarray) -> np.ndarray:
    """Return coordinates of markers; NaN for one that is exactly at 0, 0, 0."""
    points = values.reshape(-1, 3)
    return np.where(points.any(axis=1, keepdims=True), points, math.nan).ravel()


def _motive(path: Path, table: Table) -> Export | None:
    """
    Return the export of OptiTrack's Motive: rows Type, Name, ..., Frame, Time (Seconds).

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : Table
        Its lines, by their fields.

    Returns
    -------
    Export or None
        None if the file is none of Motive.

    Raises
    ------
    InputError
        Rows of the header are missing, or the rotations are no quaternions.

    """
    if not table or not table[0] or not table[0][0].strip().lower().startswith('format version'):
        return None
    about = dict(zip(table[0][::2], table[0][1::2], strict=False))
    found = _row_with(table, 'Frame')
    kinds, names = _row_named(table, 'Type'), _row_named(table, 'Name')
    if found is None or kinds is None or names is None:
        raise InputError(f'{path}: a CSV file of Motive without its rows Type, Name and Frame')
    groups = table[found - 1]
    kind = about.get('Rotation Type', 'Quaternion')
    bodies = _columns_of(('rigid body',), 'rotation', names, kinds, groups)
    markers = _columns_of(('marker', 'rigid body marker'), 'position', names, kinds, groups)
    if bodies and kind != 'Quaternion':
        raise InputError(
            f'{path}: Rotation Type is {kind}; expected Quaternion: export it again so'
        )
    return Export(
        first=found + 1,
        seconds=lambda numbers: numbers[1],
        bodies=bodies,
        markers={name: columns[:3] for name, columns in markers.items()},
        quaternion=lambda values: values,
    )


def _columns_of(
    wanted: tuple[str, ...],
    quantity: str,
    names: Sequence[str],
    kinds: Sequence[str],
    groups: Sequence[str],
) -> dict[str, tuple[int, ...]]:
    """
    Return the columns of a quantity of some kinds of things in a file of Motive.

    Parameters
    ----------
    wanted : tuple of str
        Kinds of things, in small letters.
    quantity : str
        'rotation' or 'position'.
    names : sequence of str
        Row Name: the name of each column's thing.
    kinds : sequence of str
        Row Type: its kind.
    groups : sequence of str
        Row above Frame: the quantity of each column.

    Returns
    -------
    dict of str to tuple of int
        Columns by the name of the thing.

    """
    found: dict[str, tuple[int, ...]] = {}
    for column, (name, kind, group) in enumerate(zip(names, kinds, groups, strict=False)):
        if kind.strip().lower() in wanted and group.strip().lower() == quantity:
            found[name.strip()] = (*found.get(name.strip(), ()), column)
    return found


def _vicon(path: Path, table: Table) -> Export | None:
    """
    Return the export of Vicon: a section, its rate, names, then Frame, Sub Frame and units.

    Three rotations of a body are a rotation vector (helical angles), four a quaternion.

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : Table
        Its lines, by their fields.

    Returns
    -------
    Export or None
        None if the file is none of Vicon.

    Raises
    ------
    InputError
        The rate is missing.

    """
    titles = ('objects', 'segments', 'trajectories', 'global angles')
    start = next(
        (at for at, line in enumerate(table) if line and line[0].strip().lower() in titles), None
    )
    if start is None or start + 4 >= len(table) or table[start + 3][:2] != ['Frame', 'Sub Frame']:
        return None
    try:
        rate = float(table[start + 1][0])
    except (ValueError, IndexError) as error:
        raise InputError(f'{path}, line {start + 2}: expected the rate, Hz') from error
    names, axes, units = table[start + 2], table[start + 3], table[start + 4]
    begins = [column for column, name in enumerate(names) if name.strip()]
    bodies: dict[str, tuple[int, ...]] = {}
    markers: dict[str, tuple[int, ...]] = {}
    in_degrees = False
    for begin, end in zip(begins, [*begins[1:], len(axes)], strict=True):
        place = {axes[column].strip(): column for column in range(begin, min(end, len(axes)))}
        turns = [place[name] for name in ('RX', 'RY', 'RZ', 'RW') if name in place]
        if len(turns) >= 3:
            bodies[names[begin].strip()] = tuple(turns)
            in_degrees = 'deg' in units[turns[0]].lower()
        elif {'X', 'Y', 'Z'} <= place.keys():
            markers[names[begin].strip()] = place['X'], place['Y'], place['Z']
    factor = math.pi / 180.0 if in_degrees else 1.0

    def quaternion(values: np.ndarray) -> np.ndarray:
        """Return the quaternion x, y, z, w of a body's columns; NaN where it was not seen."""
        # Three numbers are a rotation vector (helical angles), four a quaternion.
        if len(values) == 4 or np.isnan(values).any():
            return np.resize(values, 4)
        return quaternion_from_matrix(matrix_from_vector(factor * values[None]))[0]

    return Export(
        first=start + 5,
        seconds=lambda numbers: numbers[0] / rate,
        bodies=bodies,
        markers=markers,
        quaternion=quaternion,
    )


def _qualisys(path: Path, table: Table) -> Export | None:
    """
    Return the export of Qualisys' QTM: lines NO_OF_FRAMES, FREQUENCY, ..., then numbers.

    A file of 6D data has bodies with rotation matrices, any other one has markers.

    Parameters
    ----------
    path : Path
        The file, for the error.
    table : Table
        Its lines, by their fields.

    Returns
    -------
    Export or None
        None if the file is none of QTM.

    Raises
    ------
    InputError
        It has no columns Frame and Time.

    """
    if not table or not table[0] or table[0][0].strip().upper() != 'NO_OF_FRAMES':
        return None
    about = {line[0].strip().upper(): line[1:] for line in table[:HEADER_LINES] if line}
    first = next((at for at, line in enumerate(table) if line and _is_number(line[0])), len(table))
    header = [field.strip() for field in table[first - 1]]
    if header[:2] != ['Frame', 'Time']:
        raise InputError(
            f'{path}: a file of QTM without the columns Frame and Time; export it again with '
            '"Include time data for every frame" and the column header'
        )
    bodies: dict[str, tuple[int, ...]] = {}
    markers: dict[str, tuple[int, ...]] = {}
    if ''.join(about.get('DATA_INCLUDED', [])).strip().upper().startswith('6D'):
        # Each body: x, y, z, three angles, residual, and the matrix, column after column.
        begins = [column for column, name in enumerate(header) if name.endswith('Rot[0]')]
        for name, begin in zip(_names(about, 'BODY_NAMES'), begins, strict=False):
            bodies[name] = tuple(range(begin, begin + 9))
    else:
        for number, name in enumerate(_names(about, 'MARKER_NAMES')):
            markers[name] = 2 + 3 * number, 3 + 3 * number, 4 + 3 * number
    return Export(
        first=first,
        seconds=lambda numbers: numbers[1],
        bodies=bodies,
        markers=markers,
        quaternion=_quaternion_of_columns,
    )


def _names(about: dict[str, list[str]], line: str) -> list[str]:
    """Return the names in a line of the header of QTM."""
    return [name.strip() for name in about.get(line, []) if name.strip()]


def _quaternion_of_columns(values: np.ndarray) -> np.ndarray:
    """Return the quaternion of nine numbers of a matrix, column after column; NaN if all are 0."""
    matrix = values.reshape(3, 3).T
    if not np.isfinite(matrix).all() or not matrix.any():
        return np.full(4, math.nan)
    # Printed with a few digits, it is a rotation nearly.
    return quaternion_from_matrix(nearest_rotation(matrix))


def _row_with(table: Table, first: str) -> int | None:
    """Return the index of the line of the header whose first field is a text."""
    for at, line in enumerate(table[:HEADER_LINES]):
        if line and line[0].strip() == first:
            return at
    return None


def _row_named(table: Table, name: str) -> list[str] | None:
    """Return the line of the header whose second field is a name."""
    for line in table[:HEADER_LINES]:
        if len(line) > 1 and line[1].strip() == name:
            return line
    return None


def _is_number(text: str) -> bool:
    """Return whether a field of a table is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
