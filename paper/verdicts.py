# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The verdicts of a page, the guard that none changes unseen, and the page's command line."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
import re
import shutil
import sys
import tempfile

from spm_haptic_master.exceptions import InputError, SpmError

# Name of a page in its directory.
PAGE = 'README.md'
# Head of the column of verdicts: the last one of its table; the first one has the rows' names.
COLUMN = 'verdict'
# Option with which a page is written although a verdict changes.
ACCEPT = '--accept'
ACCEPT_HELP = 'write the committed page although its verdicts change'
# Markdown link; its text is the name of the row.
LINK = re.compile(r'\[([^\]]*)\]\([^)]*\)')


def read(page: str) -> dict[str, str]:
    """Return the verdict of each row of a page, Markdown, by the row's section and name."""
    found = {}
    section, inside, guarded = '', False, False
    for line in page.splitlines():
        if line.startswith('## '):
            section = line.removeprefix('## ')
        if not line.startswith('|'):
            inside = False
            continue
        first, *_, last = (LINK.sub(r'\1', cell).strip() for cell in line.strip('|').split('|'))
        if not inside:
            inside, guarded = True, last == COLUMN
        elif guarded and last.strip('-:'):
            found[f'{section}: {first}'] = last
    return found


def changes(committed: Path, page: str) -> list[str]:
    """Return a line for each row of a page, Markdown, whose verdict is not the committed one."""
    before = read(committed.read_text(encoding='utf-8')) if committed.is_file() else {}
    now = read(page)
    return [
        f'{row}: committed {_quoted(before.get(row))}, found {_quoted(now.get(row))}'
        for row in dict.fromkeys((*before, *now))
        if before.get(row) != now.get(row)
    ]


def guard(
    name: str, committed: Path, output: Path, page: str, accept: bool, write: Callable[[], None]
) -> int:
    """
    Compare the verdicts of a new page with the committed ones; return the exit code.

    `write` writes the new page to `output`, but not over the committed one where a verdict changed
    and that is not accepted: then the code is 1, and a line on stderr names each change.
    """
    changed = changes(committed, page)
    for line in changed:
        print(f'{name}: {line}', file=sys.stderr)
    if not changed or accept or output.resolve() != committed.resolve():
        write()
        print(output)
    if changed and not accept:
        print(
            f'{name}: {len(changed)} verdicts are not those of {committed}; expected those '
            f'ones, or {ACCEPT} to write the page with the new ones',
            file=sys.stderr,
        )
        return 1
    return 0


def _quoted(verdict: str | None) -> str:
    return 'no such row' if verdict is None else repr(verdict)


def run_page(
    name: str,
    description: str,
    default: Path,
    make: Callable[[Path], None],
    args: list[str] | None,
) -> int:
    """
    Make a page and its pictures; return the exit code: 1 if it fails or a verdict changed.

    `default` is the directory of the page in the repository. `make` writes README.md and pictures
    into an existing directory; an ImportError is reported as a library that is missing.
    """
    parser = argparse.ArgumentParser(prog=name, description=description)
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        default=default,
        metavar='DIR',
        help=f'directory for page and pictures (default: docs/{default.name})',
    )
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


def _make_in(
    output: Path, made: Path, name: str, make: Callable[[Path], None], default: Path, accept: bool
) -> int:
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
    try:
        make(made)
    except ImportError as error:
        raise InputError(
            f'needs more than the package itself ({error}): make {name}, or '
            "in a virtual environment: pip install '.[ros,paper]'"
        ) from error
    return guard(
        name,
        default / PAGE,
        output / PAGE,
        (made / PAGE).read_text(encoding='utf-8'),
        accept,
        lambda: _copy(made, output),
    )


def _copy(made: Path, output: Path) -> None:
    try:
        shutil.copytree(made, output, dirs_exist_ok=True)
    except OSError as error:
        raise InputError(f'{output}: cannot be written: {error}') from error
