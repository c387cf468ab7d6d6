# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How soon the slave's command stops when a process of the chain stops or dies."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
import os
import signal
import sys
import time

from benchmarks.command_line import measurement_parser, run
from benchmarks.pipeline.child_process import executable, private_environment, Program
from benchmarks.pipeline.run import PipelineError
from benchmarks.surgeon import Surgeon
import numpy as np
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.parameters.nodes import NODE_SETTINGS
from spm_haptic_master.parameters.resolver import Parameters, resolve

# Processes of the chain, with the parameters of each; those that are stopped in turn.
CHAIN: Mapping[str, Mapping[str, object]] = {
    'sim_slave': {},
    'teleop': {},
    'fkm': {},
    'encoder_driver': {'source': 'sim', 'sim.trajectory': 'sweep'},
}
# Stops in their order: a process may come back with all that has queued up, or it is gone.
STOPS = tuple(
    (process, number)
    for process in reversed(tuple(CHAIN))
    for number in (signal.SIGSTOP, signal.SIGKILL)
)
# Time that the slave follows before (s), with that much more by chance.
FOLLOWING, BY_CHANCE = 0.5, 0.2
# Attempts to follow for that time without a pause of the machine.
ATTEMPTS = 30
# Time without a command after which it has stopped, and longest wait for that (s).
QUIET, LONGEST = 0.5, 10.0
# Time after the return in which there must be no command (s).
RETURN = 1.5
# Time-outs after which teleop stops by itself, by the process that it misses: those of its
# settings (s); the command of the others stops with the last orientation.
TIMEOUTS = {
    'sim_slave': 'teleop.slave_timeout',
    'encoder_driver': 'teleop.orientation_timeout',
    'fkm': 'teleop.orientation_timeout',
    'teleop': '',
}
# Periods of the command that a stop may take beyond its time-out.
PERIODS = 2


@dataclass(slots=True)
class Stops:
    """The stops of one process by one signal."""

    process: str
    number: signal.Signals
    limit: float  # time-out of teleop and the periods beyond it, ms
    times: list[float] = field(default_factory=list)  # from the signal to the last command, ms
    commands: int = 0  # published after the return of the process, before an enable
    # Largest angle between the last command and the slave after the return, deg: 0 where the slave
    # holds it.
    off: float = 0.0


def measure_stops(
    rounds: int,
    parameters: Mapping[str, str],
    timeouts: Mapping[str, float],
    period: float,
    which: Sequence[tuple[str, signal.Signals]] = STOPS,
) -> list[Stops]:
    """
    Stop each process in turn, by each signal of `which`, and measure when the command stops.

    `timeouts` are those of teleop by their parameter, s (0 for ''), `period` is that of the
    command, s. PipelineError: the slave could not be engaged.
    """
    found = [
        Stops(process, number, 1e3 * (timeouts[TIMEOUTS[process]] + PERIODS * period))
        for process, number in which
    ]
    # The surgeon is in this process: it joins the domain of the others.
    os.environ.update(private_environment())
    chance = np.random.default_rng(1)
    running = {name: _start(name, parameters) for name in CHAIN}
    with Surgeon() as surgeon:
        try:
            for _ in range(rounds):
                for stops in found:
                    _follow(surgeon, FOLLOWING + BY_CHANCE * float(chance.random()))
                    _stop_once(stops, surgeon, running, parameters)
        finally:
            for program in running.values():
                program.send_signal(signal.SIGCONT)
                program.stop()
    return found


def _start(name: str, parameters: Mapping[str, str]) -> Program:
    return Program(executable(name, parameters={**parameters, **CHAIN[name]}))


def _follow(surgeon: Surgeon, seconds: float) -> None:
    """Have the slave follow for a time, s; again, where the machine had a pause meanwhile."""
    for _ in range(ATTEMPTS):
        if not surgeon.await_ready() or not surgeon.engage():
            break
        time.sleep(seconds)
        if surgeon.state == 'engaged':
            return
    raise PipelineError(f'the slave could not be engaged: {surgeon.state or "no teleop"}')


def _stop_once(
    stops: Stops, surgeon: Surgeon, running: dict[str, Program], parameters: Mapping[str, str]
) -> None:
    """Stop the process, wait for the end of the commands, and let it return."""
    began = time.time_ns()
    running[stops.process].send_signal(stops.number)
    if not surgeon.await_rest(lambda: len(surgeon.commands), QUIET, LONGEST):
        raise PipelineError(f'{stops.process}: commands still come {LONGEST:g} s after the stop')
    stops.times.append(max(0.0, (surgeon.commands[-1].at - began) * 1e-6))
    if stops.number == signal.SIGKILL:
        running[stops.process].kill()
    count, last = len(surgeon.commands), surgeon.commands[-1].quaternion
    returned = time.time_ns()
    if stops.number == signal.SIGKILL:
        running[stops.process] = _start(stops.process, parameters)
    else:
        running[stops.process].send_signal(signal.SIGCONT)
    time.sleep(RETURN)
    # By the time of their publication: DDS may deliver one late.
    stops.commands += sum(command.at > returned for command in surgeon.commands[count:])
    # A slave that starts again stands where it starts.
    if stops.process != 'sim_slave' or stops.number == signal.SIGSTOP:
        stops.off = max(stops.off, degrees(rotation_distance(last, surgeon.poses[-1].quaternion)))


def stops_table(found: Sequence[Stops]) -> str:
    """Return the stops as a Markdown table."""
    lines = [
        '| stopped | by | p50 ms | p99 | worst | time-out + 2 periods | commands after its '
        'return | slave off the last command after it, deg |',
        '|---|---|---|---|---|---|---|---|',
    ]
    for stops in found:
        p50, p99, worst = np.percentile(stops.times, [50.0, 99.0, 100.0])
        lines.append(
            f'| {stops.process} | {stops.number.name} | {p50:.1f} | {p99:.1f} | '
            f'{worst:.1f} | {stops.limit:.0f} | {stops.commands} | {stops.off:.3f} |'
        )
    return '\n'.join(lines)


def main(args: list[str] | None = None) -> int:
    """Measure as the command line says, and print the table; return the exit code."""
    parser = measurement_parser('teleop_stops', __doc__)
    parser.add_argument('--rounds', type=int, default=5, help='of all stops (5)')
    return run(parser, _print_stops, args)


def _print_stops(given: argparse.Namespace, parameters: Mapping[str, str]) -> None:
    parameters = {**parameters, 'rate': str(given.rate)}
    resolved = Parameters(arguments=[f'{name}:={value}' for name, value in parameters.items()])
    _, values = resolve(resolved.of('teleop'), NODE_SETTINGS['teleop'])
    timeouts = {name: values[name] if name else 0.0 for name in TIMEOUTS.values()}
    rate = values['teleop.command_rate'] or values['rate']
    print(
        f'\nTime from the stop of a process to the last servo_cp, {given.rounds} of each, '
        f'servo_cp at {rate:g} Hz\n',
        flush=True,
    )
    print(stops_table(measure_stops(given.rounds, parameters, timeouts, 1.0 / rate)))


if __name__ == '__main__':
    sys.exit(main())
