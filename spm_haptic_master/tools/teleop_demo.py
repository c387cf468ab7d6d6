# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run master, teleop and a simulated slave with a simulated surgeon, and print what it showed."""

from __future__ import annotations

import argparse
import os

from spm_haptic_master.benchmark.teleop_demo import fixed, run, table
from spm_haptic_master.exceptions import InputError, SettingError
from spm_haptic_master.executables import FOLLOWER, PIPELINE
from spm_haptic_master.ros.arguments import parameters_of, Parser
from spm_haptic_master.ros.node_settings import process_settings
from spm_haptic_master.ros.resolver import NO_EFFECT
from spm_haptic_master.tools import command_line

NAME = 'teleop_demo'
DESCRIPTION = """\
A simulated surgeon engages, clutches, loses a sensor and comes back, in about a minute; no ROS and
no hardware is needed. Parameters go to master and teleop: -p teleop.speed_limit:=1.0"""


def main(args: list[str] | None = None) -> int:
    """Run the demonstration; return the exit code."""
    return command_line.run(NAME, _program, args)


def _program(args: list[str]) -> int:
    found = Parser(NAME, DESCRIPTION).parse(args)
    given = _given(found)
    options = [word for name, values in (('--params-file', found.params_file),
                                         ('-p', found.param))
               for value in values for word in (name, value)]
    print(f'\n{table(run(options, given, lambda line: print(line, flush=True)))}')
    return 0


def _given(found: argparse.Namespace) -> dict[str, object]:
    """
    Return the parameters that the nodes of `master` are given, by name.

    Raises
    ------
    InputError
        One would have no effect, or the demonstration needs another value.

    """
    for path in found.params_file:
        if os.path.exists(path) and not os.path.isfile(path):
            raise InputError(f'--params-file {path}; expected a regular file, which {NAME} reads '
                             'before master does')
    if found.remap:
        raise InputError(f"-r '{found.remap[0]}'; expected none: the simulated surgeon and slave "
                         'know no other names')
    nodes = (*PIPELINE, FOLLOWER)
    names = {setting.name for setting in process_settings('master')}
    parameters = parameters_of(found)
    parameters.check(nodes, names)
    for argument in parameters.unused(
            {parameters.full_name(node): names for node in nodes}):
        raise InputError(f'{argument}: {NO_EFFECT}')
    given = {name: value for node in nodes for name, value in parameters.of(node).items()}
    for name in fixed():
        if name in given:
            raise SettingError(name, given[name], f'none: {NAME} sets it for its simulated rig')
    return given
