# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A directed search for faults with which a wrong orientation goes out as a checked one.

For each kind of fault the search varies settings, pose, motion, pause and fault size, and keeps
what makes the error largest over the protection level, for longer than the time to alert, while
the faulty sensor counts as checked by the others. The same holds for the published bound of a
sensor that is not checked. Above 1 is a violation.

Run it with the tests' requirements installed:
python -m benchmarks.integrity_attack [--seed N] [--runs N] [--kind TEXT] [--store FILE.json]
python -m benchmarks.integrity_attack --replay FILE.json
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
import json
from pathlib import Path
import sys
from typing import Any, NamedTuple

from benchmarks.attack_device import angle_between, matrices
from benchmarks.attack_kinds import KINDS
from benchmarks.attack_scene import Case, Choices, Impossible
from benchmarks.integrity_records import Runner, Store
import numpy as np
from paper.verdicts import COLUMN
from spm_haptic_master.kinematics.joints import JOINT_NAMES
from spm_haptic_master.supervision import supervise, Supervised

Array = Any

# What is promised: the level while the faulty sensor is checked, else its published bound.
LEVEL = 'checked'
BOUND = 'unchecked'
PROMISES = LEVEL, BOUND
# Runs of a search (25 miss what 100 find), the share of it that is drawn at random,
# and how many of the best are varied.
RUNS = 100
RANDOM_SHARE = 0.5
BEST = 6
# First and last width of a variation (of 1).
WIDTHS = 0.12, 0.02
# Part of a moment's excess in what the search climbs, where nothing lasts for the time to alert.
MOMENT = 0.02
# Draws after which a kind without a possible case is given up.
MOST_DRAWS = 40


class Score(NamedTuple):
    """
    How wrong a case is, each over what was promised; above 1 is a violation.

    Attributes
    ----------
    level : float
        Error over protection level, the faulty sensor checked, held for longer than the time to
        alert.
    bound : float
        Error over the published bound of the faulty sensor, which is unchecked, held as long.
    moment : float
        The largest of both at any sample.
    error_deg : float
        Largest error while `level` or `bound` is above 1, deg.

    """

    level: float
    bound: float
    moment: float
    error_deg: float

    def of(self, promise: str) -> float:
        """Return the error over what was promised."""
        return self.bound if promise == BOUND else self.level

    def height(self, promise: str) -> float:
        """Return what the search climbs."""
        return self.of(promise) + MOMENT * min(self.moment, 10.0)


class Attack(NamedTuple):
    """A case that was tried: its kind, what it contradicts, its numbers, its score, its words."""

    kind: str
    promise: str
    numbers: dict[str, float]
    score: Score
    words: str


def held(ratios: Array, samples: int) -> float:
    """Return the largest ratio that is reached in more samples in a row than given."""
    if len(ratios) <= samples:
        return 0.0
    rows = np.lib.stride_tricks.sliding_window_view(ratios, samples + 1)
    return float(rows.min(axis=1).max())


def degraded_samples(states: list[tuple[int, str]], n: int) -> Array:
    """Return at which samples the orientation is without a sensor."""
    flags = np.zeros(n, bool)
    for index, text in states:
        flags[index:] = text.startswith('degraded') and ('excluded' in text or 'missing' in text)
    return flags


def checked_samples(case: Case, result: Supervised) -> Array:
    """Return at which samples one of the faulty sensors is checked."""
    return (result.unchecked[:, list(case.faulty)] == 0.0).any(axis=1)


def promised(case: Case, result: Supervised) -> tuple[Array, Array]:
    """
    Return what is promised of each sample: its level (deg), and whether its bound holds instead.

    The bound holds while no faulty sensor is checked. While a sensor is left out the level holds:
    the faulty one has to be out. If the one left out was faulty before, four or five sensors go on
    as ever; three, which nothing checks, have the promise of the readings without that first
    fault: it must cost no protection against the second.
    """
    level = result.protection_level
    if not case.faulty:
        return level, np.zeros(len(case.stamps), bool)
    unchecked = ~checked_samples(case, result)
    left_out = degraded_samples(result.state, len(case.stamps))
    if case.without_first is None:
        return level, unchecked & ~left_out
    leaves_three = case.readings.shape[1] == len(JOINT_NAMES)
    if not leaves_three:
        return level, unchecked
    alone = supervise(case.stamps, case.without_first, **case.settings)
    as_alone = left_out & alone.published
    level = np.where(as_alone, np.fmax(level, alone.protection_level), level)
    is_unchecked_alone = as_alone & ~checked_samples(case, alone)
    return level, unchecked & (~left_out | is_unchecked_alone)


def score(case: Case) -> Score:
    """Return how wrong a case is."""
    result = supervise(case.stamps, case.readings, **case.settings)
    n = len(case.stamps)
    error = np.degrees(angle_between(matrices(result.quaternion), case.rotations))
    error = np.where(result.published, error, 0.0)
    level, is_declared = promised(case, result)
    counts = result.published & (np.arange(n) >= case.first)
    before = slice(max(0, case.first - 2 * case.window), max(0, case.first - case.window))
    if case.latched and result.published[before].any():
        counts[:] = False
    with np.errstate(invalid='ignore', divide='ignore'):
        over_level = np.where(counts & ~is_declared, error / level, 0.0)
        smallest = result.bounds[:, list(case.faulty)].max(axis=1, initial=0.0)
        over_bound = np.where(counts & is_declared, error / smallest, 0.0)
    over_level = np.nan_to_num(over_level, posinf=0.0)
    over_bound = np.nan_to_num(over_bound, posinf=0.0)
    wrong = np.maximum(over_level, over_bound) > 1.0
    return Score(
        held(over_level, case.window),
        held(over_bound, case.window),
        float(max(over_level.max(initial=0.0), over_bound.max(initial=0.0))),
        float(error[wrong].max(initial=0.0)),
    )


def tried(kind: str, promise: str, choices: Choices) -> Attack | None:
    """Return what a case comes to; None where the choices describe none."""
    try:
        case = KINDS[kind](choices)
    except Impossible:
        return None
    return Attack(kind, promise, dict(choices.numbers), score(case), described(case))


def described(case: Case) -> str:
    """Return a case in words: its settings and its fault."""
    settings = ', '.join(
        f'{name} {value[0] if isinstance(value, list) else value:.3g}'
        if not isinstance(value, str)
        else f'{name} {value}'
        for name, value in case.settings.items()
        if name != 'sensors' or value != 4
    )
    return f'{case.words}; {case.rate:g} Hz{", " if settings else ""}{settings}'


class Task(NamedTuple):
    """One search: a kind of fault, what it shall contradict, its seed, its number of runs."""

    kind: str
    promise: str
    seed: int
    runs: int


def search(task: Task) -> Attack | None:
    """Return the worst case that a search finds; None if the kind has no case."""
    rng = np.random.default_rng(
        [task.seed, list(KINDS).index(task.kind), PROMISES.index(task.promise)]
    )
    population: list[Attack] = []
    done = draws = 0
    while done < task.runs and draws < MOST_DRAWS * task.runs:
        draws += 1
        choices = Choices(rng)
        if done >= RANDOM_SHARE * task.runs:
            progress = done / task.runs
            width = WIDTHS[0] * (WIDTHS[1] / WIDTHS[0]) ** progress
            parent = population[int(rng.integers(min(BEST, len(population))))]
            choices = Choices(rng, parent.numbers).varied(width)
        attack = tried(task.kind, task.promise, choices)
        if attack is None:
            continue
        done += 1
        population.append(attack)
        population.sort(key=lambda each: each.score.height(task.promise), reverse=True)
        del population[4 * BEST :]
    return max(population, key=lambda each: each.score.of(task.promise), default=None)


def attacks(runner: Runner, seed: int, runs: int, kinds: Iterable[str]) -> Iterator[Attack]:
    """Yield the worst attack of each kind on the level, and on the bound of what is unchecked."""
    tasks = [Task(kind, promise, seed, runs) for kind in kinds for promise in PROMISES]
    for attack in runner.results(search, tasks):
        if attack is not None:
            yield attack


def attack_rows(found: Iterable[Attack]) -> Iterator[str]:
    """Yield the table of the worst attack of each kind."""
    yield (
        '| kind of fault, promise | error over what was promised '
        f'| largest error beyond it, deg | the worst case | {COLUMN} |'
    )
    yield '|---' * 5 + '|'
    for attack in found:
        ratio = attack.score.of(attack.promise)
        verdict = 'beyond its level' if ratio > 1.0 else 'within its level'
        yield (
            f'| {attack.kind}, {attack.promise} | {ratio:.2f} | {attack.score.error_deg:.1f} '
            f'| {attack.words} | {verdict} |'
        )


def replayed(path: Path) -> Iterator[Attack]:
    """Yield what the stored attacks come to now."""
    for stored in json.loads(path.read_text(encoding='utf-8')):
        choices = Choices(np.random.default_rng(0), stored['numbers'])
        attack = tried(stored['kind'], stored['promise'], choices)
        if attack is not None:
            yield attack


def main(args: Iterable[str] | None = None) -> int:
    """Print the table; return 1 if an error exceeds its level for too long."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--seed', type=int, default=1, help='seed of the search (default 1)')
    parser.add_argument(
        '--runs', type=int, default=RUNS, help=f'runs of each search (default {RUNS})'
    )
    parser.add_argument('--kind', default='', help='only kinds whose name contains this text')
    parser.add_argument('--store', type=Path, metavar='FILE.json', help='store the worst cases')
    parser.add_argument(
        '--replay', type=Path, metavar='FILE.json', help='run stored cases instead of a search'
    )
    options = parser.parse_args(None if args is None else list(args))
    kinds = [kind for kind in KINDS if options.kind in kind]
    found: list[Attack] = []

    def kept(attacks_found: Iterable[Attack]) -> Iterator[Attack]:
        for attack in attacks_found:
            found.append(attack)
            yield attack

    with ProcessPoolExecutor() as pool, Store(None) as store:
        source = (
            replayed(options.replay)
            if options.replay
            else attacks(Runner(pool, store), options.seed, options.runs, kinds)
        )
        for line in attack_rows(kept(source)):
            print(line, flush=True)
    if options.store:
        text = json.dumps([each._asdict() for each in found], indent=1)
        options.store.write_text(text, encoding='utf-8')
    return int(any(attack.score.of(attack.promise) > 1.0 for attack in found))


if __name__ == '__main__':
    sys.exit(main())
