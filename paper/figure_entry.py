# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""An entry of the page: one figure of the paper, and whether it was reproduced."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """Agreement of the paper's figure and the reproduction."""

    AGREES = 'agrees'
    MISPRINT = 'agrees, but for a misprint'
    PARTLY = 'agrees in part'
    DIFFERS = 'differs'
    BEYOND = 'not in the paper'
    NOT_COMPUTED = 'nothing to compute'


@dataclass(frozen=True, slots=True)
class Entry:
    """One figure, or some that belong together; texts are Markdown."""

    # Numbers of the figures; empty for a table.
    figures: tuple[int, ...]
    title: str
    # Content of the paper's figure and text, the result of this package, and their agreement.
    shows: str
    here: str
    verdict: Verdict
    # Reason of a difference, or of an agreement that is not obvious.
    why: str = ''
    # File name of the picture, tables or diagrams; empty if there is none.
    picture: str = ''
    details: str = ''

    @property
    def name(self) -> str:
        """Name in the paper: Fig. 4, or Figs. 9, 10."""
        if not self.figures:
            return 'Section 5'
        numbers = ', '.join(map(str, self.figures))
        return f'Fig. {numbers}' if len(self.figures) == 1 else f'Figs. {numbers}'


def verdict(
    holds: bool, otherwise: Verdict = Verdict.DIFFERS, then: Verdict = Verdict.AGREES
) -> Verdict:
    """Return `then` if a computed condition holds, else `otherwise`."""
    return then if holds else otherwise


def table(header: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table; the first column is left-aligned, the others right."""
    lines = [header, ('---', *['---:'] * (len(header) - 1)), *rows]
    return '\n'.join('| ' + ' | '.join(map(str, line)) + ' |' for line in lines)
