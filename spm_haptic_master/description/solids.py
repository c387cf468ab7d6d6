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


@dataclass(frozen=True, slots=True)
class Bar:
    """Size of a bar, unit SIZE: radius of its middle about O, width and thickness."""

    radius: float
    width: float
    thickness: float


@dataclass(frozen=True, slots=True)
class Cylinder:
    """
    Size of a cylinder about z.

    Attributes
    ----------
    radius : float
        Its radius, unit SIZE.
    low, high : float
        Distances of its ends from O, unit SIZE.

    """

    radius: float
    low: float
    high: float


# Radius of the proximal links about O (m). The paper gives angles only; orientations do not
# depend on it.
SIZE = 0.1
PROXIMAL = Bar(
    radius=1.0,
    width=0.085,
    thickness=0.06,
)
DISTAL = Bar(
    radius=0.855,
    width=0.085,
    thickness=0.06,
)
PLATFORM = Bar(
    radius=0.722,
    width=0.085,
    thickness=0.06,
)
BASE = Bar(
    radius=1.2,
    width=0.13,
    thickness=0.07,
)
# Discs of the proximal link at Z1k and Z2k, of the distal link at Z2k and Z3k, of the platform at
# Z3k.
PROXIMAL_AT_1 = Cylinder(
    radius=0.075,
    low=0.955,
    high=1.06,
)
PROXIMAL_AT_2 = Cylinder(
    radius=0.075,
    low=0.92,
    high=1.045,
)
DISTAL_AT_2 = Cylinder(
    radius=0.075,
    low=0.81,
    high=0.9,
)
DISTAL_AT_3 = Cylinder(
    radius=0.075,
    low=0.78,
    high=0.9,
)
PLATFORM_AT_3 = Cylinder(
    radius=0.075,
    low=0.68,
    high=0.76,
)
# Pins of the third joints; motors; encoders outside a motor or a distal link.
PIN = Cylinder(
    radius=0.03,
    low=0.68,
    high=0.9,
)
MOTOR = Cylinder(
    radius=0.12,
    low=1.08,
    high=1.36,
)
MOTOR_ENCODER = Cylinder(
    radius=0.095,
    low=1.36,
    high=1.41,
)
THIRD_ENCODER = Cylinder(
    radius=0.095,
    low=0.905,
    high=0.945,
)
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
        outer = np.einsum('t,tci,tcj->ij', volumes, corners, corners)
        outer_of_sums = np.einsum('t,ti,tj->ij', volumes, sums, sums)
        moments = density / 20.0 * (outer + outer_of_sums)
        moments -= mass * np.outer(centre, centre)
        identity = np.eye(3)
        return MassProperties(
            mass=float(mass),
            centre=centre,
            inertia=np.trace(moments) * identity - moments,
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
        first = corners[:, 0]
        one_edge = corners[:, 1] - first
        other_edge = corners[:, 2] - first
        normals = np.cross(one_edge, other_edge)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        layout = [
            ('normal', '<f4', 3),
            ('corners', '<f4', (3, 3)),
            ('attribute', '<u2'),
        ]
        facets = np.zeros(len(corners), dtype=layout)
        has_area = lengths > 0.0
        np.divide(normals, lengths, out=facets['normal'], where=has_area)
        facets['corners'] = corners
        header = name.encode().ljust(STL_HEADER)
        count = len(corners).to_bytes(4, 'little')
        return header + count + facets.tobytes()


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
    named = {'base': _base(geometry)}
    for name, alpha in zip(LEGS, geometry.alphas, strict=True):
        named[f'proximal_{name}'] = _link(
            angle=alpha,
            bar=PROXIMAL,
            first=PROXIMAL_AT_1,
            second=PROXIMAL_AT_2,
        )
    for name, beta in zip(LEGS, geometry.betas, strict=True):
        named[f'distal_{name}'] = _link(
            angle=beta,
            bar=DISTAL,
            first=DISTAL_AT_2,
            second=DISTAL_AT_3,
        )
    named['platform'] = _platform(geometry)
    return named


def _base(geometry: Geometry) -> Solid:
    """Return the base: the three motors, and bars between them."""
    first, second, third = np.array(geometry.base_axes)
    motor = cylinder(MOTOR)
    return together(
        motor.turned(onto(first)),
        motor.turned(onto(second)),
        motor.turned(onto(third)),
        _arc_between(first, second, BASE),
        _arc_between(second, third, BASE),
        _arc_between(third, first, BASE),
    )


def _platform(geometry: Geometry) -> Solid:
    """Return the platform: a disc at each Z3k, bars from them to Z_E, and the handle."""
    first, second, third = np.array(geometry.platform_axes)
    handle_axis = np.array([0.0, 0.0, 1.0])
    disc = cylinder(PLATFORM_AT_3)
    handle = []
    for radius, height in HANDLE:
        handle.append((SIZE * radius, SIZE * height))
    return together(
        disc.turned(onto(first)),
        disc.turned(onto(second)),
        disc.turned(onto(third)),
        _arc_between(handle_axis, first, PLATFORM),
        _arc_between(handle_axis, second, PLATFORM),
        _arc_between(handle_axis, third, PLATFORM),
        turned_profile(handle),
    )


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
    for leg in LEGS:
        named[f'carrier_{leg}'] = cylinder(PIN)
    found = {}
    for name, solid in named.items():
        found[name] = solid.mass_properties(DENSITY)
    return found


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
    smallest = np.argmin(np.abs(z), axis=-1)
    far = np.eye(3)[smallest]
    x = np.cross(far, z)
    squared_length = x[..., None, :] @ x[..., None]
    x /= np.sqrt(squared_length)[..., 0]
    y = np.cross(z, x)
    return np.stack([x, y, z], axis=-1)


def together(*solids: Solid) -> Solid:
    """Return several solids as one; where they overlap, both surfaces stay."""
    vertices = []
    triangles = []
    offset = 0
    for solid in solids:
        vertices.append(solid.vertices)
        triangles.append(solid.triangles + offset)
        offset += len(solid.vertices)
    return Solid(
        vertices=np.concatenate(vertices),
        triangles=np.concatenate(triangles).astype(np.int32),
    )


def cylinder(size: Cylinder) -> Solid:
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
    radius = SIZE * size.radius
    low = SIZE * size.low
    high = SIZE * size.high
    rim = CHAMFER * min(radius, high - low)
    profile = [
        (radius - rim, low),
        (radius, low + rim),
        (radius, high - rim),
        (radius - rim, high),
    ]
    return turned_profile(profile)


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
    cosines = np.cos(turn)
    sines = np.sin(turn)
    flat = np.zeros(TURN_POINTS)
    circle = np.stack([cosines, sines, flat], axis=1)
    rings = []
    for radius, height in profile:
        rings.append(radius * circle + (0.0, 0.0, height))
    return _tube(rings)


def _link(
    angle: float,
    bar: Bar,
    first: Cylinder,
    second: Cylinder,
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
    about_x = [
        [1.0, 0.0, 0.0],
        [0.0, c, -s],
        [0.0, s, c],
    ]
    there = cylinder(second)
    return together(
        _arc_bar(angle, bar),
        cylinder(first),
        there.turned(np.array(about_x)),
    )


def _arc_between(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    bar: Bar,
) -> Solid:
    """Return a bar along the great circle from one unit vector to another."""
    across = np.cross(start, end)
    sine = float(np.linalg.norm(across))
    cosine = float(start @ end)
    angle = acos(max(-1.0, min(1.0, cosine)))
    # Of no length, it has any direction.
    if sine > 0.0:
        x = across / sine
    else:
        x = onto(start)[:, 0]
    y = np.cross(start, x)
    turn = np.stack([x, y, start], axis=1)
    return _arc_bar(angle, bar).turned(turn)


def _arc_bar(angle: float, bar: Bar) -> Solid:
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
    radius = SIZE * bar.radius
    thickness = SIZE * bar.thickness
    chamfer = CHAMFER * thickness
    x = 0.5 * (SIZE * bar.width)
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
    rings = []
    for step in range(steps + 1):
        t = angle * step / steps
        ring = []
        for across, along in section:
            distance = radius + along
            y = -distance * sin(t)
            z = distance * cos(t)
            ring.append((across, y, z))
        rings.append(np.array(ring))
    return _tube(rings)


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
    numbers = np.arange(count * n).reshape(count, n)
    following = np.roll(numbers, -1, axis=1)
    # Corners of each side's two triangles: here and there on a ring, and on the next one.
    here = numbers[:-1]
    there = following[:-1]
    next_here = numbers[1:]
    next_there = following[1:]
    one_half = np.stack((here, there, next_there), axis=2)
    other_half = np.stack((here, next_there, next_here), axis=2)
    sides = np.stack([one_half, other_half], axis=1)
    first_middle = np.full(n, count * n)
    last_middle = np.full(n, count * n + 1)
    below = np.stack((first_middle, there[0], here[0]), axis=1)
    above = np.stack((last_middle, next_here[-1], next_there[-1]), axis=1)
    middle_below = rings[0].mean(axis=0)
    middle_above = rings[-1].mean(axis=0)
    triangles = np.concatenate([sides.reshape(-1, 3), below, above])
    return Solid(
        vertices=np.concatenate([*rings, [middle_below, middle_above]]),
        triangles=triangles.astype(np.int32),
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
    turns = [_about_z(angle) for angle in angles]
    links = [_about_x(alpha) for alpha in geometry.alphas]
    base = map(leg_frame, BASE_TURNS, geometry.base_axes)
    proximal = list(map(multiply_quaternions, base, turns[::3]))
    bent = map(multiply_quaternions, proximal, links)
    distal = map(multiply_quaternions, bent, turns[1::3])
    th1a, th2a, th3a = angles[:3]
    platform = chain_quaternion(th1a, th2a, th3a, geometry, FLOATS)
    return [*proximal, *distal, platform]


def _about_z(angle: float) -> Quaternion[float]:
    """Return the quaternion x, y, z, w of a turn about z, rad."""
    half = 0.5 * angle
    return 0.0, 0.0, sin(half), cos(half)


def _about_x(angle: float) -> Quaternion[float]:
    """Return the quaternion x, y, z, w of a turn about x, rad."""
    half = 0.5 * angle
    return sin(half), 0.0, 0.0, cos(half)
