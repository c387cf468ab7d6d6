# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of hazards in docs/safety.md: each row names tests, and these exist."""

import ast
from functools import cache
import re

from harness import ROOT

HEADING = '## Hazards'
COLUMNS = ('what goes wrong', 'what detects it', 'what happens', 'within', 'held by')
LEAST_ROWS = 15
# A test: its module, with or without folder and suffix, and its name.
TEST = re.compile(r'`([\w/]+?)(?:\.py)?::(\w+)`')


@cache
def names_in(module: str) -> frozenset[str]:
    """Return the names of the test functions of a module below test/."""
    name = module.removeprefix('test/')
    return frozenset(
        node.name for path in (ROOT / 'test').rglob(f'{name.rpartition("/")[2]}.py')
        if str(path.relative_to(ROOT / 'test').with_suffix('')).endswith(name)
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.FunctionDef) and node.name.startswith('test'))


def test_each_hazard_is_held_by_tests_that_exist():
    page = (ROOT / 'docs' / 'safety.md').read_text(encoding='utf-8')
    section = page.partition(f'\n{HEADING}\n')[2].partition('\n## ')[0]
    header, _, *rows = [tuple(cell.strip() for cell in line.strip('|').split('|'))
                        for line in section.splitlines() if line.startswith('|')]
    assert header == COLUMNS and len(rows) >= LEAST_ROWS
    faults = [f'{row[0]}: {row}' for row in rows if len(row) != len(COLUMNS) or not all(row)
              or not TEST.search(row[-1]) or TEST.sub('', row[-1]).strip(' ,')]
    faults += [f'{row[0]}: there is no {module}::{name}' for row in rows
               for module, name in TEST.findall(row[-1]) if name not in names_in(module)]
    assert not faults, '\n'.join(faults)
