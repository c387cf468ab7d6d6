# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Command lines: ROS arguments with or without --ros-args, for nodes and tools alike.

What ROS would ignore is refused. Parameters never reach rcl: the resolver decides each value.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
import math
import re
from textwrap import wrap
from typing import NoReturn

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.parameters.nodes import process_settings
from spm_haptic_master.parameters.resolver import Parameters
from spm_haptic_master.parameters.setting import Setting

# Options of ROS without a value.
FLAGS = tuple(
    f'--{verb}-{what}'
    for verb in ('enable', 'disable')
    for what in ('rosout-logs', 'stdout-logs', 'external-lib-logs')
)
OF_ROS = 'as of every ROS node'  # help of an option that is passed on
# Values of --log-level, as rcl has them.
LOG_LEVEL = re.compile(
    r'([\w./]+:=)?(debug|info|warn|error|fatal|unset)', re.ASCII | re.IGNORECASE
)
MARKERS = ('--ros-args', '--')  # begin and end of the ROS arguments
HELP_WIDTH = 99  # columns


class OneLineParser(argparse.ArgumentParser):
    """A parser that reports a wrong argument by InputError, in one line as any other error."""

    def error(self, message: str) -> NoReturn:
        """
        Raise InputError.

        Parameters
        ----------
        message : str
            What argparse has found.

        Raises
        ------
        InputError
            In every case: argparse would print its usage and exit.

        """
        raise InputError(f'{message} (--help lists the arguments)')


class Parser(OneLineParser):
    """
    A parser of ROS parameters and remappings, with --ros-args or without.

    Parameters
    ----------
    name : str
        Name of the program.
    description : str
        Text of --help above the arguments; its lines are not wrapped.

    """

    def __init__(self, name: str, description: str) -> None:
        super().__init__(
            prog=name,
            description=description,
            allow_abbrev=False,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self.add_argument(
            '--params-file',
            metavar='FILE',
            action='append',
            default=[],
            help='ROS parameter file; may be repeated',
        )
        self.add_argument(
            '-p',
            '--param',
            metavar='NAME:=VALUE',
            action='append',
            default=[],
            help='parameter, such as can.channel:=can1; overrides the files; may be repeated',
        )
        self.add_argument(
            '-r',
            '--remap',
            metavar='FROM:=TO',
            action='append',
            default=[],
            help='ROS remapping, such as __ns:=/left; may be repeated',
        )

    def parse(self, args: Sequence[str]) -> argparse.Namespace:
        """
        Return the arguments of a command line.

        Parameters
        ----------
        args : sequence of str
            The command line without the program's name; `--ros-args` and `--` are left out.

        Returns
        -------
        argparse.Namespace
            `params_file`, `param` and `remap`, a list each, and what the program has added.

        Raises
        ------
        InputError
            An argument is unknown, or lacks its value.

        """
        found, unknown = self.parse_known_args([each for each in args if each not in MARKERS])
        if unknown:
            raise InputError(
                f"argument '{unknown[0]}'; expected -p NAME:=VALUE, --params-file "
                'FILE or another argument that --help lists'
            )
        return found


def positive(text: str) -> float:
    """
    Return the finite number above 0 that an option gives; a type for argparse.

    Raises
    ------
    argparse.ArgumentTypeError
        The text is not a number, not finite, or not above 0.

    """
    value = finite(text)
    if value <= 0.0:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number above 0")
    return value


def finite(text: str) -> float:
    """
    Return the finite number that an option gives; a type for argparse.

    Raises
    ------
    argparse.ArgumentTypeError
        The text is not a number, or not finite.

    """
    try:
        value = float(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number") from error
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a finite number")
    return value


def node_command_line(
    name: str,
    description: str,
    nodes: Sequence[str],
    args: Sequence[str],
) -> tuple[list[str], Parameters]:
    """
    Read the command line of an executable that runs nodes.

    Parameters
    ----------
    name, description : str
        The executable, for --help.
    nodes : sequence of str
        Names of its nodes before remapping.
    args : sequence of str
        The command line, the program first.

    Returns
    -------
    tuple of list of str and Parameters
        The command line for rclpy, without the parameters, and these.

    Raises
    ------
    InputError
        An argument is unknown, or has no effect.

    """
    settings = process_settings(name)
    parser = _node_parser(name, f'{description}\n\n{help_text(settings)}')
    found = parser.parse(args[1:])
    parameters = parameters_of(found)
    parameters.check(nodes, {setting.name for setting in settings})
    for level in found.log_level:
        if not LOG_LEVEL.fullmatch(level):
            raise InputError(
                f"--log-level '{level}'; expected debug, info, warn, error, fatal or "
                'unset, or LOGGER:= and one of them'
            )
    passed = []
    for option in ('remap', 'log_level', 'log_config_file', 'enclave'):
        for value in getattr(found, option):
            passed += [f'--{option.replace("_", "-")}', value]
    return [*args[:1], MARKERS[0], *passed, *found.flags], parameters


def _node_parser(name: str, description: str) -> Parser:
    """
    Return a parser of what every ROS node takes.

    Parameters
    ----------
    name : str
        Name of the executable.
    description : str
        Text of --help above the arguments.

    Returns
    -------
    Parser
        It has --enclave, --log-level, --log-config-file and the flags of FLAGS as well.

    """
    parser = Parser(name, description)
    parser.add_argument(
        '-e', '--enclave', metavar='PATH', action='append', default=[], help=OF_ROS
    )
    for option in ('--log-level', '--log-config-file'):
        parser.add_argument(option, metavar='VALUE', action='append', default=[], help=OF_ROS)
    for flag in FLAGS:
        parser.add_argument(
            flag, action='append_const', dest='flags', const=flag, default=[], help=OF_ROS
        )
    return parser


def parameters_of(found: argparse.Namespace) -> Parameters:
    """
    Return the `Parameters` of a command line: its files and arguments, in their order.

    Parameters
    ----------
    found : argparse.Namespace
        Arguments parsed by `Parser`.

    Raises
    ------
    InputError
        As of `Parameters`.

    """
    return Parameters(found.params_file, found.param, found.remap)


def help_text(settings: Iterable[Setting]) -> str:
    """
    Return the parameters by group, for --help: name, default, description.

    Parameters
    ----------
    settings : iterable of Setting
        Settings of the program.

    Returns
    -------
    str
        Descriptions are wrapped at HELP_WIDTH columns; the groups are sorted by the first part of
        their names.

    """
    groups: dict[str, list[str]] = {}
    for setting in settings:
        first, dot, _ = setting.name.partition('.')
        groups.setdefault(f'{first}.*' if dot else '', []).extend(_help_lines(setting))
    lines = []
    for group, of_group in sorted(groups.items()):
        title = f'parameters {group} (-p NAME:=VALUE) [default]:'
        lines += [title.replace('  ', ' '), *of_group, '']
    return '\n'.join(lines)


def _help_lines(setting: Setting) -> list[str]:
    """Return the lines of a setting in --help."""
    if setting.default in (None, ''):
        shown = ''
    else:
        shown = f' [{_shown(setting.default)}]'
    indent = ' ' * 6
    text = wrap(setting.description, HELP_WIDTH, initial_indent=indent, subsequent_indent=indent)
    return [f'  {setting.name}{shown}', *text]


def _shown(default: object) -> str:
    """Return a default as a user would write it."""
    if isinstance(default, tuple):
        return ', '.join(map(_shown, default))
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, float):
        return f'{default:g}'
    return str(default)
