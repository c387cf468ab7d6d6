# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""A picture of a supervised recording: parity, protection level, exposure, what is published."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.recording import Supervised
from spm_haptic_master.validation import plot_style
from spm_haptic_master.validation.parity_map import ParityMap

# Colours of the sensors.
SENSORS = (*LEGS, plot_style.ESTIMATE, plot_style.CLASSIC, plot_style.REFERENCE)
# Largest number of points of a curve (points): more do not show.
POINTS = 20_000
# Background of the times without an orientation.
WITHHELD = {'color': plot_style.CLASSIC, 'alpha': 0.25, 'linewidth': 0.0}


def draw(
    path: Path,
    seconds: NDArray[np.float64],
    found: ParityMap,
    result: Supervised,
    alert_limit_deg: float,
) -> None:
    """
    Draw parity, protection level and exposure over time, and the parity over the workspace.

    Times without a published orientation are shaded.

    Parameters
    ----------
    path : Path
        PNG file to write.
    seconds : ndarray, shape (n,)
        Times of the samples from the first, s.
    found : ParityMap
        Parity of the samples, and where the platform was.
    result : Supervised
        Result of their supervision.
    alert_limit_deg : float
        Alert limit, drawn as a line, deg.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    every = max(1, len(seconds) // POINTS)
    t = seconds[::every]
    figure = plot_style.new_figure(height=8.5)
    parity, level, exposure, map_ = figure.subplots(
        4,
        1,
        gridspec_kw={'height_ratios': [2, 2, 2, 3]},
    )
    parity.plot(t, found.parity_deg[::every], '.', markersize=1.0, color=plot_style.IMPROVED)
    plot_style.label_axes(parity, '', 'parity, deg', 'Shaded: orientation withheld')
    level.plot(t, result.protection_level[::every], '.', markersize=1.5, color=plot_style.ESTIMATE)
    level.axhline(
        alert_limit_deg,
        color=plot_style.CLASSIC,
        linestyle='--',
        linewidth=1.0,
        label='alert limit',
    )
    level.set_ylim(bottom=0.0)
    level.legend(loc='lower left')
    plot_style.label_axes(level, '', 'protection level, deg')
    for column, name, colour in zip(result.unchecked.T, ALL_JOINT_NAMES, SENSORS, strict=False):
        times = column[::every]
        exposure.plot(
            t,
            np.where(np.isfinite(times), times, t),
            color=colour,
            label=name,
            linewidth=1.2,
        )
    exposure.legend(loc='upper left', ncols=len(result.unchecked.T))
    plot_style.label_axes(exposure, 'time, s', 'unchecked, s')
    for axes in (parity, level, exposure):
        axes.set_xlim(seconds[0], seconds[-1])
        _shade(axes, seconds, ~result.published)
    _draw_map(figure, map_, found, every)
    plot_style.save(figure, path)


def _draw_map(
    figure: Any,
    axes: Any,
    found: ParityMap,
    every: int,
) -> None:
    """
    Draw the parity over tilt and self-rotation.

    The scale of the colours covers 98 % of the samples.

    Parameters
    ----------
    figure : object
        The picture.
    axes : object
        Where to draw.
    found : ParityMap
        Parity of the samples.
    every : int
        Step of the samples that are drawn.

    """
    parity = found.parity_deg[::every]
    known = parity[np.isfinite(parity)]
    largest = float(np.percentile(np.abs(known), 98.0)) if len(known) else 1.0
    points = axes.scatter(
        found.phi_deg[::every],
        found.tilt_deg[::every],
        c=parity,
        s=3.0,
        cmap='coolwarm',
        vmin=-largest,
        vmax=largest,
        linewidths=0.0,
    )
    figure.colorbar(points, ax=axes, label='parity, deg')
    plot_style.label_axes(axes, 'self-rotation φ, deg', 'tilt, deg')


def _shade(
    axes: Any,
    seconds: NDArray[np.float64],
    withheld: NDArray[np.bool_],
) -> None:
    """
    Shade the times at which no orientation is published.

    Parameters
    ----------
    axes : object
        Where to draw.
    seconds : ndarray, shape (n,)
        Times, s.
    withheld : ndarray of bool, shape (n,)
        Whether the orientation of a sample is withheld.

    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], withheld, [False]])))
    last = len(seconds) - 1
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(seconds[begin], seconds[min(end, last)], **WITHHELD)
