# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The table of hazards in docs/safety.md: each row names tests, and these exist."""

import ast
from functools import cache
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / 'docs' / 'safety.md'
HEADING = '## Hazards'
COLUMNS = ('what goes wrong', 'what detects it', 'what happens', 'within', 'held by')
LEAST_ROWS = 15
# A test: its module, with or without folder and suffix, and its name.
TEST = re.compile(r'`([\w/]+?)(?:\.py)?::(\w+)`')


def rows_of(page: str) -> list[tuple[str, ...]]:
    """Return the rows of the table below the heading; none if there is no such table."""
    _, _, below = page.partition(f'\n{HEADING}\n')
    section = re.split(r'^## ', below, maxsplit=1, flags=re.MULTILINE)[0]
    table = [tuple(cell.strip() for cell in line.strip('|').split('|'))
             for line in section.splitlines() if line.startswith('|')]
    return table[2:] if table and table[0] == COLUMNS else []


@cache
def names_in(module: str) -> frozenset[str]:
    """Return the names of the test functions of a module below test/."""
    name = module.removeprefix('test/')
    return frozenset(
        node.name for path in (ROOT / 'test').rglob(f'{name.rpartition("/")[2]}.py')
        if str(path.relative_to(ROOT / 'test').with_suffix('')).endswith(name)
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
        if isinstance(node, ast.FunctionDef) and node.name.startswith('test'))


def faults_of(page: str) -> list[str]:
    """Return what is wrong with the table of a page."""
    rows = rows_of(page)
    if len(rows) < LEAST_ROWS:
        return [f'{len(rows)} rows below "{HEADING}"; expected a table of {", ".join(COLUMNS)} '
                f'with {LEAST_ROWS} rows or more']
    faults = []
    for row in rows:
        if len(row) != len(COLUMNS) or not all(row):
            faults.append(f'{row[0]}: {len(row)} cells; expected {len(COLUMNS)}, none empty')
            continue
        tests = TEST.findall(row[-1])
        if TEST.sub('', row[-1]).strip(' ,'):
            faults.append(f'{row[0]}: held by {row[-1]}; expected `module::test`')
        faults += [f'{row[0]}: there is no {module}::{name}' for module, name in tests
                   if name not in names_in(module)]
    return faults


def test_each_hazard_is_held_by_tests_that_exist():
    faults = faults_of(PAGE.read_text(encoding='utf-8'))
    assert not faults, '\n'.join(faults)


GOOD = 'a | b | c | d | `test_hazards::test_what_is_wrong_is_found`'


@pytest.mark.parametrize(('row', 'words'), [
    (None, '14 rows'), ('a | b | c | d | `test_hazards::test_of_nothing`',
                        'a: there is no test_hazards::test_of_nothing'),
    ('a | b | c | d | `nodes/test_hazards::test_what_is_wrong_is_found`', 'no nodes/test_hazards'),
    ('a | b | c | d | nobody', 'held by nobody'), ('a | b | | d | ', 'none empty'),
    ('a | b | c', '3 cells'), (GOOD, None)])
def test_what_is_wrong_is_found(row, words):
    rows = [' | '.join(COLUMNS), '-', *[GOOD] * (LEAST_ROWS - 1), *([row] if row else [])]
    found = faults_of(f'# Safety\n\n{HEADING}\n\n' + '\n'.join(
        f'| {line} |' for line in rows) + '\n\n## States\n\n| a | b | c | d | e |\n')
    assert [words in fault for fault in found] == ([True] if words else [])
