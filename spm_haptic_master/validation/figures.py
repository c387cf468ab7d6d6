# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The paper's Figs. 32 to 34 for any comparison of forward models with motion capture."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TYPE_CHECKING

from spm_haptic_master.validation import plot_style
from spm_haptic_master.validation.comparison import Comparison, zxz_degrees

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Line styles in the order of drawing: the last one lies on top.
STYLES: dict[str, dict[str, Any]] = {
    'captured': {'color': plot_style.CAPTURE, 'label': 'motion capture', 'linewidth': 1.6},
    'classic': {'color': plot_style.CLASSIC, 'label': 'classic FKM (3 sensors)', 'linewidth': 0.9},
    'improved': {'color': plot_style.IMPROVED, 'label': 'improved FKM (4 sensors)',
                 'linewidth': 1.1},
}
# Least span of an axis (deg): an angle that moves less is not magnified.
LEAST_SPAN = 2.0


def draw(comparison: Comparison, directory: Path) -> None:
    """Draw fig32.png (all angles), fig33.png and fig34.png (self-rotation) into a directory."""
    time = comparison.time - comparison.time[0]
    angles = {name: zxz_degrees(rotations, unwrapped=True) for name, rotations in (
        *comparison.models.items(), ('captured', comparison.captured))}
    models = [name for name in STYLES if name in comparison.models]

    figure = plot_style.new_figure(height=6.0)
    for row, (axes, letter) in enumerate(zip(
            figure.subplots(3, 1, sharex=True), ('ψ', 'θ', 'φ'), strict=True)):
        for name in models:
            axes.plot(time, angles[name][row], **STYLES[name])
        low, high = axes.get_ylim()
        more = max(0.5 * (LEAST_SPAN - (high - low)), 0.0)
        axes.set_ylim(low - more, high + more)
        plot_style.label_axes(axes, 'time, s' if row == 2 else '', f'{letter}, deg')
    _finish(figure, 'Orientation of the platform by the forward models', directory / 'fig32.png')
    for number, names, title in (
            (33, models, 'Self-rotation by the forward models'),
            (34, ['captured', *models], 'Self-rotation: forward models and motion capture')):
        figure = plot_style.new_figure()
        axes = figure.subplots()
        for name in names:
            axes.plot(time, angles[name][2], **STYLES[name])
        plot_style.label_axes(axes, 'time, s', 'self-rotation φ, deg')
        _finish(figure, title, directory / f'fig{number}.png')


def _finish(figure: Figure, title: str, path: Path) -> None:
    figure.axes[0].set_title(title, fontsize=10)
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc='outside lower center', ncols=3,
                  fontsize=9)
    plot_style.save(figure, path)
