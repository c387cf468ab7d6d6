# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One look for every picture: sizes, colours, and how it becomes a PNG."""

from __future__ import annotations

from pathlib import Path

from spm_haptic_master.exceptions import InputError

try:
    from matplotlib.figure import Figure
except ImportError as error:
    raise InputError(f'drawing needs matplotlib ({error}): apt install python3-matplotlib, or '
                     "pip install 'spm_haptic_master[validate]'") from error

# Dots an inch: an 8 inch picture is as wide as a README's column, on a dense screen too.
RESOLUTION = 110
WIDTH, HEIGHT = 8.0, 3.4  # inch
# A colour a model, everywhere; distinguishable without red and green.
REFERENCE = '#000000'
CLASSIC = '#d95f02'
MULTI_BODY = '#1b9e77'
IMPROVED = '#2b6cb0'
ESTIMATE = '#b0379b'
CAPTURE = '#9a9a9a'
LEGS = ('#c0392b', '#2e8b57', '#2b6cb0')
GRID = {'color': '#dddddd', 'linewidth': 0.6}


def new_figure(width: float = WIDTH, height: float = HEIGHT, **layout) -> Figure:
    """Return an empty picture, inches; lays itself out."""
    return Figure(figsize=(width, height), layout='constrained', **layout)


def dress(axes, x: str, y: str, title: str = '') -> None:
    """Label axes, with a light grid."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(True, **GRID)
    axes.set_axisbelow(True)


def save(figure: Figure, path: Path) -> None:
    """Write a picture as a PNG, the same bytes for the same picture."""
    try:
        figure.savefig(path, dpi=RESOLUTION, metadata={'Software': None},
                       pil_kwargs={'optimize': True})
    except OSError as error:
        raise InputError(f'{path}: cannot be written: {error}') from error
