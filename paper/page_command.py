# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line of a page: where it is written, and an error in one line."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import sys

from spm_haptic_master.exceptions import InputError, SpmError


def run_page(name: str, description: str, default: Path, make: Callable[[Path], None],
             args: list[str] | None) -> int:
    """
    Make a page and its pictures; return the exit code.

    Parameters
    ----------
    name, description : str
        Name of the command, and what it does.
    default : Path
        Directory of the page in the repository.
    make : callable
        Writes the page into an existing directory; an ImportError is reported as a library that
        is missing.
    args : list of str, optional
        Arguments; those of the process by default.

    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument('-o', '--output', type=Path, default=default, metavar='DIR',
                        help='directory for page and pictures (default: docs/'
                        f'{default.name})')
    output = parser.parse_args(args).output
    try:
        _make_in(output, name, make)
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1
    return 0


def _make_in(output: Path, name: str, make: Callable[[Path], None]) -> None:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
    try:
        make(output)
    except ImportError as error:
        raise InputError(f'needs more than the package itself ({error}): make {name}, or '
                         "in a virtual environment: pip install '.[ros,paper]'") from error
