# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Figs. 6, 7 and 15: dexterity and det A over the workspace, and the locus of det A = 0."""

from __future__ import annotations

from math import degrees, radians
from pathlib import Path

from matplotlib.axes import Axes
import numpy as np
from paper.figure_entry import Entry, table, Verdict, verdict
from paper.linkage_drawing import Linkage
from spm_haptic_master.kinematics import (
    dexterity,
    Geometry,
    inverse,
    jacobian,
    parallel_determinant,
    singularity_locus,
    workspace_pose,
)
from spm_haptic_master.validation import plot_style

# Half angle of the workspace's cone in the sister paper (deg).
HALF_ANGLE = 26.0
# Half angle if 26 deg is read as the apex angle of the cone (deg).
READ_AS_APEX = 13.0
# Self-rotation of Figs. 6 and 15 (deg).
PHI = 50.0
# Self-rotations of Fig. 7 (deg), which the print does not name: one with a locus near the rim, one
# between, and the paper's own.
THREE_PHI = (30.0, 40.0, 50.0)
# Number of circles and rays of the grid.
CIRCLES, RAYS = 60, 120
# Steps of the colour scales of the dexterity and of det A.
DEXTERITY_STEP, DETERMINANT_STEP = 0.02, 0.005
# Half angle of the cone that is completely within reach at phi = 50 deg (deg).
REACHED = 20.0
# Style of the singularity locus.
LOCUS = {'color': '#d00000', 'markersize': 1.8, 'linestyle': 'none', 'marker': '.'}


def polar_grid(circles: int, rays: int) -> tuple[np.ndarray, np.ndarray]:
    """Return tilts and azimuths, rad, of a grid over the workspace's cone."""
    tilt, azimuth = np.meshgrid(
        np.linspace(0.0, radians(HALF_ANGLE), circles + 1), np.linspace(0.0, 2.0 * np.pi, rays + 1)
    )
    return tilt, azimuth


def entries(out: Path, circles: int = CIRCLES, rays: int = RAYS) -> list[Entry]:
    """Draw into the directory `out` and return the entries of the page."""
    return [*_dexterity(out, circles, rays), _determinant(out, circles, rays)]


def plane(tilt: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the point of a pose in the map: its distance from the middle is its tilt, deg."""
    distance = np.degrees(tilt)
    return distance * np.cos(azimuth), distance * np.sin(azimuth)


def label(axes: Axes, title: str) -> None:
    """Label a map of the cone; the dashed circle is the other reading of its angle."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.plot(
        READ_AS_APEX * np.cos(turn),
        READ_AS_APEX * np.sin(turn),
        color='white',
        linestyle='--',
        linewidth=0.9,
    )
    axes.set_aspect('equal')
    axes.set_facecolor('#dddddd')
    axes.set_xlabel('tilt towards (1, −1, 0), deg')
    axes.set_title(title, fontsize=10)


def _levels(low: float, high: float, step: float) -> np.ndarray:
    return step * np.arange(np.floor(low / step), np.ceil(high / step) + 1.0)


def weighted_dexterity(G: np.ndarray) -> np.ndarray:
    """Return eq. 12 of Jacobians, (..., N, 3), in the Frobenius norm weighted by 1 / 3."""
    squares = np.swapaxes(G, -1, -2) @ G
    return 3.0 / np.sqrt(
        np.trace(squares, axis1=-2, axis2=-1)
        * np.trace(np.linalg.inv(squares), axis1=-2, axis2=-1)
    )


def _dexterity(out: Path, circles: int, rays: int) -> list[Entry]:
    tilt, azimuth = polar_grid(circles, rays)
    poses = workspace_pose(tilt, azimuth, radians(PHI))
    maps = {sensors: dexterity(poses, sensors=sensors) for sensors in (3, 4)}
    weighted = {
        sensors: weighted_dexterity(jacobian(poses, sensors=sensors)) for sensors in (3, 4)
    }
    locus = singularity_locus(radians(PHI), radians(HALF_ANGLE))
    largest = max(float(np.nanmax(each)) for each in maps.values())
    figure = plot_style.new_figure(height=4.0)
    axes = figure.subplots(1, 2, sharey=True)
    for place, sensors, title in zip(
        axes, (3, 4), ('Fig. 6: three sensors', 'Fig. 15: four sensors'), strict=True
    ):
        picture = place.contourf(
            *plane(tilt, azimuth),
            maps[sensors],
            cmap='viridis',
            levels=_levels(0.0, largest, DEXTERITY_STEP),
        )
        lines = place.contour(
            *plane(tilt, azimuth),
            maps[sensors],
            colors='white',
            linewidths=0.6,
            levels=[0.02, 0.05, 0.1, 0.15] if sensors == 3 else [0.3, 0.35, 0.4, 0.45, 0.5],
        )
        place.clabel(lines, fontsize=7)
        label(place, f'{title}, φ = {PHI:g} deg')
    axes[0].plot(*plane(*locus), **LOCUS)
    axes[0].set_ylabel('tilt towards (1, 1, −2), deg')
    figure.colorbar(
        picture,
        ax=axes,
        label='dexterity η, one scale',
        shrink=0.85,
        ticks=np.arange(0.0, largest, 0.1),
    )
    plot_style.save(figure, out / 'fig06_15.png')

    inner = np.degrees(tilt) <= READ_AS_APEX + 1e-9
    reach = float(np.isfinite(maps[3]).mean())
    centre = float(maps[3][0, 0])

    def span(values: np.ndarray, part: np.ndarray) -> str:
        return f'{np.nanmin(values[part]):.3f} to {np.nanmax(values[part]):.3f}'

    everywhere = np.ones_like(inner)
    rows = [
        (f'{name}, half cone {angle:g} deg', span(values[3], part), span(values[4], part))
        for name, values in (('2-norm', maps), ('Frobenius norm', weighted))
        for angle, part in ((READ_AS_APEX, inner), (HALF_ANGLE, everywhere))
    ]
    details = table(('dexterity at φ = 50 deg', 'three sensors', 'four sensors'), rows)
    nearest = degrees(float(locus[0].min()))
    reached = float(np.nanmin(maps[4][np.degrees(tilt) <= REACHED + 1e-9]))
    lowest = np.unravel_index(np.nanargmin(maps[4]), maps[4].shape)
    edge = Linkage.at(inverse(poses[lowest]).theta1, poses[lowest], Geometry())
    stretched = float(np.sum(edge.first * np.cross(edge.second, edge.third), axis=-1).min())
    return [
        Entry(
            (6,),
            'Dexterity over the workspace, three sensors',
            'At φ = 50 deg the dexterity vanishes along a dotted line through the centre of the '
            'workspace.',
            f'It vanishes along the red line, which passes the centre at {nearest:.2f} deg; at '
            f'the centre itself it is {centre:.4f}.',
            verdict(nearest < 2.0),
            'The line meets the centre exactly at φ = 49.36 deg, which the paper rounds. Eq. 12 '
            'does not name its norm: the picture has the 2-norm, smallest over '
            'largest singular value; the table has both. "Apex angle 26 deg" is the half angle '
            "of the sister paper's cone; the dashed circle is the other reading. "
            f'{100.0 * reach:.1f} % of the grid is within reach; grey is not.',
            'fig06_15.png',
            details,
        ),
        Entry(
            (15,),
            'Dexterity over the workspace, four sensors',
            'The dexterity does not vanish anywhere.',
            f'At φ = 50 deg it is {span(maps[4], inner)} within {READ_AS_APEX:g} deg of the '
            f'centre and {reached:.3f} or more within {REACHED:g} deg (picture at Fig. 6, same '
            'colour scale).',
            verdict(reached > 0.1),
            f'Its least value, {maps[4][lowest]:.3f}, lies beside the grey poses that a leg '
            f'cannot reach: there a leg is nearly stretched (B_kk = {stretched:.3f}), a serial '
            'singularity, which no sensor removes.',
        ),
    ]


def _determinant(out: Path, circles: int, rays: int) -> Entry:
    tilt, azimuth = polar_grid(circles, rays)
    values = [
        parallel_determinant(workspace_pose(tilt, azimuth, radians(phi))) for phi in THREE_PHI
    ]
    largest = max(float(np.nanmax(np.abs(each))) for each in values)
    figure = plot_style.new_figure(height=3.5)
    axes = figure.subplots(1, 3, sharey=True)
    rows = []
    for place, phi, value in zip(axes, THREE_PHI, values, strict=True):
        picture = place.contourf(
            *plane(tilt, azimuth),
            value,
            cmap='PuOr',
            levels=_levels(-largest, largest, DETERMINANT_STEP),
        )
        locus = singularity_locus(radians(phi), radians(HALF_ANGLE))
        place.plot(*plane(*locus), **LOCUS)
        label(place, f'φ = {phi:g} deg')
        rows.append(
            (
                f'{phi:g} deg',
                f'{np.nanmin(value):.4f} to {np.nanmax(value):.4f}',
                f'{np.degrees(locus[0].min()):.2f} deg' if locus[0].size else 'none',
            )
        )
    axes[0].set_ylabel('tilt towards (1, 1, −2), deg')
    figure.colorbar(
        picture, ax=axes, label='det A, one scale', shrink=0.85, ticks=np.arange(-4, 5) * 0.02
    )
    plot_style.save(figure, out / 'fig07.png')
    return Entry(
        (7,),
        'det A over the workspace, and the singularity locus',
        'The singular poses for three values of φ: a line that moves through the workspace.',
        'A line across the cone, which comes in from the rim as φ grows and reaches the centre at '
        '49.36 deg.',
        Verdict.PARTLY,
        'The print does not name the three values; these show the line. '
        "The sign of det A is that of the rows Z2k × Z3k; with the print's Z3k × Z2k it is "
        'opposite, and the line is the same.',
        'fig07.png',
        table(('φ', 'det A', 'nearest singular pose, from the centre'), rows),
    )
