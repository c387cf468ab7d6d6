# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command line of a page: where it is written, its guard, and an error in one line."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import shutil
import sys
import tempfile

from paper.verdicts import ACCEPT, ACCEPT_HELP, guard
from spm_haptic_master.exceptions import InputError, SpmError

# Name of a page in its directory.
PAGE = 'README.md'


def run_page(name: str, description: str, default: Path, make: Callable[[Path], None],
             args: list[str] | None) -> int:
    """
    Make a page and its pictures; return the exit code: 1 if it fails or a verdict changed.

    Parameters
    ----------
    name, description : str
        Name of the command, and what it does.
    default : Path
        Directory of the page in the repository.
    make : callable
        Writes README.md and pictures into an existing directory; an ImportError is reported as a
        library that is missing.
    args : list of str, optional
        Arguments; those of the process by default.

    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument('-o', '--output', type=Path, default=default, metavar='DIR',
                        help='directory for page and pictures (default: docs/'
                        f'{default.name})')
    parser.add_argument(ACCEPT, action='store_true', help=ACCEPT_HELP)
    options = parser.parse_args(args)
    try:
        with tempfile.TemporaryDirectory() as made:
            return _make_in(options.output, Path(made), name, make, default, options.accept)
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'{name}: {error}', file=sys.stderr)
        return 1


def _make_in(output: Path, made: Path, name: str, make: Callable[[Path], None], default: Path,
             accept: bool) -> int:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
    try:
        make(made)
    except ImportError as error:
        raise InputError(f'needs more than the package itself ({error}): make {name}, or '
                         "in a virtual environment: pip install '.[ros,paper]'") from error
    return guard(name, default / PAGE, output / PAGE, (made / PAGE).read_text(encoding='utf-8'),
                 accept, lambda: _copy(made, output))


def _copy(made: Path, output: Path) -> None:
    try:
        shutil.copytree(made, output, dirs_exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
