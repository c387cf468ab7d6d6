# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rows of a status on a terminal: names, values and bars, within any width, in colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from textwrap import wrap
import unicodedata

# Unicode categories of characters that take no column of their own.
COMBINING = ('Mn', 'Me')
# Columns before the names, and of the names.
INDENT, NAMES = 2, 18
# Least width of a terminal with a column of names; in a narrower one a name is part of its line.
WIDE = 66
# Most and fewest columns of a bar; below, there is none.
LONGEST_BAR, SHORTEST_BAR = 24, 4
# Words at the two ends of a bar: at the singularity, and far from it.
AT, FAR = 'at [', '] far '


class Colour(Enum):
    """Colour of a value, as the terminal's control sequence (ECMA-48)."""

    NONE = ''
    GREEN = '\x1b[32m'
    AMBER = '\x1b[33m'
    RED = '\x1b[31m'


# End of a colour.
PLAIN = '\x1b[0m'


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the status."""

    name: str  # of the value; empty: the row goes on with that above
    text: str  # value in words and digits, with its unit
    colour: Colour = Colour.NONE
    share: float | None = None  # filled share of a bar before the text, 0 .. 1; None: no bar

    def line(self, width: int, coloured: bool) -> str:
        """Return the row on a terminal of a width, with its control sequences if coloured."""
        name = self.name.ljust(NAMES) if width >= WIDE else f'{self.name} '.lstrip()
        head = ' ' * INDENT + name
        text = self.text
        if self.share is not None:
            text = bar(self.share, width - len(head) - len(text) - 1) + text
        line = fitted(head + text, width)
        value = line[len(head):]
        if not coloured or self.colour is Colour.NONE or not value:
            return line
        return line[:len(head)] + self.colour.value + value + PLAIN

    def wrapped(self, width: int, most: int) -> list[Row]:
        """Return the row with its rest in rows below it, of which there are `most` at most."""
        room = width - INDENT - NAMES
        if width < WIDE or len(self.text) <= room:
            return [self]
        parts = wrap(self.text, room, break_on_hyphens=False) or ['']
        if len(parts) > most:
            # The last one is cut at the end of its line.
            parts[most - 1:] = [' '.join(parts[most - 1:])]
        return [Row(self.name, parts[0], self.colour, self.share),
                *(Row('', part, self.colour) for part in parts[1:])]


def status_lines(rows: Sequence[str | Row], width: int, height: int,
                 coloured: bool) -> list[str]:
    """Return a status on a terminal: each value in full where all rows fit into its height."""
    spare = height - len(rows)
    shown: list[str] = []
    for row in rows:
        if isinstance(row, str):
            shown.append(row)
            continue
        parts = row.wrapped(width, 1 + max(0, spare))
        spare -= len(parts) - 1
        shown += [part.line(width, coloured) for part in parts]
    return shown[:height]


def bar(share: float, columns: int) -> str:
    """Return a bar of at most that many columns; empty where it would be too short."""
    columns = min(columns - len(AT) - len(FAR) + 1, LONGEST_BAR)
    if columns < SHORTEST_BAR:
        return ''
    full = round(min(max(share, 0.0), 1.0) * columns)
    return f'{AT}{"#" * full}{"-" * (columns - full)}{FAR}'


def fitted(text: str, width: int) -> str:
    """Return what of a text fits into a line of a terminal, without control characters."""
    taken, left = '', width
    for character in text:
        category = unicodedata.category(character)
        if category.startswith('C'):
            character = '?'
        left -= 0 if category in COMBINING else \
            2 if unicodedata.east_asian_width(character) in 'FW' else 1
        if left < 0:
            break
        taken += character
    return taken
