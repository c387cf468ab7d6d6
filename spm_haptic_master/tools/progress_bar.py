# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress of a recording on stderr: a bar on a terminal, otherwise one line a second."""

from __future__ import annotations

import shutil
import sys
import time

from spm_haptic_master.encoders.source import EncoderSource

# Time between two lines where the output is not a terminal (s).
LINE_PERIOD = 1.0
# Time between two updates of the bar on a terminal (s).
TERMINAL_PERIOD = 0.1
# Width of the bar (characters).
BAR = 30


class ProgressBar:
    """
    Shows how much of a recording is done.

    Parameters
    ----------
    name : str
        Name of the program, at the beginning of each line.
    seconds : float
        Length of the recording, s.
    source : EncoderSource
        Source that is recorded; its fault or caution is shown, too.

    """

    def __init__(self, name: str, seconds: float, source: EncoderSource):
        self._name = name
        self._seconds = seconds
        self._source = source
        self._terminal = sys.stderr.isatty()
        self._next = 0.0

    def show(self, done: float, sets: int) -> None:
        """Show the recorded time in s and the number of sets, if an update is due."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        fraction = min(done / self._seconds, 1.0) if self._seconds > 0.0 else 1.0
        text = f'{done:4.1f} of {self._seconds:g} s, {sets} sets'
        if trouble := self._source.fault or self._source.caution:
            text += f' ({trouble})'
        if self._terminal:
            print(f'\r[{_bar(fraction)}] {text}\x1b[K', end='', file=sys.stderr, flush=True)
        else:
            print(f'{self._name}: {text}', file=sys.stderr, flush=True)

    def end(self) -> None:
        """End the line of the bar."""
        if self._terminal:
            print(file=sys.stderr)


class CountBar:
    """
    Shows on stderr how many items are done.

    Parameters
    ----------
    name : str
        Name of the program, at the beginning of each line.
    total : int or None
        Number of items; None if it is unknown.
    items : str
        Their name, in the plural.

    """

    def __init__(self, name: str, total: int | None, items: str):
        self._name = name
        self._total = total
        self._items = items
        self._terminal = sys.stderr.isatty()
        # Short work shows nothing.
        self._next = time.monotonic() + LINE_PERIOD
        self._shown = False

    def show(self, done: int) -> None:
        """Show the number of items done, if an update is due."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        self._shown = True
        text = f'{done} {self._items}' if self._total is None \
            else f'{done} of {self._total} {self._items}'
        if not self._terminal:
            print(f'{self._name}: {text}', file=sys.stderr, flush=True)
        elif self._total is None:
            print(f'\r{text}\x1b[K', end='', file=sys.stderr, flush=True)
        else:
            print(f'\r[{_bar(done / self._total)}] {text}\x1b[K', end='', file=sys.stderr,
                  flush=True)

    def end(self) -> None:
        """End the line of the bar."""
        if self._terminal and self._shown:
            print(file=sys.stderr)


class StageBar:
    """
    Shows on stderr which stage of a computation runs and what part of the whole is done.

    Parameters
    ----------
    name : str
        Name of the program, at the beginning of each line.

    """

    def __init__(self, name: str):
        self._name = name
        self._terminal = sys.stderr.isatty()
        self._next = 0.0
        self._text = ''

    def show(self, text: str, fraction: float) -> None:
        """Show the stage and the part done (unit 1), if an update is due."""
        now = time.monotonic()
        if now < self._next and (text == self._text or not self._terminal):
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        self._text = text
        if self._terminal:
            width = shutil.get_terminal_size().columns - 1
            line = f'[{_bar(min(max(fraction, 0.0), 1.0))}] {text}'
            print(f'\r{line[:width]}\x1b[K', end='', file=sys.stderr, flush=True)
        else:
            print(f'{self._name}: {100.0 * fraction:3.0f} %, {text}', file=sys.stderr, flush=True)

    def end(self) -> None:
        """End the line of the bar."""
        if self._terminal:
            print(file=sys.stderr)


def _bar(fraction: float) -> str:
    """Return a bar of `BAR` characters."""
    return ('#' * round(BAR * fraction)).ljust(BAR, '.')
