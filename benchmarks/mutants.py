# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Random mutants of the package, and how many of them the quick tests kill.

A mutant is one change of one file: a comparison turned, an operator swapped, a constant changed, a
condition negated, a statement dropped. The tests beside the mutant's room run first, then all quick
tests; a mutant that none of them fails on has survived and is printed. Run it with the package's
test requirements installed: python benchmarks/mutants.py [ROOM ...] [--count N] [--seed S]
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
import copy
from dataclasses import dataclass
import os
from pathlib import Path
import queue
import random
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = 'spm_haptic_master'
ROOMS = ('kinematics', 'supervision', 'encoders')
QUICK = 'not process and not packaging and not slow'
# Mutants that change nothing a test could see, each with its reason: FILE: MUTANT # reason.
EQUIVALENT = ROOT / 'benchmarks' / 'equivalent_mutants.txt'
# s; a mutant whose tests take longer runs in a loop, and counts as killed.
TIMEOUT = 300.0

COMPARISONS = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq, ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In}
TURNED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt}
OPERATORS = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Mod: ast.Mult,
    ast.Pow: ast.Mult, ast.LShift: ast.RShift, ast.RShift: ast.LShift, ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd, ast.FloorDiv: ast.Mult}


@dataclass(frozen=True)
class Mutant:
    """One change: the file, its line, what was changed in words, and the changed source."""

    path: Path
    line: int
    change: str
    source: str

    @property
    def name(self) -> str:
        """As it is written in the list of equivalent ones, which knows no line numbers."""
        return f'{self.path}: {self.change}'


def _replaced(tree: ast.Module, index: int, new) -> str:
    """Return the source in which `new` has changed the node number `index` of a walk."""
    changed = copy.deepcopy(tree)
    new(list(ast.walk(changed))[index])
    return ast.unparse(ast.fix_missing_locations(changed))


def _annotations(tree: ast.Module) -> set[int]:
    """Return the numbers of nodes that no test can see: annotations and docstrings."""
    hidden: set[int] = set()
    number = {id(node): index for index, node in enumerate(ast.walk(tree))}
    for node in ast.walk(tree):
        parts = [getattr(node, 'annotation', None), getattr(node, 'returns', None)]
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            parts.append(node)
        # The words of an error are looked at by people.
        if isinstance(node, ast.JoinedStr):
            parts.append(node)
        for part in filter(None, parts):
            hidden |= {number[id(inner)] for inner in ast.walk(part)}
    return hidden


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    tree = ast.parse((ROOT / path).read_text())
    hidden = _annotations(tree)

    def mutant(node, index, words, new):
        where = ast.unparse(node).split('\n')[0][:70]
        return Mutant(path, node.lineno, f'{where} -> {words}', _replaced(tree, index, new))

    for index, node in enumerate(ast.walk(tree)):
        if index in hidden:
            continue
        if isinstance(node, ast.Compare):
            for table in (COMPARISONS, TURNED):
                other = table.get(type(node.ops[0]))
                if other is not None:
                    def turn(n, other=other):
                        n.ops[0] = other()
                    yield mutant(node, index, other.__name__, turn)
        elif isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
            other = OPERATORS[type(node.op)]

            def swap(n, other=other):
                n.op = other()
            yield mutant(node, index, other.__name__, swap)
        elif isinstance(node, ast.BoolOp):
            other = ast.And if isinstance(node.op, ast.Or) else ast.Or

            def swap_bool(n, other=other):
                n.op = other()
            yield mutant(node, index, other.__name__, swap_bool)
        elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
            value = node.value
            new = not value if isinstance(value, bool) else value + 1 if isinstance(value, int) \
                else value * 2.0 + (value == 0.0)

            def change(n, new=new):
                n.value = new
            yield mutant(node, index, repr(new), change)
        elif isinstance(node, (ast.If, ast.While, ast.IfExp)):
            def negate(n):
                n.test = ast.UnaryOp(ast.Not(), n.test)
            yield mutant(node.test, index, 'negated', negate)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
            def plain(n):
                n.op = ast.UAdd() if isinstance(n.op, ast.USub) else ast.Not()
                if isinstance(n.op, ast.Not):
                    n.operand = ast.UnaryOp(ast.Not(), n.operand)
            yield mutant(node, index, 'without its sign', plain)
        for field in ('body', 'orelse', 'finalbody'):
            statements = getattr(node, field, None)
            if not isinstance(statements, list):
                continue
            for place, statement in enumerate(statements):
                dropped = (isinstance(statement, (ast.AugAssign, ast.Raise))
                           or isinstance(statement, ast.Expr)
                           and not isinstance(statement.value, ast.Constant)
                           or isinstance(statement, ast.Assign)
                           and isinstance(statement.targets[0], ast.Attribute))
                if dropped:
                    def drop(n, field=field, place=place):
                        getattr(n, field)[place] = ast.Pass()
                    yield mutant(statement, index, 'dropped', drop)


def chosen(room: str, count: int, seed: int) -> list[Mutant]:
    """Return a random choice of a room's mutants; the same seed gives the same."""
    every = [mutant for path in sorted((ROOT / PACKAGE / room).glob('*.py'))
             for mutant in mutants_of(path.relative_to(ROOT))]
    return random.Random(seed).sample(every, min(count, len(every)))


def _equivalent() -> set[str]:
    if not EQUIVALENT.exists():
        return set()
    lines = EQUIVALENT.read_text().splitlines()
    return {line.partition('  # ')[0].strip() for line in lines
            if line.strip() and not line.startswith('#')}


def _copy(directory: Path) -> None:
    """Copy what the quick tests need."""
    for name in (PACKAGE, 'test', 'config', 'paper', 'benchmarks', 'launch', 'docs', 'resource'):
        if (ROOT / name).exists():
            shutil.copytree(ROOT / name, directory / name,
                            ignore=shutil.ignore_patterns('__pycache__'))
    for name in ('setup.cfg', 'setup.py', 'package.xml', 'README.md', 'pyproject.toml'):
        shutil.copy(ROOT / name, directory / name)


def _passes(directory: Path, tests: list[str]) -> bool:
    environment = {**os.environ, 'PYTHONPATH': str(directory), 'PYTHONDONTWRITEBYTECODE': '1'}
    command = [sys.executable, '-m', 'pytest', '-x', '-q', '-p', 'no:cacheprovider', '-m', QUICK,
               *tests]
    try:
        return subprocess.run(command, cwd=directory, env=environment, timeout=TIMEOUT,
                              stdin=subprocess.DEVNULL, capture_output=True).returncode == 0
    except subprocess.TimeoutExpired:
        return False


def killed(mutant: Mutant, room: str, directory: Path) -> bool:
    """Whether the quick tests fail on the mutant, in a copy of the project."""
    target = directory / mutant.path
    original = target.read_text()
    target.write_text(mutant.source)
    try:
        return not _passes(directory, [f'test/{room}']) or not _passes(directory, ['test'])
    finally:
        target.write_text(original)


def main() -> int:
    """Try the mutants of each room; 1 where a room is below --least."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('rooms', nargs='*', default=ROOMS, metavar='ROOM')
    parser.add_argument('--count', type=int, default=60, help='mutants a room')
    parser.add_argument('--seed', type=int, default=2015)
    parser.add_argument('--jobs', type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument('--least', type=float, default=90.0, help='share killed, per cent')
    options = parser.parse_args()
    code = 0
    known = _equivalent()
    with tempfile.TemporaryDirectory(prefix='mutants_') as temporary:
        copies: queue.Queue[Path] = queue.Queue()
        for job in range(options.jobs):
            directory = Path(temporary, str(job))
            _copy(directory)
            copies.put(directory)
        if not _passes(directory, ['test']):
            print('the quick tests fail without any mutant', file=sys.stderr)
            return 1

        def attempt(mutant: Mutant, room: str) -> bool:
            directory = copies.get()
            try:
                return killed(mutant, room, directory)
            finally:
                copies.put(directory)

        with ThreadPoolExecutor(options.jobs) as pool:
            for room in options.rooms:
                begin = time.monotonic()
                mutants = [mutant for mutant in chosen(room, options.count, options.seed)
                           if mutant.name not in known]
                dead = 0
                outcomes = pool.map(lambda mutant, room=room: attempt(mutant, room), mutants)
                for number, (mutant, gone) in enumerate(zip(mutants, outcomes, strict=True), 1):
                    dead += gone
                    if not gone:
                        print(f'survived: {mutant.path}:{mutant.line}: {mutant.change}',
                              flush=True)
                    print(f'{room}: {number} of {len(mutants)}, {dead} killed', end='\r',
                          file=sys.stderr)
                share = 100.0 * dead / max(len(mutants), 1)
                code |= share < options.least
                print(f'{room}: {dead} of {len(mutants)} killed, {share:.0f} % '
                      f'({time.monotonic() - begin:.0f} s)', flush=True)
    return code


if __name__ == '__main__':
    sys.exit(main())
