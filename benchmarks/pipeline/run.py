# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One run of the benchmark: start a pipeline, observe it for a time, evaluate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import signal
import sys
import tempfile
import threading
import time

from benchmarks.pipeline.child_process import parameter_arguments, Program, wait_until
from benchmarks.pipeline.measured_process import READY, SAMPLES_FILE, STATUSES_FILE
import numpy as np
from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.timing import DeadlineGrid, SECOND

# Parameters of the nodes that the observer gets, too.
SCHEDULING = ('realtime.slice', 'realtime.priority')
# Time until the first orientation (s).
START_TIMEOUT = 30.0
# Time after the first orientation that is not measured (s): discovery and start-up.
SETTLE = 2.0
# Time between the end of the window and that of the processes (s): a driver reports its count
# every second, so that each run has one before and one after its window.
STATUS_PERIOD = 1.1
# Age of a reported count (ns): the driver reads it up to this long before the status is stamped.
COUNT_UNCERTAIN = 300_000
# Length of a clock tick of /proc/PID/stat (s).
TICK = 1.0 / os.sysconf('SC_CLK_TCK')
# Period of the control thread (s).
CONTROL_PERIOD = 0.005
# A status on /diagnostics: stamp in ns, name, values by key.
Status = tuple[int, str, dict[str, str]]


class PipelineError(SpmError):
    """The pipeline under measurement did not start, or ended early."""


@dataclass(frozen=True, eq=False, slots=True)
class Case:
    """A pipeline to measure."""

    name: str  # in the tables
    processes: tuple[str, ...]  # in the order of their start; the driver last
    observer: str = 'observer'  # process that receives the orientations
    # Parameters that only one of its processes gets, by process and NODE:NAME.
    own: Mapping[str, Mapping[str, object]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Run:
    """Measurements of one run."""

    case: Case
    rate: float  # sample rate that the driver was set to, Hz
    span: float  # length of the window, s
    latencies: np.ndarray  # from sample stamp to arrival at the observer, us
    stamps: np.ndarray  # sample stamps of these, ns
    made: int  # samples that the driver counted between its statuses about the window
    lost: int  # of these, without an orientation
    missed: int  # deadlines of the driver's thread
    load: Mapping[str, float]  # CPU time of each process, % of a core
    others: float  # CPU time of all other programs on the machine, % of a core
    control: np.ndarray  # lateness of the control thread, us
    statuses: Sequence[Status]  # about the window

    @property
    def achieved(self) -> float:
        """Orientations a second, Hz."""
        return len(self.latencies) / self.span


@contextmanager
def running(
    case: Case, parameters: Mapping[str, object], directory: Path
) -> Iterator[dict[str, Program]]:
    """Start the processes and yield them after the first orientation; stop all at the end."""
    started: dict[str, Program] = {}
    try:
        # The observer stands for a controller on the same host, and is scheduled as the nodes.
        scheduling = {name: parameters[name] for name in SCHEDULING if name in parameters}
        started[case.observer] = start_process(case.observer, directory, scheduling)
        for name in case.processes:
            started[name] = start_process(
                name, directory, {**parameters, **case.own.get(name, {})}
            )

        def arrived() -> bool:
            check_alive(case, started)
            return READY in started[case.observer].stdout

        if not wait_until(arrived, START_TIMEOUT):
            raise _failed(case, f'no orientation within {START_TIMEOUT:g} s', started)
        yield started
        check_alive(case, started)
    finally:
        for process in reversed(started.values()):
            process.send_signal(signal.SIGINT)
        for name, process in started.items():
            try:
                process.wait()
            except TimeoutError as error:
                print(f'{case.name}: {name}: {error}', file=sys.stderr)
    for name, process in started.items():
        if process.poll() not in (0, -signal.SIGKILL):
            raise _failed(case, f'{name} ended with {process.poll()}', started)


def start_process(name: str, directory: Path, parameters: Mapping[str, object]) -> Program:
    """Start a process of the benchmark, which writes into a directory."""
    return Program(
        [
            sys.executable,
            '-m',
            'benchmarks.pipeline.measured_process',
            name,
            str(directory),
            *parameter_arguments(parameters),
        ]
    )


def check_alive(case: Case, running: Mapping[str, Program]) -> None:
    """Raise PipelineError if a process has ended."""
    for name, process in running.items():
        if process.poll() is not None:
            raise _failed(case, f'{name} ended by itself', running)


def _failed(case: Case, how: str, running: Mapping[str, Program]) -> PipelineError:
    """Return the error of a pipeline, with what its processes printed on standard error."""
    return PipelineError(
        f'{case.name}: {how}\n' + ''.join(process.stderr for process in running.values())
    )


def measure(
    case: Case,
    seconds: float,
    rate: float,
    parameters: Mapping[str, str],
    during: Callable[
        [float, Mapping[str, Program], Path], None
    ] = lambda seconds, processes, directory: time.sleep(seconds),
    settle: float = SETTLE,
) -> Run:
    """
    Run a pipeline and measure it for a window, s, at a sample rate, Hz.

    `during` is called for the window with its length, s, the processes by name and the directory
    of the observer's files; `settle` is the time before it, s. PipelineError: no orientation
    arrived, or a process ended by itself.
    """
    with tempfile.TemporaryDirectory(prefix='benchmark_') as name:
        directory = Path(name)
        given = {'source': 'sim', 'rate': rate, **parameters}
        with running(case, given, directory) as processes:
            time.sleep(settle)
            control = Control()
            try:
                before, opened = all_processes(), time.time_ns()
                during(seconds, processes, directory)
                closed, after = time.time_ns(), all_processes()
            finally:
                lateness = control.stop()
            time.sleep(STATUS_PERIOD)
        arrivals, stamps = read_samples(directory)
        margin = round(STATUS_PERIOD * SECOND)
        with open(directory / STATUSES_FILE, encoding='utf-8') as file:
            statuses = [
                status
                for status in map(json.loads, file)
                if opened - margin <= status[0] <= closed + margin
            ]
    span = (closed - opened) / SECOND
    per_cent = 100.0 * TICK / span
    load = {
        name: (after[process.pid][1] - before[process.pid][1]) * per_cent
        for name, process in processes.items()
    }
    everything, everything_before = (
        sum(ticks for pid, (_, ticks) in found.items() if pid != os.getpid())
        for found in (after, before)
    )
    made, lost, missed = count_samples(statuses, stamps)
    inside = (stamps >= opened) & (stamps < closed)
    if not inside.any():
        raise PipelineError(
            f'{case.name}: overloaded: of {made} samples not one orientation '
            f'arrived in {span:.1f} s'
        )
    return Run(
        case,
        rate,
        span,
        (arrivals - stamps)[inside] * 1e-3,
        stamps[inside],
        made,
        lost,
        missed,
        load,
        (everything - everything_before) * per_cent - sum(load.values()),
        lateness,
        statuses,
    )


def count_samples(statuses: Sequence[Status], stamps: np.ndarray) -> tuple[int, int, int]:
    """
    Return samples made, samples lost and deadlines missed about the window.

    The driver reports its counts in statuses with a stamp, ns. Samples that it counted between
    two of them arrived if their stamps are between the two. PipelineError: the driver has fewer
    than two statuses.
    """
    stamps = np.sort(stamps)
    reported = []
    for at, _, values in statuses:
        if 'sets' not in values:
            continue
        arrived = np.searchsorted(stamps, at)
        certain = arrived == np.searchsorted(stamps, at - COUNT_UNCERTAIN)
        reported.append(
            (certain, int(values['sets']), int(arrived), int(values.get('missed deadlines', 0)))
        )
    # At high rates a sample is always in between: a count may be one off.
    reported = [entry for entry in reported if entry[0]] or reported
    if len(reported) < 2:
        raise PipelineError('overloaded: the driver reported fewer than two counts of its samples')
    (_, *first), (_, *last) = reported[0], reported[-1]
    made, received, missed = (after - before for before, after in zip(first, last, strict=True))
    return made, max(0, made - received), missed


def read_samples(directory: Path) -> np.ndarray:
    """Return arrival and stamp of the samples in a directory, ns, shape (2, n)."""
    return np.fromfile(directory / SAMPLES_FILE, np.dtype((np.int64, 2))).T


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


def all_processes() -> dict[int, tuple[int, int]]:
    """Return parent and CPU time, with that of ended children, clock ticks, of each process id."""
    found = {}
    for path in Path('/proc').glob('[0-9]*/stat'):
        # A process that has ended meanwhile has left its ticks to its parent.
        with suppress(FileNotFoundError, ProcessLookupError):
            # After the name in brackets: state, parent; the 12th to 15th are utime, stime, and
            # those of ended children.
            fields = path.read_text().rpartition(')')[2].split()
            found[int(path.parent.name)] = int(fields[1]), sum(map(int, fields[11:15]))
    return found
