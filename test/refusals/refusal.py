# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One refusal, and how those of a kind are written."""

from pathlib import Path
from typing import NamedTuple

from benchmarks.pipeline.child_process import parameter_arguments
from spm_haptic_master.parameters.files import simulated_rig


class Refusal(NamedTuple):
    """One refusal."""

    program: str  # executable
    arguments: tuple  # its command line, without the name, in the working directory
    what: str  # parameter or argument, as in the table
    refused: str  # value that is refused, as in the table
    why: str  # reason, as in the table
    message: str  # line on stderr after the program's name; `...` is what depends on the machine
    files: dict = {}  # content of files by name  # noqa: RUF012


SIM = {'source': 'sim'}
CAN = {
    'source': 'can',
    'can.interface': 'udp_multicast',
    'can.channel': '239.74.0.0',
    **simulated_rig(),
}
LOG = Path(__file__).parents[1] / 'data' / 'fig9_canopen.log.gz'
REPLAY_OF_NOTHING = {'source': 'replay', **simulated_rig()}
REPLAY = {**REPLAY_OF_NOTHING, 'replay.path': LOG}


def argument(program, given, what, refused, why, message):
    """Return the refusal of a command line of words without blanks."""
    return Refusal(program, given.split(), what, refused, why, message)


def parameter(program, parameters, what, refused, why, message):
    """Return the refusal of a parameter."""
    return Refusal(
        program,
        parameter_arguments(parameters),
        what,
        refused,
        why,
        message,
    )


def driver(what, value, refused, why, message, **others):
    """Return the refusal of a parameter of a driver on a bus; in names, __ stands for a dot."""
    given = {name.replace('__', '.'): value for name, value in others.items()}
    parameters = {**CAN, **given, what: value}
    return parameter(
        'encoder_driver',
        parameters,
        what,
        refused,
        why,
        message,
    )


def of_file(program, content, refused, why, message, arguments=()):
    """Return the refusal of a parameter file."""
    return Refusal(
        program,
        ('--params-file', 'rig.yaml', *arguments),
        '--params-file',
        refused,
        why,
        message,
        files={'rig.yaml': content},
    )


def option(program, name, value, why, message):
    """Return the refusal of an option of a tool."""
    needed = ('-o', 'a.yaml') if program == 'calibrate' and name != '-o' else ()
    return Refusal(
        program,
        (*needed, name, *value.split()),
        name,
        value,
        why,
        message,
    )
