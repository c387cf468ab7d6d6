# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The end of a process takes `END_TIMEOUT` at most: it then says what it waits for, and goes."""

from __future__ import annotations

from collections.abc import Callable
import faulthandler
import os
import signal
import threading
import time

from spm_haptic_master.standard_streams import print_within, STANDARD_ERROR

# Longest end of a process (s), from the signal on: a longer one hangs in a library.
END_TIMEOUT = 5.0
# Time for the line that says so (s). As long after it the stacks are printed by a thread that
# needs no interpreter, and as long after that the kernel ends the process, whether stderr was read
# or not.
PRINT_TIMEOUT = 1.0


class EndLimit:
    """Limits the time of the end of an executable."""

    def __init__(self, name: str) -> None:
        self._name = name
        # When the end must be over, s, monotonic; None before it begins.
        self._until: float | None = None
        self._is_over = False
        self._waits_for = 'its nodes'

    def begin(self) -> None:
        """Begin to count, at the first call; a signal handler may do that."""
        if self._until is not None:
            return
        self._until = time.monotonic() + END_TIMEOUT
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_REAL, END_TIMEOUT + 2.0 * PRINT_TIMEOUT)
        faulthandler.dump_traceback_later(
            END_TIMEOUT + PRINT_TIMEOUT, exit=True, file=STANDARD_ERROR)

    def watch(self) -> None:
        """Begin to count, and report by name what is waited for; not from a signal handler."""
        self.begin()
        threading.Thread(target=self._run, name='end', daemon=True).start()

    def take(self, step: str, action: Callable[[], object]) -> None:
        """Do a step of the end, which is named where it takes too long."""
        self._waits_for = step
        action()

    def lift(self) -> None:
        """Let the process take its time."""
        self._is_over = True
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _run(self) -> None:
        time.sleep(max(0.0, (self._until or 0.0) - time.monotonic()))
        if self._is_over:
            return
        print_within(STANDARD_ERROR, f'{self._name}: still waiting for {self._waits_for} '
                     f'{END_TIMEOUT:g} s after the end began: it ends without', PRINT_TIMEOUT)
        faulthandler.dump_traceback(file=STANDARD_ERROR)
        os._exit(1)
