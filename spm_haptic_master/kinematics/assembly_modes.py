# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Classic forward model: the assembly modes of three active joint angles (eqs. 1 to 7).

`forward_all` finds all of them. Along a motion, `track_mode` selects the one nearest to the last
orientation, and `continue_mode` follows one from its last passive angles.

The turn equations of legs B and C are linear in cos th3A and sin th3A. Eliminating both (eqs. 3,
4) leaves a trigonometric polynomial of degree 4 in th2A with at most 8 real roots. As in the
paper, it is solved as a polynomial of degree 8 in the tangent of a half angle, but with the half
angle measured from where the polynomial is largest, so that no root is near infinity. Each root
gives th3A, and both angles are polished on the closures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
import math
from typing import Generic, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from spm_haptic_master.exceptions import InputError, SingularityError, UnreachableError
from spm_haptic_master.kinematics.checks import check_angles, check_rotations
from spm_haptic_master.kinematics.geometry import check_geometry, Geometry, PAPER_GEOMETRY
from spm_haptic_master.kinematics.leg_kernels import (
    both_turns,
    chain_quaternion,
    common_turn,
    into_second_link,
    into_third_joint,
    second_in_second_joint,
    turn_equation,
    turn_through_link,
)
from spm_haptic_master.kinematics.number_backends import (
    Array,
    Backend,
    FLOATS,
    N,
    Quaternion,
    Vector,
)
from spm_haptic_master.kinematics.rotations import (
    quaternion_from_matrix,
    rotation_distance,
    rotation_from_quaternion,
)

# Number of samples of the trigonometric polynomial of degree 4: the number of its coefficients.
SAMPLES = 9
# Values of th2A at the samples (rad).
SAMPLE_ANGLES = tuple(2.0 * math.pi * j / SAMPLES for j in range(SAMPLES))
# With eta half the angle, the polynomial is sum_i p_i cos^(8-i)(eta) sin^i(eta). The samples are
# at eta = pi / 2 + j pi / 9, so that the first one is the coefficient of t^8.
ETA = 0.5 * math.pi + math.pi * np.arange(SAMPLES)[:, None] / SAMPLES
POWERS = np.arange(SAMPLES)
# Matrix from the samples to the ascending coefficients of the polynomial in t, (9, 9), unit 1.
COSINE_POWERS = np.cos(ETA) ** (8 - POWERS)
SINE_POWERS = np.sin(ETA) ** POWERS
HALF_ANGLE_MATRIX = np.linalg.inv(COSINE_POWERS * SINE_POWERS)
# Largest |Z2k . Z3k - cos beta| of an assembly mode (unit 1): far above rounding, so that modes
# which just meet at a singularity are found, and far below 1e-9, the accuracy of forward_all.
CLOSURE_TOLERANCE = 1e-12
# Largest closure error that may be rounding alone (unit 1): some ten units in the last place.
ROUNDING = 2e-15
# Largest |Im t| / (1 + |t|^2) of a root t = tan(th2A / 2) that is polished as a real one (unit 1):
# rounding splits a double root by 1e-7 and a fourfold one by 1e-3. Polishing rejects the others.
NEAR_REAL = 0.1
# Smallest sine of the angle between (L1, M1) and (L2, M2) at which eq. 3 determines th3A (unit 1):
# below, two modes may share th2A, and both solutions of one of the two equations are tried.
PARALLEL_EQUATIONS = 1e-3
# Largest polynomial, relative to the size of its terms, of which every th2A is a root (unit 1).
SELF_MOTION = 1e-12
# Largest number of Newton steps: one or two are usual, many at a multiple root.
POLISHING_STEPS = 60
# Smallest fraction of a Newton step before polishing ends (unit 1), and largest angle between two
# solutions that may be one mode (rad).
LEAST_SCALE = 1e-3
MERGING_ANGLE = 1e-3
# Smallest difference between the distances of two distinguishable modes from the last orientation
# (rad): the platform turns about this far between samples at 1 kHz (10 rad/s).
AMBIGUITY_MARGIN = 0.01
# Two turn equations in one angle, from cosine and sine of another.
TurnEquations: TypeAlias = Callable[[float, float], tuple[Vector[float], Vector[float]]]


class Mode(NamedTuple):
    """
    An assembly mode.

    Attributes
    ----------
    quaternion : tuple of 4 float
        Orientation of the platform, x, y, z, w.
    th2a, th3a : float
        Passive angles of leg A, rad.
    determinant : float
        Of the closures' rates (unit 1): zero where two modes meet.

    """

    quaternion: Quaternion[float]
    th2a: float
    th3a: float
    determinant: float


@dataclass(frozen=True, slots=True)
class LockedChain(Generic[N]):
    """
    Mechanism with its active joints locked.

    Attributes
    ----------
    th1a : number
        Active angle of leg A, rad.
    seconds : tuple of two vectors
        Z2B and Z2C in the frame of leg A's second joint (unit 1).
    g : Geometry
        Link angles and axes.

    """

    th1a: N
    seconds: tuple[Vector[N], ...]
    g: Geometry

    @classmethod
    def of(
        cls,
        th1: Sequence[N],
        g: Geometry,
        m: Backend[N],
    ) -> LockedChain[N]:
        """Return the chain of th1A, th1B, th1C (rad) of a Geometry; nothing is validated."""
        th1a, *others = th1
        c1 = m.cos(th1a)
        s1 = m.sin(th1a)
        seconds = []
        for angle, carried in zip(others, g.carried, strict=True):
            cosine = m.cos(angle)
            sine = m.sin(angle)
            seconds.append(second_in_second_joint(c1, s1, cosine, sine, carried))
        return cls(
            th1a=th1a,
            seconds=tuple(seconds),
            g=g,
        )

    def turn_equations(self, c: N, s: N) -> tuple[Vector[N], Vector[N]]:
        """Eqs. 1 and 2: (L, M, N) of legs B and C for th3A, from cosine and sine of th2A."""
        equations = []
        for axis, carried in zip(self.seconds, self.g.carried, strict=True):
            before = into_third_joint(c, s, axis, self.g)
            equations.append(turn_equation(before, carried.third, carried.cos_beta))
        first, second = equations
        return first, second

    def closures(self: LockedChain[float], th2a: float, th3a: float) -> list[float]:
        """Return closure error, rates along th2A and th3A, of leg B, then of leg C (unit 1)."""
        c2 = math.cos(th2a)
        s2 = math.sin(th2a)
        c3 = math.cos(th3a)
        s3 = math.sin(th3a)
        carrier = self.g.legs[0]
        found = []
        for second, carried in zip(self.seconds, self.g.carried, strict=True):
            dx, dy, dz = into_second_link(c2, s2, second)
            vx, vy, vz = turn_through_link(c3, s3, carried.before_distal)
            # A turn of the platform about a unit axis changes it at the rate axis . (Z3k x Z2k).
            y = vz * dx - vx * dz
            z = vx * dy - vy * dx
            found += [
                dx * vx + dy * vy + dz * vz - carried.cos_beta,
                z,
                carrier.cos_beta * z - carrier.sin_beta * y,
            ]
        return found

    def quaternion(self: LockedChain[float], th2a: float, th3a: float) -> Quaternion[float]:
        """Orientation of the platform, x, y, z, w, from leg A's passive angles in rad."""
        return chain_quaternion(self.th1a, th2a, th3a, self.g, FLOATS)


def checked_chain(th1: ArrayLike, geometry: Geometry) -> LockedChain[float]:
    """Return the chain of one triple th1 (3,), rad; InputError if an argument is wrong."""
    triple = check_angles('th1', th1, (3,))
    if triple.ndim != 1:
        raise InputError(f'th1 has shape {triple.shape}: expected one triple, (3,)')
    return LockedChain.of(triple.tolist(), check_geometry(geometry), FLOATS)


def eliminant(first: Vector[float], second: Vector[float]) -> float:
    """Left side of eq. 4: zero where the two equations have a common th3A."""
    cosine, sine, determinant = common_turn(first, second)
    return cosine * cosine + sine * sine - determinant * determinant


def eliminant_roots(equations: TurnEquations) -> list[float] | None:
    """
    Return the angles, rad, at which two turn equations may have a common solution.

    `equations` returns the equations, in a further angle, from cosine and sine of the angle that
    is sought. Returned are the real and nearly real roots of eq. 4, at most 8; None where every
    angle is one.
    """
    samples = []
    size = 0.0
    for angle in SAMPLE_ANGLES:
        cosine = math.cos(angle)
        sine = math.sin(angle)
        first, second = equations(cosine, sine)
        samples.append(eliminant(first, second))
        first_size = math.hypot(*first)
        second_size = math.hypot(*second)
        size = max(size, first_size**2 * second_size**2)
    largest = max(range(SAMPLES), key=lambda j: abs(samples[j]))
    if abs(samples[largest]) <= SELF_MOTION * size:
        return None
    # The largest one first: it is the coefficient of t^8, which must not vanish.
    ordered = samples[largest:] + samples[:largest]
    coefficients = HALF_ANGLE_MATRIX @ np.array(ordered)
    infinity = SAMPLE_ANGLES[largest]
    found = []
    for t in np.roots(coefficients[::-1]).tolist():
        # Of a pair of conjugate roots, one is enough.
        largest_part = NEAR_REAL * (1.0 + abs(t) ** 2)
        if 0.0 <= t.imag <= largest_part:
            half = math.atan(t.real)
            found.append(infinity + math.pi + 2.0 * half)
    return found


def common_turns(first: Vector[float], second: Vector[float]) -> Sequence[float]:
    """Return the candidates, rad, for the common solution of two turn equations."""
    cosine, sine, determinant = common_turn(first, second)
    size1 = math.hypot(*first[:2])
    size2 = math.hypot(*second[:2])
    if abs(determinant) > PARALLEL_EQUATIONS * size1 * size2:
        return [math.atan2(sine * determinant, cosine * determinant)]
    if size1 > size2:
        return both_turns(first)
    return both_turns(second)


def polish(
    chain: LockedChain[float],
    th2a: float,
    th3a: float,
) -> tuple[float, float, float, float]:
    """Polish th2A, th3A (rad) by Newton's method; return both, closure error, determinant."""
    fb, b2, b3, fc, c2, c3 = chain.closures(th2a, th3a)
    error = math.hypot(fb, fc)
    scale = 1.0
    for _ in range(POLISHING_STEPS):
        # It does not slow the convergence, and keeps the step defined where two modes meet.
        damping = error * error
        a22 = b2 * b2 + c2 * c2 + damping
        a23 = b2 * b3 + c2 * c3
        a33 = b3 * b3 + c3 * c3 + damping
        determinant = a22 * a33 - a23 * a23
        if error == 0.0 or determinant <= 0.0 or scale < LEAST_SCALE:
            break
        r2 = b2 * fb + c2 * fc
        r3 = b3 * fb + c3 * fc
        new2 = th2a - scale * (a33 * r2 - a23 * r3) / determinant
        new3 = th3a - scale * (a22 * r3 - a23 * r2) / determinant
        closures = chain.closures(new2, new3)
        new_error = math.hypot(closures[0], closures[3])
        if new_error < error:
            th2a = new2
            th3a = new3
            error = new_error
            fb, b2, b3, fc, c2, c3 = closures
            scale = 1.0
        elif error < ROUNDING:
            break
        else:
            scale *= 0.5
    return th2a, th3a, error, b2 * c3 - b3 * c2


def assembly_modes(chain: LockedChain[float]) -> list[Mode]:
    """All assembly modes; SingularityError where they are infinitely many."""
    roots = eliminant_roots(chain.turn_equations)
    if roots is None:
        raise SingularityError(
            f'th1A = {chain.th1a} rad and {chain.g}: the platform moves freely with the active '
            'joints locked; there are infinitely many assembly modes'
        )
    modes: list[Mode] = []
    for root in roots:
        equations = chain.turn_equations(math.cos(root), math.sin(root))
        for candidate in common_turns(*equations):
            th2a, th3a, error, determinant = polish(chain, root, candidate)
            if error > CLOSURE_TOLERANCE:
                continue
            mode = Mode(
                quaternion=chain.quaternion(th2a, th3a),
                th2a=th2a,
                th3a=th3a,
                determinant=determinant,
            )
            if not any(_same_mode(chain, mode, known) for known in modes):
                modes.append(mode)
    return modes


def _same_mode(
    chain: LockedChain[float],
    mode: Mode,
    other: Mode,
) -> bool:
    """Return whether two solutions are one mode: half-way between them the legs close as well."""
    if rotation_distance(mode.quaternion, other.quaternion) > MERGING_ANGLE:
        return False
    half2 = 0.5 * math.remainder(other.th2a - mode.th2a, 2.0 * math.pi)
    half3 = 0.5 * math.remainder(other.th3a - mode.th3a, 2.0 * math.pi)
    fb, _, _, fc, _, _ = chain.closures(mode.th2a + half2, mode.th3a + half3)
    return math.hypot(fb, fc) < ROUNDING


def forward_all(th1: ArrayLike, geometry: Geometry = PAPER_GEOMETRY) -> Array:
    """
    Every real assembly mode of one triple of active joint angles (eqs. 1 to 7).

    Parameters
    ----------
    th1 : array_like, shape (3,)
        Active joints A, B, C, rad.
    geometry : Geometry
        Link angles and axes.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        R_base_platform of the n = 0 .. 8 modes, in no particular order. All loops close to
        `CLOSURE_TOLERANCE`. Two modes that meet at a parallel singularity are returned as one
        where rounding makes them indistinguishable (some 1e-7 rad), else as two.

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.
    SingularityError
        The platform moves freely with these joints locked: infinitely many modes.

    """
    chain = checked_chain(th1, geometry)
    rotations = []
    for mode in assembly_modes(chain):
        rotations.append(rotation_from_quaternion(*mode.quaternion))
    return np.array(rotations).reshape(-1, 3, 3)


# Along a motion ----------------------------------------------------------------------------------


class TrackedMode(NamedTuple):
    """
    The assembly mode nearest to a last known orientation.

    Attributes
    ----------
    rotation : ndarray, shape (3, 3)
        R_base_platform of the nearest mode.
    ambiguous : bool
        True if another mode is about as near, so that either may be the platform's.

    """

    rotation: Array
    ambiguous: bool


def continue_mode(
    th1: Sequence[float],
    th2a: float,
    th3a: float,
    geometry: Geometry,
) -> tuple[Quaternion[float], float, float]:
    """
    Classic forward model along a motion, by Newton's method from the last passive angles.

    Nothing is validated. Next to a parallel singularity noise takes the active angles beyond the
    last ones that can be assembled: then it is the pose with the least closure error.

    Parameters
    ----------
    th1 : sequence of three float
        Active joints A, B, C, rad.
    th2a, th3a : float
        Passive angles of leg A to start from, rad.
    geometry : Geometry
        Link angles and axes.

    Returns
    -------
    quaternion : tuple of four float
        x, y, z, w of R_base_platform.
    th2a, th3a : float
        The new passive angles of leg A, rad.

    """
    chain = LockedChain.of(th1, geometry, FLOATS)
    th2a, th3a, *_ = polish(chain, th2a, th3a)
    return chain.quaternion(th2a, th3a), th2a, th3a


def track_mode(
    th1: ArrayLike,
    last: ArrayLike,
    geometry: Geometry = PAPER_GEOMETRY,
) -> TrackedMode:
    """
    Classic forward model with branch tracking: the mode nearest to the last orientation (Fig. 10).

    Parameters
    ----------
    th1 : array_like, shape (3,)
        Active joints A, B, C, rad.
    last : array_like, shape (3, 3)
        R_base_platform to start from.
    geometry : Geometry
        Link angles and axes.

    Returns
    -------
    TrackedMode

    Raises
    ------
    InputError
        An argument has a wrong type, shape or value.
    UnreachableError
        No assembly mode closes.
    SingularityError
        The platform moves freely with these joints locked: infinitely many modes.

    """
    chain = checked_chain(th1, geometry)
    matrix = check_rotations('last', last)
    if matrix.ndim != 2:
        raise InputError(f'last has shape {matrix.shape}: expected one rotation, (3, 3)')
    x, y, z, w = quaternion_from_matrix(matrix).tolist()
    before = (x, y, z, w)

    def order(mode: Mode) -> tuple[float, Quaternion[float]]:
        return rotation_distance(mode.quaternion, before), mode.quaternion

    modes = sorted(assembly_modes(chain), key=order)
    if not modes:
        raise UnreachableError(f'th1 = {np.asarray(th1).tolist()} rad: no assembly mode closes')
    nearest = modes[0]
    # Where two modes merged into one the rates are parallel, to the root of the rounding.
    ambiguous = abs(nearest.determinant) < math.sqrt(ROUNDING)
    if len(modes) > 1:
        distance = rotation_distance(nearest.quaternion, before)
        next_distance = rotation_distance(modes[1].quaternion, before)
        ambiguous = ambiguous or next_distance - distance < AMBIGUITY_MARGIN
    rotation = np.array(rotation_from_quaternion(*nearest.quaternion))
    return TrackedMode(rotation.reshape(3, 3), ambiguous)
