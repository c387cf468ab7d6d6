# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How near the pipeline is to its floor: the real nodes beside a bare relay, apart and composed."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
import signal
import sys

import numpy as np

from spm_haptic_master.benchmark.report import (
    disturbance,
    draw,
    machine,
    quantiles,
    ratio,
    row,
    table,
    write_csv,
)
from spm_haptic_master.benchmark.run import Case, measure, MEMORY_PERIOD, PipelineError, Run
from spm_haptic_master.exceptions import InputError, SpmError

BARE = Case('bare relay', ('bare_relay', 'bare_driver'))
NODES = Case('driver and fkm', ('fkm', 'encoder_driver'))
ALL_OUTPUTS = Case('driver and fkm, all outputs observed', NODES.processes, 'observer_of_all')
BARE_THREE = Case('bare relay and listener', ('bare_relay', 'bare_listener', 'bare_driver'))
THREE = Case('three processes', ('fkm', 'diagnostics', 'encoder_driver'))
BARE_MASTER = Case('bare, composed', ('bare_master',))
MASTER = Case('master (composed)', ('master',))
# Those that are compared stand beside each other, so that drift of the machine meets both.
CASES = (BARE, NODES, ALL_OUTPUTS, BARE_THREE, THREE, MASTER, BARE_MASTER)

HEADROOM_RATES = (2000.0, 3000.0, 4000.0, 5000.0)  # Hz
HEADROOM_SECONDS = 5.0
# Part of the samples that may be lost, and of the rate that may be missing, for a rate to be held.
HELD_LOST, HELD_SHORT = 0.001, 0.05
MINUTE = 60.0  # s


def p50(run: Run) -> float:
    """Return the median latency, us."""
    return quantiles(run.latencies)['p50']


def p99(run: Run) -> float:
    """Return the 99th percentile of the latency, us."""
    return quantiles(run.latencies)['p99']


def compare(seconds: float, rounds: int, rate: float, parameters: dict[str, str],
            output: Path) -> None:
    """Measure every pipeline in turn, round by round; print tables and ratios, write files."""
    runs: list[Run] = []
    rows = []
    for number in range(1, rounds + 1):
        for case in CASES:
            run = measure(case, seconds, rate, parameters)
            runs.append(run)
            rows.append(row(number, run))
            said = disturbance(run)
            print(f'round {number} of {rounds}, {case.name}: '
                  + ' '.join(f'{name} {value:.0f}'
                             for name, value in quantiles(run.latencies).items())
                  + f' us, lost {run.lost}' + (f' (disturbed: {said})' if said else ''),
                  flush=True)
    print(f'\nLatency: sample stamp to observer. Medians of {rounds} interleaved runs of '
          f'{seconds:g} s at {rate:g} Hz; lost, missed and gc pauses of all runs.\n')
    print(table(runs))
    print('\nratio, median of the rounds (least .. largest)')
    for text, above, below, figure in _comparisons():
        print(f'  {text:<58} {ratio(runs, above, below, figure)}')
    control = np.concatenate([run.control for run in runs])
    print('control thread, lateness: ' + ' '.join(
        f'{name} {value:.0f}' for name, value in quantiles(control).items()) + ' us; '
        f'{sum(bool(disturbance(run)) for run in runs)} of {len(runs)} runs disturbed')
    write_csv(output / 'runs.csv', rows)
    written = [output / 'runs.csv']
    if draw(output / 'latency.png', runs):
        written.append(output / 'latency.png')
    else:
        print("no picture: matplotlib is not installed (pip install '.[bench]')")
    print('written: ' + ', '.join(map(str, written)))


def _comparisons():
    return (
        ('p50, driver and fkm over bare', NODES, BARE, p50),
        ('p99, driver and fkm over bare', NODES, BARE, p99),
        ('CPU, fkm over bare relay', NODES, BARE,
         lambda run: run.load.get('fkm') or run.load['bare_relay']),
        ('p50, all outputs observed, over bare', ALL_OUTPUTS, BARE, p50),
        ('p50, three processes over bare three', THREE, BARE_THREE, p50),
        ('p99, three processes over bare three', THREE, BARE_THREE, p99),
        ('CPU, fkm over bare relay, of three', THREE, BARE_THREE,
         lambda run: run.load.get('fkm') or run.load['bare_relay']),
        ('p50, master over bare composed', MASTER, BARE_MASTER, p50),
        ('p99, master over bare composed', MASTER, BARE_MASTER, p99),
        ('p50, master over three processes, at the observer', MASTER, THREE, p50),
        ('p50, master over three processes, sample to publication', MASTER, THREE,
         lambda run: run.published),
    )


def headroom(seconds: float, parameters: dict[str, str]) -> None:
    """Print which rates the composed and the separate nodes hold."""
    print(f'\nheadroom, {seconds:g} s each: held means under {HELD_LOST:.1%} lost and at least '
          f'{1.0 - HELD_SHORT:.0%} of the rate')
    for case in (MASTER, THREE):
        held = [rate for rate in HEADROOM_RATES if _holds(case, seconds, rate, parameters)]
        print(f'  {case.name} holds '
              + (f'{max(held):g} Hz' if held else f'less than {HEADROOM_RATES[0]:g} Hz'))


def _holds(case: Case, seconds: float, rate: float, parameters: dict[str, str]) -> bool:
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


def soak(case: Case, minutes: float, rate: float, parameters: dict[str, str]) -> None:
    """Run for long, and print what changed: memory, latency, the grid."""
    print(f'\nsoak, {case.name}, {minutes:g} minutes at {rate:g} Hz', flush=True)
    run = measure(case, minutes * MINUTE, rate, parameters)
    first = round(MINUTE / MEMORY_PERIOD)
    for name, memory in run.memory.items():
        settled = memory[min(first, len(memory) - 1)]
        print(f'  resident memory of {name}: {settled:.1f} MiB, growth after the first minute '
              f'{memory[-1] - settled:+.2f} MiB'
              + (' (it keeps what it hears)' if name == case.observer else ''))
    elapsed = (run.stamps - run.stamps[0]) * 1e-9
    second = (elapsed >= MINUTE) & (elapsed < 2.0 * MINUTE)
    last = elapsed >= elapsed[-1] - MINUTE
    for text, part in (('second', second), ('last', last)):
        if part.any():
            print(f'  latency in the {text} minute: ' + ' '.join(
                f'{name} {value:.0f}' for name, value in quantiles(run.latencies[part]).items())
                + ' us')
    print(f'  drift of the grid: {_drift(run, last):+.1f} us in {elapsed[-1]:.0f} s; '
          f'lost {run.lost} of {run.made}, deadlines missed {run.missed}')
    for name, pauses in run.pauses.items():
        print(f'  garbage collections of {name}: {len(pauses)}'
              + (f', the longest {max(pauses):.0f} us' if pauses else ''))
    said = disturbance(run)
    if said:
        print(f'  the machine was disturbed: {said}')


def _drift(run: Run, last: np.ndarray) -> float:
    """Return how far the sampling times left their grid, us: last minute against first."""
    period = 1e9 / run.rate
    phase = (run.stamps - run.stamps[0]) % period
    first = run.stamps - run.stamps[0] < MINUTE * 1e9
    early, late = (np.angle(np.median(np.exp(2j * np.pi * phase[part] / period)))
                   for part in (first, last))
    return float((late - early + np.pi) % (2.0 * np.pi) - np.pi) / (2.0 * np.pi) * period * 1e-3


def main(args: list[str] | None = None) -> int:
    """Run the parts that the command line names."""
    parser = argparse.ArgumentParser(prog='benchmark', description=__doc__)
    parser.add_argument('parts', nargs='*', metavar='PART', default=['compare', 'headroom'],
                        help='compare, headroom, soak (default: compare headroom)')
    parser.add_argument('--seconds', type=float, default=20.0, help='of a run (20)')
    parser.add_argument('--rounds', type=int, default=5, help='of all pipelines in turn (5)')
    parser.add_argument('--rate', type=float, default=1000.0, help='Hz (1000)')
    parser.add_argument('--minutes', type=float, default=10.0, help='of the soak (10)')
    parser.add_argument('--apart', action='store_true', help='soak the nodes as three processes')
    parser.add_argument('--output', type=Path, default=Path('bench-pipeline'), metavar='DIR',
                        help='for runs.csv and latency.png (bench-pipeline)')
    parser.add_argument('-p', '--param', action='append', default=[], metavar='NAME:=VALUE',
                        help='a parameter of every node, bare ones too: realtime.gc:=disable')
    given = parser.parse_args((sys.argv if args is None else args)[1:])
    # Also where a shell ignores Ctrl-C on behalf of what it runs in the background.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    try:
        _run(given)
    except KeyboardInterrupt:
        return 130
    except SpmError as error:
        print(f'benchmark: {error}', file=sys.stderr)
        return 1
    return 0


def _run(given: argparse.Namespace) -> None:
    unknown = set(given.parts) - {'compare', 'headroom', 'soak'}
    if unknown:
        raise InputError(f'{", ".join(sorted(unknown))}: expected compare, headroom or soak')
    if given.rounds < 1:
        raise InputError(f'--rounds {given.rounds}; expected 1 or more')
    parameters = _parameters(given.param)
    if 'rate' in parameters:
        raise InputError(f"-p 'rate:={parameters['rate']}'; expected --rate HZ")
    given.output.mkdir(parents=True, exist_ok=True)
    print(machine(), flush=True)
    if 'compare' in given.parts:
        compare(given.seconds, given.rounds, given.rate, parameters, given.output)
    if 'headroom' in given.parts:
        headroom(min(given.seconds, HEADROOM_SECONDS), parameters)
    if 'soak' in given.parts:
        soak(THREE if given.apart else MASTER, given.minutes, given.rate, parameters)


def _parameters(given: Sequence[str]) -> dict[str, str]:
    parameters = {}
    for text in given:
        name, separator, value = text.partition(':=')
        if not separator:
            raise InputError(f"-p '{text}'; expected NAME:=VALUE")
        parameters[name] = value
    return parameters
