# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One run of the benchmark: start the processes, observe them for a time, evaluate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
import os
from pathlib import Path
import tempfile
import time

import numpy as np
from spm_haptic_master.benchmark.child_process import Program
from spm_haptic_master.benchmark.observer import read_samples, read_statuses, Status
from spm_haptic_master.benchmark.pipeline import Case, PipelineError, running
from spm_haptic_master.benchmark.process_load import (
    Control,
    machine_ticks,
    process_ticks,
    TICK,
)
from spm_haptic_master.timing import SECOND

# Time after the first orientation that is not measured (s): discovery and start-up.
SETTLE = 2.0
# Time between the end of the window and that of the processes (s): a driver reports its count
# every second, so that each run has one before and one after its window.
STATUS_PERIOD = 1.1
# Age of a reported count (ns): the driver reads it up to this long before the status is stamped.
COUNT_UNCERTAIN = 300_000


@dataclass(frozen=True, slots=True)
class Run:
    """Measurements of one run."""

    case: Case
    rate: float  # sample rate that the driver was set to, Hz
    span: float  # length of the window, s
    latencies: np.ndarray  # from sample stamp to arrival at the observer, us
    stamps: np.ndarray  # sample stamps of these, ns
    # Samples that the driver counted from its first status about the window to its last; samples
    # of these that did not arrive as an orientation; deadlines that its thread missed then.
    made: int
    lost: int
    missed: int
    load: Mapping[str, float]  # CPU time of each process, % of a core
    others: float  # CPU time of all other programs on the machine, % of a core
    control: np.ndarray  # lateness of the control thread, us
    statuses: Sequence[Status]  # about the window

    @property
    def achieved(self) -> float:
        """Orientations a second, Hz."""
        return len(self.latencies) / self.span

    def reported(self, entry: str, key: str) -> list[float]:
        """Return the values of a key in an entry of /diagnostics, in the order of the statuses."""
        return [float(values[key]) for _, name, values in self.statuses
                if name == entry and key in values]


def measure(case: Case, seconds: float, rate: float, parameters: Mapping[str, str],
            during: Callable[[float, Mapping[str, Program], Path], None] =
            lambda seconds, processes, directory: time.sleep(seconds),
            settle: float | None = None) -> Run:
    """
    Run a pipeline and measure it for a window, s, at a sample rate, Hz.

    `during` is called for the window with its length, s, the processes by name and the directory
    of the observer's files; before it passes `settle`, s. PipelineError: no orientation arrived,
    or a process ended by itself.
    """
    with tempfile.TemporaryDirectory(prefix='benchmark_') as name:
        directory = Path(name)
        given = {'source': 'sim', 'rate': rate, **parameters}
        with running(case, given, directory) as processes:
            time.sleep(SETTLE if settle is None else settle)
            pids = {**{name: process.pid for name, process in processes.items()}, '': os.getpid()}
            control = Control()
            try:
                everything, ticks = machine_ticks(), _ticks(pids)
                opened = time.time_ns()
                during(seconds, processes, directory)
                closed = time.time_ns()
                spent = {name: count - ticks[name] for name, count in _ticks(pids).items()}
                busy = machine_ticks() - everything
            finally:
                lateness = control.stop()
            time.sleep(STATUS_PERIOD)
        arrivals, stamps = read_samples(directory)
        margin = round(STATUS_PERIOD * SECOND)
        statuses = [status for status in read_statuses(directory)
                    if opened - margin <= status[0] <= closed + margin]
    span = (closed - opened) / SECOND
    per_cent = 100.0 * TICK / span
    made, lost, missed = count_samples(statuses, stamps)
    inside = (stamps >= opened) & (stamps < closed)
    if not inside.any():
        raise PipelineError(f'{case.name}: overloaded: of {made} samples not one orientation '
                            f'arrived in {span:.1f} s')
    return Run(
        case, rate, span, (arrivals - stamps)[inside] * 1e-3, stamps[inside], made, lost, missed,
        load={name: spent[name] * per_cent for name in processes},
        others=(busy - sum(spent.values())) * per_cent, control=lateness, statuses=statuses)


def _ticks(pids: Mapping[str, int]) -> dict[str, int]:
    """Return the CPU time of each process, clock ticks."""
    return {name: process_ticks(pid) for name, pid in pids.items()}


def count_samples(statuses: Sequence[Status], stamps: np.ndarray) -> tuple[int, int, int]:
    """
    Return samples made, samples lost and deadlines missed about the window.

    The driver reports its counts in statuses with a stamp. Between two of them it made as many
    samples as its count grew; those that arrived have stamps between the two, ns. PipelineError:
    there are fewer than two statuses of the driver.
    """
    stamps = np.sort(stamps)
    reported = []
    for at, _, values in statuses:
        if 'sets' not in values:
            continue
        arrived = np.searchsorted(stamps, at)
        certain = arrived == np.searchsorted(stamps, at - COUNT_UNCERTAIN)
        reported.append((certain, int(values['sets']), int(arrived),
                         int(values.get('missed deadlines', 0))))
    # At high rates there is always a sample in between: a count may be one off.
    reported = [entry for entry in reported if entry[0]] or reported
    if len(reported) < 2:
        raise PipelineError('overloaded: the driver reported fewer than two counts of its samples')
    (_, *first), (_, *last) = reported[0], reported[-1]
    made, received, missed = (after - before for before, after in zip(first, last, strict=True))
    return made, max(0, made - received), missed
