# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism: link angles and axes, nominal or as built, and the constants of the formulas.

Frames of leg k (k = 0, 1, 2 for A, B, C), with angles in rad:

    R = B_k Rz(th1k) Rx(alpha_k) Rz(th2k) Rx(beta_k) Rz(th3k) Q_k^T

B_k is leg k's frame in the base, with z on Z1k; Q_k is its frame in the platform, with z on Z3k.
They define the joints' zeros. On a nominal mechanism B_k is the base frame turned by k 120 deg
about (1, 1, 1), and Q_k = Rz(k 120 deg) Rx(-gamma). On a mechanism as built, each is the frame
N_k of a leg whose axis has not moved, turned by the smallest rotation that takes its z to the
axis: N_k is the base frame turned by k 120 deg about (1, 1, 1) for B_k, and the platform frame
turned by k 120 deg about z for Q_k. Nominal axes give the nominal frames.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import GeometryError, InputError, quoted
from spm_haptic_master.kinematics.checks import (
    check_angle,
    check_axes,
    check_links,
    check_zero,
    ThreeAxes,
)
from spm_haptic_master.kinematics.joints import LEG_NAMES
from spm_haptic_master.kinematics.leg_constants import (
    Carried,
    carried_constants,
    Leg,
    leg_constants,
    leg_frame,
)
from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import multiply_quaternions

# Angle between neighbouring platform axes about Z_E (rad).
THIRD_OF_A_TURN = 2.0 * math.pi / 3.0
# Nominal base axes Z1A, Z1B, Z1C, in the base frame.
NOMINAL_BASE_AXES: ThreeAxes = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
# Turns of leg k's frame N_k in the base: none, 120 and 240 deg about (1, 1, 1).
BASE_TURNS: tuple[Quaternion[float], ...] = (
    (0.0, 0.0, 0.0, 1.0), (0.5, 0.5, 0.5, 0.5), (0.5, 0.5, 0.5, -0.5))
# Turns of leg k's frame N_k in the platform: none, 120 and 240 deg about z.
PLATFORM_TURNS: tuple[Quaternion[float], ...] = (
    (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, math.sqrt(0.75), 0.5), (0.0, 0.0, math.sqrt(0.75), -0.5))


@dataclass(frozen=True, init=False, repr=False)
class Geometry:
    """
    Link angles and axes of the manipulator; the default is the paper's nominal one.

    `Geometry(alpha, beta, gamma)` is a nominal mechanism: three equal legs, orthogonal base axes.
    `Geometry.from_axes` is a mechanism as built. All formulas take their constants from here, so
    that both cost the same. GeometryError if an angle is not a finite number in ]0, pi[.

    Parameters
    ----------
    alpha : float
        Proximal link: angle between Z1k and Z2k, rad, in ]0, pi[.
    beta : float
        Distal link: angle between Z2k and Z3k, rad, in ]0, pi[.
    gamma : float
        Angle between the platform axis Z_E and each Z3k, rad, in ]0, pi[.

    Attributes
    ----------
    alphas, betas : tuple of three float
        Angles of the proximal and the distal links of the legs A, B, C, rad.
    base_axes : tuple of three 3-tuples of float
        Z1A, Z1B, Z1C in the base frame; z, x, y on a nominal mechanism.
    platform_axes : tuple of three 3-tuples of float
        Z3A, Z3B, Z3C in the platform frame; Z3k = Rz(k 120 deg) Rx(-gamma) z on a nominal one.

    """

    alphas: Vector[float]
    betas: Vector[float]
    base_axes: ThreeAxes
    platform_axes: ThreeAxes
    _nominal: Vector[float] | None = field(compare=False)
    legs: tuple[Leg, Leg, Leg] = field(compare=False)
    # The legs B and C, seen from leg A.
    carried: tuple[Carried, Carried] = field(compare=False)
    # Cosine and sine of (alpha + beta) / 2 and of (beta - alpha) / 2 of leg A.
    half_angles: tuple[float, float, float, float] = field(compare=False)
    # Matrix of q -> B_A q Q_A^T, row by row, for the quaternion x, y, z, w of leg A's chain.
    chain: tuple[float, ...] = field(compare=False)

    def __init__(self, alpha: float = math.radians(39.3), beta: float = math.radians(34.1),
                 gamma: float = math.radians(18.2)):
        alpha, beta = check_angle('alpha', alpha), check_angle('beta', beta)
        gamma = check_angle('gamma', gamma)
        first, second, third = (
            (-math.sin(gamma) * math.sin(k * THIRD_OF_A_TURN),
             math.sin(gamma) * math.cos(k * THIRD_OF_A_TURN), math.cos(gamma)) for k in range(3))
        self._set((alpha,) * 3, (beta,) * 3, NOMINAL_BASE_AXES, (first, second, third),
                  (alpha, beta, gamma))

    @classmethod
    def from_axes(cls, base_axes: ArrayLike, platform_axes: ArrayLike, alpha: ArrayLike,
                  beta: ArrayLike) -> Geometry:
        """
        Return the mechanism as built: every axis and every link as measured.

        The frames are those in which the axes are given. The joints' zeros depend on them: see the
        module. Their usual choice needs no outside reference. Base: z = Z1A, and Z1B in the half
        plane of positive x. Platform: its three axes nearest to their nominal directions.

        Parameters
        ----------
        base_axes : array_like, shape (3, 3)
            Rows Z1A, Z1B, Z1C, unit vectors in the base frame.
        platform_axes : array_like, shape (3, 3)
            Rows Z3A, Z3B, Z3C, unit vectors in the platform frame.
        alpha, beta : array_like, shape (3,)
            Angles of the proximal and distal links of the legs A, B, C, rad, in ]0, pi[.

        Raises
        ------
        GeometryError
            An argument has a wrong type or shape; an axis is no unit vector (`LENGTH_TOLERANCE`),
            or opposite to its nominal direction (the platform's: to z); two axes of the base or
            the platform are parallel (`LEAST_ANGLE`); a link angle is not in ]0, pi[.

        """
        base = check_axes('base_axes', base_axes)
        platform = check_axes('platform_axes', platform_axes)
        for leg, (axis, nominal) in enumerate(zip(base, NOMINAL_BASE_AXES, strict=True)):
            check_zero(f'base_axes: Z1{LEG_NAMES[leg]}', axis, nominal)
        for leg, axis in enumerate(platform):
            check_zero(f'platform_axes: Z3{LEG_NAMES[leg]}', axis, (0.0, 0.0, 1.0))
        geometry = object.__new__(cls)
        geometry._set(check_links('alpha', alpha), check_links('beta', beta), base, platform,
                      None)
        return geometry

    def _set(self, alphas: Vector[float], betas: Vector[float], base_axes: ThreeAxes,
             platform_axes: ThreeAxes, nominal: Vector[float] | None) -> None:
        """Set all attributes from checked link angles and axes."""
        in_base, in_platform = (
            [leg_frame(turn, axis) for turn, axis in zip(turns, axes, strict=True)]
            for turns, axes in ((BASE_TURNS, base_axes), (PLATFORM_TURNS, platform_axes)))
        leg_a, leg_b, leg_c = map(leg_constants, alphas, betas, in_base, in_platform)
        difference, total = betas[0] - alphas[0], alphas[0] + betas[0]
        x, y, z, w = in_platform[0]
        columns = [
            multiply_quaternions(multiply_quaternions(in_base[0], unit), (-x, -y, -z, w))
            for unit in ((1.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0),
                         (0.0, 0.0, 0.0, 1.0))]
        values: dict[str, Any] = {
            'alphas': alphas, 'betas': betas, 'base_axes': base_axes,
            'platform_axes': platform_axes, '_nominal': nominal, 'legs': (leg_a, leg_b, leg_c),
            'carried': (carried_constants(leg_b, leg_a), carried_constants(leg_c, leg_a)),
            'half_angles': (math.cos(0.5 * total), math.sin(0.5 * total),
                            math.cos(0.5 * difference), math.sin(0.5 * difference)),
            'chain': tuple(column[row] for row in range(4) for column in columns)}
        for name, value in values.items():
            object.__setattr__(self, name, value)

    @property
    def alpha(self) -> float:
        """Angle of a nominal mechanism's proximal links, rad; GeometryError on one as built."""
        return self._of_nominal(0)

    @property
    def beta(self) -> float:
        """Angle of a nominal mechanism's distal links, rad; GeometryError on one as built."""
        return self._of_nominal(1)

    @property
    def gamma(self) -> float:
        """Angle between Z_E and each Z3k of a nominal mechanism, rad; GeometryError otherwise."""
        return self._of_nominal(2)

    def _of_nominal(self, index: int) -> float:
        if self._nominal is None:
            raise GeometryError(
                f'{("alpha", "beta", "gamma")[index]} of a mechanism as built: its legs differ, '
                'expected the use of alphas, betas and platform_axes')
        return self._nominal[index]

    def __repr__(self) -> str:
        """Return the call that makes this geometry."""
        if self._nominal is not None:
            alpha, beta, gamma = self._nominal
            return f'Geometry(alpha={alpha!r}, beta={beta!r}, gamma={gamma!r})'
        return (f'Geometry.from_axes(base_axes={self.base_axes!r}, '
                f'platform_axes={self.platform_axes!r}, alpha={self.alphas!r}, '
                f'beta={self.betas!r})')


def check_geometry(geometry: object) -> Geometry:
    """Return `geometry` if it is a Geometry; InputError otherwise."""
    if not isinstance(geometry, Geometry):
        raise InputError(f'geometry = {quoted(geometry)}: expected a Geometry')
    return geometry


# Geometry of the paper's manipulator: [39.3, 34.1, 18.2] deg.
PAPER_GEOMETRY = Geometry()


def in_usual_frames(geometry: Geometry, nominal: Geometry = PAPER_GEOMETRY) -> Geometry:
    """
    Return a mechanism with its axes in the frames that need no outside reference.

    Base: z = Z1A, and Z1B in the half plane of positive x of x and z. Platform: its three axes
    nearest, in the sum of squares, to their nominal directions.

    Its joints' zeros are those of its new frames. GeometryError if an axis is opposite to its
    nominal direction there.
    """
    check_geometry(geometry)
    check_geometry(nominal)
    first, second, _ = axes = np.array(geometry.base_axes)
    x = second - (second @ first) * first
    x /= np.linalg.norm(x)
    base = np.stack([x, np.cross(first, x), first])
    built = np.array(geometry.platform_axes)
    left, _, right = np.linalg.svd(np.array(nominal.platform_axes).T @ built)
    platform = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    moved = axes @ base.T
    # Exactly so, and not to rounding.
    moved[0], moved[1, 1] = (0.0, 0.0, 1.0), 0.0
    return Geometry.from_axes(moved, built @ platform.T, geometry.alphas, geometry.betas)
