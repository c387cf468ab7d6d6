# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A terminal of a test: a program on a pseudo-terminal, and what an emulator shows of it."""

from __future__ import annotations

from collections.abc import Callable
import fcntl
import os
import pty
import select
import signal
import struct
import subprocess
import termios
import time

from harness import environment, ROOT
import pytest

pyte = pytest.importorskip('pyte', reason='pyte is not installed (extra test)')

# Lines kept that have left the screen.
HISTORY = 10_000


class Terminal:
    """A program on a terminal of a size, with changed environment variables."""

    def __init__(self, command: list[str], columns: int, lines: int, **changes: str):
        self._emulator, self._device = pty.openpty()
        self._screen = pyte.HistoryScreen(columns, lines, history=HISTORY)
        self._stream = pyte.ByteStream(self._screen)
        # All that the program printed.
        self.raw = b''
        self._set_size(columns, lines)
        self._process = subprocess.Popen(
            command, cwd=ROOT, env=environment(**{'TERM': 'xterm', **changes}), stdin=self._device,
            stdout=self._device, stderr=self._device, start_new_session=True)

    def _set_size(self, columns: int, lines: int) -> None:
        fcntl.ioctl(self._device, termios.TIOCSWINSZ, struct.pack('HHHH', lines, columns, 0, 0))

    def resize(self, columns: int, lines: int) -> None:
        """Give the window another size; as xterm, a lower one loses lines below the cursor."""
        self.read(0.0)
        self._set_size(columns, lines)
        screen, row = self._screen, self._screen.cursor.y
        removed = max(0, screen.lines - lines)
        above = max(0, row + 1 - lines)
        if removed > above:
            screen.cursor_position(1, 1)
            screen.insert_lines(removed - above)
        screen.resize(lines, columns)
        screen.cursor_position(row - above + 1, 1)

    def print_to(self, text: str) -> None:
        """Print as another library of the program does."""
        os.write(self._device, text.encode())

    def read(self, seconds: float) -> None:
        """Show what is printed within some seconds."""
        end = time.monotonic() + seconds
        while True:
            left = max(0.0, end - time.monotonic())
            if not select.select([self._emulator], [], [], left)[0]:
                return
            data = os.read(self._emulator, 1 << 16)
            self.raw += data
            self._stream.feed(data)

    def read_until(self, condition: Callable[[], object], seconds: float) -> bool:
        """Show what is printed until a condition holds; False if it did not in time."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                return False
            self.read(0.1)
        return True

    @property
    def shown(self) -> list[str]:
        """Return the lines on the screen."""
        return [line.rstrip() for line in self._screen.display]

    @property
    def text(self) -> list[str]:
        """Return the lines on the screen and those that have left it upwards."""
        above = [''.join(line[column].data for column in range(self._screen.columns)).rstrip()
                 for line in self._screen.history.top]
        return above + self.shown

    @property
    def cursor(self) -> tuple[int, int]:
        """Return column and line of the cursor."""
        return self._screen.cursor.x, self._screen.cursor.y

    def end(self, seconds: float) -> int:
        """Interrupt the program, show its end and return its exit code."""
        self._process.send_signal(signal.SIGINT)
        self.read_until(lambda: self._process.poll() is not None, seconds)
        self.read(0.1)
        return self._process.wait(seconds)

    def close(self) -> None:
        """Kill the program and close the terminal."""
        self._process.kill()
        self._process.wait()
        os.close(self._emulator)
        os.close(self._device)
