# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files that a recording writes: logs of frames and tables; none is overwritten."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import chain, count
from pathlib import Path
from typing import TextIO

import can
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.timing import SECOND

# Tables of a recording: joint angles and orientations.
JOINTS_NAME = 'measured_js.csv'
ORIENTATION_NAME = 'orientation.csv'
# Columns of a table of orientations.
QUATERNION_COLUMNS = ('qx', 'qy', 'qz', 'qw')
# Files with the truth of a simulation: orientations, and the rig.
GROUND_TRUTH_NAME = 'ground_truth.csv'
RIG_NAME = 'rig.json'


def free_path(path: Path) -> Path:
    """Return a path that does not exist: the given one, or with the next free number."""
    numbered = (path.with_name(f'{path.stem}_{number}{path.suffix}') for number in count(2))
    return next(each for each in chain((path,), numbered) if not each.exists())


class FrameLog:
    """
    Appends frames to a new file, as `candump -l` writes them; each write is a whole line.

    Parameters
    ----------
    path : Path
        File that does not exist; it is created with the first frame.

    Attributes
    ----------
    path : Path
        As given.
    error : OSError or None
        Why frames could not be written; nothing is written after it.

    """

    def __init__(self, path: Path):
        self.path = path
        self.error: OSError | None = None
        self._writer: can.CanutilsLogWriter | None = None
        self._latest = 0.0

    def take(self, message: can.Message) -> None:
        """Append a frame with its stamp, s since the Unix epoch; none is before the one before."""
        # A reopened bus has another clock: a log whose time runs backwards is refused.
        self._latest = max(self._latest, message.timestamp)
        if self.error:
            return
        try:
            if self._writer is None:
                file = open(self.path, 'x', encoding='ascii', buffering=1)
                self._writer = can.CanutilsLogWriter(file)
            self._writer.last_timestamp = self._latest
            self._writer.on_message_received(message)
        except OSError as error:
            self.error = error

    def close(self) -> None:
        """Close the file."""
        try:
            if self._writer is not None:
                self._writer.stop()
        except OSError as error:
            self.error = error


class Table:
    """
    A new CSV file of stamps in s and values, created with its first row.

    Parameters
    ----------
    path : Path
        File that does not exist.
    columns : sequence of str
        Names of the columns behind the time.

    Attributes
    ----------
    rows : int
        Number of rows.
    span : tuple of 2 int
        Stamps of the first and of the latest row, ns; zeros before the first.

    Raises
    ------
    InputError
        The file exists.

    """

    def __init__(self, path: Path, columns: Sequence[str]):
        _check_new(path)
        self.path = path
        self.rows = 0
        self.span = 0, 0
        self._columns = columns
        self._file: TextIO | None = None

    def write(self, stamp: int, values: Sequence[float]) -> None:
        """
        Append a row.

        Parameters
        ----------
        stamp : int
            Time, ns since the Unix epoch; it is written in s.
        values : sequence of float
            One value for each column.

        Raises
        ------
        InputError
            It cannot be written.

        """
        seconds, nanoseconds = divmod(stamp, SECOND)
        with _reported(self.path):
            if self._file is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._file = open(self.path, 'x', encoding='utf-8')
                self._file.write(','.join(('time', *self._columns)) + '\n')
            self._file.write(
                f'{seconds}.{nanoseconds:09d},'
                + ','.join(f'{value:.9f}' for value in values)
                + '\n'
            )
        self.span = (self.span[0] if self.rows else stamp), stamp
        self.rows += 1

    def close(self) -> None:
        """Close the file, if it was created; InputError if its end cannot be written."""
        if self._file is not None:
            with _reported(self.path):
                self._file.close()


def write_new(path: Path, text: str) -> None:
    """
    Write a text file that does not exist.

    Parameters
    ----------
    path : Path
        The file; its directories are made.
    text : str
        Its content.

    Raises
    ------
    InputError
        It exists, or cannot be written.

    """
    _check_new(path)
    with _reported(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, 'x', encoding='utf-8') as file:
            file.write(text)


def _check_new(path: Path) -> None:
    """Raise InputError for a file that already exists."""
    if path.exists():
        raise InputError(f'{path}: already exists; choose another directory')


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Raise InputError where the file cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error
