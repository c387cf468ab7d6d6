# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The pictures of a calibration from free motion: parity, coverage, harmonics, correlation."""

from __future__ import annotations

from io import BytesIO
from math import degrees, pi
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.free_motion import MotionCalibration
from spm_haptic_master.calibration.mechanism_parameters import Array
from spm_haptic_master.calibration.motion_coverage import TARGET_TILTS_DEG, TARGET_TURNS_DEG
from spm_haptic_master.calibration.motion_tables import further_motions, joint_angles
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import workspace_pose, zxz_from_matrix
from spm_haptic_master.kinematics.geometry_checks import LEG_NAMES
from spm_haptic_master.validation import plot_style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

# Edge of the cells of the maps: across the tilt, and along the self-rotation (deg). A cell that is
# passed in 0.1 s has a mean parity with a tenth of the noise of a reading.
CELL, TURN_CELL = 2.0, 4.0
# Least time in a cell whose mean parity is drawn (s).
CELL_SECONDS = 0.05
# Part of the cells that the colour scale covers (percent): the last ones are spikes.
SCALE_PERCENT = 98.0
# Colours of signed values, of times, and of what the motion did not reach; the first two are
# distinguishable without red and green.
SIGNED, TIMES, NOWHERE = 'RdBu_r', 'viridis', '#c4c4c4'
# Width of the rim with the legs' letters, beyond the outermost cell (deg).
LETTERS = 3.0
# Number of further motions that are listed.
LISTED = 3
# Points of a curve over the turn (points).
POINTS = 361
# Part of the readings on either side of the range that a joint moved through (percent).
RANGE_PERCENT = 0.1

# Pictures, in the order of the report: the end of the file's name and the caption.
CAPTIONS = {
    'parity': 'Parity of the motion over the workspace, means of cells, before (directions and '
              'zeros only, the mechanism as drawn) and after the calibration; on the right the '
              'same as in the middle, on its own scale. A, B, C: tilt towards the motor of that '
              f'leg. Grey: less than {CELL_SECONDS} s there.',
    'coverage': 'Time that the motion spent in the parts of the workspace. Dashed: the part in '
                'which the calibration has to be right. A, B, C as above. Grey: not '
                'reached.',
    'harmonics': 'Deviation of each encoder over the turn of its joint, with 1 standard '
                 'deviation. Shaded: the range that the joint moved through; beyond it nothing is '
                 'measured. Over a short range a deviation is much like another zero: the two are '
                 'known together better than each by itself.',
    'correlation': 'Correlation of the errors of the estimated parameters. Those of a strong '
                   'correlation are known together better than each by itself.',
}


def draw(calibration: MotionCalibration) -> dict[str, bytes]:
    """
    Return the pictures of a calibration by the names of `CAPTIONS`, as PNG.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of the motion.

    """
    figures = {'parity': _parity(calibration), 'coverage': _coverage(calibration),
               'harmonics': _harmonics(calibration), 'correlation': _correlation(calibration)}
    return {name: _png(figure) for name, figure in figures.items()}


def _png(figure: Figure) -> bytes:
    file = BytesIO()
    figure.savefig(file, format='png', dpi=plot_style.RESOLUTION, metadata={'Software': None},
                   pil_kwargs={'optimize': True})
    return file.getvalue()


def _places(rotation: Array) -> tuple[Array, Array, Array]:
    """Return the tilt towards (1, -1, 0) and (1, 1, -2), and the self-rotation, deg."""
    centre, one, other = (workspace_pose(tilt, azimuth, 0.0)[:, 2] for tilt, azimuth in (
        (0.0, 0.0), (0.5 * pi, 0.0), (0.5 * pi, 0.5 * pi)))
    axis = rotation[:, :, 2]
    x, y = axis @ one, axis @ other
    factor = np.degrees(np.arctan2(np.hypot(x, y), axis @ centre)) / np.maximum(
        np.hypot(x, y), 1e-12)
    turn = zxz_from_matrix(rotation)[2]
    # Around the middle of the motion, so that no map is cut at half a turn.
    middle = np.angle(np.exp(1j * turn).sum())
    turn = middle + np.angle(np.exp(1j * (turn - middle)))
    return x * factor, y * factor, np.degrees(turn)


class _Cells:
    """Cells of two coordinates, deg, with means of what was measured in them."""

    def __init__(self, x: Array, y: Array, edge_x: float, edge_y: float):
        self.x, self.y = _edges(x, edge_x), _edges(y, edge_y)
        self._at = x, y

    def total(self, values: Array) -> Array:
        """Return the sums of values in the cells, shape (x, y)."""
        found: Array = np.histogram2d(*self._at, bins=(self.x, self.y), weights=values)[0]
        return found

    def mean(self, values: Array, least: int) -> Array:
        """Return the mean values in the cells; NaN where there are less than `least`."""
        number = self.total(np.ones_like(values))
        found: Array = np.where(number >= least, self.total(values) / np.maximum(number, 1.0),
                                np.nan)
        return found

    def fill(self, axes: Axes, values: Array, cmap: str, low: float, high: float) -> QuadMesh:
        """Fill the cells with colours."""
        axes.set_facecolor(NOWHERE)
        return axes.pcolormesh(self.x, self.y, np.ma.masked_invalid(values).T, cmap=cmap,
                               vmin=low, vmax=high)


def _edges(values: Array, step: float) -> Array:
    found: Array = step * np.arange(np.floor(values.min() / step),
                                    np.floor(values.max() / step) + 2.0)
    return found


def _parity(c: MotionCalibration) -> Figure:
    """Draw the mean parity over tilt and self-rotation, before and after."""
    known = np.isfinite(c.rotation).all(axis=(1, 2)) & np.isfinite(c.parity) \
        & np.isfinite(c.parity_before)
    x, y, turn = _places(c.rotation[known])
    least = max(1, round(CELL_SECONDS / _period(c)))
    cells = (_Cells(x, y, CELL, CELL), _Cells(turn, np.hypot(x, y), TURN_CELL, CELL))
    before, after = ([each.mean(np.degrees(parity[known]), least) for each in cells]
                     for parity in (c.parity_before, c.parity))
    wide, narrow = _scale(before), _scale(after)
    columns = ((before, wide, f'before: {_rms(c.parity_before):.4f} deg rms'),
               (after, wide, f'after: {_rms(c.parity):.4f} deg rms'),
               (after, narrow, 'after, own scale'))
    figure = plot_style.new_figure(width=10.0, height=7.0)
    rows = figure.subplots(2, 3, gridspec_kw={'height_ratios': [3, 2]})
    for number, (values, largest, title) in enumerate(columns):
        for axes, each, value in zip(rows[:, number], cells, values, strict=True):
            mesh = each.fill(axes, value, SIGNED, -largest, largest)
        _tilt_map(rows[0, number], _reach(x, y), title, number == 0)
        plot_style.label_axes(rows[1, number], 'self-rotation φ, deg',
                              'tilt, deg' if number == 0 else '')
        rows[1, number].set_ylim(bottom=0.0)
        if number:
            beside = rows[:, :2] if number == 1 else rows[:, 2]
            figure.colorbar(mesh, ax=beside, label='mean parity, deg', extend='both',
                            location='bottom', shrink=0.9, aspect=40 if number == 1 else 20)
    return figure


def _scale(values: list[Array]) -> float:
    every = np.abs(np.concatenate([each[np.isfinite(each)] for each in values]))
    return float(np.percentile(every, SCALE_PERCENT)) if every.size and every.any() else 1.0


def _rms(parity: Array) -> float:
    return degrees(float(np.sqrt(np.nanmean(parity ** 2))))


def _period(c: MotionCalibration) -> float:
    """Return the time between the readings of a calibration, s."""
    return float(np.median(np.diff(c.readings.seconds)))


def _reach(x: Array, y: Array) -> float:
    """Return the radius of a map of the tilt, deg."""
    return max(float(np.hypot(x, y).max()) + CELL, TARGET_TILTS_DEG[-1]) + LETTERS


def _tilt_map(axes: Axes, reach: float, title: str, labelled: bool = True) -> None:
    """Label a map of the tilt, and name the directions of the legs' motors."""
    axes.set_aspect('equal')
    plot_style.label_axes(axes, 'tilt towards (1, −1, 0), deg',
                          'tilt towards (1, 1, −2), deg' if labelled else '', title)
    # The nominal motors A, B, C are on z, x, y.
    motors = np.eye(3)[[2, 0, 1]]
    one, other = (workspace_pose(0.5 * pi, azimuth, 0.0)[:, 2] for azimuth in (0.0, 0.5 * pi))
    for leg, motor in zip(LEG_NAMES, motors, strict=True):
        at = np.array([motor @ one, motor @ other])
        at *= (reach - 0.5 * LETTERS) / np.linalg.norm(at)
        axes.text(at[0], at[1], leg, ha='center', va='center', fontweight='bold', fontsize=10)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(-reach, reach)


def _coverage(c: MotionCalibration) -> Figure:
    """Draw the time in each part of the workspace, and which further motions are proposed."""
    x, y, turn = _places(c.rotation[np.isfinite(c.rotation).all(axis=(1, 2))])
    tilt = np.hypot(x, y)
    figure = plot_style.new_figure(width=9.0, height=5.2)
    left, right = figure.subplots(1, 2)
    for axes, cells in ((left, _Cells(x, y, CELL, CELL)),
                        (right, _Cells(turn, tilt, TURN_CELL, CELL))):
        seconds = cells.total(np.full(len(x), _period(c)))
        mesh = cells.fill(axes, np.where(seconds > 0.0, seconds, np.nan), TIMES, 0.0,
                          float(seconds.max()))
        figure.colorbar(mesh, ax=axes, location='bottom', label='time in a cell, s', shrink=0.9)
    _tilt_map(left, _reach(x, y), 'direction of the tilt')
    target = {'color': plot_style.REFERENCE, 'linestyle': '--', 'linewidth': 1.2}
    circle = np.linspace(0.0, 2.0 * pi, 200)
    left.plot(TARGET_TILTS_DEG[-1] * np.cos(circle), TARGET_TILTS_DEG[-1] * np.sin(circle),
              **target)
    first, last = TARGET_TURNS_DEG[0], TARGET_TURNS_DEG[-1]
    right.plot([first, first, last, last], [0.0, TARGET_TILTS_DEG[-1], TARGET_TILTS_DEG[-1], 0.0],
               **target)
    right.set_ylim(0.0, max(float(right.get_ylim()[1]), TARGET_TILTS_DEG[-1] + CELL))
    plot_style.label_axes(right, 'self-rotation φ, deg', 'tilt, deg', 'tilt and self-rotation')
    listed = [f'{number}. {motion.text} (predicted error × '
              f'{motion.gain ** -0.5:.2f})'
              for number, motion in enumerate(further_motions(c)[:LISTED], 1)]
    if listed:
        figure.suptitle('Further motions that would determine most:\n' + '\n'.join(listed),
                        fontsize=9, ha='left', x=0.06)
    return figure


def _harmonics(c: MotionCalibration) -> Figure:
    """Draw the deviation of each encoder over the turn, and where it was measured."""
    layout = c.layout
    angle = np.linspace(-pi, pi, POINTS)
    moved = np.degrees(joint_angles(c))
    figure = plot_style.new_figure(width=9.0, height=2.7 * -(-layout.sensors // 2))
    places = figure.subplots(-(-layout.sensors // 2), 2, sharex=True, sharey=True,
                             squeeze=False)
    waves = np.column_stack([np.cos(angle), np.sin(angle), np.cos(2.0 * angle),
                             np.sin(2.0 * angle)])
    for sensor, axes in enumerate(places.flat):
        if sensor >= layout.sensors:
            axes.set_axis_off()
            continue
        own = [layout.slices[group].start + 2 * sensor + part
               for group in ('first harmonics', 'second harmonics') for part in (0, 1)]
        value = np.degrees(waves @ c.vector[own])
        deviation = np.degrees(np.sqrt(np.einsum(
            'ni,ij,nj->n', waves, c.covariance[np.ix_(own, own)], waves)))
        low, high = np.nanpercentile(moved[:, sensor], [RANGE_PERCENT, 100.0 - RANGE_PERCENT])
        for turn in (-360.0, 0.0, 360.0):
            axes.axvspan(low + turn, high + turn, color=plot_style.CLASSIC, alpha=0.18,
                         linewidth=0.0, label='moved through' if turn == 0.0 else None)
        axes.fill_between(np.degrees(angle), value - deviation, value + deviation,
                          color=plot_style.IMPROVED, alpha=0.3, linewidth=0.0,
                          label='± 1 standard deviation')
        axes.plot(np.degrees(angle), value, color=plot_style.IMPROVED, linewidth=1.6,
                  label='deviation')
        axes.axhline(0.0, color=plot_style.REFERENCE, linewidth=0.6)
        drawn = '' if set(own) & set(c.estimated) else ', not estimated'
        plot_style.label_axes(
            axes, 'joint angle, deg' if sensor >= layout.sensors - 2 else '',
            'deviation, deg' if sensor % 2 == 0 else '', f'{ALL_JOINT_NAMES[sensor]}{drawn}')
        axes.set_xlim(-180.0, 180.0)
        axes.set_xticks(range(-180, 181, 60))
        axes.tick_params(labelbottom=sensor >= layout.sensors - 2)
    figure.legend(*places[0, 0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  fontsize=9)
    return figure


def _correlation(c: MotionCalibration) -> Figure:
    """Draw the correlation matrix of the estimated parameters."""
    chosen: NDArray[np.intp] = np.array(c.estimated, dtype=np.intp)
    names = [c.layout.names[column] for column in chosen]
    deviation = c.deviations[chosen]
    matrix = c.covariance[np.ix_(chosen, chosen)] / np.outer(deviation, deviation)
    side = 2.6 + 0.18 * len(names)
    figure = plot_style.new_figure(width=side + 1.3, height=side)
    axes = figure.subplots()
    picture = axes.imshow(matrix, cmap=SIGNED, vmin=-1.0, vmax=1.0)
    at = range(len(names))
    axes.set_xticks(at, [name.replace('harmonic of ', '') for name in names], rotation=90,
                    fontsize=7)
    axes.set_yticks(at, names, fontsize=7)
    ends = [column for column in at if column and _group(c, chosen[column]) != _group(
        c, chosen[column - 1])]
    for end in ends:
        for line in (axes.axhline, axes.axvline):
            line(end - 0.5, color=plot_style.REFERENCE, linewidth=0.8)
    figure.colorbar(picture, ax=axes, label='correlation (unit 1)', shrink=0.7)
    return figure


def _group(c: MotionCalibration, column: int) -> str:
    """Return the group of a parameter."""
    return next(group for group, part in c.layout.slices.items()
                if part.start <= column < part.stop)
