# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Style of every picture: sizes, colours, axes, and how it is written as a PNG."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

from spm_haptic_master.exceptions import InputError

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
except ImportError as error:
    raise InputError(f'drawing needs matplotlib ({error}): sudo apt install python3-matplotlib, '
                     "or in a virtual environment: pip install '.[validate]'") from error

# Resolution (dots per inch): an 8 inch picture fills the column of a README on a dense screen.
RESOLUTION = 110
# Default size of a picture (inch).
WIDTH, HEIGHT = 8.0, 3.4
# Colours of the models, the same everywhere; distinguishable without red and green.
REFERENCE = '#000000'
CLASSIC = '#d95f02'
MULTI_BODY = '#1b9e77'
IMPROVED = '#2b6cb0'
ESTIMATE = '#b0379b'
CAPTURE = '#9a9a9a'
# Colour and width of the grid lines (points).
GRID_COLOUR, GRID_WIDTH = '#dddddd', 0.6


def new_figure(width: float = WIDTH, height: float = HEIGHT, **layout: Any) -> Figure:
    """Return an empty picture of a size in inches, with automatic layout."""
    return Figure(figsize=(width, height), layout='constrained', **layout)


def label_axes(axes: Axes, x: str, y: str, title: str = '') -> None:
    """Label axes, and draw a light grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(True, color=GRID_COLOUR, linewidth=GRID_WIDTH)
    axes.set_axisbelow(True)


def save(figure: Figure, path: Path | BytesIO) -> None:
    """Write a PNG, the same bytes for the same picture; InputError where that is not possible."""
    try:
        figure.savefig(path, format='png', dpi=RESOLUTION, metadata={'Software': None},
                       pil_kwargs={'optimize': True})
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error
