# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maps of the workspace: protection level with three, four, five and six sensors."""

from __future__ import annotations

from math import radians
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
import numpy as np
from paper.dexterity_maps import label, LOCUS, plane, polar_grid
from paper.figure_entry import table
from spm_haptic_master.kinematics import Geometry, singularity_locus, workspace_pose
from spm_haptic_master.validation import plot_style
from study.nine_joints import ACTIVE, rates, Worth, worth

# Self-rotations of the maps (deg): below, at and above the central parallel singularity.
SELF_ROTATIONS = (30.0, 49.36, 70.0)
# Half angle of the workspace's cone (deg).
HALF_ANGLE = 26.0
# Bounds of the colours of levels and steps (deg).
BOUNDS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0)
# Bounds of the colours of what a fault of 1 deg does to the orientation (deg).
HARM = (0.5, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0)
# Largest angle that is a figure (deg): beyond, no theory of small errors holds.
LARGEST = 90.0
# Names and verdicts of a table.
Glance = list[tuple[str, str]]
# Number of circles and rays of the grid.
CIRCLES, RAYS = 60, 120

# The sensor sets of the maps, by their number of sensors.
SETS = {3: ACTIVE, 4: (*ACTIVE, '3A'), 5: (*ACTIVE, '3A', '3B'), 6: (*ACTIVE, '3A', '3B', '3C')}
NAMES = {
    3: 'three sensors (classic)',
    4: 'four sensors (the paper)',
    5: 'five sensors',
    6: 'six sensors',
}


def sections(out: Path, circles: int = CIRCLES, rays: int = RAYS) -> tuple[Glance, list[str]]:
    """Draw into a directory; return names and verdicts, and the page's sections in Markdown."""
    tilt, azimuth = polar_grid(circles, rays)
    joints = {
        phi: rates(workspace_pose(tilt, azimuth, radians(phi)), Geometry())
        for phi in SELF_ROTATIONS
    }
    found = {
        number: {phi: worth(joints[phi], sensors) for phi in SELF_ROTATIONS}
        for number, sensors in SETS.items()
    }
    _classic(out / 'three.png', tilt, azimuth, joints)
    for number, name in ((4, 'four'), (5, 'five'), (6, 'six')):
        _maps(
            out / f'{name}.png',
            tilt,
            azimuth,
            {phi: each.levels for phi, each in found[number].items()},
            f'protection level, {NAMES[number]}',
        )
    _maps(
        out / 'isolation.png',
        tilt,
        azimuth,
        {phi: each.steps for phi, each in found[6].items()},
        'least step that is isolated, six sensors',
    )
    return _glance(found), [_text(found)]


def _glance(found: dict[int, dict[float, Worth]]) -> Glance:
    """Return where a single fault is seen, and where the faulty sensor is known."""
    seen = [
        (f'a single fault is seen, {NAMES[number]}', _where([each.levels for each in maps]))
        for number, maps in ((number, found[number].values()) for number in SETS)
    ]
    return seen + [
        (
            f'the faulty sensor is known, {NAMES[number]}',
            _where([each.steps for each in found[number].values()]),
        )
        for number in (5, 6)
    ]


def _where(values: list[np.ndarray]) -> str:
    """Return in words at which of the reachable poses a figure is one."""
    every = np.concatenate([each[~np.isnan(each)] for each in values])
    known = every < LARGEST
    return 'everywhere' if known.all() else 'not everywhere' if known.any() else 'nowhere'


def _maps(
    path: Path, tilt: np.ndarray, azimuth: np.ndarray, values: dict[float, np.ndarray], title: str
) -> None:
    """Draw a map for each self-rotation."""
    figure, places = _figure()
    for axes, (phi, value) in zip(places, values.items(), strict=True):
        _fill(axes, tilt, azimuth, value, BOUNDS)
        _finish(axes, phi)
    _bar(figure, places, BOUNDS, f'{title}, deg')
    plot_style.save(figure, path)


def _classic(
    path: Path, tilt: np.ndarray, azimuth: np.ndarray, joints: dict[float, dict[str, np.ndarray]]
) -> None:
    """Draw what a fault of 1 deg does with three sensors, which nothing detects."""
    figure, places = _figure()
    for axes, (phi, rows) in zip(places, joints.items(), strict=True):
        H = np.stack([rows[name] for name in ACTIVE], axis=-2)
        known = np.isfinite(H).all((-1, -2))
        # A singular value of rounding is none: nothing bounds the turn there.
        inverse = np.linalg.pinv(np.where(known[..., None, None], H, np.eye(3)), rcond=1e-12)
        harm = np.linalg.norm(inverse, axis=-2).max(-1)
        _fill(axes, tilt, azimuth, np.where(known, harm, np.nan), HARM)
        _finish(axes, phi)
    _bar(figure, places, HARM, 'error of an undetected fault of 1 deg, three sensors, deg')
    plot_style.save(figure, path)


def _figure() -> tuple[Figure, np.ndarray]:
    figure = plot_style.new_figure(height=3.5)
    return figure, figure.subplots(1, len(SELF_ROTATIONS), sharey=True)


def _norm(bounds: tuple[float, ...]) -> BoundaryNorm:
    return BoundaryNorm(bounds, 256, extend='both')


def _fill(
    axes: Axes,
    tilt: np.ndarray,
    azimuth: np.ndarray,
    values: np.ndarray,
    bounds: tuple[float, ...],
) -> None:
    """Fill a map with colours."""
    axes.contourf(
        *plane(tilt, azimuth),
        np.minimum(values, LARGEST),
        cmap='viridis',
        norm=_norm(bounds),
        levels=bounds,
        extend='both',
    )


def _finish(axes: Axes, phi: float) -> None:
    """Add the singularity locus and the labels."""
    axes.plot(*plane(*singularity_locus(radians(phi), radians(HALF_ANGLE))), **LOCUS)
    label(axes, f'φ = {phi:g} deg')


def _bar(figure: Figure, places: np.ndarray, bounds: tuple[float, ...], title: str) -> None:
    places[0].set_ylabel('tilt towards (1, 1, −2), deg')
    bar = figure.colorbar(ScalarMappable(_norm(bounds), 'viridis'), ax=places, ticks=bounds)
    bar.set_label(title, fontsize=8)
    bar.ax.set_yticklabels([f'{bound:g}' for bound in bounds])


def _text(found: dict[int, dict[float, Worth]]) -> str:
    """Return the section of the maps."""
    rows = []
    for number, maps in found.items():
        for phi, each in maps.items():
            levels = each.levels[np.isfinite(each.deviations)]
            rows.append(
                (
                    NAMES[number],
                    f'{phi:g} deg',
                    deg(float(np.median(levels))),
                    deg(float(np.percentile(levels, 90.0, method='lower'))),
                    deg(float(levels.max())),
                    f'{100.0 * np.mean(levels <= 0.5):.0f} %',
                )
            )
    five, six = (
        np.concatenate(
            [each.steps[np.isfinite(each.deviations)] for each in found[number].values()]
        )
        for number in (5, 6)
    )
    header = ('sensors', 'φ', 'median, deg', '90 %, deg', 'largest, deg', 'within 0.5 deg')
    return f"""\
## Over the workspace

Each map is the cone of {HALF_ANGLE:g} deg about (1, 1, 1), as in the [paper's
figures](../paper/README.md). Grey is out of reach, the red line is the parallel singularity, the
dashed circle the cone of 13 deg.

{table(header, rows)}

### Three sensors (classic)

![Error of an undetected fault of 1 deg with three sensors](three.png)

Three angles for three degrees of freedom: no fault is seen anywhere, and there is no level. The
map shows what a fault of 1 deg on the worst motor does to the orientation, undetected.

### Four sensors (the paper)

![Protection level with four sensors](four.png)

At the singularity th3A alone carries the orientation, and nothing guards it: along the red line
there is no level. Along the other bright lines, from a tilt of some 15 deg on, one of the motors
is not guarded.

### Five sensors

![Protection level with five sensors](five.png)

With th3B beside th3A every single fault is seen everywhere, the singularity included. The level
rises towards one side of the rim, where th1A has the least guard.

### Six sensors

![Protection level with six sensors](six.png)

With th3C as well the level is nearly the same everywhere, the rim included.

![Least step that is isolated with six sensors](isolation.png)

The faulty one of six is also isolated everywhere: a step of {deg(float(np.median(six)))} deg
suffices in the median, {deg(float(np.percentile(six, 99.0)))} deg at 99 % of these poses, and
{deg(float(six.max()))} deg at the rim. With five sensors the median is
{deg(float(np.median(five)))} deg, and at some poses two sensors cannot be distinguished.
"""


def deg(value: float) -> str:
    """Return an angle in deg as text; 'none' beyond `LARGEST`."""
    if not value < LARGEST:
        return 'none'
    return f'{value:.2f}' if value < 10.0 else f'{value:.0f}'
