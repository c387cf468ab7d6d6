# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Redraw the paper: python -m paper [--output DIR] [--accept]."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import sys
import time
from typing import Any

from paper.verdicts import PAGE, run_page

# Directory of the page in the repository.
DEFAULT_OUTPUT = Path(__file__).resolve().parents[1] / 'docs' / 'paper'


def main(args: list[str] | None = None) -> int:
    """Draw all figures and write the page; return 1 after an error, or if a verdict changed."""
    return run_page(
        'paper',
        'Redraws every figure of Saafi et al. (2015), and writes a page about them.',
        DEFAULT_OUTPUT,
        _make,
        args,
    )


def _make(output: Path) -> None:
    from paper import (
        dexterity_maps,
        errata,
        geometry_figures,
        mode_branches,
        page,
        rig_figures,
        scenarios,
        sensor_placement,
        solve_times,
    )

    topics: tuple[tuple[str, Callable[[], list[Any]]], ...] = (
        ('Figs. 1 to 5, 8, 11: the mechanism, eq. 5', lambda: geometry_figures.entries(output)),
        ('Figs. 6, 7, 15: maps of the workspace', lambda: dexterity_maps.entries(output)),
        ('Figs. 9, 10: modes through the singularity', lambda: mode_branches.entries(output)),
        (
            'Figs. 12 to 14: Monte Carlo of the sensor placement',
            lambda: sensor_placement.entries(output),
        ),
        ('Figs. 16 to 26: two scenarios, four models', lambda: scenarios.entries(output)),
        ('Figs. 27 to 34: the rig, simulated', lambda: rig_figures.entries(output)),
        ('Section 5: calculation times', solve_times.entries),
    )
    begin = time.monotonic()
    entries = []
    for number, (name, make) in enumerate(topics, start=1):
        print(f'[{number}/{len(topics)}] {name} ...', end=' ', flush=True)
        start = time.monotonic()
        entries += make()
        print(f'{time.monotonic() - start:.1f} s', flush=True)
    text = page.write(entries, errata.section(), solve_times.machine(), time.monotonic() - begin)
    (output / PAGE).write_text(text, encoding='utf-8')
    print(f'{len(entries)} sections in {time.monotonic() - begin:.0f} s')


if __name__ == '__main__':
    sys.exit(main())
