# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Write the table of refusals in refused.md, from the cases of the tests."""

from __future__ import annotations

from pathlib import Path
import re
import sys

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))

from refusals import REFUSALS  # noqa: E402

PAGE = Path(__file__).with_name('refused.md')
BEGIN = '<!-- refusals, by `make docs` from test/refusals -->\n'
END = '<!-- end of refusals -->'


def table() -> str:
    """Return the table, Markdown: one row for each parameter or argument and value."""
    rows: dict[tuple[str, str, str], list[str]] = {}
    for each in REFUSALS:
        rows.setdefault((each.what, each.refused, each.why), []).append(each.program)
    lines = ['| parameter or argument | refused | why | for example by |', '|---|---|---|---|']
    for (what, refused, why), programs in rows.items():
        shown = what if ' ' in what else f'`{what}`'
        programs = ', '.join(f'`{program}`' for program in dict.fromkeys(programs))
        lines.append(f'| {shown} | {refused} | {why} | {programs} |')
    return '\n'.join(lines) + '\n'


def page() -> str:
    """Return refused.md with the present table."""
    text = PAGE.read_text(encoding='utf-8')
    pattern = re.compile(f'{re.escape(BEGIN)}.*?{re.escape(END)}', re.DOTALL)
    return pattern.sub(lambda _: f'{BEGIN}\n{table()}\n{END}', text)


def main() -> None:
    """Write the page."""
    PAGE.write_text(page(), encoding='utf-8')


if __name__ == '__main__':
    main()
