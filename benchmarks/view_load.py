# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Cost of `view`: latency of `master` beside it and a browser, and its own CPU and memory."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
import os
from pathlib import Path
import shutil
from statistics import median
import subprocess
import sys
import tempfile
import time

from benchmarks import browser_process
from benchmarks.command_line import measurement_parser, run
from benchmarks.pipeline.child_process import executable, Program, wait_until
from benchmarks.pipeline.comparison import disturbance, FIGURES, MASTER, ratio, summary
from benchmarks.pipeline.run import all_processes, measure, PipelineError, Run, TICK
from benchmarks.soak_report import resident_memory
from spm_haptic_master.parameters.arguments import positive

# The same pipeline beside view, without a browser and with one on its page.
WITHOUT_BROWSER = replace(MASTER, name='view without a browser')
WITH_BROWSER = replace(MASTER, name='view with a browser')
# Time that view and the browser have before the window (s): they load the page and draw it once.
LOAD_TIME = 12.0
# Time until view says where its page is (s).
START_TIMEOUT = 60.0
# Port of the page, where it is free.
PORT = 18280
# Size of the page (pixels).
SIZE = (1280, 720)
# Real-time priority of the nodes, where it is permitted: that of `make run`.
PRIORITY = 10


@dataclass
class ViewLoad:
    """CPU time of `view` in a run, % of a core, and its memory at begin and end, MiB."""

    cpu: float = 0.0
    before: float = 0.0
    after: float = 0.0


def measure_view(seconds: float, rounds: int, rate: float, parameters: Mapping[str, str]) -> None:
    """
    Measure `master` alone, beside view, and with a browser, in turn; print all with ratios.

    Without another one given, it has the real-time priority that it has in `make run`.
    PipelineError: no browser is installed, `view` does not start, or a run failed.
    """
    path = browser_process.browser()
    if path is None:
        raise PipelineError(f'no browser is installed; expected {browser_process.NAMES[0]}')
    if not any(name.endswith('realtime.priority') for name in parameters):
        own = scheduling_of_make_run()
        print(
            'realtime.priority '
            + (f'{PRIORITY}, as make run' if own else '0: SCHED_FIFO is not permitted'),
            flush=True,
        )
        parameters = {**parameters, **own}
    runs: list[Run] = []
    loads: dict[str, list[ViewLoad]] = {WITHOUT_BROWSER.name: [], WITH_BROWSER.name: []}
    for number in range(1, rounds + 1):
        runs.append(measure(MASTER, seconds, rate, parameters))
        _print(number, rounds, runs[-1])
        for case, browser in ((WITHOUT_BROWSER, None), (WITH_BROWSER, path)):
            with _serving(browser) as view:
                load = ViewLoad()
                runs.append(
                    measure(
                        case,
                        seconds,
                        rate,
                        parameters,
                        partial(_with_load, view, load),
                        settle=LOAD_TIME,
                    )
                )
                if view.poll() is not None:
                    raise PipelineError(f'view ended by itself\n{view.stderr}')
            loads[case.name].append(load)
            _print(
                number,
                rounds,
                runs[-1],
                f', view {load.cpu:.1f} % of a core, {load.before:.1f} -> {load.after:.1f} MiB',
            )
    print(f'\nratio, median of {rounds} rounds (least .. largest)')
    for case in (WITHOUT_BROWSER, WITH_BROWSER):
        for name in ('p50', 'p99'):
            print(f'  {name}, {case.name}, over alone: {ratio(runs, case, MASTER, FIGURES[name])}')
    for case in (WITHOUT_BROWSER, WITH_BROWSER):
        cpu = median(load.cpu for load in loads[case.name])
        print(f'CPU of view, {case.name}: {cpu:.1f} % of a core (median)')


def scheduling_of_make_run() -> dict[str, str]:
    """Return the parameters with which `make run` schedules `master` for this user."""
    return {'realtime.priority': str(PRIORITY)} if may_have_priority(PRIORITY) else {}


def may_have_priority(priority: int) -> bool:
    """Return whether this user may have a thread with a priority under SCHED_FIFO."""
    policy, before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError:
        return False
    os.sched_setscheduler(0, policy, before)
    return True


def _print(number: int, rounds: int, run: Run, more: str = '') -> None:
    disturbed = disturbance(run) if run.case is MASTER else ''
    print(
        f'round {number} of {rounds}, {run.case.name}: {summary(run.latencies)} us, '
        f'lost {run.lost}{more}' + (f' (disturbed: {disturbed})' if disturbed else ''),
        flush=True,
    )


def _with_load(
    view: Program, load: ViewLoad, seconds: float, _: Mapping[str, Program], __: Path
) -> None:
    """Measure `view` over the window."""
    ticks, load.before = all_processes()[view.pid][1], resident_memory(view.pid)
    time.sleep(seconds)
    load.cpu = 100.0 * TICK * (all_processes()[view.pid][1] - ticks) / seconds
    load.after = resident_memory(view.pid)


@contextmanager
def _serving(path: str | None) -> Iterator[Program]:
    """Start `view`, and a browser, if any, on its page."""
    profile = Path(tempfile.mkdtemp(prefix='benchmark_browser_'))
    try:
        with Program(executable('view', parameters={'view.port': PORT})) as view:
            if (
                not wait_until(
                    lambda: '\n' in view.stdout or view.poll() is not None, START_TIMEOUT
                )
                or view.poll() is not None
            ):
                raise PipelineError(f'view does not start: {view.stderr.strip()}')
            url = view.stdout.splitlines()[0].removeprefix('view: ')
            browser = (
                None
                if path is None
                else subprocess.Popen(
                    browser_process.command(path, profile, url, SIZE),
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
            )
            try:
                yield view
            finally:
                if browser is not None:
                    browser_process.end(browser)
    finally:
        shutil.rmtree(profile, ignore_errors=True)


def main(args: list[str] | None = None) -> int:
    """Measure as the command line says; return the exit code."""
    parser = measurement_parser('view_load', __doc__)
    parser.add_argument('--seconds', type=positive, default=20.0, help='of a run (20)')
    parser.add_argument('--rounds', type=int, default=5, help='runs of each (5)')
    return run(
        parser,
        lambda given, parameters: measure_view(
            given.seconds, given.rounds, given.rate, parameters
        ),
        args,
    )


if __name__ == '__main__':
    sys.exit(main())
