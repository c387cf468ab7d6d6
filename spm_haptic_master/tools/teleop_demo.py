# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Run master, teleop and a simulated slave with a simulated surgeon, and print what it showed."""

from __future__ import annotations

import signal
import sys

from spm_haptic_master.arguments import Parser
from spm_haptic_master.benchmark.teleop_demo import run, table
from spm_haptic_master.exceptions import SpmError

DESCRIPTION = """\
A simulated surgeon engages, clutches, loses a sensor and comes back, in about a minute; no ROS and
no hardware is needed. Parameters go to master and teleop: -p teleop.speed_limit:=1.0"""


def main(args: list[str] | None = None) -> int:
    """Run the demonstration; return the exit code."""
    # Also where a shell makes its background jobs ignore Ctrl-C.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        given = Parser('teleop_demo', DESCRIPTION).parse((sys.argv if args is None else args)[1:])
        options = [word for name, values in (('--params-file', given.params_file),
                                             ('-p', given.param), ('-r', given.remap))
                   for value in values for word in (name, value)]
        found = run(options, lambda line: print(line, flush=True))
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'teleop_demo: {error}', file=sys.stderr)
        return 1
    print(f'\n{table(found)}')
    return 0
