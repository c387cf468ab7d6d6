# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Standard input, output and error of a process, whatever they are connected to."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
import os
import sys
import threading

STANDARD_INPUT, STANDARD_OUTPUT, STANDARD_ERROR = 0, 1, 2
# Lines that wait for a reader: an evening of a rig's log. Later ones are lost, and counted.
LINES_WAITING = 1000


def keep_open() -> None:
    """Connect each closed standard stream to /dev/null, before a file takes its descriptor."""
    for descriptor in (STANDARD_INPUT, STANDARD_OUTPUT, STANDARD_ERROR):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free descriptor: this one
    for name, descriptor in ('stdout', STANDARD_OUTPUT), ('stderr', STANDARD_ERROR):
        if getattr(sys, name) is None:
            setattr(
                sys,
                name,
                open(  # noqa: SIM115
                    descriptor, 'w', encoding='utf-8', closefd=False
                ),
            )


def discard(descriptor: int) -> None:
    """Connect a stream that cannot be written to /dev/null, which takes the buffered rest."""
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, descriptor)
    os.close(null)


def write_all(descriptor: int, text: str) -> None:
    """Write a text, by as many system calls as it takes; OSError if nobody can ever read it."""
    data = text.encode(errors='replace')
    while data:
        data = data[os.write(descriptor, data) :]


class LineWriter:
    """
    Writes lines in a thread of its own: only it waits for a reader that has stopped.

    Parameters
    ----------
    descriptor : int
        The stream, such as `STANDARD_ERROR`.

    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._lines: deque[str] = deque()
        self._lost = 0
        self._changed = threading.Condition()
        self._writing = False
        threading.Thread(target=self._run, name='lines', daemon=True).start()

    def put(self, line: str) -> None:
        """Queue a line without waiting; it is lost if `LINES_WAITING` are queued."""
        with self._changed:
            if len(self._lines) < LINES_WAITING:
                self._lines.append(line)
            else:
                self._lost += 1
            self._changed.notify_all()

    def close(self, timeout: float) -> None:
        """Wait until all lines are written, `timeout` s at most."""
        with self._changed:
            self._changed.wait_for(lambda: not (self._lines or self._writing), timeout)

    def _run(self) -> None:
        """Write lines as they come; what cannot be written is lost."""
        while True:
            with self._changed:
                self._writing = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._lines)
                self._writing = True
                lines, lost = list(self._lines), self._lost
                self._lines.clear()
                self._lost = 0
            if lost:
                lines.append(f'{lost} lines were lost here: they were not read in time')
            with suppress(OSError):  # the reader has gone
                write_all(self._descriptor, '\n'.join(lines) + '\n')


def print_within(descriptor: int, line: str, timeout: float) -> None:
    """Write one line, and wait for it `timeout` s at most."""
    writer = LineWriter(descriptor)
    writer.put(line)
    writer.close(timeout)
