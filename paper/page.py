# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The page: every figure of the paper, in its order, with the result of its reproduction."""

from __future__ import annotations

from paper.figure_entry import Entry
from paper.verdicts import COLUMN

# Head of the page, Markdown.
HEAD = """\
# The paper, reproduced

H. Saafi, M. A. Laribi, S. Zeghloul, *Forward kinematic model improvement of a spherical parallel
manipulator using an extra sensor*, Mechanism and Machine Theory 91 (2015) 102-119,
doi 10.1016/j.mechmachtheory.2015.04.006. Every figure and table of it, from this package:

```
make paper
```

computes each number on this page, except those quoted from the print, and draws each picture
beside it, in {minutes} on this machine: {machine}.

*FKM*: forward kinematic model. *Classic*: all assembly modes of the three active angles (eqs. 1 to
7). *Improved*: the paper's Case 2, closed form from th1A, th1B, th1C and th3A (eqs. 15, 16).
*`estimate`*: the maximum-likelihood orientation from the same four angles, this package's own.
Angles ψ, θ, φ are ZXZ; φ is the self-rotation.
"""


def write(entries: list[Entry], errata: str, machine: str, seconds: float) -> str:
    """Return the page, Markdown, of entries in any order, made on a machine in some seconds."""
    # The section of a figure precedes the sections that add to it.
    last = max(max(entry.figures, default=0) for entry in entries)
    ordered = sorted(entries, key=lambda entry: entry.figures or (last + 1,))
    minutes = f'{seconds / 60.0:.1f} minutes'
    parts = [
        HEAD.format(minutes=minutes, machine=machine),
        '## At a glance\n',
        _glance(ordered),
        *(_section(entry) for entry in ordered),
        f'## Where the print errs\n\n{errata}\n',
    ]
    return '\n'.join(parts)


def _glance(entries: list[Entry]) -> str:
    rows = [
        f'| [{entry.name}](#{_anchor(entry)}) | {entry.title} | {entry.verdict.value} |'
        for entry in entries
    ]
    return '\n'.join([f'| figure | title | {COLUMN} |', '| --- | --- | --- |', *rows, ''])


def _heading(entry: Entry) -> str:
    return f'{entry.name}: {entry.title}'


def _anchor(entry: Entry) -> str:
    """Return the anchor that GitHub makes of the heading."""
    kept = ''.join(c for c in _heading(entry).lower() if c.isalnum() or c in ' -')
    return kept.replace(' ', '-')


def _section(entry: Entry) -> str:
    parts = [f'## {_heading(entry)}\n']
    if entry.picture:
        parts.append(f'![{_heading(entry)}]({entry.picture})\n')
    parts += [
        f'- **The paper:** {entry.shows}',
        f'- **Here:** {entry.here}',
        f'- **{entry.verdict.value.capitalize()}.** {entry.why}'.rstrip(),
        '',
    ]
    if entry.details:
        parts += [entry.details, '']
    return '\n'.join(parts)
