# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One run of the benchmark: start the processes, observe them for a time, evaluate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
import json
import os
from pathlib import Path
import tempfile
import time

import numpy as np
from spm_haptic_master.benchmark.child_process import Program
from spm_haptic_master.benchmark.measured_process import pauses_file
from spm_haptic_master.benchmark.observer import read_samples, read_statuses
from spm_haptic_master.benchmark.pipeline import Case, PipelineError, running
from spm_haptic_master.benchmark.process_load import (
    Control,
    machine_ticks,
    process_ticks,
    TICK,
)
from spm_haptic_master.benchmark.sample_counts import count_samples, growth, reported

# Time after the first orientation that is not measured (s): discovery and start-up.
SETTLE = 2.0
# Time between the end of the window and that of the processes (s): a driver reports its count
# every second, so that each run has one before and one after its window.
STATUS_PERIOD = 1.1


@dataclass(frozen=True, slots=True)
class Run:
    """
    Measurements of one run.

    Attributes
    ----------
    case : Case
        Measured pipeline.
    rate : float
        Sample rate that the driver was set to, Hz.
    span : float
        Length of the window, s.
    latencies, intervals, stamps : ndarray
        Times from sample stamp to arrival at the observer, us; times between arrivals, us; sample
        stamps, ns. All of the window.
    made, lost : int
        Samples that the driver counted from its first status about the window to its last;
        samples of these that did not arrive as an orientation.
    missed : int
        Deadlines that the driver's thread missed in that time.
    load : mapping of str to float
        CPU time of each process, % of a core.
    pauses : mapping of str to list of float
        Lengths of the garbage collections of each process, us.
    control : ndarray
        Lateness of the control thread, us.
    others : float
        CPU time of all other programs on the machine, % of a core.
    published : float or None
        Median time from sample stamp to publication as `fkm` reports it, us.
    counted : mapping of str to int
        By how much each count of a status grew, by its key.
    rejections : ndarray, shape (n, 2)
        Times of the statuses of `fkm`, ns, and the samples that it had rejected until then.

    """

    case: Case
    rate: float
    span: float
    latencies: np.ndarray
    intervals: np.ndarray
    stamps: np.ndarray
    made: int
    lost: int
    missed: int
    load: Mapping[str, float]
    pauses: Mapping[str, list[float]]
    control: np.ndarray
    others: float
    published: float | None
    counted: Mapping[str, int]
    rejections: np.ndarray

    @property
    def rejected(self) -> int:
        """Return the number of samples that `fkm` rejected."""
        return self.counted.get('samples rejected', 0)

    @property
    def achieved(self) -> float:
        """Orientations a second, Hz."""
        return len(self.latencies) / self.span


def _wait(seconds: float, _: Mapping[str, Program], __: Path) -> None:
    time.sleep(seconds)


def measure(case: Case, seconds: float, rate: float, parameters: Mapping[str, str],
            during: Callable[[float, Mapping[str, Program], Path], None] = _wait,
            settle: float | None = None) -> Run:
    """
    Run a pipeline and measure it.

    Parameters
    ----------
    case : Case
        Pipeline.
    seconds : float
        Length of the window, s.
    rate : float
        Sample rate, Hz.
    parameters : mapping of str to str
        ROS parameters of the nodes by name.
    during : callable
        Called for the window with its length, s, the processes by name and the directory of the
        observer's files; waits for that time by default.
    settle : float, optional
        Time before the window, s; `SETTLE` by default.

    Raises
    ------
    PipelineError
        No orientation arrived, or a process ended by itself.

    """
    with tempfile.TemporaryDirectory(prefix='benchmark_') as name:
        directory = Path(name)
        given = {'source': 'sim', 'rate': rate, **parameters}
        with running(case, given, directory) as processes:
            time.sleep(SETTLE if settle is None else settle)
            control = Control()
            try:
                everything, ticks, opened = machine_ticks(), _ticks(processes), time.time_ns()
                during(seconds, processes, directory)
                closed = time.time_ns()
                spent = {name: count - ticks[name] for name, count in _ticks(processes).items()}
                busy = machine_ticks() - everything
            finally:
                lateness = control.stop()
            time.sleep(STATUS_PERIOD)
        span = (closed - opened) * 1e-9
        per_cent = 100.0 * TICK / span
        arrivals, stamps = read_samples(directory)
        margin = round(STATUS_PERIOD * 1e9)
        statuses = [status for status in read_statuses(directory)
                    if opened - margin <= status[0] <= closed + margin]
        made, lost, missed = count_samples(statuses, stamps)
        published = reported(statuses, 'fkm: timing', 'latency p50 (us)')
        inside = (stamps >= opened) & (stamps < closed)
        if not inside.any():
            raise PipelineError(f'{case.name}: overloaded: of {made} samples not one orientation '
                                f'arrived in {span:.1f} s')
        return Run(
            case, rate, span,
            latencies=(arrivals - stamps)[inside] * 1e-3,
            intervals=np.diff(arrivals[inside]) * 1e-3,
            stamps=stamps[inside], made=made, lost=lost, missed=missed,
            load={name: count * per_cent for name, count in spent.items() if name != 'benchmark'},
            pauses={name: _pauses(directory / pauses_file(name), opened, closed)
                    for name in (*case.processes, case.observer)},
            control=lateness, others=(busy - sum(spent.values())) * per_cent,
            published=float(np.median(published)) if published else None,
            counted=growth(statuses),
            rejections=np.array([(at, int(values['samples rejected'])) for at, _, values
                                 in statuses if 'samples rejected' in values]).reshape(-1, 2))


def _ticks(processes: Mapping[str, Program]) -> dict[str, int]:
    """Return the CPU time of each process, and of this one as 'benchmark', clock ticks."""
    pids = {name: process.pid for name, process in processes.items()}
    return {name: process_ticks(pid) for name, pid in {**pids, 'benchmark': os.getpid()}.items()}


def _pauses(path: Path, opened: int, closed: int) -> list[float]:
    if not path.exists():  # it had to be killed
        return []
    return [length * 1e-3 for began, length in json.loads(path.read_text())
            if opened <= began < closed]
