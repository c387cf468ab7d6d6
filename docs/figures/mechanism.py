# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Draw mechanism.png: the device with its four encoders, and the symbols of leg A."""

from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
from paper.linkage_drawing import arc, Linkage
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import Geometry, inverse, workspace_pose
from spm_haptic_master.validation import plot_style

OUTPUT = Path(__file__).with_name('mechanism.png')
# Tilt and self-rotation of the drawn pose (deg): links and platform do not hide each other.
TILT, AZIMUTH, PHI = 8.0, 60.0, 15.0
# Direction from the centre O to the eye, in the base frame.
EYE = np.array([1.0, 0.2, 0.55])
SENSOR = '#e0a100'
FAINT = '#9aa1ab'


class Picture:
    """
    A parallel projection onto plain axes.

    Parameters
    ----------
    axes : matplotlib Axes
        Axes to draw on.
    eye : ndarray, shape (3,)
        Direction from the centre of the sphere to the eye.

    """

    def __init__(self, axes, eye: np.ndarray):
        self._axes = axes
        toward = eye / np.linalg.norm(eye)
        right = np.cross([0.0, 0.0, 1.0], toward)
        right /= np.linalg.norm(right)
        self._plane = np.stack([right, np.cross(toward, right)], axis=-1)
        axes.set_aspect('equal')
        axes.set_axis_off()

    def line(self, points, **style) -> None:
        """Draw a line through points, shape (n, 3)."""
        self._axes.plot(
            *(np.asarray(points) @ self._plane).T, **{'solid_capstyle': 'round', **style}
        )

    def dot(self, point, **style) -> None:
        """Mark a point, shape (3,)."""
        self._axes.plot(*(point @ self._plane)[:, None], 'o', **style)

    def fill(self, points, **style) -> None:
        """Fill a closed line of points, shape (n, 3)."""
        self._axes.fill(*(np.asarray(points) @ self._plane).T, **style)

    def arrow(self, points, **style) -> None:
        """Draw a line with an arrow head at its end, shape (n, 3)."""
        flat = np.asarray(points) @ self._plane
        self._axes.plot(*flat[:-1].T, **{'solid_capstyle': 'butt', **style})
        self._axes.annotate(
            '',
            xy=flat[-1],
            xytext=flat[-3],
            zorder=style.get('zorder', 3),
            arrowprops={
                'arrowstyle': '-|>',
                'color': style['color'],
                'lw': style['linewidth'],
                'shrinkA': 0,
                'shrinkB': 0,
                'mutation_scale': 11,
            },
        )

    def text(self, point, words: str, shift=(0.0, 0.0), **style) -> None:
        """Write at a point, shape (3,), shifted in the picture's plane."""
        self._axes.text(
            *(point @ self._plane + np.array(shift)),
            words,
            **{'ha': 'center', 'va': 'center', 'fontsize': 10, 'zorder': 9, **style},
        )


def turn_about(
    axis: np.ndarray, distance: float, radius: float, start: float, sweep: float
) -> np.ndarray:
    """Return points of a right-handed turn about an axis, at a distance along it, (n, 3)."""
    side = np.cross(axis, [0.3, -0.5, 0.8])
    side /= np.linalg.norm(side)
    angle = np.radians(np.linspace(start, start + sweep, 40))[:, None]
    return distance * axis + radius * (np.cos(angle) * side + np.sin(angle) * np.cross(axis, side))


def draw_leg(picture: Picture, linkage: Linkage, leg: int) -> None:
    """Draw a leg's joint axes, links and joints; proximal link thick, distal link thinner."""
    color = LEGS[leg]
    joints = linkage.first[leg], linkage.second[leg], linkage.third[leg]
    for joint in joints:
        picture.line([np.zeros(3), joint], color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)))
    for start, end, width in ((joints[0], joints[1], 9.0), (joints[1], joints[2], 5.5)):
        picture.line(arc(start, end), color='white', linewidth=width + 2.5, zorder=3)
        picture.line(arc(start, end), color=color, linewidth=width, zorder=3)
    for joint in joints:
        picture.dot(
            joint,
            markersize=8,
            color='white',
            markeredgecolor=color,
            markeredgewidth=1.8,
            zorder=5,
        )


def draw_platform(picture: Picture, linkage: Linkage) -> None:
    """Draw the platform, its axis Z_E and the surgeon's handle on it."""
    rim = np.concatenate([arc(linkage.third[k], linkage.third[(k + 1) % 3]) for k in range(3)])
    picture.fill(rim, facecolor='#c9ced6', edgecolor='#6c7480', linewidth=1.2, zorder=2)
    axis = linkage.platform
    picture.line([np.zeros(3), axis], color=FAINT, linewidth=0.8, linestyle=(0, (4, 3)))
    picture.line([axis, 1.42 * axis], color='#2f343b', linewidth=5.0, zorder=6)


def draw_encoder(
    picture: Picture, axis: np.ndarray, distance: float, name: str, shift, start: float = 20.0
) -> None:
    """Draw a sensed joint: a disc on the axis, the positive sense of its turn, its name."""
    picture.fill(
        turn_about(axis, distance, 0.085, 0.0, 360.0),
        facecolor=SENSOR,
        edgecolor='#7a5800',
        linewidth=1.0,
        zorder=6,
    )
    picture.line([axis, distance * axis], color='#7a5800', linewidth=1.4, zorder=5)
    picture.arrow(
        turn_about(axis, distance, 0.16, start, 285.0), color='#7a5800', linewidth=1.3, zorder=7
    )
    picture.text(distance * axis, name, shift, fontweight='bold', fontsize=11, color='#5c4300')


def draw_base(picture: Picture, linkage: Linkage) -> None:
    """Draw the base that carries the three motors, and the centre O."""
    for k in range(3):
        picture.line(
            1.16 * arc(linkage.first[k], linkage.first[(k + 1) % 3]),
            color='#e3e6ea',
            linewidth=6.0,
            zorder=1,
        )
    picture.dot(np.zeros(3), markersize=5, color='#2f343b', zorder=4)


def device(picture: Picture, linkage: Linkage) -> None:
    """Draw the three legs, the platform and the four encoders."""
    draw_base(picture, linkage)
    draw_platform(picture, linkage)
    for leg in range(3):
        draw_leg(picture, linkage, leg)
    picture.text(np.zeros(3), 'O', (-0.07, -0.06))
    for axis, distance, name, shift in (
        (linkage.first[0], 1.16, 'th1A', (0.34, 0.03)),
        (linkage.first[1], 1.16, 'th1B', (0.0, -0.27)),
        (linkage.first[2], 1.16, 'th1C', (0.0, -0.27)),
        (linkage.third[0], 1.13, 'th3A', (-0.02, 0.27)),
    ):
        draw_encoder(picture, axis, distance, name, shift)
    picture.text(1.42 * linkage.platform, '$Z_E$', (0.0, 0.09), fontsize=12)
    for leg, shift in ((0, (-0.13, 0.1)), (1, (-0.05, -0.14)), (2, (0.19, 0.0))):
        middle = arc(linkage.first[leg], linkage.second[leg])[15]
        picture.text(middle, f'leg {"ABC"[leg]}', shift, color=LEGS[leg], fontweight='bold')
    picture.text(linkage.platform, 'platform', (0.09, -0.2), fontsize=9, color='#4a515b')


def leg_a(picture: Picture, linkage: Linkage) -> None:
    """Draw leg A with the angles of its links, its joint axes and its joint angles."""
    draw_platform(picture, linkage)
    draw_leg(picture, linkage, 0)
    picture.dot(np.zeros(3), markersize=5, color='#2f343b', zorder=4)
    picture.text(np.zeros(3), 'O', (-0.07, -0.06))
    first, second, third = linkage.first[0], linkage.second[0], linkage.third[0]
    picture.line(
        arc(third, linkage.platform),
        color='#2f343b',
        linewidth=1.5,
        linestyle=(0, (2, 2)),
        zorder=4,
    )
    for start, end, name, shift in (
        (first, second, 'α', (-0.09, 0.04)),
        (second, third, 'β', (0.02, -0.09)),
        (third, linkage.platform, 'γ', (0.06, 0.05)),
    ):
        picture.text(arc(start, end)[15], name, shift, fontweight='bold', fontsize=14)
    for axis, name, angle, shift in (
        (first, '$Z_{1A}$', 'th1A', (0.33, 0.0)),
        (second, '$Z_{2A}$', 'th2A', (-0.1, 0.15)),
        (third, '$Z_{3A}$', 'th3A', (0.24, 0.07)),
    ):
        picture.line([axis, 1.25 * axis], color=FAINT, linewidth=1.2, zorder=2)
        picture.arrow(
            turn_about(axis, 1.2, 0.11, 20.0, 285.0), color='#7a5800', linewidth=1.3, zorder=7
        )
        picture.text(1.27 * axis, f'{name}, {angle}', shift, fontsize=11)
    picture.text(1.42 * linkage.platform, '$Z_E$', (0.06, 0.09), fontsize=12)


def main() -> None:
    """Write mechanism.png beside this file."""
    R = workspace_pose(radians(TILT), radians(AZIMUTH), radians(PHI))
    linkage = Linkage.at(inverse(R).theta1, R, Geometry())
    figure = plot_style.new_figure(width=8.0, height=4.4)
    left, right = figure.subplots(1, 2)
    device(Picture(left, EYE), linkage)
    leg_a(Picture(right, EYE), linkage)
    left.set_title('three legs, one platform, four encoders', fontsize=10)
    right.set_title('leg A: link angles, joint axes, joint angles', fontsize=10)
    plot_style.save(figure, OUTPUT)


if __name__ == '__main__':
    main()
