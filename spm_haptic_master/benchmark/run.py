# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One run of the benchmark: processes started, observed for a while, and what that gave."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
import json
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time

import numpy as np

from spm_haptic_master.benchmark.observer import READY, SAMPLES_FILE, STATUSES_FILE
from spm_haptic_master.benchmark.process import pauses_file
from spm_haptic_master.encoders.deadline_grid import DeadlineGrid
from spm_haptic_master.exceptions import SpmError

MODULE = 'spm_haptic_master.benchmark.process'
START_TIMEOUT = 30.0  # s
POLL_PERIOD = 0.1  # s, of looking whether a process ended before its time
SETTLE = 2.0  # s from the first orientation: discovery and start-up are over
# s; a driver states its count every second, so that each run begins and ends with one.
STATUS_PERIOD = 1.1
STOP_TIMEOUT = 15.0  # s
# ns before a status in which a sample may have been made that its count, read a little earlier than
# its stamp, leaves out.
COUNT_UNCERTAIN = 300_000
CONTROL_PERIOD = 0.005  # s
MEMORY_PERIOD = 5.0  # s
# Domains 1 .. 101 keep clear of the ephemeral ports on Linux.
DOMAINS = 101

TICK = 1.0 / os.sysconf('SC_CLK_TCK')  # s
PAGE = os.sysconf('SC_PAGE_SIZE')  # bytes


class PipelineError(SpmError):
    """The pipeline under measurement did not come up, or did not last."""


@dataclass(frozen=True, slots=True)
class Case:
    """
    A pipeline to measure.

    Attributes
    ----------
    name : str
        As in the tables.
    processes : tuple of str
        What runs, in the order of starting; the driver last.
    observer : str
        Who listens.

    """

    name: str
    processes: tuple[str, ...]
    observer: str = 'observer'


@dataclass(frozen=True, slots=True)
class Run:
    """
    What one run of a case gave.

    Attributes
    ----------
    case : Case
    rate : float
        Samples a second that were asked for, Hz.
    span : float
        Length of the window, s.
    latencies, intervals, stamps : ndarray
        us from sample stamp to observer, us between arrivals, ns; of the window.
    made, lost : int
        Samples the driver counts, from its first status about the window to its last; how many
        of them did not arrive as an orientation.
    missed : int
        Deadlines that the driver's thread passed over meanwhile.
    load : dict of str to float
        CPU time of each process, % of a core.
    pauses : dict of str to list of float
        Length of each garbage collection of each process, us.
    memory : dict of str to list of float
        Resident memory of each process, MiB, every `MEMORY_PERIOD`.
    control : ndarray
        Lateness of a thread that does nothing but wake up, us.
    others : float
        CPU time of everything else on the machine, % of a core.
    published : float or None
        Median time from sample stamp to publication by `fkm`'s own account, us.
    rejected : int
        Samples that `fkm` refused meanwhile.
    start : float
        s from starting the processes to the first orientation.

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
    rejected: int
    start: float

    @property
    def achieved(self) -> float:
        """Orientations a second, Hz."""
        return len(self.latencies) / self.span


class Control:
    """A thread that wakes up on a grid and notes how late: the machine's own disturbance."""

    def __init__(self):
        self._stop = threading.Event()
        self._lateness: list[float] = []
        self._thread = threading.Thread(target=self._run, name='control')
        self._thread.start()

    def stop(self) -> np.ndarray:
        """End it, and return the lateness of each wake-up, us."""
        self._stop.set()
        self._thread.join()
        return np.array(self._lateness) * 1e6

    def _run(self) -> None:
        grid = DeadlineGrid(CONTROL_PERIOD)
        while not self._stop.is_set():
            grid.wait(CONTROL_PERIOD)
            self._lateness.append(grid.lateness)


def measure(case: Case, seconds: float, rate: float, parameters: Mapping[str, str]) -> Run:
    """
    Run a case and measure it.

    Parameters
    ----------
    case : Case
        What to run.
    seconds : float
        Length of the window, s.
    rate : float
        Samples a second, Hz.
    parameters : mapping of str to str
        ROS parameters of the nodes, as after `-p`.

    Raises
    ------
    PipelineError
        No orientation came, or a process ended by itself.

    """
    with tempfile.TemporaryDirectory(prefix='benchmark_') as name:
        directory = Path(name)
        began = time.monotonic()
        with _running(case, rate, parameters, directory) as processes:
            start = time.monotonic() - began
            time.sleep(SETTLE)
            memory: dict[str, list[float]] = {name: [] for name in processes}
            control = Control()
            everything, ticks, opened = _everything_ticks(), _ticks(processes), time.time_ns()
            _sleep_and_note_memory(seconds, processes, memory)
            closed = time.time_ns()
            spent = {name: count - ticks[name] for name, count in _ticks(processes).items()}
            busy = _everything_ticks() - everything
            lateness = control.stop()
            time.sleep(STATUS_PERIOD)
        span = (closed - opened) * 1e-9
        per_cent = 100.0 * TICK / span
        arrivals, stamps = np.fromfile(directory / SAMPLES_FILE, np.int64).reshape(-1, 2).T
        margin = round(STATUS_PERIOD * 1e9)
        statuses = [(at, source, values) for at, source, values
                    in json.loads((directory / STATUSES_FILE).read_text())
                    if opened - margin <= at <= closed + margin]
        made, lost, missed = count_samples(statuses, stamps)
        refused = _stated(statuses, 'samples rejected')
        published = _stated(statuses, 'latency p50 (us)')
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
            rejected=round(refused[-1] - refused[0]) if refused else 0, start=start)


@contextmanager
def _running(case, rate, parameters, directory) -> Iterator[dict[str, int]]:
    """Start the processes, wait for the first orientation; stop them all in the end."""
    environment = {**os.environ, 'ROS_DOMAIN_ID': str(1 + os.getpid() % DOMAINS),
                   'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
    ros = ['--ros-args', '-p', f'rate:={rate}']
    for key, value in parameters.items():
        ros += ['-p', f'{key}:={value}']
    running: dict[str, subprocess.Popen] = {}
    complaints = directory / 'stderr.txt'
    try:
        with open(complaints, 'w') as stderr:
            for name in (case.observer, *case.processes):
                observes = name == case.observer
                running[name] = subprocess.Popen(
                    [sys.executable, '-m', MODULE, name, str(directory),
                     *([] if observes else ros)],
                    env=environment, stdin=subprocess.DEVNULL, stderr=stderr,
                    stdout=subprocess.PIPE if observes else subprocess.DEVNULL)
        _await_first(case, running, complaints)
        yield {name: process.pid for name, process in running.items()}
        _check_alive(case, running, complaints)
    finally:
        for process in reversed(running.values()):
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in running.values():
            try:
                process.wait(STOP_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        running[case.observer].stdout.close()
    for name, process in running.items():
        if process.returncode == -signal.SIGKILL:
            print(f'{case.name}: {name} did not end within {STOP_TIMEOUT:g} s and was killed',
                  file=sys.stderr)
        elif process.returncode:
            raise PipelineError(f'{case.name}: {name} ended with {process.returncode}\n'
                                + complaints.read_text())


def _await_first(case, running, complaints) -> None:
    stdout = running[case.observer].stdout
    deadline = time.monotonic() + START_TIMEOUT
    while not select.select([stdout], [], [], POLL_PERIOD)[0]:
        _check_alive(case, running, complaints)
        if time.monotonic() > deadline:
            raise PipelineError(f'{case.name}: no orientation within {START_TIMEOUT:g} s\n'
                                + complaints.read_text())
    if stdout.readline().strip() != READY.encode():
        raise PipelineError(f'{case.name}: the observer ended\n' + complaints.read_text())


def _check_alive(case, running, complaints) -> None:
    for name, process in running.items():
        if process.poll() is not None:
            raise PipelineError(f'{case.name}: {name} ended by itself\n'
                                + complaints.read_text())


def _sleep_and_note_memory(seconds, processes, memory) -> None:
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0.0:
        for name, pid in processes.items():
            resident = int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE
            memory[name].append(resident / 2**20)
        time.sleep(min(left, MEMORY_PERIOD))


def _ticks(processes) -> dict[str, int]:
    """Return the clock ticks that each process has used, and this one's as 'benchmark'."""
    return {name: _process_ticks(pid)
            for name, pid in {**processes, 'benchmark': os.getpid()}.items()}


def _process_ticks(pid: int) -> int:
    return sum(map(int, _stat_fields(Path(f'/proc/{pid}/stat'))[11:13]))


def _everything_ticks() -> int:
    """Return the clock ticks of all processes, with those of their ended children."""
    total = 0
    for path in Path('/proc').glob('[0-9]*/stat'):
        try:
            total += sum(map(int, _stat_fields(path)[11:15]))
        except (FileNotFoundError, ProcessLookupError):
            continue  # it ended, and its parent has its ticks
    return total


def _stat_fields(path: Path) -> list[str]:
    """Return what follows the name in brackets: from the 12th on utime, stime, cutime, cstime."""
    return path.read_text().rpartition(')')[2].split()


def _pauses(path: Path, opened: int, closed: int) -> list[float]:
    if not path.exists():  # it had to be killed
        return []
    return [length * 1e-3 for began, length in json.loads(path.read_text())
            if opened <= began < closed]


def _stated(statuses, key: str) -> list[float]:
    return [float(values[key]) for _, _, values in statuses if key in values]


def count_samples(statuses, stamps) -> tuple[int, int, int]:
    """
    Return samples made, lost and deadlines missed about the window.

    The driver states its counts with a time. Between two such times it made as many samples as its
    count grew; those of them that arrived have stamps between the two.
    """
    stamps = np.sort(stamps)
    stated = []
    for at, _, values in statuses:
        if 'sets' not in values:
            continue
        arrived = np.searchsorted(stamps, at)
        certain = arrived == np.searchsorted(stamps, at - COUNT_UNCERTAIN)
        stated.append((certain, int(values['sets']), arrived, int(values['missed deadlines'])))
    # At high rates there is always a sample in between: a count may be one off.
    stated = [entry for entry in stated if entry[0]] or stated
    if len(stated) < 2:
        raise PipelineError('overloaded: the driver did not come to state how many samples it made')
    (_, *first), (_, *last) = stated[0], stated[-1]
    made, arrived, missed = (after - before for before, after in zip(first, last, strict=True))
    return made, max(0, int(made - arrived)), missed
