"""The manipulator drawn as a spherical linkage: joint axes as points, links as arcs of a sphere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.legs import second_axis_a, second_axis_b, second_axis_c
from spm_haptic_master.tools.drawing import LEGS

FIRST = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Points of an arc, and of the sphere's grid lines.
ARC_POINTS = 30
# deg; the workspace's centre (1, 1, 1) towards the eye, a little from the side so that arcs of one
# plane do not hide each other.
VIEW = {'elev': 30.0, 'azim': 62.0}


@dataclass(frozen=True, slots=True)
class Linkage:
    """
    Joint axes in the base frame.

    Attributes
    ----------
    first, second, third : ndarray, shape (3, 3)
        Z1k, Z2k, Z3k, a row a leg.
    platform : ndarray, shape (3,)
        Z_E.

    """

    first: np.ndarray
    second: np.ndarray
    third: np.ndarray
    platform: np.ndarray

    @classmethod
    def at(cls, th1: np.ndarray, R: np.ndarray, g: Geometry) -> Linkage:
        """Return the linkage with active joints th1 and the platform at R."""
        second = [axis(np.cos(angle), np.sin(angle), g) for axis, angle in zip(
            (second_axis_a, second_axis_b, second_axis_c), th1, strict=True)]
        return cls(FIRST, np.array(second), (R @ np.array(g.platform_axes).T).T, R[:, 2])


def arc(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return points of the great circle from one unit vector to another, shape (n, 3)."""
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    part = np.linspace(0.0, 1.0, ARC_POINTS)[:, None]
    return (np.sin((1.0 - part) * angle) * start + np.sin(part * angle) * end) / np.sin(angle)


def axes_3d(figure, place, title: str):
    """Return 3D axes with a sphere to draw linkages on."""
    axes = figure.add_subplot(place, projection='3d')
    axes.view_init(**VIEW)
    axes.set_proj_type('ortho')
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.55)
    axes.set_axis_off()
    axes.set_title(title, fontsize=10)
    # The octant of the sphere in which the device works, as a light net.
    for angle in np.linspace(0.0, 0.5 * np.pi, 7):
        c, s = np.cos(angle), np.sin(angle)
        axes.plot(*arc(np.array([c, s, 0.0]), np.array([0.0, 0.0, 1.0])).T,
                  color='#dddddd', linewidth=0.7)
        turn = np.linspace(0.0, 0.5 * np.pi, ARC_POINTS)
        axes.plot(c * np.cos(turn), c * np.sin(turn), np.full_like(turn, s),
                  color='#dddddd', linewidth=0.7)
    axes.set(xlim=(0.05, 0.95), ylim=(0.05, 0.95), zlim=(0.05, 0.95))
    return axes


def draw(axes, linkage: Linkage, legs=(0, 1, 2), faint=False, labels=True,
         platform=True) -> None:
    """Draw legs and platform: proximal links thick, distal links thinner, platform filled."""
    alpha = 0.25 if faint else 1.0
    for k in legs:
        first, second, third = linkage.first[k], linkage.second[k], linkage.third[k]
        axes.plot(*arc(first, second).T, color=LEGS[k], linewidth=4.5, alpha=alpha,
                  solid_capstyle='round')
        axes.plot(*arc(second, third).T, color=LEGS[k], linewidth=2.2, alpha=alpha)
        for joint, vector in enumerate((first, second, third), start=1):
            axes.plot(*vector[:, None], 'o', color='white', markersize=6, alpha=alpha,
                      markeredgecolor=LEGS[k], markeredgewidth=1.5)
            if labels:
                label(axes, vector, f'{"ABC"[k]}$_{joint}$')
    if platform:
        rim = np.concatenate([arc(linkage.third[k], linkage.third[(k + 1) % 3])
                              for k in range(3)])
        fill(axes, rim, '#999999', 0.15 if faint else 0.45)
        axes.plot(*np.stack([0.75 * linkage.platform, 1.3 * linkage.platform]).T, color='black',
                  linewidth=1.2, alpha=alpha)
        if labels:
            label(axes, 1.3 * linkage.platform, 'Z$_E$')


def label(axes, vector: np.ndarray, text: str, away: float = 1.09, **style) -> None:
    """Write beside a point of the sphere, a little outside it."""
    axes.text(*(away * vector), text, fontsize=9, ha='center', va='center', **style)


def fill(axes, rim: np.ndarray, color: str, alpha: float) -> None:
    """Fill a closed line on the sphere."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    axes.add_collection3d(Poly3DCollection([rim], facecolor=color, alpha=alpha, linewidth=0))
