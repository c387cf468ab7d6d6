# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The numbers that free motion may determine: a vector, and the mechanism and encoders it stands for.

In this order, with N sensors: N zeros; 6 deviations of the link angles (proximal A, B, C, distal
A, B, C); 3 of the base axes; 3 of the platform axes; 2 N coefficients of the first harmonics
(cosine, sine of each encoder); 2 N of the second ones. All in rad, all 0 for the drawing. The
axes have three numbers each set, as the frames take the other three: the base's are the angle
from Z1A to Z1B and the two directions of Z1C, the platform's the three deviations that are no
rotation of the platform.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.exceptions import InputError
from spm_haptic_master.kinematics import Geometry, in_usual_frames
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES, LEG_NAMES

Array = NDArray[np.float64]

# Groups of parameters, in the order in which a motion determines them.
GROUPS = ('zeros', 'links', 'base axes', 'platform axes', 'first harmonics', 'second harmonics')

# Tolerance of the second harmonics over that of the first ones (unit 1).
SECOND_HARMONIC = 0.1
# Number of mechanisms that are kept: those of a vector and of its differences.
GEOMETRIES = 32


@dataclass(frozen=True)
class Layout:
    """A rig as drawn, and the meaning of its parameter vector; InputError for unusual frames."""

    sensors: int  # N
    nominal: Geometry = Geometry()  # the drawing, in its usual frames
    working_mode: tuple[int, int, int] = (1, 1, 1)
    # Standard deviations before the fit, around the drawing.
    mechanism_tolerance: float = radians(0.5)  # of each link angle and number of the axes, rad
    harmonic_tolerance: float = radians(0.3)  # of each coefficient of the first harmonics, rad

    def __post_init__(self) -> None:
        """Raise InputError if Z1B of the drawing has a component in y."""
        usual = in_usual_frames(self.nominal, self.nominal)
        if not np.allclose(usual.base_axes, self.nominal.base_axes, rtol=0.0, atol=1e-9):
            raise InputError('geometry.base_axes: expected axes of the drawing in the usual '
                             'frames, Z1A = z and Z1B in the half plane of positive x of x and z')

    @cached_property
    def sizes(self) -> dict[str, int]:
        """Return the number of parameters of each group."""
        n = self.sensors
        return dict(zip(GROUPS, (n, 6, 3, 3, 2 * n, 2 * n), strict=True))

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Return the place of each group in the vector."""
        ends = np.cumsum(list(self.sizes.values())).tolist()
        return {group: slice(end - size, end)
                for (group, size), end in zip(self.sizes.items(), ends, strict=True)}

    @property
    def count(self) -> int:
        """Return the length P of the vector."""
        return sum(self.sizes.values())

    def columns(self, group: str) -> range:
        """Return the places of a group's parameters."""
        return range(self.count)[self.slices[group]]

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the name of each parameter."""
        joints = ALL_JOINT_NAMES[:self.sensors]
        return (*(f'zero of {joint}' for joint in joints),
                *(f'{part} link {leg}' for part in ('proximal', 'distal') for leg in LEG_NAMES),
                'angle from Z1A to Z1B', 'Z1C towards Z1A', 'Z1C across Z1A',
                *(f'platform axes, deviation {number}' for number in (1, 2, 3)),
                *(f'{order} harmonic of {joint}, {part}' for order in ('first', 'second')
                  for joint in joints for part in ('cosine', 'sine')))

    @cached_property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter before the fit, rad; inf for zeros."""
        mechanism, harmonic = self.mechanism_tolerance, self.harmonic_tolerance
        return np.repeat((np.inf, *[mechanism] * 3, harmonic, harmonic * SECOND_HARMONIC),
                         list(self.sizes.values()))

    @cached_property
    def base_tangents(self) -> tuple[Array, Array]:
        """Return the directions in which Z1C deviates: towards Z1A, and across."""
        first, _, third = np.array(self.nominal.base_axes)
        towards = first - (first @ third) * third
        towards /= np.linalg.norm(towards)
        return towards, np.cross(third, towards)

    @cached_property
    def platform_tangents(self) -> Array:
        """Return three deviations of the nine components that are no rotation, shape (3, 3, 3)."""
        axes = np.array(self.nominal.platform_axes)
        turns = np.stack([np.cross(unit, axes).ravel() for unit in np.eye(3)])
        lengths = np.zeros((3, 9))
        for leg, axis in enumerate(axes):
            lengths[leg, 3 * leg:3 * leg + 3] = axis
        # The null space of rotations and lengths.
        return np.linalg.svd(np.vstack([turns, lengths]))[2][6:].reshape(3, 3, 3)

    def geometry(self, vector: Array) -> Geometry:
        """Return the mechanism of a vector, in its usual frames; GeometryError if impossible."""
        mechanism = vector[self.slices['links'].start:self.slices['platform axes'].stop]
        return _geometry(self, mechanism.tobytes())

    def harmonics(self, vector: Array) -> tuple[Array, Array]:
        """Return the cosine, sine of the first and second harmonics, shape (N, 2) each, rad."""
        first, second = (vector[self.slices[group]].reshape(-1, 2) for group in GROUPS[4:])
        return first, second

    def harmonic_deviation(self, angles: Array, vector: Array) -> tuple[Array, Array]:
        """Return reading minus angle by the harmonics, (n, N), rad, and its slope by the angle."""
        first, second = self.harmonics(vector)
        c1, s1, c2, s2 = (np.cos(angles), np.sin(angles), np.cos(2.0 * angles),
                          np.sin(2.0 * angles))
        return (first[:, 0] * c1 + first[:, 1] * s1 + second[:, 0] * c2 + second[:, 1] * s2,
                first[:, 1] * c1 - first[:, 0] * s1
                + 2.0 * (second[:, 1] * c2 - second[:, 0] * s2))


@lru_cache(maxsize=GEOMETRIES)
def _geometry(layout: Layout, numbers: bytes) -> Geometry:
    """Return a mechanism by the bytes of its part of a vector: links, base and platform axes."""
    nominal = layout.nominal
    proximal, distal, (turn, towards, across), deviations = np.frombuffer(numbers).reshape(4, 3)
    axes = np.array(nominal.base_axes)
    angle = np.arctan2(axes[1, 0], axes[1, 2]) + turn
    axes[1] = np.sin(angle), 0.0, np.cos(angle)
    to, over = layout.base_tangents
    axes[2] = axes[2] + towards * to + across * over
    axes[2] /= np.linalg.norm(axes[2])
    platform = np.array(nominal.platform_axes) + np.tensordot(
        deviations, layout.platform_tangents, 1)
    built = Geometry.from_axes(
        axes, np.array([axis / np.linalg.norm(axis) for axis in platform]),
        np.array(nominal.alphas) + proximal, np.array(nominal.betas) + distal)
    return in_usual_frames(built, nominal)
