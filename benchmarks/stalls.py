# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Times without an orientation on a living bus, found while it runs and afterwards."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import time

from benchmarks.pipeline.child_process import Program
from benchmarks.pipeline.measured_process import SAMPLE, STACKS_SIGNAL
import numpy as np
from spm_haptic_master.timing import SECOND

# Time without an orientation on a living bus that counts as a stall (s).
STALL = 1.0
# The same, after which the stacks of all threads are printed (s).
HANG = 5.0
# Time for a process to print its stacks (s).
STACKS_TIME = 0.5


class Watch:
    """Prints the stacks of all threads once in every hang: no orientations on a living bus."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._size = 0
        self._grown = time.time()
        self._reported = False
        self.hangs = 0

    @property
    def count(self) -> int:
        """Return the number of orientations that the observer has written."""
        return self._size // SAMPLE.size

    def tend(self, alive_since: float | None, processes: Mapping[str, Program]) -> None:
        """Look for orientations since the last call."""
        now = time.time()
        size = self._file.stat().st_size
        if size != self._size:
            self._size, self._grown, self._reported = size, now, False
        elif (
            alive_since is not None
            and not self._reported
            and now - max(alive_since, self._grown) > HANG
        ):
            self._reported = True
            self.hangs += 1
            before = {name: len(process.stderr) for name, process in processes.items()}
            for process in processes.values():
                process.send_signal(STACKS_SIGNAL)
            time.sleep(STACKS_TIME)
            for name, process in processes.items():
                print(
                    f'  no orientation for {HANG:g} s; {name}:\n{process.stderr[before[name] :]}',
                    flush=True,
                )


def stalls(
    arrivals: np.ndarray, alive: list[tuple[float, float]]
) -> tuple[list[tuple[float, float]], list[float]]:
    """
    Return the times without an orientation on a living bus, and those until the first one.

    `arrivals` are those of the orientations, s, ascending; `alive` the times from which and until
    which the bus was alive, s. A gap is beginning and length of a time longer than `STALL` without
    an orientation while it was. A restart is the time from a return of the bus (the first entry of
    `alive` is none) to the first orientation; the whole time that it was alive if none came.
    """
    gaps, restarts = [], []
    for number, (since, until) in enumerate(alive):
        inside = arrivals[(arrivals >= since) & (arrivals <= until)]
        times = np.concatenate([[since], inside, [until]])
        steps = np.diff(times)
        gaps += [(float(times[at]), float(steps[at])) for at in np.flatnonzero(steps > STALL)]
        if number:
            restarts.append(float(steps[0]))
    return gaps, restarts


def unexplained(gaps: list[tuple[float, float]], rejections: np.ndarray) -> list[float]:
    """
    Return the lengths, s, of the gaps (beginning and length, s) in which no sample was rejected.

    A machine that is too busy delays samples, and `fkm` rejects them as stale: no deadlock.
    `rejections` are times, ns, ascending, and the samples rejected until then, shape (n, 2).
    """
    found = []
    for begin, length in gaps:
        before, after = np.searchsorted(
            rejections[:, 0], [begin * SECOND, (begin + length) * SECOND]
        )
        span = rejections[max(0, before - 1) : after + 1, 1]
        if not len(span) or span[-1] == span[0]:
            found.append(length)
    return found
