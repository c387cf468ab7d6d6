# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A pipeline under measurement: its processes, from their start to their end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
import signal
import sys

from spm_haptic_master.benchmark.child_process import (
    parameter_arguments,
    private_environment,
    Program,
    wait_until,
)
from spm_haptic_master.benchmark.observer import READY
from spm_haptic_master.exceptions import SpmError

# Module that runs each process of a pipeline.
MODULE = 'spm_haptic_master.benchmark.measured_process'
# Parameters of the nodes that the observer gets, too.
SCHEDULING = ('realtime.slice', 'realtime.priority')
# Time until the first orientation (s).
START_TIMEOUT = 30.0


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


@contextmanager
def running(case: Case, parameters: Mapping[str, object],
            directory: Path) -> Iterator[dict[str, Program]]:
    """Start the processes and yield them after the first orientation; stop all at the end."""
    started: dict[str, Program] = {}
    try:
        # The observer stands for a controller on the same host, and is scheduled as the nodes.
        scheduling = {name: parameters[name] for name in SCHEDULING if name in parameters}
        started[case.observer] = start_process(case.observer, directory, scheduling)
        for name in case.processes:
            started[name] = start_process(
                name, directory, {**parameters, **case.own.get(name, {})})
        _await_first(case, started)
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
            raise PipelineError(f'{case.name}: {name} ended with {process.poll()}\n'
                                + _complaints(started))


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
