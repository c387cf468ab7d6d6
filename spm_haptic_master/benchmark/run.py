# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One run of the benchmark: start the processes, observe them for a time, evaluate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
import json
import os
from pathlib import Path
import signal
import sys
import tempfile
import time

import numpy as np
from spm_haptic_master.benchmark.child_process import (
    parameter_arguments,
    private_environment,
    Program,
    wait_until,
)
from spm_haptic_master.benchmark.measured_process import pauses_file
from spm_haptic_master.benchmark.observer import read_samples, read_statuses, READY, Status
from spm_haptic_master.benchmark.process_load import (
    Control,
    machine_ticks,
    process_ticks,
    resident_memory,
    TICK,
)
from spm_haptic_master.exceptions import SpmError

# Module that runs each process of a pipeline.
MODULE = 'spm_haptic_master.benchmark.measured_process'
# Time until the first orientation (s).
START_TIMEOUT = 30.0
# Time after the first orientation that is not measured (s): discovery and start-up.
SETTLE = 2.0
# Time between the end of the window and that of the processes (s): a driver reports its count
# every second, so that each run has one before and one after its window.
STATUS_PERIOD = 1.1
# Age of a reported count (ns): the driver reads it up to this long before the status is stamped.
COUNT_UNCERTAIN = 300_000
# Time between two readings of the resident memory (s).
MEMORY_PERIOD = 5.0

# Resident memory of processes by name, MiB, every `MEMORY_PERIOD`.
Memory = dict[str, list[float]]


class PipelineError(SpmError):
    """The pipeline under measurement did not start, or ended early."""


@dataclass(frozen=True, slots=True)
class Case:
    """
    A pipeline to measure.

    Attributes
    ----------
    name : str
        Name in the tables.
    processes : tuple of str
        Processes in the order of their start; the driver last.
    observer : str
        Process that receives the orientations.
    own : tuple of (str, str)
        Parameters beside those of all processes: 'PROCESS NODE:NAME' and value.

    """

    name: str
    processes: tuple[str, ...]
    observer: str = 'observer'
    own: tuple[tuple[str, str], ...] = ()

    def parameters(self, process: str) -> dict[str, str]:
        """Return the parameters that only one of its processes gets."""
        return {name: value for key, value in self.own
                for owner, name in [key.split(' ')] if owner == process}


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
    memory : mapping of str to list of float
        Resident memory of each process, MiB, every `MEMORY_PERIOD`.
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
    start : float
        Time from the start of the processes to the first orientation, s.

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
    memory: Mapping[str, list[float]]
    control: np.ndarray
    others: float
    published: float | None
    counted: Mapping[str, int]
    rejections: np.ndarray
    start: float

    @property
    def rejected(self) -> int:
        """Return the number of samples that `fkm` rejected."""
        return self.counted.get('samples rejected', 0)

    @property
    def achieved(self) -> float:
        """Orientations a second, Hz."""
        return len(self.latencies) / self.span


def memory_over(seconds: float, processes: Mapping[str, Program], _: Path) -> Memory:
    """Sleep for a time, s; return the memory of the processes during it."""
    memory: Memory = {name: [] for name in processes}
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        read_memory(memory, processes)
        time.sleep(min(left, MEMORY_PERIOD))
    return memory


def read_memory(memory: Memory, processes: Mapping[str, Program]) -> None:
    """Append the present resident memory of the processes."""
    for name, process in processes.items():
        memory[name].append(resident_memory(process.pid))


def measure(case: Case, seconds: float, rate: float, parameters: Mapping[str, str],
            during: Callable[[float, Mapping[str, Program], Path], Memory] = memory_over) -> Run:
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
        observer's files; returns the memory of the processes.

    Raises
    ------
    PipelineError
        No orientation arrived, or a process ended by itself.

    """
    with tempfile.TemporaryDirectory(prefix='benchmark_') as name:
        directory = Path(name)
        began = time.monotonic()
        given = {'source': 'sim', 'rate': rate, **parameters}
        with _running(case, given, directory) as processes:
            start = time.monotonic() - began
            time.sleep(SETTLE)
            control = Control()
            try:
                everything, ticks, opened = machine_ticks(), _ticks(processes), time.time_ns()
                memory = during(seconds, processes, directory)
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
        published = _reported(statuses, 'latency p50 (us)')
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
            memory=memory, control=lateness, others=(busy - sum(spent.values())) * per_cent,
            published=float(np.median(published)) if published else None,
            counted=_growth(statuses),
            rejections=np.array([(at, int(values['samples rejected'])) for at, _, values
                                 in statuses if 'samples rejected' in values]).reshape(-1, 2),
            start=start)


@contextmanager
def _running(case: Case, parameters: Mapping[str, object],
             directory: Path) -> Iterator[dict[str, Program]]:
    """Start the processes and yield them after the first orientation; stop all at the end."""
    running: dict[str, Program] = {}
    try:
        for name in (case.observer, *case.processes):
            given = {} if name == case.observer else {**parameters, **case.parameters(name)}
            running[name] = start_process(name, directory, given)
        _await_first(case, running)
        yield running
        check_alive(case, running)
    finally:
        for process in reversed(running.values()):
            process.send_signal(signal.SIGINT)
        for name, process in running.items():
            try:
                process.wait()
            except TimeoutError as error:
                print(f'{case.name}: {name}: {error}', file=sys.stderr)
    for name, process in running.items():
        if process.poll() not in (0, -signal.SIGKILL):
            raise PipelineError(f'{case.name}: {name} ended with {process.poll()}\n'
                                + _complaints(running))


def start_process(name: str, directory: Path, parameters: Mapping[str, object]) -> Program:
    """Start a process of the benchmark, which writes into a directory."""
    ros = ['--ros-args', *parameter_arguments(parameters)] if parameters else []
    return Program([sys.executable, '-m', MODULE, name, str(directory), *ros],
                   environment=private_environment())


def _await_first(case: Case, running: Mapping[str, Program]) -> None:
    """Wait for the first orientation."""
    observer = running[case.observer]

    def arrived() -> bool:
        check_alive(case, running)
        return READY in observer.stdout

    if not wait_until(arrived, START_TIMEOUT):
        raise PipelineError(f'{case.name}: no orientation within {START_TIMEOUT:g} s\n'
                            + _complaints(running))


def check_alive(case: Case, running: Mapping[str, Program]) -> None:
    """Raise PipelineError if a process has ended."""
    for name, process in running.items():
        if process.poll() is not None:
            raise PipelineError(f'{case.name}: {name} ended by itself\n' + _complaints(running))


def _complaints(running: Mapping[str, Program]) -> str:
    """Return what the processes have printed on standard error."""
    return ''.join(process.stderr for process in running.values())


def _ticks(processes: Mapping[str, Program]) -> dict[str, int]:
    """Return the CPU time of each process, and of this one as 'benchmark', clock ticks."""
    pids = {name: process.pid for name, process in processes.items()}
    return {name: process_ticks(pid) for name, pid in {**pids, 'benchmark': os.getpid()}.items()}


def _pauses(path: Path, opened: int, closed: int) -> list[float]:
    if not path.exists():  # it had to be killed
        return []
    return [length * 1e-3 for began, length in json.loads(path.read_text())
            if opened <= began < closed]


def _reported(statuses: Sequence[Status], key: str) -> list[float]:
    return [float(values[key]) for _, _, values in statuses if key in values]


def _growth(statuses: Sequence[Status]) -> dict[str, int]:
    """Return by how much each count grew from the first status of its name to the last."""
    first: dict[str, dict[str, str]] = {}
    last: dict[str, dict[str, str]] = {}
    for _, name, values in statuses:
        first.setdefault(name, values)
        last[name] = values
    return {key: int(value) - int(first[name].get(key, '0'))
            for name, values in last.items() for key, value in values.items()
            if value.isdecimal() and first[name].get(key, '0').isdecimal()}


def count_samples(statuses: Sequence[Status], stamps: np.ndarray) -> tuple[int, int, int]:
    """
    Return samples made, samples lost and deadlines missed about the window.

    The driver reports its counts in statuses with a stamp. Between two of them it made as many
    samples as its count grew; those that arrived have stamps between the two.

    Parameters
    ----------
    statuses : sequence of (int, str, dict of str to str)
        Stamp (ns), name and values of each status.
    stamps : ndarray, shape (n,)
        Stamps of the orientations that arrived, ns.

    Raises
    ------
    PipelineError
        There are fewer than two statuses of the driver.

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
