# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The manipulator drawn as a spherical linkage: axes as points, links as arcs of a sphere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
import numpy as np
from spm_haptic_master.description.colours import LEGS
from spm_haptic_master.kinematics import Geometry
from spm_haptic_master.kinematics.leg_kernels import second_axis

# Nominal base axes Z1A, Z1B, Z1C in the base frame, a row a leg.
FIRST = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
# Number of points of an arc.
ARC_POINTS = 30
# Direction of the eye on the workspace's axis (1, 1, 1).
FRONT = np.array([1.0, 1.0, 1.0])
# Direction of the eye beside that axis, for drawings with depth.
BESIDE = np.array([1.0, 0.25, 0.75])


@dataclass(frozen=True, slots=True)
class Linkage:
    """
    Joint axes in the base frame.

    Attributes
    ----------
    first, second, third : ndarray, shape (3, 3)
        Unit vectors Z1k, Z2k, Z3k, a row a leg.
    platform : ndarray, shape (3,)
        Unit vector Z_E.

    """

    first: np.ndarray
    second: np.ndarray
    third: np.ndarray
    platform: np.ndarray

    @classmethod
    def at(cls, th1: np.ndarray, R: np.ndarray, g: Geometry) -> Linkage:
        """Return the linkage with active joints th1 and the platform at R."""
        second = [
            second_axis(np.cos(angle), np.sin(angle), leg)
            for leg, angle in zip(g.legs, th1, strict=True)
        ]
        return cls(
            np.array(g.base_axes), np.array(second), (R @ np.array(g.platform_axes).T).T, R[:, 2]
        )


def arc(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return points of the great circle from one unit vector to another, shape (n, 3)."""
    angle = np.arccos(np.clip(start @ end, -1.0, 1.0))
    part = np.linspace(0.0, 1.0, ARC_POINTS)[:, None]
    return (np.sin((1.0 - part) * angle) * start + np.sin(part * angle) * end) / np.sin(angle)


class View:
    """An orthographic view of the unit sphere from a direction, (3,), drawn on plane axes."""

    def __init__(self, axes: Axes, title: str, eye: np.ndarray = FRONT):
        self.axes = axes
        toward = eye / np.linalg.norm(eye)
        right = np.cross([0.0, 0.0, 1.0], toward)
        right /= np.linalg.norm(right)
        self._plane = np.stack([right, np.cross(toward, right)], axis=-1)
        axes.set_aspect('equal')
        axes.set_axis_off()
        axes.set_title(title, fontsize=10)
        turn = np.linspace(0.0, 2.0 * np.pi, 4 * ARC_POINTS)
        axes.fill(
            np.cos(turn), np.sin(turn), facecolor='#f6f7f9', edgecolor='#bbbbbb', linewidth=0.8
        )
        # Octant in which the device works: the planes of the base axes.
        for k in range(3):
            self.plot(arc(FIRST[k], FIRST[(k + 1) % 3]), color='#c8ccd2', linewidth=0.9)
            self.plot(np.stack([np.zeros(3), FIRST[k]]), color='#c8ccd2', linewidth=0.9)

    def plot(self, points: np.ndarray, *style: Any, **styles: Any) -> None:
        """Draw a line through points, shape (n, 3)."""
        self.axes.plot(*(points @ self._plane).T, *style, **styles)

    def fill(self, rim: np.ndarray, color: str, alpha: float) -> None:
        """Fill a closed line of points, shape (n, 3)."""
        self.axes.fill(*(rim @ self._plane).T, facecolor=color, alpha=alpha, linewidth=0)

    def label(
        self,
        vector: np.ndarray,
        text: str,
        away: float = 0.1,
        toward: Sequence[float] | None = None,
        **style: Any,
    ) -> None:
        """Write a text `away` radii from a point, outwards or in a direction of the drawing."""
        place = vector @ self._plane
        out = place if toward is None else np.asarray(toward)
        out = out / np.linalg.norm(out)
        self.axes.text(
            *(place + away * out),
            text,
            ha='center',
            va='center',
            **{'fontsize': 9, 'zorder': 5, **style},
        )


def draw(
    view: View,
    linkage: Linkage,
    legs: Sequence[int] = (0, 1, 2),
    faint: bool = False,
    labels: bool = True,
    platform: bool = True,
) -> None:
    """Draw legs and platform: proximal links thick, distal links thinner, platform filled."""
    alpha = 0.3 if faint else 1.0
    if platform:
        rim = np.concatenate([arc(linkage.third[k], linkage.third[(k + 1) % 3]) for k in range(3)])
        view.fill(rim, '#888888', 0.15 if faint else 0.4)
    for k in legs:
        first, second, third = linkage.first[k], linkage.second[k], linkage.third[k]
        view.plot(
            arc(first, second), color=LEGS[k], linewidth=5.0, alpha=alpha, solid_capstyle='round'
        )
        view.plot(arc(second, third), color=LEGS[k], linewidth=2.4, alpha=alpha)
        for joint, vector in enumerate((first, second, third), start=1):
            view.plot(
                vector[None],
                'o',
                color='white',
                markersize=6,
                markeredgecolor=LEGS[k],
                markeredgewidth=1.5,
                markerfacecolor='white',
                zorder=4,
                alpha=alpha,
            )
            if labels:
                view.label(vector, f'{"ABC"[k]}$_{joint}$', 0.13)
    if platform:
        view.plot(linkage.platform[None], '+', color='black', markersize=8, alpha=alpha)
        if labels:
            view.label(linkage.platform, 'Z$_E$', 0.12, toward=(1.0, -0.6))
