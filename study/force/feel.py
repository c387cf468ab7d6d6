# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A session to feel, in simulated time: python -m study.force.feel [--output DIR]."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from spm_haptic_master.exceptions import InputError, SpmError

# Directory of the picture in the repository, and its name.
DEFAULT_OUTPUT = Path(__file__).resolve().parents[2] / 'docs' / 'force'
PICTURE = 'feel.png'


def main(args: list[str] | None = None) -> int:
    """Play the session, print its figures, draw it; return 1 where a torque lasts too long."""
    parser = argparse.ArgumentParser(
        prog='feel',
        description=(
            'Plays a session with force feedback in simulated time: a wall, the singular '
            'surface, the '
            'clutch, and the loss of wrench, encoder, drive and master. Exit code 1 if a '
            'torque lasts '
            'longer than it may.'
        ),
    )
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=DEFAULT_OUTPUT,
        metavar='DIR',
        help='directory of the picture (default: docs/force)',
    )
    options = parser.parse_args(args)
    try:
        return _play(options.output)
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'feel: {error}', file=sys.stderr)
        return 1


def _play(output: Path) -> int:
    try:
        from study.force.feel_picture import draw, figures
        from study.force.session import END, play
    except ImportError as error:
        raise InputError(
            f'needs more than the package itself ({error}): make feel, or in a '
            "virtual environment: pip install '.[ros,paper]'"
        ) from error
    found = play(lambda share: _show(f'{share * END:4.1f} of {END:g} s'))
    _show('drawing')
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
    draw(found, output / PICTURE)
    _show('')
    text, in_time = figures(found)
    print(text)
    print(f'\n{output / PICTURE}: the picture')
    return 0 if in_time else 1


def _show(text: str) -> None:
    if sys.stderr.isatty():
        print(f'\r{text}\x1b[K', end='', file=sys.stderr, flush=True)


if __name__ == '__main__':
    sys.exit(main())
