# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Random mutants of the package, and the share of them that the quick tests of their room detect.

A mutant is one change of one expression or statement: a comparison turned, an operator swapped, a
constant changed, a condition negated, a statement dropped. It is killed if a quick test of its
room fails on it; a mutant on which all pass has survived and is printed. Comments and layout
remain, and linters do not run, so that only the behaviour can kill. Run it with the package's test
requirements installed:

    python -m benchmarks.mutants [ROOM | ROOM/FILE.py ...] [--count N] [--seed S]
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
import copy
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
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
QUICK = 'not process and not packaging and not slow and not linter and not evidence'
# Mutants that no test can detect, one a line: FILE: CHANGE  # reason. A change is written as this
# script prints it, without the line's number; without `CODE | ` where the rest is unique in FILE.
EQUIVALENT = ROOT / 'benchmarks' / 'equivalent_mutants.txt'
# What a copy of the project does without.
NOT_COPIED = (
    '.git',
    '.venv',
    'build',
    'install',
    'log',
    'dist',
    '__pycache__',
    '*.egg-info',
    '.*_cache',
    '.hypothesis',
)
# Times that tests may take, relative to those without a mutant, before the mutant counts as an
# endless loop, and as killed; and the least such limit (s), for a machine that is busy.
SLOWER = 4.0
LEAST_TIMEOUT = 60.0

# What each operator is replaced by: the nearest wrong one first.
OPERATORS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
    ast.And: (ast.Or,),
    ast.Or: (ast.And,),
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.Mod: (ast.Mult,),
    ast.Pow: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,),
    ast.LShift: (ast.RShift,),
    ast.RShift: (ast.LShift,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.BitXor: (ast.BitAnd,),
}
# Keywords whose value no correct caller notices: the options of a dataclass, and zip's check.
KEYWORDS = {'frozen', 'slots', 'strict'}


@dataclass(frozen=True)
class Mutant:
    """
    One change of one file.

    Attributes
    ----------
    path : Path
        The file, relative to the project.
    line : int
        Line of the change.
    code : str
        That line.
    change : str
        What is changed in it, and what that becomes, in words.
    source : str
        The whole file, changed.

    """

    path: Path
    line: int
    code: str
    change: str
    source: str

    @property
    def full_change(self) -> str:
        """Return the change with its line of code."""
        return f'{self.code} | {self.change}'


def _unseen(tree: ast.Module) -> set[int]:
    """Return the ids of nodes that have no behaviour: annotations, docstrings, texts, options."""
    roots: list[ast.AST | None] = []
    for node in ast.walk(tree):
        roots += [getattr(node, 'annotation', None), getattr(node, 'returns', None)]
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            or isinstance(node, ast.JoinedStr)
            or isinstance(node, ast.keyword)
            and node.arg in KEYWORDS
            or isinstance(node, ast.If)
            and ast.unparse(node.test) == 'TYPE_CHECKING'
        ):
            roots.append(node)
    return {id(inner) for root in roots if root is not None for inner in ast.walk(root)}


def _with(node: ast.AST, **fields: object) -> str:
    """Return the code of an expression with other fields."""
    changed = copy.copy(node)
    for name, value in fields.items():
        setattr(changed, name, value)
    return f'({ast.unparse(changed)})'


def _changed(node: ast.AST) -> Iterator[tuple[ast.AST, str, str]]:
    """Yield the node to replace, its new code, and the change in words."""
    if isinstance(node, ast.Compare):
        for place, operator in enumerate(node.ops):
            for other in OPERATORS[type(operator)]:
                ops = [*node.ops[:place], other(), *node.ops[place + 1 :]]
                yield node, _with(node, ops=ops), other.__name__
    elif isinstance(node, (ast.BinOp, ast.BoolOp)):
        for other in OPERATORS.get(type(node.op), ()):
            yield node, _with(node, op=other()), other.__name__
    elif isinstance(node, ast.Constant) and isinstance(node.value, (bool, int, float)):
        value = node.value
        new = (
            not value
            if isinstance(value, bool)
            else value + 1
            if isinstance(value, int)
            else 2.0 * value + (value == 0.0)
        )
        yield node, repr(new), repr(new)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.Not)):
        yield node, f'({ast.unparse(node.operand)})', 'without its sign'
    # A negated comparison, `not` or constant is among the above.
    if isinstance(node, (ast.If, ast.While, ast.IfExp)) and not isinstance(
        node.test, (ast.Compare, ast.UnaryOp, ast.Constant)
    ):
        yield node.test, f'(not ({ast.unparse(node.test)}))', 'negated'
    if (
        isinstance(node, (ast.AugAssign, ast.Raise))
        or isinstance(node, ast.Expr)
        and not isinstance(node.value, ast.Constant)
        or isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Attribute)
    ):
        yield node, 'pass', 'dropped'


def mutants_of(path: Path) -> Iterator[Mutant]:
    """Yield every mutant of a file."""
    source = (ROOT / path).read_text()
    # Columns of the syntax tree count bytes.
    data = source.encode()
    lines = data.splitlines(keepends=True)
    begins = [0, *accumulate(map(len, lines))]
    tree = ast.parse(source)
    unseen = _unseen(tree)
    found = {source}
    for node in ast.walk(tree):
        if id(node) in unseen:
            continue
        for place, code, words in _changed(node):
            first = begins[place.lineno - 1] + place.col_offset
            last = begins[place.end_lineno - 1] + place.end_col_offset
            mutated = (data[:first] + code.encode() + data[last:]).decode()
            if mutated not in found:
                found.add(mutated)
                line = lines[place.lineno - 1].decode().partition('  # ')[0].strip()
                before = ast.unparse(place).split('\n')[0][:70]
                yield Mutant(path, place.lineno, line, f'{before} -> {words}', mutated)


def chosen(target: str, count: int, seed: int) -> list[Mutant]:
    """Return a random choice of the mutants of a room or file; a seed gives the same ones."""
    path = ROOT / PACKAGE / target
    files = sorted(path.rglob('*.py')) if path.is_dir() else [path]
    every = [mutant for file in files for mutant in mutants_of(file.relative_to(ROOT))]
    return random.Random(seed).sample(every, min(count, len(every)))


def equivalent() -> set[Mutant]:
    """Return the mutants listed as equivalent; report entries that are not exactly one mutant."""
    lines = EQUIVALENT.read_text().splitlines() if EQUIVALENT.exists() else []
    listed: set[Mutant] = set()
    every = cache(lambda path: tuple(mutants_of(path)) if (ROOT / path).is_file() else ())
    for line in lines:
        entry = line.partition('  # ')[0].strip()
        if not entry or entry.startswith('#'):
            continue
        file, _, change = entry.partition(': ')
        found = [
            mutant for mutant in every(Path(file)) if change in (mutant.change, mutant.full_change)
        ]
        if len(found) == 1:
            listed |= {found[0]}
        else:
            print(
                f'{EQUIVALENT.name}: ignored, since {len(found)} mutants are {entry}',
                file=sys.stderr,
            )
    return listed


class Bench:
    """
    A copy of the project in which mutants are tried, one at a time.

    Parameters
    ----------
    directory : Path
        Where the copy goes.

    """

    def __init__(self, directory: Path):
        shutil.copytree(ROOT, directory, ignore=shutil.ignore_patterns(*NOT_COPIED))
        self.directory = directory

    def failure(self, tests: Sequence[str], timeout: float | None = None) -> str | None:
        """Return what the quick tests among `tests` print if they fail or exceed `timeout` (s)."""
        command = [
            sys.executable,
            '-m',
            'pytest',
            '-x',
            '-q',
            '-p',
            'no:cacheprovider',
            '-m',
            QUICK,
            *tests,
        ]
        environment = {
            **os.environ,
            'PYTHONPATH': str(self.directory),
            'PYTHONHASHSEED': '0',
            'PYTHONDONTWRITEBYTECODE': '1',
        }
        try:
            done = subprocess.run(
                command,
                cwd=self.directory,
                env=environment,
                timeout=timeout,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
            )
        except subprocess.TimeoutExpired:
            return f'no end within {timeout:.0f} s'
        # 5: there is no quick test among them.
        return None if done.returncode in (0, 5) else done.stdout + done.stderr

    def kills(self, mutant: Mutant, tests: str, timeout: float) -> bool:
        """Whether a folder of tests fails on the mutant, or exceeds its time (s)."""
        target = self.directory / mutant.path
        original = target.read_text()
        target.write_text(mutant.source)
        try:
            return self.failure(self._ordered(tests, mutant.path.stem), timeout) is not None
        finally:
            target.write_text(original)

    def _ordered(self, tests: str, module: str) -> list[str]:
        """Return the files of a room's tests, first those that name the mutant's module."""
        files = sorted(
            (self.directory / tests).rglob('test_*.py'),
            key=lambda file: module not in file.read_text(),
        )
        return [str(file.relative_to(self.directory)) for file in files]


def time_limit(bench: Bench, tests: str) -> float:
    """
    Return the time (s) that tests may take on a mutant.

    Raises
    ------
    RuntimeError
        They fail without any mutant.

    """
    begin = time.monotonic()
    failure = bench.failure([tests])
    if failure is not None:
        raise RuntimeError(f'{tests} fails without any mutant\n{failure}')
    return max(LEAST_TIMEOUT, SLOWER * (time.monotonic() - begin))


def share_killed(target: str, mutants: list[Mutant], benches: queue.Queue[Bench]) -> float:
    """Try the mutants of a room or file; print survivors; return the share killed, per cent."""
    begin = time.monotonic()
    tests = f'test/{Path(target).parts[0]}'
    print(
        f'{target}: quick tests of {tests} without a mutant, then with {len(mutants)}',
        file=sys.stderr,
        flush=True,
    )
    limit = time_limit(benches.queue[0], tests)

    def attempt(mutant: Mutant) -> bool:
        bench = benches.get()
        try:
            return bench.kills(mutant, tests, limit)
        finally:
            benches.put(bench)

    dead = 0
    with ThreadPoolExecutor(benches.qsize()) as pool:
        outcomes = {pool.submit(attempt, mutant): mutant for mutant in mutants}
        try:
            for number, outcome in enumerate(as_completed(outcomes), 1):
                mutant = outcomes[outcome]
                dead += outcome.result()
                if not outcome.result():
                    print(
                        f'survived: {mutant.path}:{mutant.line}: {mutant.full_change}', flush=True
                    )
                print(
                    f'{target}: {number} of {len(mutants)} tried, {dead} killed, '
                    f'{time.monotonic() - begin:.0f} s',
                    file=sys.stderr,
                    flush=True,
                    end='\r' if sys.stderr.isatty() else '\n',
                )
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
    share = 100.0 * dead / max(len(mutants), 1)
    print(
        f'{target}: {dead} of {len(mutants)} killed, {share:.0f} % '
        f'({time.monotonic() - begin:.0f} s)',
        flush=True,
    )
    return share


def main() -> int:
    """Try the mutants of each room; return 1 where a share is below --least."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument(
        'targets',
        nargs='*',
        default=ROOMS,
        metavar='ROOM | ROOM/FILE.py',
        help=f'default: {" ".join(ROOMS)}',
    )
    parser.add_argument('--count', type=int, default=60, help='mutants of each (default: 60)')
    parser.add_argument('--seed', type=int, default=2015, help='of the choice (default: 2015)')
    parser.add_argument(
        '--jobs',
        type=int,
        default=len(os.sched_getaffinity(0)),
        help='mutants tried at a time (default: the cores)',
    )
    parser.add_argument(
        '--least',
        type=float,
        default=90.0,
        help='per cent killed, below which the exit code is 1 (default: 90)',
    )
    options = parser.parse_args()
    for target in options.targets:
        if not (ROOT / PACKAGE / target).exists():
            parser.error(f"'{target}' is not a room, or a file of a room, of {PACKAGE}")
    known = equivalent()
    low = False
    with tempfile.TemporaryDirectory(prefix='mutants_') as temporary:
        benches: queue.Queue[Bench] = queue.Queue()
        for job in range(options.jobs):
            benches.put(Bench(Path(temporary, str(job))))
        try:
            for target in options.targets:
                mutants = [
                    mutant
                    for mutant in chosen(target, options.count, options.seed)
                    if mutant not in known
                ]
                low |= share_killed(target, mutants, benches) < options.least
        except RuntimeError as error:
            print(f'mutants: {error}', file=sys.stderr)
            return 1
    return int(low)


if __name__ == '__main__':
    sys.exit(main())
