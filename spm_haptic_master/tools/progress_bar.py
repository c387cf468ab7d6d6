# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Progress on stderr: a bar on a terminal, otherwise one line a second."""

from __future__ import annotations

import shutil
import sys
import time

from spm_haptic_master.encoders.source import EncoderSource

# Time between two lines where the output is not a terminal, and between two updates of the bar on
# a terminal (s).
LINE_PERIOD, TERMINAL_PERIOD = 1.0, 0.1
# Width of the bar (characters).
BAR = 30


class ProgressBar:
    """
    Shows what is done and, where it is known, what part of the whole.

    Each line begins with the name of the program; work shorter than `delay`, s, shows nothing.
    """

    def __init__(self, name: str, delay: float = 0.0):
        self._name = name
        self._terminal = sys.stderr.isatty()
        self._next = time.monotonic() + delay
        self._shown = False

    def show(self, text: str, share: float | None = None) -> None:
        """Show a text and the part done, None where it is unknown, if that is due."""
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        self._shown = True
        if not self._terminal:
            print(f'{self._name}: {text}', file=sys.stderr, flush=True)
            return
        bar = '' if share is None else \
            f'[{("#" * round(BAR * min(max(share, 0.0), 1.0))).ljust(BAR, ".")}] '
        width = shutil.get_terminal_size().columns - 1
        print(f'\r{f"{bar}{text}"[:width]}\x1b[K', end='', file=sys.stderr, flush=True)

    def stage(self, text: str, share: float) -> None:
        """Show a stage of a computation and the part of the whole that is done."""
        self.show(text if self._terminal else f'{100.0 * share:3.0f} %, {text}', share)

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal and self._shown:
            print(file=sys.stderr)


def with_trouble(text: str, source: EncoderSource) -> str:
    """Return a text with the fault or the caution of a source, if it has any."""
    trouble = source.fault or source.caution
    return f'{text} ({trouble})' if trouble else text
