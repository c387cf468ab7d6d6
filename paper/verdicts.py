# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The verdicts of a page, and the guard that none of them changes unseen."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re
import sys

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
    return [f'{row}: committed {_quoted(before.get(row))}, found {_quoted(now.get(row))}'
            for row in dict.fromkeys((*before, *now)) if before.get(row) != now.get(row)]


def guard(name: str, committed: Path, output: Path, page: str, accept: bool,
          write: Callable[[], None]) -> int:
    """
    Compare the verdicts of a new page with the committed ones; write it; return the exit code.

    Parameters
    ----------
    name : str
        Name of the command, for its messages.
    committed, output : Path
        The page in the repository, and where the new one goes. The former is left as it is where
        a verdict changed.
    page : str
        The new page, Markdown.
    accept : bool
        Whether changes are accepted.
    write : callable
        Writes the new page.

    Returns
    -------
    int
        1 where a verdict changed and that is not accepted, else 0.

    """
    changed = changes(committed, page)
    for line in changed:
        print(f'{name}: {line}', file=sys.stderr)
    if not changed or accept or output.resolve() != committed.resolve():
        write()
        print(output)
    if changed and not accept:
        print(f'{name}: {len(changed)} verdicts are not those of {committed}; expected those '
              f'ones, or {ACCEPT} to write the page with the new ones', file=sys.stderr)
        return 1
    return 0


def _quoted(verdict: str | None) -> str:
    return 'no such row' if verdict is None else repr(verdict)
