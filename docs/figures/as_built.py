# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw as_built.png: the frames and zeros of a leg whose axes are not where the drawing says."""

from __future__ import annotations

from math import radians
from pathlib import Path

from docs.figures.mechanism import FAINT, Picture, SENSOR, turn_about
import numpy as np
from paper.linkage_drawing import arc
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.validation import plot_style

OUTPUT = Path(__file__).with_name('as_built.png')
# Deviation of the drawn axes from the nominal ones (deg): far more than a real rig has.
DEVIATION = 20.0
# Drawn leg: 0 for A.
LEG = 0
EYE_BASE = np.array([1.0, 0.55, 0.45])
EYE_PLATFORM = np.array([1.0, 0.35, 0.8])
COLOR = LEGS[LEG]
INK = '#2f343b'


def mechanism() -> Geometry:
    """Return a mechanism whose leg A is far from nominal, in links and axes."""
    g = Geometry(radians(55.0), radians(50.0), radians(35.0))
    base, platform = np.array(g.base_axes), np.array(g.platform_axes)
    off = radians(DEVIATION)
    base[LEG] = np.cos(off) * base[LEG] + np.sin(off) * np.array([0.28, 0.96, 0.0])
    side = np.cross(platform[LEG], [0.0, 0.0, 1.0])
    platform[LEG] = np.cos(off) * platform[LEG] - np.sin(off) * side / np.linalg.norm(side)
    return Geometry.from_axes(base, platform, g.alphas, g.betas)


def axis(
    picture: Picture, vector: np.ndarray, name: str, shift, length: float = 1.25, **style
) -> None:
    """Draw an axis from O with its name."""
    picture.line([np.zeros(3), length * vector], **{'linewidth': 1.3, 'color': INK, **style})
    picture.text(length * vector, name, shift, fontsize=11, color=style.get('color', INK))


def link(
    picture: Picture, start: np.ndarray, end: np.ndarray, width: float, name: str, shift
) -> None:
    """Draw a link as an arc between two axes, with the name of its angle."""
    picture.line(arc(start, end), color=COLOR, linewidth=width, zorder=3)
    for joint in (start, end):
        picture.dot(
            joint,
            markersize=8,
            color='white',
            markeredgecolor=COLOR,
            markeredgewidth=1.8,
            zorder=5,
        )
    picture.text(arc(start, end)[15], name, shift, fontsize=13, fontweight='bold')


def turned(picture: Picture, nominal: np.ndarray, built: np.ndarray, shift) -> None:
    """Draw where the axis is on a nominal mechanism, and the smallest turn from there."""
    picture.line([np.zeros(3), 1.1 * nominal], color=FAINT, linewidth=1.2, linestyle=(0, (4, 3)))
    picture.arrow(1.05 * arc(nominal, built)[2:-1], color=SENSOR, linewidth=2.2, zorder=6)
    picture.text(
        1.05 * arc(nominal, built)[10], 'smallest turn', shift, fontsize=9, color='#5c4300'
    )


def base(picture: Picture, g: Geometry) -> None:
    """Draw leg A's frame in the base with th1A at zero."""
    leg = g.legs[LEG]
    x, y, z = np.reshape(leg.base_frame, (3, 3)).T
    for vector, name, shift in (
        (np.eye(3)[0], 'x', (0.0, -0.06)),
        (np.eye(3)[1], 'y', (0.06, 0)),
        (np.eye(3)[2], 'z', (-0.04, 0.06)),
    ):
        axis(picture, vector, name, shift, 1.18, color=FAINT, linestyle=(0, (4, 3)))
    turned(picture, np.eye(3)[2], z, (0.5, -0.16))
    axis(picture, z, '$Z_{1A}$', (0.03, 0.08), 1.35)
    axis(picture, x, '$x_A$', (0.02, -0.07), 1.0)
    axis(picture, y, '$y_A$', (0.05, 0.06), 1.0)
    second = leg.second[0] + np.array(leg.second[1])
    axis(picture, second, '$Z_{2A}$ at th1A = 0', (-0.05, 0.1))
    link(picture, z, second, 7.0, '$α_A$', (0.05, -0.12))
    picture.arrow(turn_about(z, 1.2, 0.12, 20.0, 285.0), color='#7a5800', linewidth=1.3, zorder=7)
    picture.text(1.2 * z, 'th1A', (0.27, 0.0), fontsize=11)


def platform(picture: Picture, g: Geometry) -> None:
    """Draw leg A's frame in the platform with th3A at zero."""
    leg = g.legs[LEG]
    x, y, z = np.reshape(leg.platform_frame, (3, 3)).T
    axes = np.array(g.platform_axes)
    rim = np.concatenate([arc(axes[k], axes[(k + 1) % 3]) for k in range(3)])
    picture.fill(rim, facecolor='#c9ced6', edgecolor='#6c7480', linewidth=1.2, zorder=1)
    for vector, name, shift in (
        (np.eye(3)[0], 'x', (-0.04, -0.05)),
        (np.eye(3)[1], 'y', (0.06, 0.0)),
    ):
        axis(picture, vector, name, shift, 1.1, color=FAINT, linestyle=(0, (4, 3)))
    turned(picture, np.eye(3)[2], z, (0.1, 0.17))
    axis(picture, np.eye(3)[2], '$Z_E$', (-0.07, 0.05), 1.25)
    axis(picture, z, '$Z_{3A}$', (0.1, 0.05))
    axis(picture, x, '$x_A$', (-0.03, -0.06), 1.0)
    axis(picture, y, '$y_A$', (0.08, 0.0), 1.0)
    second = np.cos(g.betas[LEG]) * z + np.sin(g.betas[LEG]) * y
    axis(picture, second, '$Z_{2A}$ at th3A = 0', (0.27, 0.06))
    link(picture, z, second, 4.5, '$β_A$', (0.08, 0.05))
    picture.arrow(turn_about(z, 1.12, 0.1, 20.0, 285.0), color='#7a5800', linewidth=1.3, zorder=7)
    picture.text(1.12 * z, 'th3A', (0.26, -0.05), fontsize=11)


def main() -> None:
    """Write as_built.png beside this file."""
    g = mechanism()
    figure = plot_style.new_figure(width=8.0, height=3.7)
    left, right = figure.subplots(1, 2)
    for axes in (left, right):
        axes.set_anchor('N')
    base(Picture(left, EYE_BASE), g)
    platform(Picture(right, EYE_PLATFORM), g)
    left.set_title('in the base: frame $B_A$, zero of th1A', fontsize=10, pad=14)
    right.set_title('in the platform: frame $Q_A$, zero of th3A', fontsize=10, pad=14)
    plot_style.save(figure, OUTPUT)


if __name__ == '__main__':
    main()
