# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pipelines of the benchmark, compared: table and ratios."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import csv
from datetime import date
from importlib import metadata
import os
from pathlib import Path
import platform
from statistics import median

from benchmarks.pipeline.run import Case, measure, Run
import numpy as np

BARE = Case('bare relay', ('bare_relay', 'bare_driver'))
NODES = Case('driver and fkm', ('fkm', 'encoder_driver'))
ALL_OUTPUTS = Case('driver and fkm, all outputs observed', NODES.processes, 'observer_of_all')
BARE_THREE = Case('bare relay and listener', ('bare_relay', 'bare_listener', 'bare_driver'))
THREE = Case('three processes', ('fkm', 'diagnostics', 'encoder_driver'))
BARE_MASTER = Case('bare, composed', ('bare_master',))
MASTER = Case('master (composed)', ('master',))
# Pipelines in the order of a round: those that are compared run one after the other, because the
# machine drifts.
CASES = (BARE, NODES, ALL_OUTPUTS, BARE_THREE, THREE, MASTER, BARE_MASTER)

# Percentiles of a latency in the tables, by column.
QUANTILES = {'p50': 50.0, 'p90': 90.0, 'p99': 99.0, 'p99.9': 99.9, 'max': 100.0}
# Largest 99th percentile of the control thread's lateness (us: one period of 1 kHz), and CPU time
# of other programs (% of a core), of an undisturbed machine.
DISTURBED_LATENESS, DISTURBED_LOAD = 1000.0, 20.0


def published(run: Run) -> float:
    """Return the median time from sample stamp to publication by `fkm`, us; NaN if unknown."""
    return float(
        np.median(
            [
                float(values['latency p50 (us)'])
                for _, name, values in run.statuses
                if name == 'fkm: timing' and 'latency p50 (us)' in values
            ]
            or [np.nan]
        )
    )


# Figures of a run: latencies, us, and CPU time of `fkm` or of the bare relay in its place.
FIGURES: dict[str, Callable[[Run], float]] = {
    'p50': lambda run: float(np.percentile(run.latencies, 50.0)),
    'p99': lambda run: float(np.percentile(run.latencies, 99.0)),
    'CPU of fkm': lambda run: run.load.get('fkm') or run.load['bare_relay'],
    'p50 of the publication': published,
}
# Largest ratios to the bare relay: beyond, the computation is felt beside the hop of a message.
REACH = {'p50': 1.15, 'CPU of fkm': 1.45}
# The figures of a pipeline that are compared with those of another one.
COMPARISONS = (
    (NODES, BARE, ('p50', 'p99', 'CPU of fkm')),
    (ALL_OUTPUTS, BARE, ('p50',)),
    (THREE, BARE_THREE, ('p50', 'p99', 'CPU of fkm')),
    (MASTER, BARE_MASTER, ('p50', 'p99')),
    (MASTER, THREE, ('p50', 'p50 of the publication')),
)


def compare(
    seconds: float, rounds: int, rate: float, parameters: Mapping[str, str], output: Path
) -> None:
    """
    Measure every pipeline in each round, s at a rate in Hz; print table and ratios.

    runs.csv, one line for each run, goes into the output directory.
    """
    output.mkdir(parents=True, exist_ok=True)
    runs, rows = [], []
    for number in range(1, rounds + 1):
        for case in CASES:
            run = measure(case, seconds, rate, parameters)
            runs.append(run)
            rows.append(row(number, run))
            disturbed = rows[-1]['disturbed']
            print(
                f'round {number} of {rounds}, {case.name}: {summary(run.latencies)} us, '
                f'lost {run.lost}' + (f' (disturbed: {disturbed})' if disturbed else ''),
                flush=True,
            )
    print(
        f'\nLatency: sample stamp to observer. Medians of {rounds} interleaved runs of '
        f'{seconds:g} s at {rate:g} Hz; lost and missed of all runs.\n'
    )
    print(table(runs))
    print('\nratio, median of the rounds (least .. largest)')
    for above, below, names in COMPARISONS:
        for name in names:
            text = f'{name}, {above.name} over {below.name}'
            reach = REACH.get(name) if (above, below) == (NODES, BARE) else None
            print(f'  {text:<75} {ratio(runs, above, below, FIGURES[name], reach)}')
    control = np.concatenate([run.control for run in runs])
    print(
        f'control thread, lateness: {summary(control)} us; '
        f'{sum(bool(each["disturbed"]) for each in rows)} of {len(rows)} runs disturbed'
    )
    path = output / 'runs.csv'
    with open(path, 'w', newline='') as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    print(f'written: {path}')


def machine() -> str:
    """Return date, kind of machine and versions in one line."""
    cpu = Path('/proc/cpuinfo').read_text()
    model = next(
        (line.partition(': ')[2] for line in cpu.splitlines() if line.startswith('model name')),
        platform.machine(),
    )
    virtual = ', virtual machine' if ' hypervisor ' in cpu else ''
    middleware = os.environ.get('RMW_IMPLEMENTATION', 'rmw_fastrtps_cpp')
    return (
        f'{date.today()}, {os.cpu_count()} x {" ".join(model.split())}{virtual}, '
        f'Linux {platform.release()}, Python {platform.python_version()}, '
        f'rclpy {_version("rclpy")}, {middleware} {_version(middleware)}'
    )


def _version(package: str) -> str:
    # A wheel has another name, and the version that counts.
    for name in ('ros-' + package.replace('_', '-'), package):
        with suppress(metadata.PackageNotFoundError):
            return metadata.version(name)
    return '(version unknown)'


def quantiles(latencies: np.ndarray) -> dict[str, float]:
    """Return the percentiles of latencies, by name, us."""
    return dict(zip(QUANTILES, np.percentile(latencies, list(QUANTILES.values())), strict=True))


def summary(times: np.ndarray) -> str:
    """Return the percentiles of times, us, in words."""
    return ' '.join(f'{name} {value:.0f}' for name, value in quantiles(times).items())


def disturbance(run: Run) -> str:
    """Return how the machine itself was disturbed, in words; '' if it was not."""
    found = []
    late = np.percentile(run.control, 99.0)
    if late > DISTURBED_LATENESS:
        found.append(f'control thread p99 {late:.0f} us late')
    if run.others > DISTURBED_LOAD:
        found.append(f'other programs {run.others:.0f} % of a core')
    return ', '.join(found)


def row(number: int, run: Run) -> dict[str, object]:
    """Return the figures of a run by column."""
    control = quantiles(run.control)
    return {
        'round': number,
        'pipeline': run.case.name,
        'rate asked (Hz)': run.rate,
        'rate (Hz)': round(run.achieved, 1),
        **{
            f'latency {name} (us)': round(value)
            for name, value in quantiles(run.latencies).items()
        },
        'made': run.made,
        'lost': run.lost,
        'deadlines missed': run.missed,
        'CPU (%)': ' '.join(f'{name} {load:.1f}' for name, load in run.load.items()),
        **{f'control {name} (us)': round(control[name]) for name in ('p50', 'p99', 'max')},
        'others CPU (%)': round(run.others),
        'disturbed': disturbance(run),
    }


def table(runs: Sequence[Run]) -> str:
    """Return the medians of each pipeline's runs as a Markdown table."""
    lines = [
        '| pipeline | Hz | p50 us | p90 | p99 | p99.9 | max | lost of made '
        '| deadlines missed | CPU, % of a core |',
        '|---|---|---|---|---|---|---|---|---|---|',
    ]
    for case in dict.fromkeys(run.case for run in runs):
        of_case = [run for run in runs if run.case is case]
        latencies = [quantiles(run.latencies) for run in of_case]
        lines.append(
            '| '
            + ' | '.join(
                [
                    case.name,
                    f'{median(run.achieved for run in of_case):.1f}',
                    *(f'{median(each[name] for each in latencies):.0f}' for name in QUANTILES),
                    f'{sum(run.lost for run in of_case)} of {sum(run.made for run in of_case)}',
                    f'{sum(run.missed for run in of_case)}',
                    ', '.join(
                        f'{name} {median(run.load[name] for run in of_case):.1f}'
                        for name in of_case[0].load
                    ),
                ]
            )
            + ' |'
        )
    return '\n'.join(lines)


def ratio(
    runs: Sequence[Run],
    above: Case,
    below: Case,
    figure: Callable[[Run], float],
    reach: float | None = None,
) -> str:
    """
    Return the ratio of a figure of two pipelines, in words.

    Parameters
    ----------
    runs : sequence of Run
        Runs of both, in the order of the rounds.
    above, below : Case
        The pipelines.
    figure : callable
        Returns the figure of a run.
    reach : float, optional
        Largest ratio that is good enough.

    Returns
    -------
    str
        Median and range over the rounds, and whether the median is within reach.

    """
    figures = ([figure(run) for run in runs if run.case is case] for case in (above, below))
    ratios = [a / b for a, b in zip(*figures, strict=True)]
    middle = median(ratios)
    text = f'{middle:.2f} ({min(ratios):.2f} .. {max(ratios):.2f})'
    if reach is None:
        return text
    return f'{text}, reach {reach:g}: {"met" if middle <= reach else "not met"}'
