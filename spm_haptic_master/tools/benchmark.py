# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Measure the real nodes beside a bare relay, as separate processes and composed in one."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
import signal
import sys

from spm_haptic_master.benchmark.comparison import compare, headroom, MASTER, THREE
from spm_haptic_master.benchmark.report import machine
from spm_haptic_master.benchmark.soak import soak
from spm_haptic_master.benchmark.teleop_stops import measure_stops, stops_table, TIMEOUTS
from spm_haptic_master.benchmark.view_load import measure_view
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.ros.arguments import OneLineParser, positive
from spm_haptic_master.ros.node_settings import ALL_NAMES
from spm_haptic_master.ros.resolver import Parameters, resolve
from spm_haptic_master.teleoperation.settings import TELEOP_SETTINGS

PARTS = ('compare', 'headroom', 'soak', 'teleop', 'view')
# Longest run of a rate of `headroom` (s).
HEADROOM_SECONDS = 5.0


def main(args: list[str] | None = None) -> int:
    """Run the parts that the command line names; return the exit code."""
    parser = OneLineParser(prog='benchmark', description=__doc__)
    parser.add_argument('parts', nargs='*', metavar='PART', default=['compare', 'headroom'],
                        help=f'{", ".join(PARTS)} (default: compare headroom)')
    parser.add_argument('--seconds', type=positive, default=20.0, help='of a run (20)')
    parser.add_argument('--rounds', type=int, default=5,
                        help='of all pipelines in turn; of teleop, of all stops (5)')
    parser.add_argument('--rate', type=positive, default=1000.0, help='Hz (1000)')
    parser.add_argument('--minutes', type=positive, default=10.0, help='of the soak (10)')
    parser.add_argument('--apart', action='store_true', help='soak the nodes as three processes')
    parser.add_argument('--output', type=Path, default=Path('bench-pipeline'), metavar='DIR',
                        help='for runs.csv and latency.png (bench-pipeline)')
    parser.add_argument('-p', '--param', action='append', default=[], metavar='NAME:=VALUE',
                        help='a parameter of every node, bare ones too: realtime.gc:=disable; '
                             'realtime.slice and .priority are also those of the observer')
    # Also where a shell makes its background jobs ignore Ctrl-C.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        given = (sys.argv if args is None else args)[1:]
        # As of the nodes, whose arguments ROS has behind it.
        _run(parser.parse_args([each for each in given if each != '--ros-args']))
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    return 0


def _run(given: argparse.Namespace) -> None:
    unknown = set(given.parts) - set(PARTS)
    if unknown:
        raise InputError(f'{", ".join(sorted(unknown))}: expected {", ".join(PARTS)}')
    if given.rounds < 1:
        raise InputError(f'--rounds {given.rounds}; expected 1 or more')
    parameters = _parameters(given.param)
    if 'rate' in parameters:
        raise InputError(f"-p 'rate:={parameters['rate']}'; expected --rate HZ")
    Parameters(arguments=given.param).check((*PIPELINE, FOLLOWER), ALL_NAMES)
    given.output.mkdir(parents=True, exist_ok=True)
    print(machine(), flush=True)
    if 'compare' in given.parts:
        compare(given.seconds, given.rounds, given.rate, parameters, given.output)
    if 'headroom' in given.parts:
        headroom(min(given.seconds, HEADROOM_SECONDS), parameters)
    if 'soak' in given.parts:
        soak(THREE if given.apart else MASTER, given.minutes, given.rate, parameters)
    if 'teleop' in given.parts:
        _teleop(given.rounds, {**parameters, 'rate': str(given.rate)})
    if 'view' in given.parts:
        measure_view(given.seconds, given.rounds, given.rate, parameters)


def _teleop(rounds: int, parameters: Mapping[str, str]) -> None:
    """Print how soon the slave's command stops when a process of the chain does."""
    given = Parameters(arguments=[f'{name}:={value}' for name, value in parameters.items()])
    _, values = resolve(given.of(FOLLOWER), TELEOP_SETTINGS)
    timeouts = {name: values[name] if name else 0.0 for name in TIMEOUTS.values()}
    rate = values['teleop.command_rate'] or values['rate']
    print(f'\nTime from the stop of a process to the last servo_cp, {rounds} of each, servo_cp at '
          f'{rate:g} Hz\n', flush=True)
    print(stops_table(measure_stops(rounds, parameters, timeouts, 1.0 / rate)))


def _parameters(given: Sequence[str]) -> dict[str, str]:
    """Return the parameters given as NAME:=VALUE."""
    parameters = {}
    for text in given:
        name, separator, value = text.partition(':=')
        if not separator:
            raise InputError(f"-p '{text}'; expected NAME:=VALUE")
        parameters[name] = value
    return parameters
