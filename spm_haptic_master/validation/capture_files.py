# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Rows of the exports of motion capture systems: Motive, Vicon and QTM.

A rigid body gives its orientation in the capture's frame; without one, markers named A, B, C and D
give their positions. Where a system writes zeros or nothing for what it did not see, the row has
no value.
"""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.validation.capture_headers import Array, Columns, Export, read_header, Sheet

# A row of an export: time, s, and a quaternion x, y, z, w or twelve coordinates; NaN not seen.
Rows = list[list[float]]

# Names of the four markers, in the order of the columns of a table of markers.
MARKER_NAMES = ('a', 'b', 'c', 'd')
# Longest list of names that is printed (characters).
QUOTED = 120


def export_rows(
    sheet: Sheet,
    body: str | None,
) -> tuple[bool, Rows] | None:
    """
    Return the rows of an export of a known system.

    Parameters
    ----------
    sheet : Sheet
        The file.
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
    export = read_header(sheet)
    if export is None:
        return None
    if export.bodies:
        columns = _of_body(sheet, export.bodies, body)
        return True, _rows(sheet, export, columns)
    columns = _of_markers(sheet, export.markers)
    return False, _rows(sheet, export, columns)


def _of_body(
    sheet: Sheet,
    bodies: Columns,
    body: str | None,
) -> tuple[int, ...]:
    """Return the columns of the wanted rigid body, or of the only one."""
    if body is None and len(bodies) == 1:
        return next(iter(bodies.values()))
    if body in bodies:
        return bodies[body]
    listed = ', '.join(bodies)[:QUOTED]
    raise InputError(f'{sheet.path}: rigid bodies {listed}; name one by --capture-topic')


def _of_markers(
    sheet: Sheet,
    markers: Columns,
) -> tuple[int, ...]:
    """
    Return the columns of x, y, z of the markers A, B, C, D.

    What is before the last colon or underscore of a name does not count.
    """
    short = {}
    for name in markers:
        _, _, last = name.replace('_', ':').rpartition(':')
        short[last.lower()] = name
    missing = [name.upper() for name in MARKER_NAMES if name not in short]
    if missing:
        among = ', '.join(markers)[:QUOTED] or 'none'
        raise InputError(
            f'{sheet.path}: no rigid body, and no marker {", ".join(missing)} among '
            f'{among}; expected A, B on the axis, C, D beside it'
        )
    columns: list[int] = []
    for name in MARKER_NAMES:
        columns += markers[short[name]]
    return tuple(columns)


def _rows(
    sheet: Sheet,
    export: Export,
    columns: Sequence[int],
) -> Rows:
    """Return the rows of some columns up to the end of the section; NaN what was not seen."""
    rows: Rows = []
    lines = sheet.lines[export.first :]
    for number, line in enumerate(lines, export.first + 1):
        filled = [field for field in line if field.strip()]
        if len(filled) >= 2:
            numbers = _numbers(sheet, number, line)
            wanted = [_at(numbers, column) for column in columns]
            values = np.array(wanted)
            if export.bodies:
                seen = export.quaternion(values)
            else:
                seen = _seen(values)
            rows.append([export.seconds(numbers), *seen.tolist()])
        elif rows:
            break  # a further section begins
    return rows


def _numbers(
    sheet: Sheet,
    number: int,
    line: Sequence[str],
) -> list[float]:
    """Return the numbers of a line, NaN for an empty field; InputError where one is no number."""
    try:
        return [float(field.strip() or 'nan') for field in line]
    except ValueError as error:
        raise InputError(f'{sheet.path}, line {number}: not numbers: {error}') from error


def _at(numbers: Sequence[float], column: int) -> float:
    """Return the number in a column; NaN in a line that ends before it."""
    if column < len(numbers):
        return numbers[column]
    return math.nan


def _seen(values: Array) -> Array:
    """Return coordinates of markers; NaN for one that is exactly at 0, 0, 0."""
    points = values.reshape(-1, 3)
    is_seen = points.any(axis=1, keepdims=True)
    return np.where(is_seen, points, math.nan).ravel()
