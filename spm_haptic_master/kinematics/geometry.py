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
from spm_haptic_master.kinematics.checks import check_angle, check_axes, check_links, ThreeAxes
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    rotation_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import times

# Angle between neighbouring platform axes about Z_E (rad).
THIRD_OF_A_TURN = 2.0 * math.pi / 3.0
# Nominal base axes Z1A, Z1B, Z1C, in the base frame.
NOMINAL_BASE_AXES: ThreeAxes = (
    (0.0, 0.0, 1.0),
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
)
# The quaternions that are all others' sum, x, y, z, w.
UNIT_QUATERNIONS: tuple[Quaternion[float], ...] = (
    (1.0, 0.0, 0.0, 0.0),
    (0.0, 1.0, 0.0, 0.0),
    (0.0, 0.0, 1.0, 0.0),
    (0.0, 0.0, 0.0, 1.0),
)
# Turns of leg k's frame N_k in the base: none, 120 and 240 deg about (1, 1, 1).
BASE_TURNS: tuple[Quaternion[float], ...] = (
    (0.0, 0.0, 0.0, 1.0),
    (0.5, 0.5, 0.5, 0.5),
    (0.5, 0.5, 0.5, -0.5),
)
# Turns of leg k's frame N_k in the platform: none, 120 and 240 deg about z.
PLATFORM_TURNS: tuple[Quaternion[float], ...] = (
    (0.0, 0.0, 0.0, 1.0),
    (0.0, 0.0, math.sqrt(0.75), 0.5),
    (0.0, 0.0, math.sqrt(0.75), -0.5),
)
# x, y, c x, c y, s z, s x, s y, c z of an axis (x, y, z) and a link with cosine c and sine s.
LinkTurn = tuple[float, float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Leg:
    """
    Constants of one leg.

    Attributes
    ----------
    cos_alpha, sin_alpha, cos_beta, sin_beta : float
        Of the proximal and the distal link's angle (unit 1).
    first : tuple of three float
        Z1k in the base frame.
    second : tuple of three 3-tuples of float
        p, q, r of Z2k = p + q cos th1k + r sin th1k, in the base frame.
    third : tuple of three float
        Z3k in the platform frame.
    base_frame : tuple of nine float
        B_k, row by row; its third column is Z1k.
    platform_frame : tuple of nine float
        Q_k, row by row; its third column is Z3k.

    """

    cos_alpha: float
    sin_alpha: float
    cos_beta: float
    sin_beta: float
    first: Vector[float]
    second: ThreeAxes
    third: Vector[float]
    base_frame: Rotation[float]
    platform_frame: Rotation[float]


@dataclass(frozen=True, slots=True)
class Carried:
    """
    Constants of leg B or C seen from leg A, which carries the platform.

    Attributes
    ----------
    cos_beta : float
        Cosine of the distal link's angle (unit 1).
    first : tuple of eight float
        `LinkTurn` of Z1k from leg A's frame B_A through its proximal link: Rx(-alpha).
    second : tuple of eleven float
        p, q, r of `Leg.second`, in leg A's frame B_A; cosine and sine of leg A's alpha.
    third : tuple of three float
        Z3k in leg A's frame Q_A, i.e. after its third joint.
    before_distal : tuple of eight float
        `LinkTurn` of `third` through leg A's distal link: Rx(beta).
    zero : tuple of eight float
        The same of the direction from which th3k is measured: the first axis of Q_k.

    """

    cos_beta: float
    first: LinkTurn
    second: tuple[float, float, float, float, float, float, float, float, float, float, float]
    third: Vector[float]
    before_distal: LinkTurn
    zero: LinkTurn


def leg_frame(turn: Quaternion[float], axis: Vector[float]) -> Quaternion[float]:
    """Turn a leg's frame N_k by the smallest rotation that takes its z to an axis."""
    x, y, z = times(rotation_from_quaternion(*conjugate(turn)), axis)
    sine = math.hypot(x, y)
    half = 0.5 * math.atan2(sine, z)
    scale = 0.0
    if sine > 0.0:
        scale = math.sin(half) / sine
    to_axis = (-scale * y, scale * x, 0.0, math.cos(half))
    return multiply_quaternions(turn, to_axis)


def leg_constants(
    alpha: float,
    beta: float,
    base: Quaternion[float],
    platform: Quaternion[float],
) -> Leg:
    """Return the constants of a leg from its link angles and its frames B_k and Q_k."""
    in_base = rotation_from_quaternion(*base)
    in_platform = rotation_from_quaternion(*platform)
    cos_alpha = math.cos(alpha)
    sin_alpha = math.sin(alpha)
    # The columns of B_k: its axes in the base frame.
    xx, yx, zx, xy, yy, zy, xz, yz, zz = in_base
    return Leg(
        cos_alpha=cos_alpha,
        sin_alpha=sin_alpha,
        cos_beta=math.cos(beta),
        sin_beta=math.sin(beta),
        first=(zx, zy, zz),
        second=(
            (cos_alpha * zx, cos_alpha * zy, cos_alpha * zz),
            (-sin_alpha * yx, -sin_alpha * yy, -sin_alpha * yz),
            (sin_alpha * xx, sin_alpha * xy, sin_alpha * xz),
        ),
        third=(in_platform[2], in_platform[5], in_platform[8]),
        base_frame=in_base,
        platform_frame=in_platform,
    )


def carried_constants(leg: Leg, carrier: Leg) -> Carried:
    """Return the constants of leg B or C from those of leg A."""

    def into(frame: Rotation[float], axis: tuple[float, ...]) -> Vector[float]:
        x, y, z = (sum(frame[3 * i + j] * axis[i] for i in range(3)) for j in range(3))
        return x, y, z

    p, q, r = (into(carrier.base_frame, axis) for axis in leg.second)
    first = into(carrier.base_frame, leg.first)
    third = into(carrier.platform_frame, leg.third)
    zero = into(carrier.platform_frame, leg.platform_frame[::3])
    return Carried(
        cos_beta=leg.cos_beta,
        first=_link_turn(first, carrier.cos_alpha, -carrier.sin_alpha),
        second=(*p, *q, *r, carrier.cos_alpha, carrier.sin_alpha),
        third=third,
        before_distal=_link_turn(third, carrier.cos_beta, carrier.sin_beta),
        zero=_link_turn(zero, carrier.cos_beta, carrier.sin_beta),
    )


def _link_turn(
    axis: Vector[float],
    cosine: float,
    sine: float,
) -> LinkTurn:
    """Return the constants of Rx(link) Rz(t) axis, from cosine and sine of the link's angle."""
    x, y, z = axis
    return x, y, cosine * x, cosine * y, sine * z, sine * x, sine * y, cosine * z


@dataclass(frozen=True, init=False, repr=False)
class Geometry:
    """
    Link angles and axes of the manipulator; the default is the paper's nominal one.

    `Geometry(alpha, beta, gamma)` is a nominal mechanism: three equal legs, orthogonal base axes.
    `Geometry.from_axes` is a mechanism as built; both cost the same. GeometryError if an angle is
    not a finite number in ]0, pi[.

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

    def __init__(
        self,
        alpha: float = math.radians(39.3),
        beta: float = math.radians(34.1),
        gamma: float = math.radians(18.2),
    ):
        alpha = check_angle('alpha', alpha)
        beta = check_angle('beta', beta)
        gamma = check_angle('gamma', gamma)
        axes = []
        for k in range(3):
            angle = k * THIRD_OF_A_TURN
            x = -math.sin(gamma) * math.sin(angle)
            y = math.sin(gamma) * math.cos(angle)
            axes.append((x, y, math.cos(gamma)))
        first, second, third = axes
        self._set(
            alphas=(alpha,) * 3,
            betas=(beta,) * 3,
            base_axes=NOMINAL_BASE_AXES,
            platform_axes=(first, second, third),
            nominal=(alpha, beta, gamma),
        )

    @classmethod
    def from_axes(
        cls,
        base_axes: ArrayLike,
        platform_axes: ArrayLike,
        alpha: ArrayLike,
        beta: ArrayLike,
    ) -> Geometry:
        """
        Return the mechanism as built: every axis and every link as measured.

        The frames are those in which the axes are given. The joints' zeros depend on them: see the
        module. `in_usual_frames` turns the axes to frames that need no outside reference.

        Parameters
        ----------
        base_axes : array_like, shape (3, 3)
            Rows Z1A, Z1B, Z1C, unit vectors in the base frame.
        platform_axes : array_like, shape (3, 3)
            Rows Z3A, Z3B, Z3C, unit vectors in the platform frame.
        alpha, beta : array_like, shape (3,)
            Angles of the proximal and distal links of the legs A, B, C, rad, in ]0, pi[.

        Returns
        -------
        Geometry

        Raises
        ------
        GeometryError
            An argument has a wrong type or shape; an axis is no unit vector (`LENGTH_TOLERANCE`),
            or opposite to its nominal direction (the platform's: to z); two axes of the base or
            the platform are parallel (`LEAST_ANGLE`); a link angle is not in ]0, pi[.

        """
        base = check_axes(
            name='base_axes',
            axes=base_axes,
            symbol='Z1',
            nominal=NOMINAL_BASE_AXES,
        )
        platform = check_axes(
            name='platform_axes',
            axes=platform_axes,
            symbol='Z3',
            nominal=((0.0, 0.0, 1.0),) * 3,
        )
        geometry = object.__new__(cls)
        geometry._set(
            alphas=check_links('alpha', alpha),
            betas=check_links('beta', beta),
            base_axes=base,
            platform_axes=platform,
            nominal=None,
        )
        return geometry

    def _set(
        self,
        alphas: Vector[float],
        betas: Vector[float],
        base_axes: ThreeAxes,
        platform_axes: ThreeAxes,
        nominal: Vector[float] | None,
    ) -> None:
        """Set all attributes from checked link angles and axes."""
        in_base = list(map(leg_frame, BASE_TURNS, base_axes))
        in_platform = list(map(leg_frame, PLATFORM_TURNS, platform_axes))
        leg_a, leg_b, leg_c = map(leg_constants, alphas, betas, in_base, in_platform)
        half_difference = 0.5 * (betas[0] - alphas[0])
        half_total = 0.5 * (alphas[0] + betas[0])
        columns = []
        from_platform = conjugate(in_platform[0])
        for unit in UNIT_QUATERNIONS:
            turned = multiply_quaternions(in_base[0], unit)
            columns.append(multiply_quaternions(turned, from_platform))
        chain: list[float] = []
        for row in range(4):
            chain += [column[row] for column in columns]
        values: dict[str, Any] = {
            'alphas': alphas,
            'betas': betas,
            'base_axes': base_axes,
            'platform_axes': platform_axes,
            '_nominal': nominal,
            'legs': (leg_a, leg_b, leg_c),
            'carried': (carried_constants(leg_b, leg_a), carried_constants(leg_c, leg_a)),
            'half_angles': (
                math.cos(half_total),
                math.sin(half_total),
                math.cos(half_difference),
                math.sin(half_difference),
            ),
            'chain': tuple(chain),
        }
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
                'expected the use of alphas, betas and platform_axes'
            )
        return self._nominal[index]

    def __repr__(self) -> str:
        """Return the call that makes this geometry."""
        if self._nominal is not None:
            alpha, beta, gamma = self._nominal
            return f'Geometry(alpha={alpha!r}, beta={beta!r}, gamma={gamma!r})'
        return (
            f'Geometry.from_axes(base_axes={self.base_axes!r}, '
            f'platform_axes={self.platform_axes!r}, alpha={self.alphas!r}, '
            f'beta={self.betas!r})'
        )


def check_geometry(geometry: object, name: str = 'geometry') -> Geometry:
    """Return the argument `name` if it is a Geometry; InputError otherwise."""
    if not isinstance(geometry, Geometry):
        raise InputError(f'{name} = {quoted(geometry)}: expected a Geometry')
    return geometry


# Geometry of the paper's manipulator: [39.3, 34.1, 18.2] deg.
PAPER_GEOMETRY = Geometry()


def in_usual_frames(geometry: Geometry, nominal: Geometry = PAPER_GEOMETRY) -> Geometry:
    """
    Return a mechanism with its axes in the frames that need no outside reference.

    Base: z = Z1A, and Z1B in the half plane of positive x of x and z. Platform: its three axes
    nearest, in the sum of squares, to their nominal directions.

    Parameters
    ----------
    geometry : Geometry
        The mechanism, its axes in any frames.
    nominal : Geometry
        The mechanism with the nominal directions of the platform's axes.

    Returns
    -------
    Geometry
        The same mechanism; its joints' zeros are those of its new frames.

    Raises
    ------
    InputError
        An argument is no Geometry.
    GeometryError
        An axis is opposite to its nominal direction in the new frames.

    """
    check_geometry(geometry)
    check_geometry(nominal, 'nominal')
    axes = np.array(geometry.base_axes)
    first, second, _ = axes
    x = second - (second @ first) * first
    x /= np.linalg.norm(x)
    base = np.stack([x, np.cross(first, x), first])
    built = np.array(geometry.platform_axes)
    wanted = np.array(nominal.platform_axes)
    left, _, right = np.linalg.svd(wanted.T @ built)
    handedness = np.linalg.det(left @ right)
    platform = left @ np.diag([1.0, 1.0, handedness]) @ right
    moved = axes @ base.T
    # Exactly so, and not to rounding.
    moved[0] = (0.0, 0.0, 1.0)
    moved[1, 1] = 0.0
    return Geometry.from_axes(
        base_axes=moved,
        platform_axes=built @ platform.T,
        alpha=geometry.alphas,
        beta=geometry.betas,
    )
