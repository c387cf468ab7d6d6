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
LINE_PERIOD, TERMINAL_PERIOD = 1.0, 0.1
# Width of the bar (characters).
BAR = 30


def given(
    found: argparse.Namespace,
    nodes: Sequence[str] = (DRIVER,),
    names: Collection[str] = DRIVER_NAMES,
) -> dict[str, object]:
    """
    Return parameters of nodes on a command line parsed by `arguments.Parser`, by name.

    `names` are the parameters that the program takes. A node's own parameters count; one of two
    nodes has to be the same in both. InputError as of `Parameters`, `check` and `check_agreement`.
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


def checked(values: Values, settings: tuple[Setting, ...], *sources: str) -> dict[str, Any]:
    """
    Return a value for each of `settings`: the given one, or the one in config/SOURCE.yaml.

    SettingError for a value that a setting cannot have.
    """
    defaults = {
        name: value for source in sources for name, value in source_defaults(source).items()
    }
    return resolve(values, settings, defaults)[1]


def bus_values(values: Values) -> dict[str, Any]:
    """Return the driver's parameters on a bus, raw counts where not given; errors of `checked`."""
    return checked({**raw_counts(sensors_of(values)), **values}, SOURCE_SETTINGS['can'], 'can')


def bus_name(values: Values, of: str = 'can') -> str:
    """Return interface and channel of the bus, as `bus_of`; its port between processes."""
    return can_bus.bus_name(values[f'{of}.interface'], values[f'{of}.channel'])


@contextmanager
def bus_of(values: Values, of: str = 'can') -> Iterator[can.BusABC]:
    """
    Open the bus of the encoders (`can`) or of the `drives`, and close it in the end.

    SettingError where python-can has no such interface; InputError where the bus cannot be
    opened, or failed while it was open.
    """
    can_bus.check_interface(values[f'{of}.interface'], f'{of}.interface')
    try:
        with can_bus.open_bus(
            values[f'{of}.interface'], values[f'{of}.channel'], values[f'{of}.bitrate']
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
    """

    def __init__(self, name: str):
        self._name = name
        self._terminal = sys.stderr.isatty()
        self._next = time.monotonic() + LINE_PERIOD
        self._shown = False

    def show(self, text: str, share: float | None = None) -> None:
        """Show a text and the part done, None where it is unknown, if that is due."""
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
        """Show a stage of a computation and the part of the whole that is done."""
        self.show(text if self._terminal else f'{100.0 * share:3.0f} %, {text}', share)

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *error: object) -> None:
        if self._terminal and self._shown:
            print(file=sys.stderr)


def run(name: str, program: Callable[[list[str]], int], args: list[str] | None = None) -> int:
    """
    Run a program and return its exit code: 130 after Ctrl-C or SIGTERM, 1 after an error.

    `program` takes the command line without the name and returns the exit code; `args` begins
    with the name, and is by default that of this process. An error is one line on stderr.
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
    """Make a function of the command line without the name the `main` of a program, by `run`."""
    return lambda body: partial(run, name, body)
