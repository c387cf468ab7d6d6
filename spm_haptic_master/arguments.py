# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Command lines: ROS arguments with or without --ros-args, for nodes and tools alike.

ROS ignores what it does not know: an argument in the wrong place, a parameter file for nodes of
another name. Here that is refused.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NoReturn

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameter_files import (
    check_reach,
    effective,
    flat_sections,
    read_sections,
    Section,
)

# Options of ROS with a value, beside parameters and remappings.
VALUES = ('--enclave', '--log-level', '--log-config-file')
# Options of ROS without a value.
FLAGS = tuple(f'--{verb}-{what}' for verb in ('enable', 'disable')
              for what in ('rosout-logs', 'stdout-logs', 'external-lib-logs'))
# Tokens that begin and end the ROS arguments.
MARKERS = ('--ros-args', '--')


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a wrong argument in one line, as programs do any other error."""

    def error(self, message: str) -> NoReturn:
        """Raise InputError."""
        raise InputError(f'{message} (--help lists the arguments)')


class Parser(OneLineParser):
    """
    A parser of ROS parameters and remappings, with --ros-args or without.

    Parameters
    ----------
    name : str
        Name of the program.
    description : str
        Description for the help text.

    """

    def __init__(self, name: str, description: str) -> None:
        super().__init__(prog=name, description=description, allow_abbrev=False,
                         formatter_class=argparse.RawDescriptionHelpFormatter)
        self.add_argument('--params-file', metavar='FILE', action='append', default=[],
                          help='ROS parameter file; may be repeated')
        self.add_argument('-p', '--param', metavar='NAME:=VALUE', action='append', default=[],
                          help='parameter, such as can.channel:=can1; overrides the files; may '
                          'be repeated')
        self.add_argument('-r', '--remap', metavar='FROM:=TO', action='append', default=[],
                          help='ROS remapping, such as __ns:=/left; may be repeated')

    def parse(self, args: Sequence[str]) -> argparse.Namespace:
        """
        Return the arguments of a command line without the program's name.

        Raises
        ------
        InputError
            An argument is wrong, or it is none of the program's.

        """
        found, unknown = self.parse_known_args([each for each in args if each not in MARKERS])
        if unknown:
            raise InputError(f"argument '{unknown[0]}'; expected -p NAME:=VALUE, --params-file "
                             'FILE or another argument that --help lists')
        return found


def positive(text: str) -> float:
    """Return the finite number above 0 that an option gives; a type for argparse."""
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number above 0")
    return value


def finite(text: str) -> float:
    """Return the finite number that an option gives; a type for argparse."""
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number") from error
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a finite number")
    return value


@dataclass(frozen=True, slots=True)
class Remap:
    """
    A remapping of a node's name or namespace.

    Attributes
    ----------
    node : str
        Name of the node that it is for; empty for all.
    what : str
        '__node' or '__ns'.
    value : str
        New name or namespace.

    """

    node: str
    what: str
    value: str


def node_command_line(name: str, description: str, nodes: Sequence[str],
                      args: Sequence[str]) -> list[str]:
    """
    Return a node's command line as rclpy takes it, checked.

    Parameters
    ----------
    name, description : str
        Of the executable.
    nodes : sequence of str
        Names of the nodes of the process.
    args : sequence of str
        Command line, the program first.

    Raises
    ------
    InputError
        An argument is none of ROS's, a file is no parameter file, or nothing of a file or
        argument reaches a node of the process or takes effect there.

    """
    parser = Parser(name, description)
    parser.add_argument('-e', *VALUES[:1], metavar='PATH', help='as of every ROS node')
    for option in VALUES[1:]:
        parser.add_argument(option, metavar='VALUE', action='append', default=[],
                            help='as of every ROS node')
    for option in FLAGS:
        parser.add_argument(option, action='store_true', help='as of every ROS node')
    found = parser.parse(args[1:])
    given = sections(found)
    full_names = [full_name(node, found.remap) for node in nodes]
    check_reach(given, full_names)
    for node in full_names:
        effective(given, node)
    command_line = [*args[:1], MARKERS[0]]
    for option in ('params_file', 'param', 'remap', 'log_level', 'log_config_file'):
        for value in getattr(found, option):
            command_line += [f'--{option.replace("_", "-")}', value]
    if found.enclave:
        command_line += ['--enclave', found.enclave]
    return command_line + [option for option in FLAGS
                           if getattr(found, option[2:].replace('-', '_'))]


def sections(found: argparse.Namespace) -> list[Section]:
    """
    Return the sections of the files, then those of the parameters on the command line.

    Raises
    ------
    InputError
        A file is no parameter file, or a parameter has no value.

    """
    given = []
    for text in found.param:
        name, separator, value = text.partition(':=')
        if not separator or not name:
            raise InputError(f"-p '{text}'; expected NAME:=VALUE")
        node, _, name = name.rpartition(':')
        given.append((node, name, value))
    return [*(section for path in found.params_file for section in read_sections(path)),
            *flat_sections(given)]


def full_name(node: str, remaps: Sequence[str]) -> str:
    """
    Return the fully qualified name of a node after remapping.

    Raises
    ------
    InputError
        A remapping has no value.

    """
    chosen = {'__node': node, '__ns': ''}
    decided = set()
    for remap in map(_remap, remaps):
        # As in rcl, the first one that fits decides.
        if remap.what in chosen and remap.what not in decided and remap.node in ('', node):
            decided.add(remap.what)
            chosen[remap.what] = remap.value
    namespace = chosen['__ns'].strip('/')
    return f'/{namespace}/{chosen["__node"]}' if namespace else f'/{chosen["__node"]}'


def _remap(text: str) -> Remap:
    left, separator, value = text.partition(':=')
    if not separator or not left or not value:
        raise InputError(f"-r '{text}'; expected FROM:=TO")
    node, _, what = left.rpartition(':')
    return Remap(node, '__node' if what == '__name' else what, value)
