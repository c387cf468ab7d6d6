# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Style of every picture: sizes, colours, axes, how it is written as a PNG; pictures of a comparison.

The latter are the paper's Figs. 32 to 34 for any forward models and motion capture.
"""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from spm_haptic_master.exceptions import InputError
from spm_haptic_master.validation.comparison import Comparison, zxz_degrees

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as error:
    raise InputError(
        f'drawing needs matplotlib ({error}): sudo apt install python3-matplotlib, '
        "or in a virtual environment: pip install '.[validate]'"
    ) from error

# Resolution (dots per inch): an 8 inch picture fills the column of a README on a dense screen.
RESOLUTION = 110
# Default size of a picture (inch).
WIDTH = 8.0
HEIGHT = 3.4
# Colours of the models, the same everywhere: three encoders alone and all of them as on the page
# of `view` (description/colours.py); distinguishable without red and green.
REFERENCE = '#000000'
CLASSIC = '#a3308f'
MULTI_BODY = '#c08a00'
IMPROVED = '#00687a'
ESTIMATE = '#4c9be8'
CAPTURE = '#9a9a9a'
# Colour and width of the grid lines (points).
GRID_COLOUR = '#dddddd'
GRID_WIDTH = 0.6
# Line styles in the order of drawing: the last one lies on top.
STYLES: dict[str, dict[str, Any]] = {
    'captured': {
        'color': CAPTURE,
        'label': 'motion capture',
        'linewidth': 1.6,
    },
    'classic': {
        'color': CLASSIC,
        'label': 'classic FKM (3 sensors)',
        'linewidth': 0.9,
    },
    'improved': {
        'color': IMPROVED,
        'label': 'improved FKM (4 sensors)',
        'linewidth': 1.1,
    },
}
# Least span of an axis (deg): an angle that moves less is not magnified.
LEAST_SPAN = 2.0


def new_figure(
    width: float = WIDTH,
    height: float = HEIGHT,
    **layout: Any,
) -> Figure:
    """
    Return an empty picture with automatic layout.

    Parameters
    ----------
    width : float, optional
        Width, inch.
    height : float, optional
        Height, inch.
    **layout : object
        Further arguments of matplotlib's `Figure`.

    Returns
    -------
    Figure
        The picture, which belongs to no window.

    """
    return Figure(figsize=(width, height), layout='constrained', **layout)


def label_axes(
    axes: Axes,
    x: str,
    y: str,
    title: str = '',
) -> None:
    """
    Label axes, and draw a light grid behind what is drawn.

    Parameters
    ----------
    axes : Axes
        The axes.
    x : str
        Label of the x axis; may be empty.
    y : str
        Label of the y axis; may be empty.
    title : str, optional
        Title; without one none is drawn.

    """
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(True, color=GRID_COLOUR, linewidth=GRID_WIDTH)
    axes.set_axisbelow(True)


def save(figure: Figure, path: Path | BytesIO) -> None:
    """
    Write a picture as a PNG, the same bytes for the same picture.

    Parameters
    ----------
    figure : Figure
        The picture.
    path : Path or BytesIO
        File or buffer to write to.

    Raises
    ------
    InputError
        The file cannot be written.

    """
    try:
        figure.savefig(
            path,
            format='png',
            dpi=RESOLUTION,
            metadata={'Software': None},
            pil_kwargs={'optimize': True},
        )
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error


def draw_comparison(comparison: Comparison, directory: Path) -> None:
    """
    Draw a comparison as the paper's figures.

    fig32.png has all angles of the models, fig33.png their self-rotation, and fig34.png this with
    that of the motion capture.

    Parameters
    ----------
    comparison : Comparison
        Orientations of capture and models.
    directory : Path
        Directory to write to.

    Raises
    ------
    InputError
        A file cannot be written.

    """
    time = comparison.time - comparison.time[0]
    angles = {}
    for name, rotations in (*comparison.models.items(), ('captured', comparison.captured)):
        angles[name] = zxz_degrees(rotations, unwrapped=True)
    models = [name for name in STYLES if name in comparison.models]

    figure = new_figure(height=6.0)
    of_angles = figure.subplots(3, 1, sharex=True)
    for row, letter in enumerate(('ψ', 'θ', 'φ')):
        axes = of_angles[row]
        for name in models:
            axes.plot(time, angles[name][row], **STYLES[name])
        low, high = axes.get_ylim()
        more = max(0.5 * (LEAST_SPAN - (high - low)), 0.0)
        axes.set_ylim(low - more, high + more)
        label_axes(axes, 'time, s' if row == 2 else '', f'{letter}, deg')
    _finish(figure, 'Orientation of the platform by the forward models', directory / 'fig32.png')
    for number, names, title in (
        (33, models, 'Self-rotation by the forward models'),
        (34, ['captured', *models], 'Self-rotation: forward models and motion capture'),
    ):
        figure = new_figure()
        axes = figure.subplots()
        for name in names:
            axes.plot(time, angles[name][2], **STYLES[name])
        label_axes(axes, 'time, s', 'self-rotation φ, deg')
        _finish(figure, title, directory / f'fig{number}.png')


def _finish(
    figure: Figure,
    title: str,
    path: Path,
) -> None:
    """Add title and legend to a picture, and write it."""
    figure.axes[0].set_title(title, fontsize=10)
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(),
        loc='outside lower center',
        ncols=3,
        fontsize=9,
    )
    save(figure, path)
