# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Logs of frames as other tools write them, read by python-can: what is whole, or a reason.

A damaged log must not pass for a shorter one: it ends with an error that names the place.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import gzip
from io import TextIOWrapper
from itertools import islice
from pathlib import Path
import re
import struct
from typing import Any
import zlib

import can
from spm_haptic_master.exceptions import ReplayError, SettingError
from spm_haptic_master.parameters.encoders import LOG_FORMATS

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
# Formats that number their channels from 1, where python-can numbers them from 0.
NUMBERED_FROM_ONE = ('.asc', '.blf')
# A line of `candump -l`: whole bytes, or a remote frame. python-can pairs an odd number of digits
# with what is not there.
CANDUMP_LINE = re.compile(
    r'\s*\([^)]*\)\s+\S+\s+[0-9A-Fa-f]+#(R[0-9A-Fa-f]?|#[0-9A-Fa-f])?([0-9A-Fa-f]{2})*'
    r'(\s+[RT])?\s*|\s*'
)
# Number at the beginning of a line of an ASC file (s).
LEADING_SECONDS = re.compile(r'\s*(\d+\.\d+)\s')
# Number of frames that show which channels have encoders: a second of four at 1 kHz.
FIRST_FRAMES = 5000
# Longest part of a line that is quoted (characters).
QUOTED = 60
# Bytes of a file that are read at once.
BLOCK = 1 << 20


class LogFile:
    """
    Frames of a log file.

    Parameters
    ----------
    path : str
        The file, in one of the formats of EXPECTED, also compressed (.gz).

    Attributes
    ----------
    path : Path
        The file.

    Raises
    ------
    SettingError
        The file does not exist, or has another format.
    ReplayError
        It cannot be opened.

    """

    def __init__(self, path: str):
        self.path = Path(path).expanduser()
        # The latest line of a text file and its number, 1 for the first; 0 before it.
        self._number = 0
        self._line = ''
        # Sum of the times at the beginning of the lines of an ASC file, s.
        self._elapsed = 0.0
        if not self.path.is_file():
            raise SettingError(
                name='replay.path',
                value=path,
                expected='an existing file',
            )
        suffix = Path(self.path.name.lower().removesuffix(COMPRESSED)).suffix
        if suffix not in EXPECTED:
            raise SettingError(
                name='replay.path',
                value=str(self.path),
                expected=f'a log in a format that keeps all frames ({LOG_FORMATS})',
            )
        self._suffix = suffix
        self._open().stop()

    def channel_of(self, message: can.Message) -> str:
        """
        Return the name of a frame's channel as the file has it.

        Parameters
        ----------
        message : can.Message
            A frame of this file.

        Returns
        -------
        str
            The name; empty where the file has none.

        """
        if message.channel is None:
            return ''
        if isinstance(message.channel, int) and self._suffix in NUMBERED_FROM_ONE:
            return str(message.channel + 1)
        return str(message.channel)

    def select_channel(self, identifiers: set[tuple[int, bool]], wanted: str) -> str:
        """
        Return the channel with the encoders' frames.

        Parameters
        ----------
        identifiers : set of (int, bool)
            Identifiers of the encoders' frames, and whether each has 29 bits.
        wanted : str
            Parameter `can.channel`; it decides where several channels have such frames.

        Returns
        -------
        str
            The channel; empty where the file names none.

        Raises
        ------
        SettingError
            Several channels have frames of the encoders, and `wanted` is none of them.

        """
        found: dict[str, int] = {}
        try:
            for message in islice(self.frames(), FIRST_FRAMES):
                if (message.arbitration_id, message.is_extended_id) in identifiers:
                    channel = self.channel_of(message)
                    found[channel] = found.get(channel, 0) + 1
        except ReplayError:
            # Reported where the replay arrives at it.
            pass
        if len(found) <= 1:
            return next(iter(found), '')
        if wanted in found:
            return wanted
        channels = ', '.join(sorted(found))
        raise SettingError(
            name='can.channel',
            value=wanted,
            expected=f'one of {channels}: {self.path} has frames of the encoders on each',
        )

    def frames(self) -> Iterator[can.Message]:
        """
        Yield the frames from the first on.

        Yields
        ------
        can.Message
            Frame with its recorded time, s.

        Raises
        ------
        ReplayError
            The file is broken, cut, or its times run backwards.

        """
        reader = self._open()
        file = reader.file
        if isinstance(file, TextIOWrapper):
            reader.file = self._checked_lines(file.buffer)
        number = 0
        last = 0.0
        try:
            for message in reader:
                number += 1
                if getattr(reader, 'timestamps_format', None) == 'relative':
                    message.timestamp = self._elapsed
                self._check_time(message.timestamp, last, number)
                last = message.timestamp
                yield message
            self._check_ended(reader, number)
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
            self._elapsed = 0.0
            reader.stop()
            file.close()

    def _open(self) -> Any:
        """Return python-can's reader of the file; ReplayError where that fails."""
        try:
            return can.LogReader(str(self.path))
        except Exception as error:
            # As above: the exception depends on the reader.
            raise ReplayError(f'{self.path}: cannot be read: {self._trouble(error)}') from error

    def _check_time(
        self,
        stamp: float,
        last: float,
        number: int,
    ) -> None:
        """Raise ReplayError for a stamp, s, that is none, or well before the last one."""
        if not 0.0 <= stamp < STAMP_LIMIT:
            raise ReplayError(
                f'{self.path}: the stamp of frame {number} is {stamp:g} s; expected 0 to '
                f'{STAMP_LIMIT:.0f} s'
            )
        if stamp < last - BACKWARDS_TOLERANCE:
            raise ReplayError(
                f'{self.path}: time runs backwards at frame {number}, from {last:.6f} s to '
                f'{stamp:.6f} s'
            )

    def _check_ended(self, reader: Any, number: int) -> None:
        """Raise ReplayError for a .blf without its end: its header has the size at that time."""
        recorded = getattr(reader, 'file_size', None)
        if recorded is None:
            return
        size = self._size()
        if recorded > size:
            raise ReplayError(
                f'{self.path}: not readable after {number} frames: truncated, {recorded} bytes '
                'were recorded'
            )
        if recorded < size:
            raise ReplayError(
                f'{self.path}: its recording was not ended (its header says {recorded} bytes, it '
                f'has {size}): `can_logconvert {self.path.name} whole.blf` keeps the '
                f'{number} frames that are in it'
            )

    def _size(self) -> int:
        """Return the size of the file, without its compression."""
        if self.path.suffix.lower() != COMPRESSED:
            return self.path.stat().st_size
        with gzip.open(self.path) as file:
            return sum(len(block) for block in iter(lambda: file.read(BLOCK), b''))

    def _checked_lines(self, lines: Iterable[bytes]) -> Iterator[str]:
        """Yield and count the lines of a text file; bytes that are not UTF-8 are escaped."""
        candump = self._suffix == '.log'
        for self._number, line in enumerate(lines, 1):
            self._line = line.decode('utf-8', 'backslashreplace')
            if candump and not CANDUMP_LINE.fullmatch(self._line):
                raise ValueError(self._line)
            if not candump and (seconds := LEADING_SECONDS.match(self._line)):
                self._elapsed += float(seconds[1])
            yield self._line

    def _trouble(self, error: Exception) -> str:
        """Return where the log cannot be read, and what was expected there."""
        at = f'after line {self._number}, ' if self._number else ''
        damaged = _is_damage(error)
        if damaged and self.path.suffix.lower() == COMPRESSED:
            return f'{at}the compressed data end or are broken; expected a whole {COMPRESSED} file'
        if isinstance(error, OSError) and not damaged:
            return f'{at}{error.strerror or error}'
        if self._number:
            return self._trouble_of_line()
        expected = EXPECTED[self._suffix]
        if damaged:
            return f'its data are damaged; expected {expected}'
        if isinstance(error, struct.error):
            reason = 'it is cut'
        else:
            reason = str(error).partition('\n')[0]
        return f'{reason}; expected {expected}'

    def _trouble_of_line(self) -> str:
        """Return the line that cannot be read, and how to remove it if it is the last one."""
        quoted = self._line.rstrip('\r\n')
        dots = ' ...' if len(quoted) > QUOTED else ''
        if self._line.endswith('\n'):
            cure = ''
        else:
            cure = f'; it is the last line: `sed -i "$ d" {self.path.name}` removes it'
        return (
            f'line {self._number} is {quoted[:QUOTED]!r}{dots}; expected '
            f'{EXPECTED[self._suffix]}{cure}'
        )


def _is_damage(error: Exception) -> bool:
    """Return whether an error is one of compressed data, in a file or in a block of a log."""
    return isinstance(error, (EOFError, zlib.error)) or 'gzip' in type(error).__name__.lower()
