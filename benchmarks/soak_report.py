# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The report of a soak."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
import os
from pathlib import Path

from benchmarks.disturbances import FailingBus, Visitors
from benchmarks.pipeline.comparison import disturbance, quantiles
from benchmarks.pipeline.run import Run, Status
from benchmarks.stalls import HANG, STALL, stalls, unexplained
import numpy as np
from spm_haptic_master.timing import SECOND

# Time between two readings of the resident memory (s).
MEMORY_PERIOD = 5.0

# Reasons of rejected and dropped samples that are printed with their counts.
MOST_REASONS = 12

# Size of a page of /proc/PID/statm (bytes).
PAGE = os.sysconf('SC_PAGE_SIZE')

# Resident memory of processes by name, MiB, every `MEMORY_PERIOD`.
Memory = dict[str, list[float]]


def report(
    run: Run,
    memory: Memory,
    bus: FailingBus,
    visitors: Visitors,
    hangs: int,
    rows: int,
    minute: float,
) -> None:
    """
    Print memory, latency, losses and stalls of a soak with minutes of that length, s.

    `hangs` are those seen, `rows` the orientations recorded.
    """
    first = round(minute / MEMORY_PERIOD)
    for name, sizes in memory.items():
        settled, half = sizes[min(first, len(sizes) - 1)], sizes[len(sizes) // 2]
        print(
            f'  resident memory of {name}: {settled:.1f} MiB, growth after the first minute '
            f'{sizes[-1] - settled:+.2f} MiB, of it in the second half '
            f'{sizes[-1] - half:+.2f} MiB'
        )
    elapsed = (run.stamps - run.stamps[0]) / SECOND
    # Single minutes of a busy machine differ: the figures are of a tenth of the run.
    length = max(minute, 0.1 * run.span)
    wakes = round(len(run.control) * min(1.0, length / run.span))
    parts = (
        ('first', elapsed < length, run.control[:wakes]),
        ('last', elapsed >= run.span - length, run.control[-wakes:]),
    )
    for text, part, late in parts:
        latency = _summary(run.latencies[part]) + ' us' if part.any() else 'no orientation'
        print(
            f'  latency, {text} {length / minute:.3g} minutes: {latency} (control thread late '
            f'by {_summary(late)} us)'
        )
    counted = growth(run.statuses)
    reasons = {
        key: count
        for key, count in counted.items()
        if count and key.startswith(('rejected: ', 'dropped: '))
    }
    print(
        f'  samples: {counted.get("cycles", 0)} cycles, {run.made} made, {run.lost} without an '
        f'orientation at the observer, of these {counted.get("samples rejected", 0)} rejected '
        f'by fkm; {rows} orientations recorded'
    )
    for line in reason_lines(reasons):
        print(f'    {line}')
    arrivals = np.sort(run.stamps / SECOND + run.latencies * 1e-6)
    opened, closed = arrivals[0], arrivals[0] + run.span
    alive = [
        (max(since, opened), min(until, closed))
        for since, until in bus.alive
        if since < closed and until > opened
    ]
    gaps, restarts = stalls(arrivals, alive)
    print(
        f'  failures of the bus: {len(restarts)}; bus opened again '
        f'{counted.get("bus opened", 0)} times'
        + (
            f'; first orientation after its return: median {np.median(restarts):.2f} s, largest '
            f'{max(restarts):.2f} s'
            if restarts
            else ''
        )
    )
    print(
        f'  subscribers that came and went: {visitors.came}; without an orientation: '
        f'{visitors.without}; killed because they did not end: {visitors.stuck}'
    )
    lengths = [length for _, length in gaps]
    rejections = np.array(
        [
            (at, int(values['samples rejected']))
            for at, _, values in run.statuses
            if 'samples rejected' in values
        ]
    ).reshape(-1, 2)
    dead = unexplained(gaps, rejections)
    print(
        f'  times over {STALL:g} s without an orientation while the bus was alive: {len(gaps)}'
        + (f', the longest {max(lengths):.2f} s' if gaps else '')
        + f'; of these without a rejected sample: {len(dead)}'
        + (f', the longest {max(dead):.2f} s' if dead else '')
        + f'; over {HANG:g} s: {hangs}'
    )
    loads = ', '.join(f'{name} {load:.1f}' for name, load in run.load.items())
    print(f'  CPU, % of a core: {loads}; all other programs {run.others:.0f}')
    disturbed = disturbance(run)
    if disturbed:
        print(f'  the machine was disturbed: {disturbed}')


def reason_lines(reasons: Mapping[str, int]) -> Iterator[str]:
    """Yield the most frequent reasons with their counts, and how many others there are."""
    ordered = Counter(reasons).most_common()
    for reason, count in ordered[:MOST_REASONS]:
        yield f'{reason}: {count}'
    others = ordered[MOST_REASONS:]
    if others:
        yield f'{len(others)} other reasons: {sum(count for _, count in others)}'


def growth(statuses: Sequence[Status]) -> dict[str, int]:
    """Return by how much each count grew from the first status of its name to the last."""
    first: dict[str, dict[str, str]] = {}
    last: dict[str, dict[str, str]] = {}
    for _, name, values in statuses:
        first.setdefault(name, values)
        last[name] = values
    return {
        key: int(value) - int(first[name].get(key, '0'))
        for name, values in last.items()
        for key, value in values.items()
        if value.isdecimal() and first[name].get(key, '0').isdecimal()
    }


def resident_memory(pid: int) -> float:
    """Return the resident memory of a process, MiB."""
    return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * PAGE / 2**20


def _summary(times: np.ndarray) -> str:
    found = quantiles(times)
    return ' '.join(f'{name} {found[name]:.0f}' for name in ('p50', 'p99', 'max'))
