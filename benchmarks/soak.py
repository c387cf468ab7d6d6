# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A long run: encoders on a bus that fails, a recorder, subscribers that come and go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
import sys
import tempfile
import time

from benchmarks.command_line import measurement_parser, run
from benchmarks.disturbances import FailingBus, Schedule, Visitors
from benchmarks.pipeline.child_process import bus_channel, Program
from benchmarks.pipeline.comparison import MASTER, THREE
from benchmarks.pipeline.measured_process import SAMPLES_FILE
from benchmarks.pipeline.run import Case, check_alive, measure
from benchmarks.soak_report import Memory, MEMORY_PERIOD, report, resident_memory
from benchmarks.stalls import Watch
from spm_haptic_master.parameters.arguments import positive
from spm_haptic_master.parameters.files import simulated_rig

# Times of a soak.
SCHEDULE = Schedule()
# Time between two reports of the progress (minutes).
PROGRESS_MINUTES = 5.0
# Period of the loop that disturbs and observes (s).
LOOP_PERIOD = 0.05


class Soak:
    """
    The disturbances of a soak of a pipeline at a rate, Hz, and the observation of it.

    `hangs` are those seen; `memory` is the resident memory of each process, MiB, every
    `MEMORY_PERIOD`.
    """

    def __init__(self, case: Case, rate: float) -> None:
        self._case = case
        self.bus = FailingBus(rate, SCHEDULE)
        self.visitors = Visitors(SCHEDULE)
        self.hangs = 0
        self.memory: Memory = {}

    def during(self, seconds: float, processes: Mapping[str, Program], directory: Path) -> None:
        """Disturb for a time, s; Ctrl-C ends it early: what was measured then is reported."""
        self.memory = {name: [] for name in processes}
        try:
            self._disturb(seconds, processes, directory)
        except KeyboardInterrupt:
            print('  interrupted', flush=True)

    def _disturb(self, seconds: float, processes: Mapping[str, Program], directory: Path) -> None:
        watch = Watch(directory / SAMPLES_FILE)
        begin = time.monotonic()
        memory_at, progress_at = begin, begin + PROGRESS_MINUTES * SCHEDULE.minute
        while (now := time.monotonic()) < begin + seconds:
            check_alive(self._case, processes)
            if now >= memory_at:
                memory_at += MEMORY_PERIOD
                for name, process in processes.items():
                    self.memory[name].append(resident_memory(process.pid))
            self.bus.tend()
            alive_since = self.bus.alive_since
            self.visitors.tend(alive_since)
            watch.tend(alive_since, processes)
            self.hangs = watch.hangs
            if now >= progress_at:
                progress_at += PROGRESS_MINUTES * SCHEDULE.minute
                sizes = ', '.join(
                    f'{name} {values[-1]:.1f}' for name, values in self.memory.items()
                )
                print(
                    f'  {(now - begin) / SCHEDULE.minute:.0f} minutes: {watch.count} '
                    f'orientations; resident memory, MiB: {sizes}',
                    flush=True,
                )
            time.sleep(LOOP_PERIOD)


def soak(case: Case, minutes: float, rate: float, parameters: Mapping[str, str]) -> None:
    """
    Run a pipeline for minutes of `SCHEDULE` on a failing bus; print memory, latency and losses.

    The recorder and the source on the bus are added. PipelineError: a process did not start, or
    ended by itself.
    """
    print(f'\nsoak, {case.name}, {minutes:g} minutes at {rate:g} Hz', flush=True)
    with tempfile.TemporaryDirectory(prefix='recorder_') as recordings:
        driver = case.processes[-1]
        own = {
            'source': 'can',
            'can.interface': 'udp_multicast',
            'can.channel': bus_channel(),
            **simulated_rig(),
        }
        whole = replace(
            case,
            processes=('recorder', *case.processes),
            own={
                'recorder': {'recorder:directory': recordings},
                driver: {f'encoder_driver:{name}': value for name, value in own.items()},
            },
        )
        disturbances = Soak(whole, rate)
        try:
            disturbances.bus.start()
            measured = measure(
                whole, minutes * SCHEDULE.minute, rate, parameters, disturbances.during
            )
        finally:
            disturbances.bus.stop()
            disturbances.visitors.end()
        rows = _rows(Path(recordings) / 'orientation.csv')
    report(
        measured,
        disturbances.memory,
        disturbances.bus,
        disturbances.visitors,
        disturbances.hangs,
        rows,
        SCHEDULE.minute,
    )


def _rows(path: Path) -> int:
    """Return the number of rows of a CSV file below its header; 0 where there is no file."""
    if not path.exists():
        return 0
    with open(path, 'rb') as file:
        return sum(block.count(b'\n') for block in iter(lambda: file.read(1 << 20), b'')) - 1


def main(args: list[str] | None = None) -> int:
    """Run the soak of the command line; return the exit code."""
    parser = measurement_parser('soak', __doc__)
    parser.add_argument('--minutes', type=positive, default=10.0, help='length (10)')
    parser.add_argument('--apart', action='store_true', help='the nodes as three processes')
    return run(
        parser,
        lambda given, parameters: soak(
            THREE if given.apart else MASTER, given.minutes, given.rate, parameters
        ),
        args,
    )


if __name__ == '__main__':
    sys.exit(main())
