# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A log of the frames of a bus that is written while they come, and whole whenever that ends."""

from __future__ import annotations

from io import StringIO
from itertools import count
from pathlib import Path
import time
from typing import BinaryIO

import can

# Longest time for which frames are held in memory (s): what a kill loses.
WRITE_PERIOD = 0.1


def free_path(path: Path) -> Path:
    """Return a path that does not exist: the given one, or with the next free number."""
    numbered = (path.with_name(f'{path.stem}_{number}{path.suffix}') for number in count(2))
    found = path
    while found.exists():
        found = next(numbered)
    return found


class FrameLog:
    """Appends frames to a new file, as `candump -l` writes them; each write is of whole lines."""

    def __init__(self, path: Path):
        self.path = path
        # Why frames could not be written; nothing is written after it.
        self.error: OSError | None = None
        self._file: BinaryIO | None = None
        self._text = StringIO()
        self._writer = can.CanutilsLogWriter(self._text)
        self._written_at = time.monotonic()
        self._latest = 0.0

    def take(self, message: can.Message) -> None:
        """Append a frame with its stamp, s since the Unix epoch; none is before the one before."""
        # A bus that is opened again has another clock: a log whose time runs backwards is refused.
        self._writer.last_timestamp = self._latest = max(self._latest, message.timestamp)
        self._writer.on_message_received(message)
        if time.monotonic() - self._written_at >= WRITE_PERIOD:
            self._write()

    def close(self) -> None:
        """Write what is left, and close the file."""
        self._write()
        if self._file is not None:
            self._file.close()

    def _write(self) -> None:
        self._written_at = time.monotonic()
        lines = self._text.getvalue()
        self._text.seek(0)
        self._text.truncate()
        if not lines or self.error:
            return
        try:
            if self._file is None:
                self._file = open(self.path, 'xb', buffering=0)
            self._file.write(lines.encode())
        except OSError as error:
            self.error = error
