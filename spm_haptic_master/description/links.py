# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The solids of the links, each in its own frame, which all have their origin in O, and their turns.

The links of a leg are stacked along their common joint axis, the proximal link outside the distal
one and that outside the platform, with a gap between them: no two of them touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, cos, sin
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.description.solids import (
    arc_bar,
    disc,
    MassProperties,
    Solid,
    together,
    turned_profile,
)
from spm_haptic_master.kinematics import Geometry, quaternion_from_matrix
from spm_haptic_master.kinematics.leg_kernels import chain_quaternion
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion
from spm_haptic_master.kinematics.rotations import multiply_quaternions

# Legs, in names of links and joints.
LEGS = ('a', 'b', 'c')
# Radius of the proximal links about O (m). The paper gives angles only; orientations do not
# depend on it.
SIZE = 0.1

# Radii about O of the bars' middles, their thickness and their width (unit SIZE).
PROXIMAL, DISTAL, PLATFORM, BASE = 1.0, 0.855, 0.722, 1.2
THICKNESS, WIDTH = 0.06, 0.085
BASE_THICKNESS, BASE_WIDTH = 0.07, 0.13
# Radius of the discs at the joints, and the radii about O between which each is (unit SIZE): the
# proximal link's at Z1k and Z2k, the distal link's at Z2k and Z3k, the platform's at Z3k.
JOINT = 0.075
PROXIMAL_AT_1, PROXIMAL_AT_2 = (0.955, 1.06), (0.92, 1.045)
DISTAL_AT_2, DISTAL_AT_3 = (0.81, 0.9), (0.78, 0.9)
PLATFORM_AT_3 = (0.68, 0.76)
# Motors: radius, and the radii about O between which they are (unit SIZE).
MOTOR, MOTOR_AT = 0.12, (1.08, 1.36)
# Encoders: radius, and the radii about O between which they are, outside a motor or a distal link
# (unit SIZE).
ENCODER, ENCODER_AT_1, ENCODER_AT_3 = 0.095, (1.36, 1.41), (0.905, 0.945)
# Profile of the handle on Z_E: radius and distance from O (unit SIZE).
HANDLE = ((0.075, 0.69), (0.09, 0.705), (0.09, 0.74), (0.045, 0.78), (0.036, 1.05), (0.036, 1.1),
          (0.07, 1.17), (0.092, 1.27), (0.095, 1.4), (0.08, 1.55), (0.05, 1.61), (0.01, 1.625))
# Distance of the legs' tips from O (unit SIZE): in the gap between distal link and platform.
TIP = 0.77
# Radius of the pins of the third joints (unit SIZE).
PIN = 0.03
# Density of the links, kg/m^3: aluminium.
DENSITY = 2700.0
# Least sine of the angle between two axes that an arc connects (unit 1): below, none is needed.
LEAST_SINE = 1e-6


class Encoder(NamedTuple):
    """A cylinder about z of a link's frame that stands for an encoder, m."""

    radius: float
    low: float  # heights of its ends
    high: float


# Encoders on a motor's axis, and on a leg's third joint.
MOTOR_ENCODER, THIRD_ENCODER = (Encoder(SIZE * ENCODER, *(SIZE * height for height in heights))
                                for heights in (ENCODER_AT_1, ENCODER_AT_3))


def solids(geometry: Geometry) -> dict[str, Solid]:
    """
    Return the solids of all links by name, each in the frame of its link.

    A proximal link has Z1k on z and Z2k on Rx(alpha_k) z; a distal link Z2k on z and Z3k on
    Rx(beta_k) z. The platform carries the handle.
    """
    z = np.array([0.0, 0.0, 1.0])
    axes, ends = np.array(geometry.base_axes), np.array(geometry.platform_axes)
    base = together(
        *(_joint_disc(MOTOR_AT, MOTOR).turned(onto(axis)) for axis in axes),
        *(_arc_between(axes[k], axes[(k + 1) % 3], BASE, BASE_WIDTH, BASE_THICKNESS)
          for k in range(3)))
    platform = together(
        *(_joint_disc(PLATFORM_AT_3, JOINT).turned(onto(axis)) for axis in ends),
        *(_arc_between(z, axis, PLATFORM, WIDTH, THICKNESS) for axis in ends),
        turned_profile([(SIZE * radius, SIZE * height) for radius, height in HANDLE]))
    return {'base': base,
            **{f'proximal_{name}': _link(angle, PROXIMAL, PROXIMAL_AT_1, PROXIMAL_AT_2)
               for name, angle in zip(LEGS, geometry.alphas, strict=True)},
            **{f'distal_{name}': _link(angle, DISTAL, DISTAL_AT_2, DISTAL_AT_3)
               for name, angle in zip(LEGS, geometry.betas, strict=True)},
            'platform': platform}


def masses(geometry: Geometry) -> dict[str, MassProperties]:
    """
    Return mass, centre and inertia of the moving links by their names in the URDF.

    Encoders weigh nothing; the base does not move and is left out. The carriers are the pins of
    the third joints.
    """
    named = solids(geometry)
    del named['base']
    named['spm_platform'] = named.pop('platform')
    pin = _joint_disc((PLATFORM_AT_3[0], DISTAL_AT_3[1]), PIN)
    named |= {f'carrier_{name}': pin for name in LEGS}
    return {name: solid.mass_properties(DENSITY) for name, solid in named.items()}


def onto(axis: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a rotation matrix, shape (3, 3), that takes z to a unit vector."""
    z = np.asarray(axis, dtype=float)
    # Any direction that is far from the axis.
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _link(angle: float, radius: float, first: tuple[float, float],
          second: tuple[float, float]) -> Solid:
    """Return a bar of an angle, rad, with a disc at either end."""
    c, s = np.cos(angle), np.sin(angle)
    there = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    return together(
        arc_bar(angle, SIZE * radius, SIZE * WIDTH, SIZE * THICKNESS),
        _joint_disc(first, JOINT), _joint_disc(second, JOINT).turned(there))


def _joint_disc(between: tuple[float, float], radius: float) -> Solid:
    low, high = between
    return disc(SIZE * radius, SIZE * low, SIZE * high)


def _arc_between(start: NDArray[np.float64], end: NDArray[np.float64], radius: float,
                 width: float, thickness: float) -> Solid:
    """Return a bar along the great circle from one unit vector to another."""
    across = np.cross(start, end)
    sine = float(np.linalg.norm(across))
    angle = acos(max(-1.0, min(1.0, float(start @ end))))
    x = across / sine if sine > LEAST_SINE else onto(start)[:, 0]
    frame = np.stack([x, np.cross(start, x), start], axis=-1)
    return arc_bar(angle, SIZE * radius, SIZE * width, SIZE * thickness).turned(frame)


class LinkTurns:
    """How each link of a mechanism is turned."""

    def __init__(self, geometry: Geometry) -> None:
        self._geometry = geometry
        frames = np.array([leg.base_frame for leg in geometry.legs]).reshape(3, 3, 3)
        self._base = list(map(tuple, quaternion_from_matrix(frames).tolist()))
        self._bent = [(sin(0.5 * alpha), 0.0, 0.0, cos(0.5 * alpha)) for alpha in geometry.alphas]

    def at(self, angles: Sequence[float]) -> list[Quaternion[float]]:
        """
        Return the turn of each link in the base frame by the angles of all nine joints, rad.

        Quaternions x, y, z, w: of the proximal links A, B, C: B_k Rz(th1k), eq. 1; of the distal
        links A, B, C: that times Rx(alpha_k) Rz(th2k); of the platform, eq. 6.
        """
        proximal = [multiply_quaternions(self._base[k], _about_z(angles[3 * k]))
                    for k in range(3)]
        distal = [multiply_quaternions(multiply_quaternions(proximal[k], self._bent[k]),
                                       _about_z(angles[3 * k + 1])) for k in range(3)]
        th1a, th2a, th3a = angles[:3]
        return [*proximal, *distal, chain_quaternion(th1a, th2a, th3a, self._geometry, FLOATS)]


def _about_z(angle: float) -> Quaternion[float]:
    return 0.0, 0.0, sin(0.5 * angle), cos(0.5 * angle)
