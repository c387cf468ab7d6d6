# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measurements on a machine that may be busy: how busy it was, and what that makes of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import gc
import os
from pathlib import Path
import time

from benchmarks.pipeline.run import all_processes, Control, TICK
import numpy as np
import pytest
from spm_haptic_master.exceptions import SpmError

# Lateness of a thread that only wakes up, from which the machine was disturbed (s): ten periods
# at 1 kHz.
DISTURBED_LATENESS = 0.01
# The same for a test that runs beside others, and measures no samples at 1 kHz (s).
BESIDE_OTHERS = 0.1
# CPU time of other programs and other virtual machines from which this one was disturbed (% of a
# core).
DISTURBED_LOAD = 20.0
# How the reason of a skipped measurement begins. Such skips are counted at the end of the run.
SKIPPED = 'machine too busy: '


class Disturbance:
    """
    How busy the machine was in a `with` block.

    `lateness` is the largest one of a control thread, s, which may be `limit`; `load` the CPU time
    of programs that this run of the tests has not started, % of a core. An SpmError in the block
    may be due to a busy machine, as what is `expect`ed after it.
    """

    def __init__(self, limit: float = DISTURBED_LATENESS):
        self._limit = limit

    def __enter__(self):
        # To search what was there before for garbage would stop this process for 0.2 s.
        gc.freeze()
        self._began = time.monotonic()
        self._others = _ticks_of_others()
        self._control = Control()
        return self

    def __exit__(self, kind, error, _):
        gc.unfreeze()
        self.lateness = 1e-6 * float(np.max(self._control.stop(), initial=0.0))
        others = _ticks_of_others() - self._others
        self.load = 100.0 * TICK * others / (time.monotonic() - self._began)
        if isinstance(error, SpmError):
            self.expect(False, error)

    @property
    def disturbed(self) -> bool:
        """Whether the machine was too busy."""
        return self.lateness > self._limit or self.load > DISTURBED_LOAD

    def expect(self, holds: bool, measured: object = '') -> None:
        """Assert what only a busy machine may break; skip the test where this machine was busy."""
        if not holds and self.disturbed:
            pytest.skip(f'{SKIPPED}{self}; measured: {measured}')
        assert holds, f'{measured}; {self}'

    def __str__(self):
        return (
            f'control thread up to {1e3 * self.lateness:.0f} ms late, '
            f'other programs {self.load:.0f} % of a core'
        )


def number_of_skips(reports: Iterable[pytest.TestReport]) -> int:
    """Return how many of the skipped tests were skipped because of a busy machine."""
    return sum(SKIPPED in str(report.longrepr) for report in reports)


def _ticks_of_others() -> int:
    """Return the CPU time of other programs and of other virtual machines, clock ticks."""
    total = Path('/proc/stat').read_text().split(maxsplit=9)
    # A worker of pytest-xdist has been started by the process of the run.
    run = os.getppid() if 'PYTEST_XDIST_WORKER' in os.environ else os.getpid()
    processes = all_processes()
    own = {run} | descendants(run, processes)
    return sum(ticks for pid, (_, ticks) in processes.items() if pid not in own) + int(total[8])


def descendants(pid: int, processes: Mapping[int, tuple[int, int]] | None = None) -> set[int]:
    """Return the ids of the processes that a process has started, and of theirs."""
    processes = all_processes() if processes is None else processes
    found: set[int] = set()
    added = {pid}
    while added:
        added = {child for child, (parent, _) in processes.items() if parent in added}
        found |= added
    return found
