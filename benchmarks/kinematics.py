# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Cost of the forward models in units that mean the same on any machine.

The unit of scalar code is a call of `math.sin`, that of batches an element of `numpy.sin`. Each
measurement of an entry stands between two of its unit, so that what slows the machine down slows
both; their ratio is the cost. Where a process has its code and data in memory changes the unit by
a tenth and more, so some processes measure, each with an order of its own: the figure is the
median of their costs, and the least and the largest of these stand beside it. The orders are the
same in each run.

Beside the package are the models that one would choose otherwise: Newton-Raphson with numpy on the
three loop closures, and a multi-body model.

Run it with the package installed: python -m benchmarks.kinematics
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
import json
import os
from statistics import median
import subprocess
import sys
from typing import TypeAlias

from benchmarks.model_costs import (
    BUILT,
    CASE_2,
    entries,
    FOUR,
    MULTI_BODY,
    NEWTON,
    newton_agreement,
    SIX,
    SUPERVISED,
    unit_of_batches,
    unit_of_scalars,
)

# Processes that measure, and rounds of each in which each entry is measured once.
PROCESSES = 7
ROUNDS = 5
# Largest cost of the mechanism as built over that of the nominal one (unit 1).
BUILT_REACH = 1.1
# Largest cost of an estimate from six sensors over that from four (unit 1); the same of a sample
# of five and of six sensors through the supervision.
SIX_REACH = 1.6
SUPERVISED_REACH = {5: 1.3, 6: 1.45}
# Least speed of the closed form over that of Newton-Raphson (unit 1).
NEWTON_REACH = 20.0
# Runs a command with each thing at the same place in memory every time (util-linux).
SAME_PLACES = ('setarch', '--addr-no-randomize')


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of an entry in one process: the median of its rounds."""

    seconds: float  # of a call, or of an element of a batch
    units: float
    reach: int | None  # largest cost in units; None without a limit


# Costs in one process, by the name of the entry.
Costs: TypeAlias = dict[str, Cost]


def costs_here() -> Costs:
    """Measure every entry in this process."""
    units = {True: unit_of_scalars(), False: unit_of_batches()}
    table = entries()
    seconds: dict[str, list[float]] = {entry.name: [] for entry in table}
    ratios: dict[str, list[float]] = {entry.name: [] for entry in table}
    for _ in range(ROUNDS):
        for entry in table:
            unit = units[entry.batch == 1]
            before = unit()
            cost = entry.measure() / entry.batch
            after = unit()
            seconds[entry.name].append(cost)
            ratios[entry.name].append(2.0 * cost / (before + after))
    return {
        entry.name: Cost(median(seconds[entry.name]), median(ratios[entry.name]), entry.reach)
        for entry in table
    }


def keeps_places() -> bool:
    """Return whether a process here may be run with each thing at the same place in memory."""
    try:
        ended = subprocess.run([*SAME_PLACES, 'true'], capture_output=True, check=False)
    except OSError:
        return False
    return ended.returncode == 0


def costs_in_process(seed: int, wrapper: Sequence[str]) -> Costs:
    """Measure every entry in a process of its own, with the order in memory of a seed."""
    ended = subprocess.run(
        [*wrapper, sys.executable, '-m', 'benchmarks.kinematics', '--here'],
        env=os.environ | {'PYTHONHASHSEED': str(seed)},
        stdout=subprocess.PIPE,
        check=True,
    )
    return {name: Cost(**cost) for name, cost in json.loads(ended.stdout).items()}


def verdict(value: float, most: float) -> str:
    """Return whether a value is within its reach, in words."""
    return 'met' if value <= most else 'not met'


def table_lines(runs: Sequence[Costs]) -> list[str]:
    """Return the table of all entries."""
    lines = [f'{"":46}{"us":>10}{"units":>10}{"least .. largest":>20}{"reach":>8}']
    for name, first in runs[0].items():
        microseconds = 1e6 * median(run[name].seconds for run in runs)
        units = sorted(run[name].units for run in runs)
        middle = median(units)
        span = f'{units[0]:.1f} .. {units[-1]:.1f}'
        line = f'{name:46}{microseconds:10.3f}{middle:10.1f}{span:>20}'
        if first.reach is not None:
            line += f'{first.reach:8}  {verdict(middle, first.reach)}'
        lines.append(line)
    return lines


def over(runs: Sequence[Costs], name: str, other: str) -> float:
    """Return the cost of one entry over that of another: the median of the processes."""
    return median(run[name].units / run[other].units for run in runs)


def comparison_lines(runs: Sequence[Costs]) -> list[str]:
    """Return what entries cost beside each other."""
    built = {
        name: over(runs, name, name.removesuffix(BUILT))
        for name in runs[0]
        if name.endswith(BUILT)
    }
    worst = max(built, key=lambda name: built[name])
    six = over(runs, SIX, FOUR)
    lines = [
        f'{worst} costs {built[worst]:.2f} of the nominal mechanism, the most of all, reach '
        f'{BUILT_REACH}: {verdict(built[worst], BUILT_REACH)}',
        f'An estimate from six sensors costs {six:.2f} of that from four, reach {SIX_REACH}: '
        f'{verdict(six, SIX_REACH)}',
    ]
    for sensors, reach in SUPERVISED_REACH.items():
        ratio = over(runs, SUPERVISED[sensors], SUPERVISED[4])
        lines.append(
            f'A supervised sample of {sensors} sensors costs {ratio:.2f} of one of four, '
            f'reach {reach}: {verdict(ratio, reach)}'
        )
    newton = over(runs, NEWTON, CASE_2)
    lines += [
        f'Case 2 is {newton:.0f} times faster than the {NEWTON}, reach {NEWTON_REACH:.0f}: '
        f'{verdict(-newton, -NEWTON_REACH)}',
        f'Case 2 is {over(runs, MULTI_BODY, CASE_2):.0f} times faster than the {MULTI_BODY}',
    ]
    return lines


def main() -> None:
    """Measure in some processes, one after the other; print the table."""
    parser = argparse.ArgumentParser('benchmarks.kinematics', description=__doc__)
    parser.add_argument('--here', action='store_true', help='measure in this process; print JSON')
    if parser.parse_args().here:
        print(json.dumps({name: asdict(cost) for name, cost in costs_here().items()}))
        return
    print(newton_agreement() + '\n', flush=True)
    wrapper = SAME_PLACES if keeps_places() else ()
    runs = []
    for seed in range(PROCESSES):
        print(f'\rprocess {seed + 1} of {PROCESSES}', end='', file=sys.stderr, flush=True)
        runs.append(costs_in_process(seed, wrapper))
    print(file=sys.stderr)
    print('\n'.join(table_lines(runs) + comparison_lines(runs)))


if __name__ == '__main__':
    main()
