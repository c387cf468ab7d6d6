# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A log file of python-can: its reader, and words for the place where it cannot be read."""

from __future__ import annotations

from collections.abc import Iterator
from io import TextIOWrapper
from pathlib import Path
import struct
from typing import Any
import zlib

import can
from can.io.generic import MessageReader

# Description of a line, or of the whole file, by the suffix without .gz.
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


class CountedLines:
    """
    Lines of a text file with their number; bytes that are no UTF-8 are escaped.

    Parameters
    ----------
    file : TextIOWrapper
        Of which nothing has been read.

    Attributes
    ----------
    number : int
        Number of the latest line, 1 for the first; 0 before it.
    line : str
        The latest line.

    """

    def __init__(self, file: TextIOWrapper):
        self._file = file
        self._buffer: Any = file.buffer
        self.number = 0
        self.line = ''

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        self.line = next(self._buffer).decode('utf-8', 'backslashreplace')
        self.number += 1
        return self.line

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._file.closed

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def open_log(path: Path) -> MessageReader:
    """
    Return python-can's reader of a log, which counts the lines of a text.

    Raises
    ------
    ValueError
        python-can has no reader of this format.
    Exception
        Which one depends on the reader.

    """
    reader: Any = can.LogReader(str(path))
    if isinstance(reader.file, TextIOWrapper):
        reader.file = CountedLines(reader.file)
    found: MessageReader = reader
    return found


def trouble(path: Path, error: Exception, reader: Any = None) -> str:
    """
    Return where a log cannot be read, and what was expected there.

    Parameters
    ----------
    path : Path
        The log.
    error : Exception
        What python-can raised.
    reader : MessageReader, optional
        Of `open_log`; None where it could not be made.

    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    lines = getattr(reader, 'file', None)
    if not isinstance(lines, CountedLines):
        lines = None
    at = f'after line {lines.number}, ' if lines and lines.number else ''
    if isinstance(error, (EOFError, zlib.error)) or 'gzip' in type(error).__name__.lower():
        return f'{at}the compressed data end or are broken; expected a whole {COMPRESSED} file'
    if isinstance(error, OSError):
        return f'{at}{error.strerror or error}'
    name = next((suffix for suffix in reversed(suffixes) if suffix in EXPECTED), '')
    expected = EXPECTED.get(name, 'a log that python-can reads')
    if lines and at:
        quoted = lines.line.rstrip('\r\n')
        dots = ' ...' if len(quoted) > QUOTED else ''
        return f'line {lines.number} is {quoted[:QUOTED]!r}{dots}; expected {expected}'
    first, *_ = str(error).splitlines() or ['']
    return f'{"it is cut" if isinstance(error, struct.error) else first}; expected {expected}'
