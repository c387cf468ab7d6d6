# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parts of the benchmark: pipelines compared, rates held."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from spm_haptic_master.benchmark.pipeline import Case, PipelineError
from spm_haptic_master.benchmark.report import (
    disturbance,
    draw,
    quantiles,
    ratio,
    row,
    summary,
    table,
    write_csv,
)
from spm_haptic_master.benchmark.run import measure, Run

# The driver under measurement: no other program between it and its samples.
SOURCE = {'encoder_driver:source': 'sim'}
OF_DRIVER, OF_MASTER = {'encoder_driver': SOURCE}, {'master': SOURCE}
BARE = Case('bare relay', ('bare_relay', 'bare_driver'))
NODES = Case('driver and fkm', ('fkm', 'encoder_driver'), own=OF_DRIVER)
ALL_OUTPUTS = Case('driver and fkm, all outputs observed', NODES.processes, 'observer_of_all',
                   OF_DRIVER)
BARE_THREE = Case('bare relay and listener', ('bare_relay', 'bare_listener', 'bare_driver'))
THREE = Case('three processes', ('fkm', 'diagnostics', 'encoder_driver'), own=OF_DRIVER)
BARE_MASTER = Case('bare, composed', ('bare_master',))
MASTER = Case('master (composed)', ('master',), own=OF_MASTER)
# The command of a slave, with each orientation; a pause of the machine is not to disengage it.
TELEOP = Case('master with teleop, servo_cp observed', ('master',), 'observer_of_commands', {
    'master': {**SOURCE, 'fkm:teleop.run': 'true', 'teleop:teleop.command_rate': '0.0',
               'teleop:teleop.orientation_timeout': '1.0', 'teleop:teleop.slave_timeout': '1.0',
               'teleop:teleop.presence_timeout': '2.0'}})
# Pipelines in the order of a round: those that are compared run one after the other, so that drift
# of the machine affects both.
CASES = (BARE, NODES, ALL_OUTPUTS, BARE_THREE, THREE, TELEOP, MASTER, BARE_MASTER)

# Rates that `headroom` tries (Hz).
HEADROOM_RATES = (2000.0, 3000.0, 4000.0, 5000.0)
# Largest fraction of lost samples at a rate that is held.
HELD_LOST = 0.001
# Largest fraction by which the rate at the observer is below a rate that is held.
HELD_SHORT = 0.05


def p50(run: Run) -> float:
    """Return the median latency, us."""
    return quantiles(run.latencies)['p50']


def p99(run: Run) -> float:
    """Return the 99th percentile of the latency, us."""
    return quantiles(run.latencies)['p99']


def load_of_relay(run: Run) -> float:
    """Return the CPU time of `fkm` or of the bare relay in its place, % of a core."""
    return run.load.get('fkm') or run.load['bare_relay']


def published(run: Run) -> float:
    """Return the median time from sample stamp to publication by `fkm`, us; NaN if unknown."""
    return float(np.median(run.reported('fkm: timing', 'latency p50 (us)') or [np.nan]))


# The figures of a pipeline that are compared with those of another one.
COMPARISONS = (
    (NODES, BARE, {'p50': p50, 'p99': p99, 'CPU of fkm': load_of_relay}),
    (ALL_OUTPUTS, BARE, {'p50': p50}),
    (THREE, BARE_THREE, {'p50': p50, 'p99': p99, 'CPU of fkm': load_of_relay}),
    (MASTER, BARE_MASTER, {'p50': p50, 'p99': p99}),
    (TELEOP, MASTER, {'p50': p50, 'p99': p99}),
    (MASTER, THREE, {'p50': p50, 'p50 of the publication': published}))


def compare(seconds: float, rounds: int, rate: float, parameters: Mapping[str, str],
            output: Path) -> None:
    """
    Measure every pipeline in each round, s at a rate in Hz; print tables and ratios, write files.

    runs.csv and latency.png go into the output directory.
    """
    runs: list[Run] = []
    rows = []
    for number in range(1, rounds + 1):
        for case in CASES:
            run = measure(case, seconds, rate, parameters)
            runs.append(run)
            rows.append(row(number, run))
            disturbed = disturbance(run)
            print(f'round {number} of {rounds}, {case.name}: {summary(run.latencies)} us, '
                  f'lost {run.lost}' + (f' (disturbed: {disturbed})' if disturbed else ''),
                  flush=True)
    print(f'\nLatency: sample stamp to observer. Medians of {rounds} interleaved runs of '
          f'{seconds:g} s at {rate:g} Hz; lost and missed of all runs.\n')
    print(table(runs))
    print('\nratio, median of the rounds (least .. largest)')
    for above, below, figures in COMPARISONS:
        for name, figure in figures.items():
            text = f'{name}, {above.name} over {below.name}'
            print(f'  {text:<75} {ratio(runs, above, below, figure)}')
    control = np.concatenate([run.control for run in runs])
    print(f'control thread, lateness: {summary(control)} us; '
          f'{sum(bool(disturbance(run)) for run in runs)} of {len(runs)} runs disturbed')
    write_csv(output / 'runs.csv', rows)
    written = [output / 'runs.csv']
    if draw(output / 'latency.png', runs):
        written.append(output / 'latency.png')
    else:
        print('no picture: matplotlib is missing (sudo apt install python3-matplotlib, or in a '
              "virtual environment: pip install '.[bench]')")
    print('written: ' + ', '.join(map(str, written)))


def headroom(seconds: float, parameters: Mapping[str, str]) -> None:
    """Print the rates that the composed and the separate nodes hold, measured for `seconds`."""
    print(f'\nheadroom, {seconds:g} s each: held means under {HELD_LOST:.1%} lost and at least '
          f'{1.0 - HELD_SHORT:.0%} of the rate')
    for case in (MASTER, THREE):
        held = [rate for rate in HEADROOM_RATES if _holds(case, seconds, rate, parameters)]
        print(f'  {case.name} holds '
              + (f'{max(held):g} Hz' if held else f'less than {HEADROOM_RATES[0]:g} Hz'))


def _holds(case: Case, seconds: float, rate: float, parameters: Mapping[str, str]) -> bool:
    print(f'  {case.name}, {rate:g} Hz: ', end='', flush=True)
    try:
        run = measure(case, seconds, rate, parameters)
    except PipelineError as overload:
        print(overload)
        return False
    lost = run.lost / run.made
    held = lost < HELD_LOST and run.achieved >= (1.0 - HELD_SHORT) * rate
    print(f'{run.achieved:.0f} Hz, lost {lost:.2%}, deadlines missed {run.missed}, '
          f'p50 {p50(run):.0f} us' + (', held' if held else ''), flush=True)
    return held
