# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A long run: encoders on a bus that fails, a recorder, subscribers that come and go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import json
from pathlib import Path
import re
import signal
import socket
import tempfile
import time

import numpy as np
from spm_haptic_master.benchmark.child_process import (
    bus_channel,
    executable,
    private_environment,
    Program,
    wait_until,
)
from spm_haptic_master.benchmark.measured_process import STACKS_SIGNAL
from spm_haptic_master.benchmark.observer import READY, SAMPLE_SIZE, SAMPLES_FILE
from spm_haptic_master.benchmark.report import disturbance, quantiles
from spm_haptic_master.benchmark.run import (
    Case,
    check_alive,
    measure,
    Memory,
    MEMORY_PERIOD,
    PipelineError,
    read_memory,
    Run,
    start_process,
)
from spm_haptic_master.parameter_files import simulated_rig

# Length of a minute (s).
MINUTE = 60.0
# Time from one failure of the bus to the next (minutes).
FAILURE_MINUTES = 5.0
# Length of a failure of the bus (s): longer than the driver waits before it reopens a silent bus.
FAILURE_SECONDS = 5.0
# Time from the start of one visitor to the next, and time that each stays (s).
VISIT_PERIOD, VISIT_SECONDS = 30.0, 15.0
# Time without an orientation on a living bus that counts as a stall (s).
STALL = 1.0
# The same, after which the stacks of all threads are printed (s).
HANG = 5.0
# Time for a process to print its stacks (s).
STACKS_TIME = 0.5
# Time between two reports of the progress (minutes).
PROGRESS_MINUTES = 5.0
# Period of the loop that disturbs and observes (s).
LOOP_PERIOD = 0.05
# Time between two packets that are no CAN frame (s).
GARBAGE_PERIOD = 0.3
# Time for the simulated encoders to start (s).
START_TIMEOUT = 30.0
# Subscriber of all outputs that comes and goes, and the end of every other one: an orderly end,
# and one after which the middleware has to find out by itself.
VISITOR, VISITOR_ENDS = 'observer_of_all', (signal.SIGINT, signal.SIGKILL)
# Line of `sim_bus` on the beginning or the end of a bus-off, with its time (s).
_BUS_OFF = re.compile(r'^([\d.]+) busoff@\S+ (begins|ends)$', re.MULTILINE)
# Nanoseconds in a second.
_SECOND = 1e9


class FailingBus:
    """
    Four simulated encoders on a bus that fails every `FAILURE_MINUTES`.

    Every other failure is a bus-off. In the others the encoders lose their power and boot again,
    and what comes meanwhile is no CAN frame: whoever reads the bus gets an error.

    Parameters
    ----------
    rate : float
        Rate of SYNC, Hz.

    Attributes
    ----------
    alive : list of (float, float)
        Times from which and until which the bus was alive, s since the Unix epoch.

    """

    def __init__(self, rate: float) -> None:
        self.alive: list[tuple[float, float]] = []
        period = FAILURE_MINUTES * MINUTE
        self._command = executable(
            'sim_bus', '--sync', '--fault', f'busoff@{period:g}+{FAILURE_SECONDS:g}',
            '-p', 'can.interface:=udp_multicast', '-p', f'can.channel:={bus_channel()}',
            '-p', f'rate:={rate:g}')
        self._life = 2.0 * period
        self._program: Program | None = None
        self._started = self._ended = self._garbage_at = 0.0

    def start(self) -> None:
        """Switch the encoders on and wait until they have booted."""
        self._program = Program(self._command, environment=private_environment())
        if not wait_until(lambda: 'four encoders' in self._output, START_TIMEOUT):
            raise PipelineError(f'sim_bus did not start: {self._program.stderr}')
        self._started = time.time()

    def tend(self) -> None:
        """Switch the encoders off or on, if that is due."""
        now = time.time()
        if self._program is None:
            if now - self._ended >= FAILURE_SECONDS:
                self.start()
            elif now >= self._garbage_at:
                self._garbage_at = now + GARBAGE_PERIOD
                _send_garbage()
        elif self._program.poll() is not None:
            raise PipelineError(f'sim_bus ended by itself: {self._program.stderr}')
        elif now - self._started >= self._life:
            self.stop()

    def stop(self) -> None:
        """Switch the encoders off, and note when they were alive."""
        if self._program is not None:
            self.alive += self._alive_until(time.time())
            self._program.kill()
            self._ended = time.time()
            self._program = None

    @property
    def alive_since(self) -> float | None:
        """Time since which the bus is alive, s since the Unix epoch; None while it is not."""
        if self._program is None:
            return None
        since, until = self._alive_until(float('inf'))[-1]
        return since if until == float('inf') else None

    @property
    def _output(self) -> str:
        return '' if self._program is None else self._program.stdout

    def _alive_until(self, end: float) -> list[tuple[float, float]]:
        """Return from when until when the encoders that run now were alive."""
        found, since = [], self._started
        for at, event in _BUS_OFF.findall(self._output):
            if event == 'begins':
                found.append((since, float(at)))
                since = float('inf')
            else:
                since = float(at)
        return [*found, (since, end)] if since < end else found


def _send_garbage() -> None:
    """Send a packet that is no CAN frame to the bus of this process."""
    port = json.loads(private_environment()['CAN_CONFIG'])['port']
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.sendto(b'no frame', (bus_channel(), port))


class Visitors:
    """
    Subscribers that come and go.

    Attributes
    ----------
    came : int
        Visitors that have left.
    without : int
        Of these, those that received no orientation although the bus was alive all the time.
    stuck : int
        Of these, those that did not end by themselves after Ctrl-C.

    """

    def __init__(self) -> None:
        self.came = self.without = self.stuck = 0
        self._directory = tempfile.TemporaryDirectory(prefix='visitor_')
        self._program: Program | None = None
        self._began = self._next = time.time()

    def tend(self, alive_since: float | None) -> None:
        """Start or end a visitor, if that is due, on a bus alive since then, s, or not alive."""
        now = time.time()
        if self._program is None:
            if now >= self._next:
                self._program = start_process(VISITOR, Path(self._directory.name), {})
                self._began, self._next = now, now + VISIT_PERIOD
        elif now - self._began >= VISIT_SECONDS:
            alive = alive_since is not None and alive_since < self._began
            self.without += alive and READY not in self._program.stdout
            self._leave()

    def end(self) -> None:
        """End the present visitor."""
        self._leave()
        self._directory.cleanup()

    def _leave(self) -> None:
        if self._program is not None:
            self._program.send_signal(VISITOR_ENDS[self.came % len(VISITOR_ENDS)])
            try:
                self._program.wait()
            except TimeoutError:  # and was killed
                self.stuck += 1
            self._program = None
            self.came += 1


class Watch:
    """
    Prints the stacks of all threads once in every hang: no orientations on a living bus.

    Attributes
    ----------
    hangs : int
        Hangs seen.

    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._size = 0
        self._grown = time.time()
        self._reported = False
        self.hangs = 0

    @property
    def count(self) -> int:
        """Return the number of orientations that the observer has written."""
        return self._size // SAMPLE_SIZE

    def tend(self, alive_since: float | None, processes: Mapping[str, Program]) -> None:
        """Look for orientations since the last call."""
        now = time.time()
        size = self._file.stat().st_size
        if size != self._size:
            self._size, self._grown, self._reported = size, now, False
        elif alive_since is not None and not self._reported \
                and now - max(alive_since, self._grown) > HANG:
            self._reported = True
            self.hangs += 1
            before = {name: len(process.stderr) for name, process in processes.items()}
            for process in processes.values():
                process.send_signal(STACKS_SIGNAL)
            time.sleep(STACKS_TIME)
            for name, process in processes.items():
                print(f'  no orientation for {HANG:g} s; {name}:\n'
                      f'{process.stderr[before[name]:]}', flush=True)


class Soak:
    """
    The disturbances of a soak, and the observation of it.

    Parameters
    ----------
    case : Case
        Pipeline.
    rate : float
        Sample rate, Hz.

    Attributes
    ----------
    bus, visitors
        The disturbances.
    hangs : int
        Hangs seen.

    """

    def __init__(self, case: Case, rate: float) -> None:
        self._case = case
        self.bus = FailingBus(rate)
        self.visitors = Visitors()
        self.hangs = 0

    def during(self, seconds: float, processes: Mapping[str, Program],
               directory: Path) -> Memory:
        """
        Disturb for a time, s; return the resident memory of the processes, MiB.

        Ctrl-C ends it early: what was measured until then is reported.
        """
        memory: Memory = {name: [] for name in processes}
        try:
            self._disturb(seconds, processes, directory, memory)
        except KeyboardInterrupt:
            print('  interrupted', flush=True)
        return memory

    def _disturb(self, seconds: float, processes: Mapping[str, Program], directory: Path,
                 memory: Memory) -> None:
        watch = Watch(directory / SAMPLES_FILE)
        begin = time.monotonic()
        memory_at, progress_at = begin, begin + PROGRESS_MINUTES * MINUTE
        while (now := time.monotonic()) < begin + seconds:
            check_alive(self._case, processes)
            if now >= memory_at:
                memory_at += MEMORY_PERIOD
                read_memory(memory, processes)
            self.bus.tend()
            alive_since = self.bus.alive_since
            self.visitors.tend(alive_since)
            watch.tend(alive_since, processes)
            self.hangs = watch.hangs
            if now >= progress_at:
                progress_at += PROGRESS_MINUTES * MINUTE
                sizes = ', '.join(f'{name} {values[-1]:.1f}' for name, values in memory.items())
                print(f'  {(now - begin) / MINUTE:.0f} minutes: {watch.count} orientations; '
                      f'resident memory, MiB: {sizes}', flush=True)
            time.sleep(LOOP_PERIOD)


def soak(case: Case, minutes: float, rate: float, parameters: Mapping[str, str]) -> None:
    """
    Run a pipeline for minutes on a failing bus; print memory, latency, losses and stalls.

    Parameters
    ----------
    case : Case
        Pipeline; the recorder and the source on the bus are added.
    minutes : float
        Length of the run, minutes of `MINUTE`.
    rate : float
        Sample rate, Hz.
    parameters : mapping of str to str
        ROS parameters of the nodes by name.

    Raises
    ------
    PipelineError
        A process did not start, or ended by itself.

    """
    print(f'\nsoak, {case.name}, {minutes:g} minutes at {rate:g} Hz', flush=True)
    with tempfile.TemporaryDirectory(prefix='recorder_') as recordings:
        driver = case.processes[-1]
        own = {'source': 'can', 'can.interface': 'udp_multicast', 'can.channel': bus_channel(),
               **simulated_rig()}
        whole = replace(
            case, processes=('recorder', *case.processes),
            own=(('recorder recorder:directory', recordings),
                 *((f'{driver} encoder_driver:{name}', str(value))
                   for name, value in own.items())))
        disturbances = Soak(whole, rate)
        try:
            disturbances.bus.start()
            run = measure(whole, minutes * MINUTE, rate, parameters, disturbances.during)
        finally:
            disturbances.bus.stop()
            disturbances.visitors.end()
        rows = _rows(Path(recordings) / 'orientation.csv')
    _report(run, disturbances, rows)


def stalls(arrivals: np.ndarray, alive: list[tuple[float, float]]) -> tuple[
        list[tuple[float, float]], list[float]]:
    """
    Return the times without an orientation on a living bus, and those until the first one.

    Parameters
    ----------
    arrivals : ndarray, shape (n,)
        Arrivals of the orientations, s, ascending.
    alive : list of (float, float)
        Times from which and until which the bus was alive, s.

    Returns
    -------
    gaps : list of (float, float)
        Beginning and length, s, of each time longer than `STALL` without an orientation while the
        bus was alive.
    restarts : list of float
        Time from each return of the bus to the first orientation, s; the whole time that the bus
        was alive if none came. The first entry of `alive` is the start, and not among them.

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
    Return the lengths, s, of the gaps in which no sample was rejected.

    A machine that is too busy delays samples, and `fkm` rejects them as stale: no deadlock.

    Parameters
    ----------
    gaps : list of (float, float)
        Beginning and length of each gap, s.
    rejections : ndarray, shape (n, 2)
        Times, ns, ascending, and the samples rejected until then.

    """
    found = []
    for begin, length in gaps:
        before, after = np.searchsorted(
            rejections[:, 0], [begin * _SECOND, (begin + length) * _SECOND])
        span = rejections[max(0, before - 1):after + 1, 1]
        if not len(span) or span[-1] == span[0]:
            found.append(length)
    return found


def _rows(path: Path) -> int:
    """Return the number of rows of a CSV file below its header; 0 where there is no file."""
    if not path.exists():
        return 0
    with open(path, 'rb') as file:
        return sum(block.count(b'\n') for block in iter(lambda: file.read(1 << 20), b'')) - 1


def _report(run: Run, disturbances: Soak, rows: int) -> None:
    first = round(MINUTE / MEMORY_PERIOD)
    for name, memory in run.memory.items():
        settled, half = memory[min(first, len(memory) - 1)], memory[len(memory) // 2]
        print(f'  resident memory of {name}: {settled:.1f} MiB, growth after the first minute '
              f'{memory[-1] - settled:+.2f} MiB, of it in the second half '
              f'{memory[-1] - half:+.2f} MiB')
    elapsed = (run.stamps - run.stamps[0]) / _SECOND
    # Single minutes of a busy machine differ: the figures are of a tenth of the run.
    length = max(MINUTE, 0.1 * run.span)
    wakes = round(len(run.control) * min(1.0, length / run.span))
    parts = (('first', elapsed < length, run.control[:wakes]),
             ('last', elapsed >= run.span - length, run.control[-wakes:]))
    for text, part, late in parts:
        latency = _summary(run.latencies[part]) + ' us' if part.any() else 'no orientation'
        print(f'  latency, {text} {length / MINUTE:.3g} minutes: {latency} (control thread late '
              f'by {_summary(late)} us)')
    counted = run.counted
    reasons = {key: count for key, count in counted.items()
               if count and key.startswith(('rejected: ', 'dropped: '))}
    print(f'  samples: {counted.get("cycles", 0)} cycles, {run.made} made, {run.lost} without an '
          f'orientation at the observer, of these {run.rejected} rejected by fkm; '
          f'{rows} orientations recorded')
    for reason, count in sorted(reasons.items(), key=lambda entry: -entry[1]):
        print(f'    {reason}: {count}')
    arrivals = np.sort(run.stamps / _SECOND + run.latencies * 1e-6)
    opened, closed = arrivals[0], arrivals[0] + run.span
    alive = [(max(since, opened), min(until, closed))
             for since, until in disturbances.bus.alive if since < closed and until > opened]
    gaps, restarts = stalls(arrivals, alive)
    print(f'  failures of the bus: {len(restarts)}; bus opened again '
          f'{counted.get("bus opened", 0)} times'
          + (f'; first orientation after its return: median {np.median(restarts):.2f} s, largest '
             f'{max(restarts):.2f} s' if restarts else ''))
    visitors = disturbances.visitors
    print(f'  subscribers that came and went: {visitors.came}; without an orientation: '
          f'{visitors.without}; killed because they did not end: {visitors.stuck}')
    lengths = [length for _, length in gaps]
    dead = unexplained(gaps, run.rejections)
    print(f'  times over {STALL:g} s without an orientation while the bus was alive: {len(gaps)}'
          + (f', the longest {max(lengths):.2f} s' if gaps else '')
          + f'; of these without a rejected sample: {len(dead)}'
          + (f', the longest {max(dead):.2f} s' if dead else '')
          + f'; over {HANG:g} s: {disturbances.hangs}')
    for name, pauses in run.pauses.items():
        print(f'  garbage collections of {name}: {len(pauses)}'
              + (f', the longest {max(pauses):.0f} us' if pauses else ''))
    loads = ', '.join(f'{name} {load:.1f}' for name, load in run.load.items())
    print(f'  CPU, % of a core: {loads}; all other programs {run.others:.0f}')
    disturbed = disturbance(run)
    if disturbed:
        print(f'  the machine was disturbed: {disturbed}')


def _summary(times: np.ndarray) -> str:
    found = quantiles(times)
    return ' '.join(f'{name} {found[name]:.0f}' for name in ('p50', 'p99', 'max'))
