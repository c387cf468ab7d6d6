# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Files of a recording: logs of frames, read and written, and tables; none is overwritten."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from io import TextIOWrapper
from itertools import chain, count
from pathlib import Path
import struct
from typing import Any, TextIO
import zlib

import can
from spm_haptic_master.exceptions import InputError, ReplayError, SettingError
from spm_haptic_master.parameters.encoders import LOG_FORMATS
from spm_haptic_master.timing import SECOND

# Tables of a recording: joint angles and orientations.
JOINTS_NAME, ORIENTATION_NAME = 'measured_js.csv', 'orientation.csv'
# Columns of a table of orientations.
QUATERNION_COLUMNS = ('qx', 'qy', 'qz', 'qw')
# Files with the truth of a simulation: orientations, and the rig.
GROUND_TRUTH_NAME, RIG_NAME = 'ground_truth.csv', 'rig.json'
# Largest step back between two frames (s): recorders may swap frames within a cycle.
BACKWARDS_TOLERANCE = 1e-3
# Largest stamp of a frame (s): later than the 32 bits of a ROS message hold.
STAMP_LIMIT = 2.0**32
# Description of a line, or of the whole file, by the suffix without .gz. Other formats are
# refused: python-can's writer of .db (4.6), for one, drops what it has not yet written when it is
# stopped, and nothing in the file shows that.
EXPECTED = {
    '.log': '(SECONDS) CHANNEL ID#DATA, as `candump -l` writes it',
    '.asc': 'a line of a Vector ASC file',
    '.csv': 'timestamp,arbitration_id,extended,remote,error,dlc,data, as python-can writes them',
    '.trc': 'a line of a PEAK TRC file',
    '.blf': 'a whole Vector BLF file',
}
COMPRESSED = '.gz'
# Longest part of a line that is quoted (characters).
QUOTED = 60


class LogFile:
    """
    Frames of a log file.

    Raises SettingError if the file does not exist or has another format, and ReplayError if it
    cannot be opened.
    """

    def __init__(self, path: str):
        self.path = Path(path).expanduser()
        # The latest line of a text file and its number, 1 for the first; 0 before it.
        self._number, self._line = 0, ''
        if not self.path.is_file():
            raise SettingError('replay.path', path, 'an existing file')
        suffix = Path(self.path.name.lower().removesuffix(COMPRESSED)).suffix
        if suffix not in EXPECTED:
            raise SettingError(
                'replay.path',
                str(self.path),
                f'a log in a format that keeps all frames ({LOG_FORMATS})',
            )
        self._expected = EXPECTED[suffix]
        self._open().stop()

    def _open(self) -> Any:
        try:
            return can.LogReader(str(self.path))
        except Exception as error:
            # As below: the exception depends on the reader.
            raise ReplayError(f'{self.path}: cannot be read: {self._trouble(error)}') from error

    def frames(self) -> Iterator[can.Message]:
        """Yield the frames from the first on; raise ReplayError where the file is broken."""
        reader = self._open()
        file = reader.file
        if isinstance(file, TextIOWrapper):
            reader.file = self._counted(file.buffer)
        number, last = 0, 0.0
        try:
            for message in reader:
                number += 1
                if not 0.0 <= message.timestamp < STAMP_LIMIT:
                    raise ReplayError(
                        f'{self.path}: the stamp of frame {number} is {message.timestamp:g} s; '
                        f'expected 0 to {STAMP_LIMIT:.0f} s'
                    )
                if message.timestamp < last - BACKWARDS_TOLERANCE:
                    raise ReplayError(
                        f'{self.path}: time runs backwards at frame {number}, from '
                        f'{last:.6f} s to {message.timestamp:.6f} s'
                    )
                last = message.timestamp
                yield message
            # python-can does not report a truncated .blf; its header has the original size.
            recorded = getattr(reader, 'file_size', 0)
            if recorded > self.path.stat().st_size and self.path.suffix.lower() != COMPRESSED:
                raise ReplayError(
                    f'{self.path}: not readable after {number} frames: '
                    f'truncated, {recorded} bytes were recorded'
                )
        except ReplayError:
            raise
        except Exception as error:
            # On a truncated file, or one with the wrong suffix, the exception depends on
            # python-can's reader (ValueError, IndexError, struct.error, EOFError, ...).
            raise ReplayError(
                f'{self.path}: not readable after {number} frames: {self._trouble(error)}'
            ) from error
        finally:
            self._number = 0
            reader.stop()
            file.close()

    def _counted(self, lines: Iterable[bytes]) -> Iterator[str]:
        """Yield and count the lines of a text file; bytes that are not UTF-8 are escaped."""
        for self._number, line in enumerate(lines, 1):
            self._line = line.decode('utf-8', 'backslashreplace')
            yield self._line

    def _trouble(self, error: Exception) -> str:
        """Return where the log cannot be read, and what was expected there."""
        at = f'after line {self._number}, ' if self._number else ''
        if isinstance(error, (EOFError, zlib.error)) or 'gzip' in type(error).__name__.lower():
            return f'{at}the compressed data end or are broken; expected a whole {COMPRESSED} file'
        if isinstance(error, OSError):
            return f'{at}{error.strerror or error}'
        if self._number:
            quoted = self._line.rstrip('\r\n')
            dots = ' ...' if len(quoted) > QUOTED else ''
            return f'line {self._number} is {quoted[:QUOTED]!r}{dots}; expected {self._expected}'
        reason = 'it is cut' if isinstance(error, struct.error) else str(error).partition('\n')[0]
        return f'{reason}; expected {self._expected}'


def free_path(path: Path) -> Path:
    """Return a path that does not exist: the given one, or with the next free number."""
    numbered = (path.with_name(f'{path.stem}_{number}{path.suffix}') for number in count(2))
    return next(each for each in chain((path,), numbered) if not each.exists())


class FrameLog:
    """Appends frames to a new file, as `candump -l` writes them; each write is a whole line."""

    def __init__(self, path: Path):
        self.path = path
        # Why frames could not be written; nothing is written after it.
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
    """Write a text file that does not exist; InputError if it does, or cannot be written."""
    _check_new(path)
    with _reported(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(path, 'x', encoding='utf-8') as file:
            file.write(text)


def _check_new(path: Path) -> None:
    if path.exists():
        raise InputError(f'{path}: already exists; choose another directory')


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    """Raise InputError where the file cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error
