# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What the page says of one figure of the paper."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """Whether the paper's figure and ours agree."""

    AGREES = 'agrees'
    MISPRINT = 'agrees, but for a misprint'
    PARTLY = 'agrees in part'
    DIFFERS = 'differs'
    BEYOND = 'not in the paper'
    NOT_COMPUTED = 'nothing to compute'


@dataclass(frozen=True, slots=True)
class Entry:
    """
    One figure, or some that belong together.

    Attributes
    ----------
    figures : tuple of int
        Their numbers; empty for a table.
    title : str
        In words.
    shows : str
        What the paper shows and prints.
    here : str
        What this package gives.
    verdict : Verdict
        Whether they agree.
    why : str
        Where they do not, or not obviously: the reason.
    picture : str
        File name, or none.
    details : str
        Tables or diagrams, Markdown.

    """

    figures: tuple[int, ...]
    title: str
    shows: str
    here: str
    verdict: Verdict
    why: str = ''
    picture: str = ''
    details: str = ''

    @property
    def name(self) -> str:
        """As the paper calls it: Fig. 4, or Figs. 9, 10."""
        if not self.figures:
            return 'Section 5'
        numbers = ', '.join(map(str, self.figures))
        return f'Fig. {numbers}' if len(self.figures) == 1 else f'Figs. {numbers}'


def verdict(holds: bool, otherwise: Verdict = Verdict.DIFFERS,
            then: Verdict = Verdict.AGREES) -> Verdict:
    """Return that they agree where a computed condition holds."""
    return then if holds else otherwise


def table(header: tuple[str, ...], rows: list[tuple[object, ...]]) -> str:
    """Return a Markdown table; the first column is left-aligned, the others right."""
    lines = [header, ('---', *['---:'] * (len(header) - 1)), *rows]
    return '\n'.join('| ' + ' | '.join(map(str, line)) + ' |' for line in lines)
