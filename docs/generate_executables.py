# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generate README's table of executables: python -m docs.generate_executables."""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.executables import EXECUTABLES

README = Path(__file__).resolve().parents[1] / 'README.md'
BEGIN, END = '<!-- executables, by `make docs` -->\n', '<!-- end of executables -->\n'


def table() -> str:
    """Return the table, Markdown."""
    rows = [f'| `{name}` | {what} |\n' for name, (_, what) in EXECUTABLES.items()]
    return '| NAME | what it is |\n|---|---|\n' + ''.join(rows)


def main() -> None:
    """Replace the table in README.md."""
    text = README.read_text(encoding='utf-8')
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    README.write_text(f'{before}{BEGIN}\n{table()}\n{END}{after}', encoding='utf-8')


if __name__ == '__main__':
    main()
