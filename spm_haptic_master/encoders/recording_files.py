# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of a recording, in directories that are made for them; no file is overwritten."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.timing import SECOND

# Tables of a recording: joint angles and orientations.
JOINTS_NAME, ORIENTATION_NAME = 'measured_js.csv', 'orientation.csv'
# Columns of a table of orientations.
QUATERNION_COLUMNS = ('qx', 'qy', 'qz', 'qw')
# Files with the truth of a simulation: orientations, and the rig.
GROUND_TRUTH_NAME, RIG_NAME = 'ground_truth.csv', 'rig.json'


class Table:
    """A new CSV file of stamps in s and values, created with its first row, or InputError."""

    def __init__(self, path: Path, columns: Sequence[str]):
        _check_new(path)
        self.path = path
        # Number of rows, and stamps of the first and of the latest, ns; zeros before the first.
        self.rows = 0
        self.span = 0, 0
        self._columns = columns
        self._file: TextIO | None = None

    def write(self, stamp: int, values: Sequence[float]) -> None:
        """Append a row: a stamp in ns, and the values; InputError if it cannot be written."""
        seconds, nanoseconds = divmod(stamp, SECOND)
        try:
            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = open(self.path, 'x', encoding='utf-8')
                self._file.write(','.join(('time', *self._columns)) + '\n')
            self._file.write(f'{seconds}.{nanoseconds:09d},'
                             + ','.join(f'{value:.9f}' for value in values) + '\n')
            self.span = (self.span[0] if self.rows else stamp), stamp
            self.rows += 1
        except OSError as error:
            raise _unwritable(self.path, error) from error

    def close(self) -> None:
        """Close the file, if it was created; InputError if its end cannot be written."""
        try:
            if self._file is not None:
                self._file.close()
        except OSError as error:
            raise _unwritable(self.path, error) from error


def write_new(path: Path, text: str) -> None:
    """Write a text file that does not exist; InputError if it does, or cannot be written."""
    _check_new(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, 'x', encoding='utf-8') as file:
            file.write(text)
    except OSError as error:
        raise _unwritable(path, error) from error


def _check_new(path: Path) -> None:
    if path.exists():
        raise InputError(f'{path}: already exists; choose another directory')


def _unwritable(path: Path, error: OSError) -> InputError:
    return InputError(f'{path}: cannot be written: {error}')
