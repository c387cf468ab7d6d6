# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
What the exports of Motive, Vicon and QTM say of their columns, by their headers.

Each reader returns None for a file of another system, and raises InputError for one of its own
that lacks what is needed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import quaternion_from_matrix
from spm_haptic_master.kinematics.rotations import matrix_from_vector
from spm_haptic_master.validation.alignment import nearest_rotation

Array = NDArray[np.float64]
# Columns of a body or a marker, by its name.
Columns = dict[str, tuple[int, ...]]

# Number of lines of a file in which its header stands.
HEADER_LINES = 40
# First lines of the sections of a file of Vicon, in small letters.
VICON_SECTIONS = ('objects', 'segments', 'trajectories', 'global angles')
# Axes of an orientation in a file of Vicon: a rotation vector, or a quaternion.
VICON_TURNS = ('RX', 'RY', 'RZ', 'RW')


@dataclass(frozen=True, slots=True)
class Sheet:
    """
    A table of text, as an export is read.

    Attributes
    ----------
    path : Path
        The file, for errors.
    lines : list of list of str
        Its lines, by their fields.

    """

    path: Path
    lines: list[list[str]]

    @property
    def begin(self) -> str:
        """Return the first field of the file in small letters; empty without one."""
        if not self.lines or not self.lines[0]:
            return ''
        return _plain(self.lines[0][0])

    def find(self, is_wanted: Callable[[list[str]], bool]) -> int | None:
        """
        Return the index of the first line that is wanted.

        Parameters
        ----------
        is_wanted : callable
            Takes the fields of a line that is not empty.

        Returns
        -------
        int or None
            None where there is no such line.

        """
        for at, line in enumerate(self.lines):
            if line and is_wanted(line):
                return at
        return None


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
    bodies: Columns
    markers: Columns
    quaternion: Callable[[Array], Array]


def read_header(sheet: Sheet) -> Export | None:
    """
    Return what the export of a known system says of its columns.

    Parameters
    ----------
    sheet : Sheet
        The file.

    Returns
    -------
    Export or None
        None if the file is of no known system.

    Raises
    ------
    InputError
        The export lacks what is needed.

    """
    return _motive(sheet) or _vicon(sheet) or _qualisys(sheet)


def _plain(field: str) -> str:
    """Return a field of a table in small letters, without the spaces around it."""
    return field.strip().lower()


def _second(numbers: Sequence[float]) -> float:
    """Return the time of a line whose second field it is, s."""
    return numbers[1]


def _motive(sheet: Sheet) -> Export | None:
    """Read the header of OptiTrack's Motive."""
    if not sheet.begin.startswith('format version'):
        return None
    frame = sheet.find(lambda line: line[0].strip() == 'Frame') or 0
    rows = _motive_rows(sheet, frame)
    bodies = _motive_columns(rows, ('rigid body',), 'rotation')
    markers = _motive_columns(rows, ('marker', 'rigid body marker'), 'position')
    pairs = sheet.lines[0]
    about = dict(zip(pairs[::2], pairs[1::2], strict=False))
    kind = about.get('Rotation Type', 'Quaternion')
    if bodies and kind != 'Quaternion':
        raise InputError(
            f'{sheet.path}: Rotation Type is {kind}; expected Quaternion: export it again so'
        )
    return Export(
        first=frame + 1,
        seconds=_second,
        bodies=bodies,
        markers={name: columns[:3] for name, columns in markers.items()},
        quaternion=lambda values: values,
    )


def _motive_rows(sheet: Sheet, frame: int) -> list[list[str]]:
    """
    Return the rows of types, names, ..., quantities before the row Frame; InputError without them.

    Motive 3 says Type and Name in the second field of the first two; before it, that was empty.
    """
    rows = [line for line in sheet.lines[1:frame] if any(line)]
    labels = [[field.strip() for field in line[:2]] for line in rows[:2]]
    if len(rows) < 3 or labels not in ([['', 'Type'], ['', 'Name']], [['', ''], ['', '']]):
        raise InputError(
            f'{sheet.path}: a CSV file of Motive without its rows Type, Name and Frame'
        )
    return rows


def _motive_columns(
    rows: list[list[str]],
    wanted: Sequence[str],
    quantity: str,
) -> Columns:
    """Return the columns of `_motive_rows` with a quantity of wanted kinds, by their names."""
    kinds, names, *_, quantities = rows
    found: Columns = {}
    columns = zip(names, kinds, quantities, strict=False)
    for column, (name, kind, of) in enumerate(columns):
        if _plain(kind) in wanted and _plain(of) == quantity:
            body = name.strip()
            found[body] = (*found.get(body, ()), column)
    return found


def _vicon(sheet: Sheet) -> Export | None:
    """Read the header of Vicon: a section, its rate, names, then Frame, Sub Frame and units."""
    section = sheet.find(lambda line: _plain(line[0]) in VICON_SECTIONS)
    if section is None or section + 4 >= len(sheet.lines):
        return None
    names = sheet.lines[section + 2]
    axes = sheet.lines[section + 3]
    units = sheet.lines[section + 4]
    if axes[:2] != ['Frame', 'Sub Frame']:
        return None
    rate = _vicon_rate(sheet, section + 1)
    bodies: Columns = {}
    markers: Columns = {}
    in_degrees = False
    for name, place in _vicon_things(names, axes).items():
        turns = tuple(place[axis] for axis in VICON_TURNS if axis in place)
        if len(turns) >= 3:
            bodies[name] = turns
            in_degrees = 'deg' in units[turns[0]].lower()
        elif {'X', 'Y', 'Z'} <= place.keys():
            markers[name] = (place['X'], place['Y'], place['Z'])
    unit = math.pi / 180.0 if in_degrees else 1.0
    return Export(
        first=section + 5,
        seconds=lambda numbers: numbers[0] / rate,
        bodies=bodies,
        markers=markers,
        quaternion=lambda values: _vicon_quaternion(values, unit),
    )


def _vicon_rate(sheet: Sheet, at: int) -> float:
    """Return the rate in a line, Hz; InputError where it has none."""
    try:
        return float(sheet.lines[at][0])
    except (ValueError, IndexError) as error:
        raise InputError(f'{sheet.path}, line {at + 1}: expected the rate, Hz') from error


def _vicon_things(
    names: Sequence[str],
    axes: Sequence[str],
) -> dict[str, dict[str, int]]:
    """Return the column of each axis of each thing; a thing ends where the next name stands."""
    found: dict[str, dict[str, int]] = {}
    begins = [column for column, name in enumerate(names) if name.strip()]
    ends = [*begins[1:], len(axes)]
    for begin, end in zip(begins, ends, strict=True):
        columns = range(begin, min(end, len(axes)))
        name = names[begin].strip()
        found[name] = {axes[column].strip(): column for column in columns}
    return found


def _vicon_quaternion(values: Array, unit: float) -> Array:
    """
    Return the quaternion x, y, z, w of a body's columns; NaN where it was not seen.

    Three numbers are a rotation vector (helical angles) in a unit, rad; four are a quaternion.
    """
    if len(values) == 4 or np.isnan(values).any():
        return np.resize(values, 4)
    turn = matrix_from_vector(unit * values[None])
    quaternion: Array = quaternion_from_matrix(turn)[0]
    return quaternion


def _qualisys(sheet: Sheet) -> Export | None:
    """Read the header of Qualisys' QTM: lines NO_OF_FRAMES, FREQUENCY, ..., then numbers."""
    if sheet.begin != 'no_of_frames':
        return None
    top = [line for line in sheet.lines[:HEADER_LINES] if line]
    about = {line[0].strip().upper(): line[1:] for line in top}
    first = sheet.find(lambda line: _is_number(line[0]))
    if first is None:
        first = len(sheet.lines)
    before_numbers = sheet.lines[first - 1]
    header = [field.strip() for field in before_numbers]
    if header[:2] != ['Frame', 'Time']:
        raise InputError(
            f'{sheet.path}: a file of QTM without the columns Frame and Time; export it again '
            'with "Include time data for every frame" and the column header'
        )
    included = ''.join(about.get('DATA_INCLUDED', []))
    bodies: Columns = {}
    markers: Columns = {}
    if included.strip().upper().startswith('6D'):
        bodies = _qualisys_bodies(header, _listed(about, 'BODY_NAMES'))
    else:
        markers = _qualisys_markers(_listed(about, 'MARKER_NAMES'))
    return Export(
        first=first,
        seconds=_second,
        bodies=bodies,
        markers=markers,
        quaternion=_quaternion_of_columns,
    )


def _listed(
    about: dict[str, list[str]],
    line: str,
) -> list[str]:
    """Return the names in a line of the header of QTM."""
    names = [name.strip() for name in about.get(line, [])]
    return [name for name in names if name]


def _qualisys_bodies(
    header: Sequence[str],
    names: Sequence[str],
) -> Columns:
    """
    Return the nine columns of the matrix of each body, column after column.

    A body has x, y, z, three angles, a residual and the matrix.
    """
    begins = [column for column, field in enumerate(header) if field.endswith('Rot[0]')]
    found: Columns = {}
    for name, begin in zip(names, begins, strict=False):
        found[name] = tuple(range(begin, begin + 9))
    return found


def _qualisys_markers(names: Sequence[str]) -> Columns:
    """Return the columns of x, y, z of each marker: they follow Frame and Time."""
    found: Columns = {}
    for at, name in enumerate(names):
        first = 2 + 3 * at
        found[name] = (first, first + 1, first + 2)
    return found


def _quaternion_of_columns(values: Array) -> Array:
    """Return the quaternion of nine numbers of a matrix, column after column; NaN if all are 0."""
    matrix = values.reshape(3, 3).T
    if not np.isfinite(matrix).all() or not matrix.any():
        return np.full(4, math.nan)
    # Printed with a few digits, it is a rotation nearly.
    return quaternion_from_matrix(nearest_rotation(matrix))


def _is_number(text: str) -> bool:
    """Return whether a field of a table is a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
