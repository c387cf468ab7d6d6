# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Shared parts of the programs: parameters, the bus, progress, one line for an error."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
import shutil
import signal
import sys
import time
from typing import Any

import can
from spm_haptic_master.calibration.recording import raw_counts
from spm_haptic_master.encoders import can_bus
from spm_haptic_master.exceptions import InputError, SpmError
from spm_haptic_master.parameters.arguments import parameters_of
from spm_haptic_master.parameters.encoders import sensors_of
from spm_haptic_master.parameters.files import source_defaults
from spm_haptic_master.parameters.nodes import DRIVER_NAMES, NODE_SETTINGS, SOURCE_SETTINGS
from spm_haptic_master.parameters.resolver import check_agreement, DRIVER, NO_EFFECT, resolve
from spm_haptic_master.parameters.setting import Setting, Values
from spm_haptic_master.standard_streams import discard, keep_open, STANDARD_OUTPUT

# Signals that end a program.
SIGNALS = (signal.SIGINT, signal.SIGTERM)
# Exit code after one, as a shell reports it for SIGINT.
INTERRUPTED = 130
# Time between two lines where the output is not a terminal, and between two updates of the bar on
# a terminal (s).
LINE_PERIOD = 1.0
TERMINAL_PERIOD = 0.1
# Width of the bar (characters).
BAR = 30


def given(
    found: argparse.Namespace,
    nodes: Sequence[str] = (DRIVER,),
    names: Collection[str] = DRIVER_NAMES,
) -> dict[str, object]:
    """
    Return the given parameters of nodes, by name.

    A node's own parameters count; a parameter of two nodes has to be the same in both.

    Parameters
    ----------
    found : argparse.Namespace
        Command line parsed by `arguments.Parser`.
    nodes : sequence of str, optional
        Nodes whose parameters they are; by default the encoder driver.
    names : collection of str, optional
        Names of the parameters that the program takes.

    Returns
    -------
    dict of str to object
        Values that were given, unchecked.

    Raises
    ------
    InputError
        A file is not a parameter file, a parameter is unknown or has no effect, or has two values.

    """
    parameters = parameters_of(found)
    parameters.check(nodes, names)
    own = {
        node: {setting.name for setting in NODE_SETTINGS[node]}.intersection(names)
        for node in nodes
    }
    unused = parameters.unused({parameters.full_name(node): own[node] for node in nodes})
    if unused:
        raise InputError(f'{unused[0]}: {NO_EFFECT}')
    values = {
        node: {name: value for name, value in parameters.of(node).items() if name in own[node]}
        for node in nodes
    }
    check_agreement(values)
    return {name: value for of_node in values.values() for name, value in of_node.items()}


def checked(
    values: Values,
    settings: tuple[Setting, ...],
    *sources: str,
) -> dict[str, Any]:
    """
    Return a value for each of some settings.

    Parameters
    ----------
    values : Values
        Given values, by name; others than those of `settings` do not count.
    settings : tuple of Setting
        The settings.
    *sources : str
        Names of files config/SOURCE.yaml whose values replace the defaults.

    Returns
    -------
    dict
        The given value, that of the file, or the default, by name.

    Raises
    ------
    SettingError
        A setting cannot have the value.

    """
    defaults = {
        name: value for source in sources for name, value in source_defaults(source).items()
    }
    return resolve(values, settings, defaults)[1]


def bus_values(values: Values) -> dict[str, Any]:
    """
    Return the driver's parameters on a bus, with raw counts where no calibration is given.

    Parameters
    ----------
    values : Values
        Given parameters, by name.

    Returns
    -------
    dict
        Checked parameters, by name.

    Raises
    ------
    SettingError
        A setting cannot have the value.

    """
    return checked({**raw_counts(sensors_of(values)), **values}, SOURCE_SETTINGS['can'], 'can')


def bus_name(values: Values, of: str = 'can') -> str:
    """
    Return the name of a bus: interface and channel, and its port between processes.

    Parameters
    ----------
    values : Values
        Checked parameters, by name.
    of : str, optional
        `can` for the bus of the encoders, `drives` for that of the drives.

    Returns
    -------
    str
        For messages.

    """
    return can_bus.bus_name(values[f'{of}.interface'], values[f'{of}.channel'])


@contextmanager
def bus_of(
    values: Values,
    of: str = 'can',
) -> Iterator[can.BusABC]:
    """
    Open the bus of the encoders or of the drives, and close it in the end.

    Parameters
    ----------
    values : Values
        Checked parameters, by name.
    of : str, optional
        `can` for the bus of the encoders, `drives` for that of the drives.

    Returns
    -------
    iterator of can.BusABC
        The open bus, as a context.

    Raises
    ------
    SettingError
        The library python-can has no such interface.
    InputError
        The bus cannot be opened, or failed while it was open.

    """
    can_bus.check_interface(values[f'{of}.interface'], f'{of}.interface')
    try:
        with can_bus.open_bus(
            values[f'{of}.interface'],
            values[f'{of}.channel'],
            values[f'{of}.bitrate'],
        ) as bus:
            yield bus
    except (SpmError, BrokenPipeError):
        raise  # the latter is of the reader of the output, not of the bus
    except can_bus.BUS_ERRORS as error:
        raise InputError(f'{bus_name(values, of)}: {can_bus.first_line(error)}') from error


class ProgressBar:
    """
    Progress on stderr: a bar on a terminal, otherwise one line a second.

    Each line begins with the name of the program; work shorter than LINE_PERIOD shows nothing.
    Used as a context it ends the line of the bar.

    Parameters
    ----------
    name : str
        Name of the program.

    """

    def __init__(self, name: str):
        self._name = name
        self._terminal = sys.stderr.isatty()
        self._next = time.monotonic() + LINE_PERIOD
        self._shown = False

    def show(
        self,
        text: str,
        share: float | None = None,
    ) -> None:
        """
        Show a text, if the last one is old enough.

        Parameters
        ----------
        text : str
            The state of the work.
        share : float or None, optional
            Part of it that is done, 0 to 1; None where it is unknown.

        """
        now = time.monotonic()
        if now < self._next:
            return
        self._next = now + (TERMINAL_PERIOD if self._terminal else LINE_PERIOD)
        self._shown = True
        if not self._terminal:
            print(f'{self._name}: {text}', file=sys.stderr)
            return
        bar = (
            ''
            if share is None
            else f'[{("#" * round(BAR * min(max(share, 0.0), 1.0))).ljust(BAR, ".")}] '
        )
        width = shutil.get_terminal_size().columns - 1
        print(f'\r{f"{bar}{text}"[:width]}\x1b[K', end='', file=sys.stderr, flush=True)

    def stage(self, text: str, share: float) -> None:
        """
        Show a stage of a computation.

        Parameters
        ----------
        text : str
            Its name.
        share : float
            Part of the whole that is done, 0 to 1; in percent where there is no bar.

        """
        self.show(text if self._terminal else f'{100.0 * share:3.0f} %, {text}', share)

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal and self._shown:
            print(file=sys.stderr)


def run(
    name: str,
    program: Callable[[list[str]], int],
    args: list[str] | None = None,
) -> int:
    """
    Run a program and return its exit code.

    An error is one line on stderr. A second signal does not interrupt the end.

    Parameters
    ----------
    name : str
        Name of the program.
    program : callable
        Takes the command line without the name, and returns the exit code.
    args : list of str or None, optional
        Command line that begins with the name; by default that of this process.

    Returns
    -------
    int
        That of the program; 130 after Ctrl-C or SIGTERM, 1 after an error.

    """
    keep_open()
    for number in SIGNALS:
        signal.signal(number, signal.default_int_handler)
    try:
        try:
            code = program((sys.argv if args is None else args)[1:])
        except KeyboardInterrupt:
            code = INTERRUPTED
        except SpmError as error:
            print(f'{name}: {error}', file=sys.stderr)
            code = 1
        # A second signal must not interrupt the end.
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        sys.stdout.flush()
    except BrokenPipeError:
        discard(STANDARD_OUTPUT)
        return 1  # the reader of the output has ended
    except OSError as error:
        discard(STANDARD_OUTPUT)
        with suppress(OSError):
            print(f'{name}: {error}', file=sys.stderr)
        return 1
    return code


def program(name: str) -> Callable[[Callable[[list[str]], int]], Callable[..., int]]:
    """
    Make a function of the command line the `main` of a program, by `run`.

    Parameters
    ----------
    name : str
        Name of the program.

    Returns
    -------
    callable
        Decorator; the function gets the command line without the name.

    """
    return lambda body: partial(run, name, body)
