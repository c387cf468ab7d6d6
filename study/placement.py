# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where a fifth sensor has to sit: th2A, th2B, th3B, at poses and over the workspace."""

from __future__ import annotations

from itertools import product
from math import acos, inf, radians, sqrt
from pathlib import Path

import numpy as np
from paper.dexterity_maps import polar_grid
from paper.figure_entry import table
from spm_haptic_master.kinematics import Geometry, workspace_pose
from spm_haptic_master.validation import plot_style
from study.nine_joints import ACTIVE, rates, Worth, worth
from study.protection_maps import deg, Glance, LARGEST

# The sets of the independent model's table, and what it found: protection level (median, 90 %,
# largest), standard deviation of the orientation (median, largest) and step that is isolated
# (median, largest), deg; infinite for "none", None where it gives no figure.
Figures = tuple[tuple[float | None, ...], ...]
REFERENCE: dict[tuple[str, ...], Figures] = {
    (*ACTIVE, '3A'): ((0.89, 5.4, inf), (0.042, 0.050), (inf, inf)),
    (*ACTIVE, '2A'): ((2.1, 22.0, inf), (0.082, 0.141), (None, None)),
    (*ACTIVE, '3A', '2A'): ((0.40, 0.57, 0.73), (0.040, 0.048), (0.76, inf)),
    (*ACTIVE, '3A', '2B'): ((0.41, 0.58, 0.93), (0.036, 0.038), (None, None)),
    (*ACTIVE, '3A', '3B'): ((0.18, 0.23, 0.40), (0.034, 0.038), (0.52, inf)),
    (*ACTIVE, '3A', '3B', '3C'): ((0.11, 0.13, 0.14), (0.028, 0.029), (0.09, 0.16)),
}
# Largest difference of two models that agree (unit 1), and half a digit of each figure as printed
# (deg).
RELATIVE, HALF_DIGITS = 0.05, (0.05, 6e-4, 6e-3)
# The poses of that table (deg).
TILTS = (0.0, 8.0, 16.0)
AZIMUTHS = (0.0, 90.0, 180.0, 270.0)
SELF_ROTATIONS = (0.0, 15.0, 30.0, 40.0, 45.0, 49.3586, 54.0, 60.0, 75.0, 90.0)
# Self-rotations of the curves and of the poses over the workspace (deg).
CURVE, EVERYWHERE = np.arange(0.0, 90.01, 0.5), np.arange(0.0, 91.0, 10.0)
# Number of circles and rays of the poses over the workspace.
CIRCLES, RAYS = 26, 48
# Colours and line styles of the curves: petrol is the device of four, as on the page of `view`.
STYLES = {
    ('3A',): (plot_style.IMPROVED, '-'),
    ('2A',): (plot_style.CAPTURE, '-'),
    ('3A', '2A'): (plot_style.MULTI_BODY, '--'),
    ('3A', '2B'): (plot_style.MULTI_BODY, '-'),
    ('3A', '3B'): (plot_style.ESTIMATE, '-'),
    ('3A', '3B', '3C'): (plot_style.REFERENCE, '-'),
}
# Passive joints that a fifth sensor may sit on.
FIFTH = ('2A', '2B', '2C', '3B', '3C')


def table_poses() -> np.ndarray:
    """Return the poses of the table: the least turn that tilts Z_E, then the self-rotation."""

    def about(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        turn = np.eye(3)
        i, j = (axis + 1) % 3, (axis + 2) % 3
        turn[[i, j], [i, j]], turn[i, j], turn[j, i] = c, -s, s
        return turn

    centre = about(2, radians(135.0)) @ about(0, acos(1.0 / sqrt(3.0)))
    return np.array(
        [
            centre @ about(2, azimuth) @ about(0, tilt) @ about(2, phi - azimuth)
            for tilt, azimuth, phi in product(*map(np.radians, (TILTS, AZIMUTHS, SELF_ROTATIONS)))
        ]
    )


def figures_of(found: Worth) -> Figures:
    """Return the figures of a row of the table, deg."""
    known = np.isfinite(found.deviations)
    levels, steps = found.levels[known], found.steps[known]
    deviations = found.deviations[known]
    return (
        (float(np.median(levels)), float(np.percentile(levels, 90.0)), float(levels.max())),
        (float(np.median(deviations)), float(deviations.max())),
        (float(np.median(steps)), float(steps.max())),
    )


def comparison(joints: dict[str, np.ndarray]) -> str:
    """Return the table of both models, Markdown, from the rates at the table's poses."""
    rows = [
        _row(sensors, figures_of(worth(joints, sensors)), REFERENCE[sensors])
        for sensors in REFERENCE
    ]
    return table(
        (
            'sensors',
            'level: median / 90 % / largest, deg',
            'deviation: median / largest, deg',
            'isolated step: median / largest, deg',
        ),
        rows,
    )


def agrees(found: Figures, reference: Figures) -> bool:
    """Return whether figures are those of the independent model, to 5 % or half a digit."""
    for own, other, digit in zip(found, reference, HALF_DIGITS, strict=True):
        for value, expected in zip(own, other, strict=True):
            if value is None or expected is None:
                continue
            if expected == inf:
                same = value > LARGEST
            else:
                least = digit if expected > 1.0 or digit < 0.01 else 0.005
                same = abs(value - expected) <= max(RELATIVE * expected, least)
            if not same:
                return False
    return True


def sections(out: Path, circles: int = CIRCLES, rays: int = RAYS) -> tuple[Glance, list[str]]:
    """Draw into a directory; return names and verdicts, and the page's sections in Markdown."""
    tilt, azimuth, phi = _everywhere(circles, rays)
    everywhere = rates(workspace_pose(tilt, azimuth, phi), Geometry())
    _draw(out / 'placement.png', everywhere)
    at_table = rates(table_poses(), Geometry())
    fifth, medians = [], {}
    for name in FIFTH:
        (median, ninety, largest), (usual, worst), steps = figures_of(
            worth(everywhere, (*ACTIVE, '3A', name))
        )
        medians[f'th{name}'] = median
        fifth.append(
            (
                f'th{name}',
                deg(median),
                deg(ninety),
                deg(largest),
                f'{usual:.3f} / {worst:.3f}',
                f'{deg(steps[0])} / {deg(steps[1])}',
            )
        )
    count = int(np.isfinite(everywhere['1A']).all(-1).sum())
    glance = [
        (
            f'an independent model, {" ".join(sensors)}',
            'agrees' if agrees(figures_of(worth(at_table, sensors)), reference) else 'differs',
        )
        for sensors, reference in REFERENCE.items()
    ]
    glance.append(
        (
            'two best places of a fifth sensor',
            ', '.join(sorted(sorted(medians, key=medians.__getitem__)[:2])),
        )
    )
    return glance, [
        f"""\
## Where, and how many

At the 120 poses of an independent model (tilt {', '.join(f'{each:g}' for each in TILTS)} deg in
four directions, φ 0 to 90 deg, the singularity among them). Each cell is what this package
computes, and in brackets what that model found.

{comparison(at_table)}

## The fifth sensor

![Protection level by sensor set: over the workspace, and along the self-rotation](placement.png)

Left: share of the workspace (tilt up to 26 deg, φ 0 to 90 deg, {count} reachable poses) with a
level up to the abscissa. Right: the level in the centre, along the self-rotation. th3B and th3C
are the best places of a fifth sensor, by the level, by the accuracy and by what can be isolated:

{
            table(
                (
                    'fifth sensor',
                    'level: median, deg',
                    '90 %, deg',
                    'largest, deg',
                    'deviation: median / largest, deg',
                    'isolated step: median / largest, deg',
                ),
                fifth,
            )
        }
"""
    ]


def _everywhere(circles: int, rays: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return poses that fill the workspace's cone evenly: tilts, azimuths, self-rotations, rad."""
    tilt, azimuth = polar_grid(circles, rays)
    # Equal areas: the grid's tilts have equal steps.
    half = tilt.max()
    tilt = np.arccos(1.0 - (tilt / half) * (1.0 - np.cos(half)))
    phi = np.radians(EVERYWHERE)[:, None, None]
    shape = np.broadcast_shapes(phi.shape, tilt[:-1].shape)
    return (
        np.broadcast_to(tilt[:-1], shape),
        np.broadcast_to(azimuth[:-1], shape),
        np.broadcast_to(phi, shape),
    )


def _row(
    sensors: tuple[str, ...],
    found: tuple[tuple[float, ...], ...],
    reference: tuple[tuple[float | None, ...], ...],
) -> tuple[str, ...]:
    """Return a row of the table: found, and in brackets the independent model's."""
    cells = []
    for part, (own, other) in enumerate(zip(found, reference, strict=True)):
        texts = [[_text(each, part) for each in values] for values in (own, other)]
        cells.append(' / '.join(texts[0]) + ' (' + ' / '.join(texts[1]) + ')')
    return ' '.join(sensors), *cells


def _text(value: float | None, part: int) -> str:
    """Return a figure of the table's part: levels, deviations, steps."""
    if value is None:
        return '-'
    return f'{value:.3f}' if part == 1 else deg(value)


def _draw(path: Path, everywhere: dict[str, np.ndarray]) -> None:
    """Draw the share of the workspace within a level, and the level along the self-rotation."""
    figure = plot_style.new_figure(height=3.6)
    left, right = figure.subplots(1, 2)
    centre = rates(workspace_pose(0.0, 0.0, np.radians(CURVE)), Geometry())
    for passive, (colour, style) in STYLES.items():
        sensors = (*ACTIVE, *passive)
        levels = worth(everywhere, sensors).levels
        levels = np.sort(levels[~np.isnan(levels)])
        name = '4: ' if len(sensors) == 4 else f'{len(sensors)}: '
        name += 'motors, ' + ', '.join(f'th{each}' for each in passive)
        left.plot(
            levels, np.linspace(0.0, 100.0, len(levels)), color=colour, linestyle=style, label=name
        )
        right.plot(CURVE, worth(centre, sensors).levels, color=colour, linestyle=style)
    plot_style.label_axes(left, 'protection level, deg', 'share of the workspace, %')
    left.set(xscale='log', xlim=(0.08, 30.0), ylim=(0.0, 100.0))
    left.legend(fontsize=7, loc='lower right')
    plot_style.label_axes(right, 'self-rotation φ in the centre, deg', 'protection level, deg')
    right.set(yscale='log', ylim=(0.08, 30.0), xlim=(CURVE[0], CURVE[-1]))
    plot_style.save(figure, path)
