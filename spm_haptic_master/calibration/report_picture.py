# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The picture of a calibration from free motion: its parity over the workspace."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
from math import degrees, pi
from typing import Any, TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion.calibration import MotionCalibration, rms
from spm_haptic_master.calibration.motion.coverage import around_middle, Region
from spm_haptic_master.calibration.motion.model import Array
from spm_haptic_master.kinematics import workspace_pose
from spm_haptic_master.kinematics.joints import LEG_NAMES
from spm_haptic_master.validation import plot_style
from spm_haptic_master.validation.parity_map import tilt_and_turn

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Edge of the cells of the maps: across the tilt, and along the self-rotation (deg). A cell that is
# passed in 0.1 s has a mean parity with a tenth of the noise of a reading.
CELL = 2.0
TURN_CELL = 4.0
# Least time in a cell whose mean parity is drawn (s).
CELL_SECONDS = 0.05
# Part of the cells that the colour scale covers (percent): the last ones are spikes.
SCALE_PERCENT = 98.0
# Colours of signed values, distinguishable without red and green, and of what the motion did not
# reach.
SIGNED, NOWHERE = 'RdBu_r', '#c4c4c4'
# Axis of the platform tilted by a right angle in the two directions of the map.
TILTED = np.array([workspace_pose(0.5 * pi, azimuth, 0.0)[:, 2] for azimuth in (0.0, 0.5 * pi)])
# Width of the rim with the legs' letters, beyond the outermost cell (deg).
LETTERS = 3.0
CAPTION = (
    'Parity of the motion over the workspace, means of cells, before (directions and zeros '
    'only, the mechanism as drawn) and after the calibration; on the right the same as in '
    'the middle, on its own scale. Dashed: the region for which bias_deg holds. A, B, C: '
    f'tilt towards the motor of that leg. Grey: less than {CELL_SECONDS} s there.'
)


def draw(c: MotionCalibration) -> bytes:
    """
    Return the picture of a calibration: the mean parity over the workspace, before and after.

    The upper row has maps over the direction of tilt, the lower one over self-rotation and tilt.
    The columns are the parity as drawn, that of the result on the same scale, and on its own
    scale.

    Parameters
    ----------
    c : MotionCalibration
        Result of a calibration from free motion.

    Returns
    -------
    bytes
        The picture, PNG.

    """
    known = np.isfinite(c.rotation).all(axis=(1, 2))
    known &= np.isfinite(c.parity) & np.isfinite(c.parity_before)
    x, y, turn = _places(c.rotation[known])
    tilt = np.hypot(x, y)
    maps = (_Map(x, y, _edges(x, CELL)), _Map(turn, tilt, _edges(turn, TURN_CELL)))
    columns = _columns(c, maps, known)
    figure = plot_style.new_figure(width=10.0, height=7.0)
    rows = figure.subplots(2, 3, gridspec_kw={'height_ratios': [3, 2]})
    reach = max(float(tilt.max()) + CELL, c.region.tilt_deg) + LETTERS
    for number, column in enumerate(columns):
        tilts, turns = rows[:, number]
        is_first = number == 0
        _draw_cells(
            tilts,
            maps[0],
            column.means[0],
            column.largest,
        )
        mesh = _draw_cells(
            turns,
            maps[1],
            column.means[1],
            column.largest,
        )
        _label_tilts(tilts, reach, column.title, is_first)
        _outline(c.region, tilts, turns)
        _label_turns(turns, c.region, is_first)
        if number == 1:
            _add_scale(
                figure,
                mesh,
                rows[:, :2],
                40,
                7,
            )
        elif number == 2:
            _add_scale(
                figure,
                mesh,
                rows[:, 2],
                20,
                4,
            )
    file = BytesIO()
    plot_style.save(figure, file)
    return file.getvalue()


@dataclass(frozen=True, slots=True)
class _Map:
    """
    The samples of a motion on one map.

    Attributes
    ----------
    across : ndarray, shape (n,)
        First coordinate of each sample, deg.
    along : ndarray, shape (n,)
        Second coordinate, deg.
    across_edges : ndarray
        Edges of the cells in the first coordinate, deg.

    """

    across: Array
    along: Array
    across_edges: Array

    @property
    def edges(self) -> tuple[Array, Array]:
        """Return the edges of the cells in both coordinates, deg."""
        return self.across_edges, _edges(self.along, CELL)

    def means(self, values: Array, least: int) -> Array:
        """
        Return the mean values in the cells.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Values whose means are returned.
        least : int
            Least number of samples in a cell.

        Returns
        -------
        ndarray, shape (cells across, cells along)
            NaN where a cell has fewer samples.

        """
        number = np.histogram2d(self.across, self.along, self.edges)[0]
        total = np.histogram2d(
            self.across,
            self.along,
            self.edges,
            weights=values,
        )[0]
        return np.where(number >= least, total / np.maximum(number, 1.0), np.nan)


@dataclass(frozen=True, slots=True)
class _Column:
    """
    A column of the picture.

    Attributes
    ----------
    title : str
        What it shows.
    means : list of ndarray
        Mean parity in the cells of both maps, deg.
    largest : float
        End of the colour scale, deg.

    """

    title: str
    means: list[Array]
    largest: float


def _columns(
    c: MotionCalibration,
    maps: tuple[_Map, _Map],
    known: NDArray[np.bool_],
) -> list[_Column]:
    """
    Return the columns of the picture.

    Parameters
    ----------
    c : MotionCalibration
        Result of a calibration from free motion.
    maps : tuple of 2 _Map
        Where its samples are.
    known : ndarray of bool, shape (n,)
        Which of its samples these are.

    Returns
    -------
    list of _Column
        Before, after on the same scale, and after on its own.

    """
    least = max(1, round(CELL_SECONDS * c.readings.rate))
    parity_before = np.degrees(c.parity_before[known])
    parity_after = np.degrees(c.parity[known])
    before = [each.means(parity_before, least) for each in maps]
    after = [each.means(parity_after, least) for each in maps]
    return [
        _Column(
            title=f'before: {degrees(rms(c.parity_before)):.4f} deg rms',
            means=before,
            largest=_scale(before),
        ),
        _Column(
            title=f'after: {degrees(rms(c.parity)):.4f} deg rms',
            means=after,
            largest=_scale(before),
        ),
        _Column(
            title='after, own scale',
            means=after,
            largest=_scale(after),
        ),
    ]


def _draw_cells(
    axes: Axes,
    of: _Map,
    means: Array,
    largest: float,
) -> Any:
    """Draw the cells of a map in colours, and return what the colour scale describes."""
    axes.set_facecolor(NOWHERE)
    shown = np.ma.masked_invalid(means).T
    return axes.pcolormesh(
        *of.edges,
        shown,
        cmap=SIGNED,
        vmin=-largest,
        vmax=largest,
    )


def _add_scale(
    figure: Any,
    mesh: Any,
    beside: Any,
    aspect: int,
    ticks: int,
) -> None:
    """Draw a colour scale below some maps, so many times as long as high, with so many ticks."""
    from matplotlib.ticker import MaxNLocator

    figure.colorbar(
        mesh,
        ax=beside,
        label='mean parity, deg',
        extend='both',
        location='bottom',
        shrink=0.9,
        aspect=aspect,
        ticks=MaxNLocator(ticks),
    )


def _places(rotation: Array) -> tuple[Array, Array, Array]:
    """
    Return where on the maps orientations are.

    The direction of tilt is that of the platform's axis, at the distance of the tilt from the
    centre (an azimuthal equidistant map).

    Returns
    -------
    x : ndarray, shape (n,)
        Tilt towards (1, -1, 0), deg.
    y : ndarray, shape (n,)
        Tilt towards (1, 1, -2), deg.
    turn : ndarray, shape (n,)
        Self-rotation, deg, without jumps.

    """
    tilt, turn = tilt_and_turn(rotation)
    x, y = (rotation[:, :, 2] @ direction for direction in TILTED)
    sine = np.maximum(np.hypot(x, y), 1e-12)
    factor = np.degrees(tilt) / sine
    return x * factor, y * factor, np.degrees(around_middle(turn))


def _edges(values: Array, step: float) -> Array:
    """Return the edges of cells of a width that have all values."""
    first = np.floor(values.min() / step)
    last = np.floor(values.max() / step)
    return step * np.arange(first, last + 2.0)


def _scale(values: list[Array]) -> float:
    """Return the largest value of a colour scale: `SCALE_PERCENT` of the cells are within it."""
    known = [each[np.isfinite(each)] for each in values]
    every = np.abs(np.concatenate(known))
    if every.size and every.any():
        return float(np.percentile(every, SCALE_PERCENT))
    return 1.0


def _outline(
    region: Region,
    tilts: Axes,
    turns: Axes,
) -> None:
    """Draw the edge of a region on both maps."""
    line: dict[str, Any] = {'color': plot_style.REFERENCE, 'linestyle': '--', 'linewidth': 1.2}
    circle = np.linspace(0.0, 2.0 * pi, 200)
    across = region.tilt_deg * np.cos(circle)
    along = region.tilt_deg * np.sin(circle)
    tilts.plot(across, along, **line)
    first = region.from_deg
    last = region.to_deg
    corners = [first, first, last, last]
    turns.plot(corners, [0.0, region.tilt_deg, region.tilt_deg, 0.0], **line)


def _label_tilts(
    axes: Axes,
    reach: float,
    title: str,
    labelled: bool,
) -> None:
    """Label a map of the tilt, and name the directions of the legs' motors."""
    axes.set_aspect('equal')
    plot_style.label_axes(
        axes,
        'tilt towards (1, −1, 0), deg',
        'tilt towards (1, 1, −2), deg' if labelled else '',
        title,
    )
    # The nominal motors A, B, C are on z, x, y.
    motors = np.eye(3)[[2, 0, 1]]
    for leg, at in zip(LEG_NAMES, motors @ TILTED.T, strict=True):
        at *= (reach - 0.5 * LETTERS) / np.linalg.norm(at)
        axes.text(
            at[0],
            at[1],
            leg,
            ha='center',
            va='center',
            fontweight='bold',
            fontsize=10,
        )
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)


def _label_turns(
    axes: Axes,
    region: Region,
    labelled: bool,
) -> None:
    """Label a map of self-rotation and tilt; it shows at least the tilt of the region."""
    plot_style.label_axes(axes, 'self-rotation φ, deg', 'tilt, deg' if labelled else '')
    highest = float(axes.get_ylim()[1])
    axes.set_ylim(0.0, max(highest, region.tilt_deg + CELL))
