# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Closed surfaces of triangles: turned profiles, arcs of a sphere, and their STL file."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# Points on the circumference of a turned solid.
TURN_POINTS = 24
# Sections of an arc for each rad of its angle, at least two.
ARC_SECTIONS = 18
# Part of a bar's thickness that its edges are chamfered by (unit 1).
CHAMFER = 0.25
# Bytes of the text at the beginning of a binary STL file.
STL_HEADER = 80


class MassProperties(NamedTuple):
    """Mass of a body, and how it is distributed."""

    mass: float  # kg
    centre: NDArray[np.float64]  # centre of mass, m, shape (3,)
    # Moments of inertia about it, kg m^2, along the axes of the body's frame, shape (3, 3).
    inertia: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solid:
    """A closed surface."""

    vertices: NDArray[np.float64]  # corners, m, shape (n, 3)
    triangles: NDArray[np.int32]  # indices of them, counter-clockwise from outside, (m, 3)

    def turned(self, rotation: NDArray[np.float64]) -> Solid:
        """Return the solid turned by a rotation matrix, shape (3, 3)."""
        return Solid(self.vertices @ rotation.T, self.triangles)

    def mass_properties(self, density: float) -> MassProperties:
        """
        Return mass, centre and inertia of the solid, filled with a density, kg/m^3.

        Sums over the tetrahedra between the origin and each triangle (Tonon, 2004); where several
        surfaces overlap, the common part counts once for each.
        """
        corners = self.vertices[self.triangles]
        volumes = np.linalg.det(corners) / 6.0
        sums = corners.sum(axis=1)
        mass = density * volumes.sum()
        centre = density * (volumes @ sums) / (4.0 * mass)
        # Second moments about the origin, integral of r r^T dV: of a tetrahedron with one corner
        # there, volume / 20 times (sum of corner corner^T + (sum of corners) (sum)^T).
        moments = density / 20.0 * (np.einsum('t,tci,tcj->ij', volumes, corners, corners)
                                    + np.einsum('t,ti,tj->ij', volumes, sums, sums))
        moments -= mass * np.outer(centre, centre)
        return MassProperties(float(mass), centre, np.trace(moments) * np.eye(3) - moments)

    def stl(self, name: str) -> bytes:
        """Return the solid as a binary STL file whose header has a name."""
        corners = self.vertices[self.triangles].astype('<f4')
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        facets = np.zeros(len(corners), dtype=[
            ('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')])
        facets['normal'] = normals / np.where(lengths > 0.0, lengths, 1.0)
        facets['corners'] = corners
        return name.encode().ljust(STL_HEADER)[:STL_HEADER] \
            + len(corners).to_bytes(4, 'little') + facets.tobytes()


def together(*solids: Solid) -> Solid:
    """Return several solids as one; where they overlap, both surfaces stay."""
    offsets = np.cumsum([0, *(len(each.vertices) for each in solids[:-1])])
    return Solid(np.concatenate([each.vertices for each in solids]),
                 np.concatenate([each.triangles + offset for each, offset
                                 in zip(solids, offsets, strict=True)]).astype(np.int32))


def turned_profile(profile: list[tuple[float, float]]) -> Solid:
    """Return the solid of a profile (radius, height), m, from below, turned about z."""
    turn = np.arange(TURN_POINTS) * tau / TURN_POINTS
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros(TURN_POINTS)], axis=-1)
    return _tube([radius * circle + (0.0, 0.0, height) for radius, height in profile])


def disc(radius: float, low: float, high: float) -> Solid:
    """Return a cylinder about z from height `low` to `high`, with chamfered rims, m."""
    rim = CHAMFER * min(radius, high - low)
    return turned_profile([(radius - rim, low), (radius, low + rim), (radius, high - rim),
                           (radius - rim, high)])


def arc_bar(angle: float, radius: float, width: float, thickness: float) -> Solid:
    """
    Return a bar bent along an arc of a sphere about the origin.

    The arc goes from z to Rx(angle) z, rad, at the radius of the bar's middle, m; the width is
    across the arc, the thickness along the radius.
    """
    chamfer = CHAMFER * thickness
    x, r = 0.5 * width, 0.5 * thickness
    # Across and along the radius, counter-clockwise about the direction of the arc.
    section = [(x, -r + chamfer), (x, r - chamfer), (x - chamfer, r), (-x + chamfer, r),
               (-x, r - chamfer), (-x, -r + chamfer), (-x + chamfer, -r), (x - chamfer, -r)]
    steps = max(2, round(ARC_SECTIONS * angle))
    return _tube([
        np.array([(across, -(radius + along) * sin(t), (radius + along) * cos(t))
                  for across, along in section])
        for t in (angle * step / steps for step in range(steps + 1))])


def _tube(rings: list[NDArray[np.float64]]) -> Solid:
    """Return the solid through rings of equally many points, closed at both ends."""
    n = len(rings[0])
    here = np.arange(n)
    there = np.roll(here, -1)
    triangles = []
    for ring in range(len(rings) - 1):
        low, high = ring * n, (ring + 1) * n
        triangles += [np.stack([low + here, low + there, high + there], axis=-1),
                      np.stack([low + here, high + there, high + here], axis=-1)]
    first, last = len(rings) * n, len(rings) * n + 1
    top = (len(rings) - 1) * n
    triangles += [np.stack([np.full(n, first), there, here], axis=-1),
                  np.stack([np.full(n, last), top + here, top + there], axis=-1)]
    vertices = np.concatenate([*rings, rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]])
    return Solid(vertices, np.concatenate(triangles).astype(np.int32))
