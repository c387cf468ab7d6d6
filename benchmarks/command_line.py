# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line of a measurement: its rate and parameters, and what machine it ran on."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from benchmarks.pipeline.comparison import machine
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.parameters.arguments import OneLineParser, positive
from spm_haptic_master.parameters.nodes import ALL_NAMES
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.tools import command_line


def measurement_parser(name: str, description: str | None) -> OneLineParser:
    """Return a parser of what every measurement takes: --rate and -p."""
    parser = OneLineParser(prog=name, description=description)
    parser.add_argument('--rate', type=positive, default=1000.0, help='Hz (1000)')
    parser.add_argument(
        '-p',
        '--param',
        action='append',
        default=[],
        metavar='NAME:=VALUE',
        help='a parameter of every node, bare ones too: realtime.gc:=disable; '
        'realtime.slice and .priority are also those of the observer',
    )
    return parser


def run(
    parser: OneLineParser,
    measure: Callable[[argparse.Namespace, dict[str, str]], None],
    args: list[str] | None,
) -> int:
    """
    Check the command line, print what machine this is, measure; return the exit code.

    `measure` is called with the command line and the parameters of the nodes by name.
    """

    def program(words: list[str]) -> int:
        # As of the nodes, whose arguments ROS has behind it.
        given = parser.parse_args([each for each in words if each != '--ros-args'])
        if getattr(given, 'rounds', 1) < 1:
            raise InputError(f'--rounds {given.rounds}; expected 1 or more')
        of_nodes = Parameters(arguments=given.param)
        parameters = dict(text.split(':=', 1) for text in given.param)
        if 'rate' in parameters:
            raise InputError(f"-p 'rate:={parameters['rate']}'; expected --rate HZ")
        of_nodes.check((*PIPELINE, FOLLOWER), ALL_NAMES)
        print(machine(), flush=True)
        measure(given, parameters)
        return 0

    return command_line.run(parser.prog, program, args)
