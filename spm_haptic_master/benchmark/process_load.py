# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""CPU time of processes, from /proc, and the machine's own lateness."""

from __future__ import annotations

import os
from pathlib import Path
import threading

import numpy as np
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid

# Length of a clock tick of /proc/PID/stat (s).
TICK = 1.0 / os.sysconf('SC_CLK_TCK')
# Period of the control thread (s).
CONTROL_PERIOD = 0.005


class Control:
    """A thread that only wakes up on a grid: its lateness is the machine's own disturbance."""

    def __init__(self) -> None:
        self._stop = threading.Event()
        self._lateness: list[float] = []
        self._thread = threading.Thread(target=self._run, name='control')
        self._thread.start()

    def stop(self) -> np.ndarray:
        """End the thread and return the lateness of each wake-up, us."""
        self._stop.set()
        self._thread.join()
        return np.array(self._lateness) * 1e6

    def _run(self) -> None:
        grid = DeadlineGrid(CONTROL_PERIOD)
        while not self._stop.is_set():
            grid.wait(CONTROL_PERIOD)
            self._lateness.append(grid.lateness)


def process_ticks(pid: int) -> int:
    """Return the CPU time of a process, clock ticks."""
    return sum(map(int, _stat_fields(Path(f'/proc/{pid}/stat'))[11:13]))


def all_processes() -> dict[int, tuple[int, int]]:
    """Return parent and CPU time, with that of ended children, clock ticks, of each process id."""
    found = {}
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            fields = _stat_fields(path)
        except (FileNotFoundError, ProcessLookupError):
            continue  # it has ended, and its ticks are now its parent's
        found[int(path.parent.name)] = int(fields[1]), sum(map(int, fields[11:15]))
    return found


def _stat_fields(path: Path) -> list[str]:
    """Return the fields after the name in brackets: from the 12th utime, stime, cutime, cstime."""
    return path.read_text().rpartition(')')[2].split()
