# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `supervise` makes of the runs of `benchmarks.integrity`: recorded, stored, compared."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
import json
from pathlib import Path
import sys
import time
from typing import Any, NamedTuple
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.orientation_state import HEALTHY, received_state, STARTING

# Differences that are no change of a decision: of a detection (samples), of a published share
# (unit 1).
SAME_DETECTION, SAME_SHARE = 2, 1e-3

Array = Any


class Record(NamedTuple):
    """
    What `supervise` makes of a run of n samples of N sensors.

    Attributes
    ----------
    group, name : str
        Row or condition of the run, and its name therein.
    onset : int
        First faulty sample; n without a fault.
    rate : float
        Samples a second, Hz.
    faulty : int or None
        Index of the faulty sensor.
    samples : structured ndarray, shape (n,)
        `published`, `quaternion` (4,), `level` (deg), `checked` (N,), as in `supervise`, and
        `error` (deg); NaN where nothing is published.
    state : list of (int, str)
        Index and text at each change of `state`.

    """

    group: str
    name: str
    onset: int
    rate: float
    faulty: int | None
    samples: Array
    state: list[tuple[int, str]]

    @property
    def ratio(self) -> float:
        """Largest error over its level; 0 where nothing is published."""
        out = self.samples[self.samples['published']]
        return float((out['error'] / out['level']).max(initial=0.0))

    @property
    def undeclared(self) -> float:
        """Longest time beyond the level, the faulty sensor checked, over the time to alert."""
        wrong = self.samples['error'] > self.samples['level']
        if self.faulty is not None:
            wrong &= self.samples['checked'][:, self.faulty]
        return longest(wrong) / max(0.02 * self.rate, 10.0)

    @property
    def excluded(self) -> tuple[str, ...]:
        """Names of the sensors that are excluded at the end."""
        return received_state(self.state[-1][1]).left_out

    @property
    def detected(self) -> int | None:
        """First sample withheld for the fault, or without the faulty sensor; None if never."""
        for index, text in self.state:
            if index >= self.onset and text not in (STARTING.text, HEALTHY.text):
                published = np.flatnonzero(self.samples['published'][self.onset : index])
                return self.onset + int(published[-1] + 1 if len(published) else 0)
        return None

    @property
    def end(self) -> str:
        """State at the end, without the reason of a silence."""
        text = self.state[-1][1]
        state = received_state(text)
        return text if state.publishes else state.condition.value


def longest(flags: Array) -> int:
    """Return the most samples in a row that are flagged."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags, [0]])))
    return int(max(edges[1::2] - edges[::2], default=0))


# Files ---------------------------------------------------------------------------------------


class Store:
    """
    A file of records, .npz: the samples of each, and the rest of it as JSON.

    Parameters
    ----------
    path : Path or None
        The file; None: nothing is stored.

    """

    def __init__(self, path: Path | None) -> None:
        self._file = None if path is None else ZipFile(path, 'w', ZIP_DEFLATED)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def add(self, found: Record) -> None:
        """Append a record."""
        if self._file is None:
            return
        rest = np.array(json.dumps(found._replace(samples=None)))
        for part, content in (('samples', found.samples), ('rest', rest)):
            with self._file.open(f'{found.group}; {found.name}; {part}.npy', 'w') as member:
                np.lib.format.write_array(member, content)


class Runner:
    """
    Runs in a pool of processes, with the progress on stderr.

    Parameters
    ----------
    pool : Executor
        The processes.
    store : Store
        Where records are kept.

    """

    def __init__(self, pool: Executor, store: Store) -> None:
        self._pool, self._store = pool, store
        self._begin = time.monotonic()

    def show(self, text: str) -> None:
        """Show the progress."""
        print(
            f'integrity: {time.monotonic() - self._begin:.0f} s, {text}',
            file=sys.stderr,
            flush=True,
        )

    def results(self, function: Callable[[Any], Any], tasks: Sequence[Any]) -> Iterator[Any]:
        """Yield what a function returns of each task."""
        for done, found in enumerate(self._pool.map(function, tasks), start=1):
            self.show(f'{function.__name__}: {done} of {len(tasks)}')
            yield found

    def records(
        self, function: Callable[[Any], list[Record]], tasks: Sequence[Any]
    ) -> Iterator[list[Record]]:
        """Yield the records of each task, and store them."""
        for records in self.results(function, tasks):
            for each in records:
                self._store.add(each)
            yield records


def load(path: Path) -> dict[tuple[str, str], Record]:
    """Return the records of a file by group and name."""
    found = {}
    with np.load(path) as file:
        for key in file.files:
            if key.endswith('; rest'):
                rest = Record(*json.loads(str(file[key])))
                samples = file[key.removesuffix('rest') + 'samples']
                found[rest.group, rest.name] = rest._replace(samples=samples)
    return found


# Comparison ----------------------------------------------------------------------------------


def changes(was: Record, now: Record) -> dict[str, str]:
    """Return what changed from one record of a run to another, by cause."""
    found = {}
    before, after = was.detected, now.detected
    if before is None and after is not None:
        found['detected'] = f'detected after {after - now.onset} samples'
    elif before is not None and after is None:
        found['not detected'] = f'not detected, before after {before - was.onset} samples'
    elif before is not None and after is not None and abs(after - before) > SAME_DETECTION:
        found['later' if after > before else 'earlier'] = (
            f'detected after {after - now.onset} samples, before {before - was.onset}'
        )
    if was.end != now.end:
        found['other end'] = f'at the end {now.end}, before {was.end}'
    shares = [float(each.samples['published'].mean()) for each in (was, now)]
    if abs(shares[1] - shares[0]) > SAME_SHARE:
        found['published more' if shares[1] > shares[0] else 'published less'] = (
            f'published {100.0 * shares[1]:.2f} %, before {100.0 * shares[0]:.2f} %'
        )
    if max(was.undeclared, now.undeclared) > 1.0 and was.undeclared != now.undeclared:
        found['beyond'] = (
            f'beyond the level for {now.undeclared:.2f} of the time to alert, '
            f'before {was.undeclared:.2f}'
        )
    return found


# Columns of the comparison.
CAUSES = (
    'detected',
    'not detected',
    'later',
    'earlier',
    'other end',
    'published less',
    'published more',
    'beyond',
)


def compare(
    before: dict[tuple[str, str], Record], now: dict[tuple[str, str], Record]
) -> Iterator[str]:
    """Yield the lines of the comparison of stored records: each group, then each changed run."""
    if before.keys() != now.keys():
        yield f'runs of one file only: {len(before.keys() ^ now.keys())}'
        yield ''
    groups: dict[str, list[tuple[Record, Record, dict[str, str]]]] = {}
    for key in (key for key in before if key in now):
        pair = before[key], now[key]
        groups.setdefault(key[0], []).append((*pair, changes(*pair)))
    yield (
        '| runs | number | as before | '
        + ' | '.join(CAUSES)
        + ' | least share published, before and now | largest error over its level | longest '
        'time beyond it, of the time to alert | another sensor excluded at any time |'
    )
    yield '|---' * (7 + len(CAUSES)) + '|'
    for group, runs in groups.items():
        both = list(zip(*((was, new) for was, new, _ in runs), strict=True))
        yield (
            f'| {group} | {len(runs)} | {sum(not found for *_, found in runs)} | '
            + ' | '.join(str(sum(cause in found for *_, found in runs)) for cause in CAUSES)
            + ' | '
            + ', '.join(f'{100.0 * min(map(share, each)):.2f} %' for each in both)
            + ' | '
            + ', '.join(f'{max(one.ratio for one in each):.2f}' for each in both)
            + ' | '
            + ', '.join(f'{max(one.undeclared for one in each):.2f}' for each in both)
            + ' | '
            + ', '.join(str(sum(map(wrongly_excluded, each))) for each in both)
            + ' |'
        )
    yield ''
    for group, runs in groups.items():
        for _, new, found in runs:
            if found:
                yield f'- {group}; {new.name}: ' + '; '.join(found.values())


def share(found: Record) -> float:
    """Return the share of the samples from the tenth on that are published."""
    return float(found.samples['published'][10:].mean())


def wrongly_excluded(found: Record) -> bool:
    """Return whether another sensor than the faulty one is excluded at any time."""
    right = '' if found.faulty is None else ALL_JOINT_NAMES[found.faulty]
    return any(name != right for _, text in found.state for name in received_state(text).left_out)
