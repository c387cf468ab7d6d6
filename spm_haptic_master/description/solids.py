# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The solids of the links, each in its own frame, which all have their origin in O, and their turns.

A solid is a closed surface of triangles: a turned profile or an arc of a sphere. The links of a
leg are stacked along their common joint axis, the proximal link outside the distal one and that
outside the platform, with a gap between them: no two of them touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos, cos, sin, tau
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.kinematics.geometry import BASE_TURNS, Geometry, leg_frame
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import multiply_quaternions

# Points on the circumference of a turned solid; sections of an arc for each rad of its angle.
TURN_POINTS = 24
ARC_SECTIONS = 18
# Part of a bar's thickness that its edges are chamfered by (unit 1).
CHAMFER = 0.25
# Bytes of the text at the beginning of a binary STL file.
STL_HEADER = 80
# Legs, in names of links and joints.
LEGS = ('a', 'b', 'c')
# Radius of the proximal links about O (m). The paper gives angles only; orientations do not
# depend on it.
SIZE = 0.1
# Bars: radius about O of the middle, width and thickness (unit SIZE).
PROXIMAL = (1.0, 0.085, 0.06)
DISTAL = (0.855, 0.085, 0.06)
PLATFORM = (0.722, 0.085, 0.06)
BASE = 1.2, 0.13, 0.07
# Cylinders: radius, and the radii about O between which each is (unit SIZE): discs of the proximal
# link at Z1k and Z2k, of the distal link at Z2k and Z3k, of the platform at Z3k; pins of the third
# joints; motors; encoders outside a motor or a distal link.
PROXIMAL_AT_1 = (0.075, 0.955, 1.06)
PROXIMAL_AT_2 = (0.075, 0.92, 1.045)
DISTAL_AT_2 = (0.075, 0.81, 0.9)
DISTAL_AT_3 = (0.075, 0.78, 0.9)
PLATFORM_AT_3 = (0.075, 0.68, 0.76)
PIN = (0.03, 0.68, 0.9)
MOTOR = (0.12, 1.08, 1.36)
MOTOR_ENCODER = (0.095, 1.36, 1.41)
THIRD_ENCODER = 0.095, 0.905, 0.945
# Profile of the handle on Z_E: radius and distance from O (unit SIZE).
HANDLE = (
    (0.075, 0.69),
    (0.09, 0.705),
    (0.09, 0.74),
    (0.045, 0.78),
    (0.036, 1.05),
    (0.036, 1.1),
    (0.07, 1.17),
    (0.092, 1.27),
    (0.095, 1.4),
    (0.08, 1.55),
    (0.05, 1.61),
    (0.01, 1.625),
)
# Density of the links, kg/m^3: aluminium.
DENSITY = 2700.0


class MassProperties(NamedTuple):
    """
    Mass of a body, and how it is distributed.

    Attributes
    ----------
    mass : float
        Mass, kg.
    centre : ndarray, shape (3,)
        Centre of mass in the body's frame, m.
    inertia : ndarray, shape (3, 3)
        Moments of inertia about the centre of mass, kg m^2.

    """

    mass: float  # kg
    centre: NDArray[np.float64]  # centre of mass, m, shape (3,)
    # Moments of inertia about it, kg m^2, along the axes of the body's frame, shape (3, 3).
    inertia: NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Solid:
    """
    A closed surface.

    Attributes
    ----------
    vertices : ndarray, shape (n, 3)
        Corners, m.
    triangles : ndarray of int, shape (m, 3)
        Numbers of the corners of each triangle, counter-clockwise from outside.

    """

    vertices: NDArray[np.float64]  # corners, m, shape (n, 3)
    triangles: NDArray[np.int32]  # indices of them, counter-clockwise from outside, (m, 3)

    def turned(self, rotation: NDArray[np.float64]) -> Solid:
        """
        Return the solid turned by a rotation matrix, shape (3, 3).

        Parameters
        ----------
        rotation : ndarray, shape (3, 3)
            Its columns are the solid's axes after the turn.

        """
        return Solid(self.vertices @ rotation.T, self.triangles)

    def mass_properties(self, density: float) -> MassProperties:
        """
        Return mass, centre and inertia of the solid, filled with a density, kg/m^3.

        Sums over the tetrahedra between the origin and each triangle (Tonon, 2004); where several
        surfaces overlap, the common part counts once for each.

        Parameters
        ----------
        density : float
            Density, kg/m^3.

        Returns
        -------
        MassProperties
            In the frame of the vertices.

        """
        corners = self.vertices[self.triangles]
        volumes = np.linalg.det(corners) / 6.0
        sums = corners.sum(axis=1)
        mass = density * volumes.sum()
        centre = density * (volumes @ sums) / (4.0 * mass)
        # Second moments about the origin, integral of r r^T dV: of a tetrahedron with one corner
        # there, volume / 20 times (sum of corner corner^T + (sum of corners) (sum)^T).
        moments = (
            density
            / 20.0
            * (
                np.einsum('t,tci,tcj->ij', volumes, corners, corners)
                + np.einsum('t,ti,tj->ij', volumes, sums, sums)
            )
        )
        moments -= mass * np.outer(centre, centre)
        return MassProperties(
            mass=float(mass),
            centre=centre,
            inertia=np.trace(moments) * np.eye(3) - moments,
        )

    def stl(self, name: str) -> bytes:
        """
        Return the solid as a binary STL file whose header has a name.

        Parameters
        ----------
        name : str
            Text of the header, at most STL_HEADER bytes.

        Returns
        -------
        bytes
            Header, number of triangles, and each triangle with its normal, in m; a triangle
            without an area has the normal 0.

        """
        corners = self.vertices[self.triangles].astype('<f4')
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        facets = np.zeros(
            len(corners),
            dtype=[('normal', '<f4', 3), ('corners', '<f4', (3, 3)), ('attribute', '<u2')],
        )
        np.divide(normals, lengths, out=facets['normal'], where=lengths > 0.0)
        facets['corners'] = corners
        return (
            name.encode().ljust(STL_HEADER) + len(corners).to_bytes(4, 'little') + facets.tobytes()
        )


def solids(geometry: Geometry) -> dict[str, Solid]:
    """
    Return the solids of all links by name, each in the frame of its link.

    A proximal link has Z1k on z and Z2k on Rx(alpha_k) z; a distal link Z2k on z and Z3k on
    Rx(beta_k) z. The platform carries the handle.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.

    Returns
    -------
    dict
        `base`, `proximal_K`, `distal_K` (K: a, b, c) and `platform`.

    """
    axes = np.array(geometry.base_axes)
    ends = np.array(geometry.platform_axes)
    platform = together(
        *(cylinder(PLATFORM_AT_3).turned(onto(axis)) for axis in ends),
        *(_arc_between(np.array([0.0, 0.0, 1.0]), axis, PLATFORM) for axis in ends),
        turned_profile([(SIZE * radius, SIZE * height) for radius, height in HANDLE]),
    )
    return {
        'base': together(
            *(cylinder(MOTOR).turned(onto(axis)) for axis in axes),
            *(_arc_between(axes[k], axes[(k + 1) % 3], BASE) for k in range(3)),
        ),
        **{
            f'proximal_{name}': _link(angle, PROXIMAL, PROXIMAL_AT_1, PROXIMAL_AT_2)
            for name, angle in zip(LEGS, geometry.alphas, strict=True)
        },
        **{
            f'distal_{name}': _link(angle, DISTAL, DISTAL_AT_2, DISTAL_AT_3)
            for name, angle in zip(LEGS, geometry.betas, strict=True)
        },
        'platform': platform,
    }


def masses(geometry: Geometry) -> dict[str, MassProperties]:
    """
    Return mass, centre and inertia of the moving links by their names in the URDF.

    Encoders weigh nothing; the base does not move and is left out. The carriers are the pins of
    the third joints.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.

    Returns
    -------
    dict
        Of aluminium of DENSITY, in the frame of each link.

    """
    named = solids(geometry)
    del named['base']
    named['spm_platform'] = named.pop('platform')
    named |= {f'carrier_{name}': cylinder(PIN) for name in LEGS}
    return {name: solid.mass_properties(DENSITY) for name, solid in named.items()}


def onto(axes: Sequence[object] | NDArray[np.float64]) -> NDArray[np.float64]:
    """
    Return rotation matrices, shape (..., 3, 3), that take z to unit vectors, (..., 3).

    Parameters
    ----------
    axes : array_like, shape (..., 3)
        Unit vectors.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        R with R z = axis; how far it turns about the axis is arbitrary.

    """
    z = np.asarray(axes, dtype=float)
    # Any direction that is far from the axis.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z), axis=-1)], z)
    x /= np.sqrt(x[..., None, :] @ x[..., None])[..., 0]
    return np.stack([x, np.cross(z, x), z], axis=-1)


def together(*solids: Solid) -> Solid:
    """Return several solids as one; where they overlap, both surfaces stay."""
    offsets = np.cumsum([0, *(len(each.vertices) for each in solids[:-1])])
    return Solid(
        np.concatenate([each.vertices for each in solids]),
        np.concatenate(
            [each.triangles + offset for each, offset in zip(solids, offsets, strict=True)]
        ).astype(np.int32),
    )


def cylinder(size: Sequence[float]) -> Solid:
    """
    Return a chamfered cylinder about z: radius and the heights of its ends, unit SIZE.

    Parameters
    ----------
    size : sequence of 3 float
        Radius, lower and upper height, unit SIZE.

    Returns
    -------
    Solid
        In m.

    """
    radius, low, high = (SIZE * each for each in size)
    rim = CHAMFER * min(radius, high - low)
    return turned_profile(
        [(radius - rim, low), (radius, low + rim), (radius, high - rim), (radius - rim, high)]
    )


def turned_profile(profile: Sequence[tuple[float, float]]) -> Solid:
    """
    Return the solid of a profile (radius, height), m, from below, turned about z.

    Parameters
    ----------
    profile : sequence of tuples of two float
        Radius and height of each corner, m, from the lower end to the upper one.

    Returns
    -------
    Solid
        With a flat end below and above.

    """
    turn = np.arange(TURN_POINTS) * tau / TURN_POINTS
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros(TURN_POINTS)], axis=1)
    return _tube([radius * circle + (0.0, 0.0, height) for radius, height in profile])


def _link(
    angle: float, bar: Sequence[float], first: Sequence[float], second: Sequence[float]
) -> Solid:
    """
    Return a bar of an angle, rad, with a disc at either end.

    Parameters
    ----------
    angle : float
        Angle between the joint axes at its ends.
    bar : sequence of 3 float
        Radius about O, width and thickness (unit SIZE).
    first, second : sequence of 3 float
        Discs at z and at Rx(angle) z, as `cylinder` has them.

    Returns
    -------
    Solid
        In the frame of the link, m.

    """
    c = np.cos(angle)
    s = np.sin(angle)
    there = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return together(_arc_bar(angle, bar), cylinder(first), cylinder(second).turned(there))


def _arc_between(
    start: NDArray[np.float64], end: NDArray[np.float64], bar: Sequence[float]
) -> Solid:
    """Return a bar along the great circle from one unit vector to another."""
    across = np.cross(start, end)
    sine = float(np.linalg.norm(across))
    angle = acos(max(-1.0, min(1.0, float(start @ end))))
    # Of no length, it has any direction.
    if sine > 0.0:
        x = across / sine
    else:
        x = onto(start)[:, 0]
    return _arc_bar(angle, bar).turned(np.stack([x, np.cross(start, x), start], axis=1))


def _arc_bar(angle: float, bar: Sequence[float]) -> Solid:
    """
    Return a bar, with its width across the arc, along a sphere from z to Rx(angle) z, rad.

    Parameters
    ----------
    angle : float
        Angle of the arc.
    bar : sequence of 3 float
        Radius about O, width and thickness (unit SIZE).

    Returns
    -------
    Solid
        With chamfered edges, m.

    """
    radius, width, thickness = (SIZE * each for each in bar)
    chamfer = CHAMFER * thickness
    x = 0.5 * width
    r = 0.5 * thickness
    # Across and along the radius, counter-clockwise about the direction of the arc.
    section = [
        (x, -r + chamfer),
        (x, r - chamfer),
        (x - chamfer, r),
        (-x + chamfer, r),
        (-x, r - chamfer),
        (-x, -r + chamfer),
        (-x + chamfer, -r),
        (x - chamfer, -r),
    ]
    steps = max(2, round(ARC_SECTIONS * angle))
    return _tube(
        [
            np.array(
                [
                    (across, -(radius + along) * sin(t), (radius + along) * cos(t))
                    for across, along in section
                ]
            )
            for t in (angle * step / steps for step in range(steps + 1))
        ]
    )


def _tube(rings: list[NDArray[np.float64]]) -> Solid:
    """
    Return the solid through rings of equally many points, closed at both ends.

    Parameters
    ----------
    rings : list of ndarray, shape (n, 3)
        Points of each ring, m, counter-clockwise as seen from the last ring.

    Returns
    -------
    Solid
        The middles of the first and of the last ring are two more corners.

    """
    count = len(rings)
    n = len(rings[0])
    here = np.arange(count * n).reshape(count, n)
    there = np.roll(here, -1, axis=1)
    first = np.full(n, count * n)
    last = np.full(n, count * n + 1)
    sides = [
        np.stack(corners, axis=2)
        for corners in ((here[:-1], there[:-1], there[1:]), (here[:-1], there[1:], here[1:]))
    ]
    ends = [
        np.stack(corners, axis=1)
        for corners in ((first, there[0], here[0]), (last, here[-1], there[-1]))
    ]
    return Solid(
        np.concatenate([*rings, rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]]),
        np.concatenate([np.stack(sides, axis=1).reshape(-1, 3), *ends]).astype(np.int32),
    )


def link_turns(geometry: Geometry, angles: Sequence[float]) -> list[Quaternion[float]]:
    """
    Return the turn of each link in the base frame by the angles of all nine joints, rad.

    Quaternions x, y, z, w: of the proximal links A, B, C: B_k Rz(th1k), eq. 1; of the distal links
    A, B, C: that times Rx(alpha_k) Rz(th2k); of the platform, eq. 6.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.
    angles : sequence of 9 float
        Angles in the order of MECHANISM_JOINT_NAMES.

    Returns
    -------
    list of seven tuples of 4 float
        Turns of the three proximal links, of the three distal links, and of the platform.

    """
    turns = [(0.0, 0.0, sin(0.5 * angle), cos(0.5 * angle)) for angle in angles]
    base = map(leg_frame, BASE_TURNS, geometry.base_axes)
    proximal = list(map(multiply_quaternions, base, turns[::3]))
    links = [(sin(0.5 * alpha), 0.0, 0.0, cos(0.5 * alpha)) for alpha in geometry.alphas]
    bent = map(multiply_quaternions, proximal, links)
    th1a, th2a, th3a = angles[:3]
    return [
        *proximal,
        *map(multiply_quaternions, bent, turns[1::3]),
        chain_quaternion(th1a, th2a, th3a, geometry, FLOATS),
    ]
