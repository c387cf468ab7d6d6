# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mechanism written down a second time, from facts.md and with plain matrices.

Nothing here uses the package's formulas, so that tests compare two independent statements.
"""

import math

import numpy as np

from spm_haptic_master.kinematics import Geometry

MODES = [(a, b, c) for a in (1, -1) for b in (1, -1) for c in (1, -1)]
LEG_TURN = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""z to x to y: base frame of leg A to that of leg B."""

CENTRE = math.radians(135.0), math.acos(1.0 / math.sqrt(3.0))
"""ZXZ psi, theta of the workspace's centre, rad."""


def about_z(angle):
    """Matrix of a turn about z, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def about_x(angle):
    """Matrix of a turn about x, rad."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def zxz(psi, theta, phi):
    """Matrix of ZXZ Euler angles, rad."""
    return about_z(psi) @ about_x(theta) @ about_z(phi)


def turn(vector):
    """Matrix of a rotation vector, rad (Rodrigues)."""
    vector = np.asarray(vector, dtype=float)
    angle = np.linalg.norm(vector)
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * k + (1.0 - math.cos(angle)) * k @ k


def small_vector(matrices):
    """Rotation vectors of small rotations, to third order, (..., 3)."""
    return 0.5 * np.stack([
        matrices[..., 2, 1] - matrices[..., 1, 2], matrices[..., 0, 2] - matrices[..., 2, 0],
        matrices[..., 1, 0] - matrices[..., 0, 1]], axis=-1)


def angle_between(p, q):
    """Angle between two rotations, rad; good for small ones too."""
    return 2.0 * math.asin(min(1.0, np.linalg.norm(np.asarray(p) - q) / math.sqrt(8.0)))


def first_axes():
    """Z1A, Z1B, Z1C in the base frame."""
    return [np.linalg.matrix_power(LEG_TURN, k) @ [0.0, 0.0, 1.0] for k in range(3)]


def second_axes(th1, g):
    """Z2A, Z2B, Z2C in the base frame."""
    return [np.linalg.matrix_power(LEG_TURN, k) @ about_z(th1[k]) @ about_x(g.alpha)
            @ [0.0, 0.0, 1.0] for k in range(3)]


def third_axes(R, g):
    """Z3A, Z3B, Z3C in the base frame."""
    return [R @ about_z(2.0 * math.pi * k / 3.0) @ about_x(-g.gamma) @ [0.0, 0.0, 1.0]
            for k in range(3)]


def closures(th1, R, g):
    """Loop closure errors of the three legs."""
    return np.array([
        second @ third - math.cos(g.beta)
        for second, third in zip(second_axes(th1, g), third_axes(R, g), strict=True)])


def working_mode(th1, R, g):
    """Return the signs of B_kk = Z1k . (Z2k x Z3k)."""
    return tuple(
        int(np.sign(first @ np.cross(second, third)))
        for first, second, third in zip(
            first_axes(), second_axes(th1, g), third_axes(R, g), strict=True))


def chain(th1a, th2a, th3a, g):
    """Orientation of a platform carried by leg A."""
    return (about_z(th1a) @ about_x(g.alpha) @ about_z(th2a) @ about_x(g.beta) @ about_z(th3a)
            @ about_x(g.gamma))


def tilted(phi, tilt, azimuth):
    """Turn the workspace's centre at phi by tilt about an axis perpendicular to (1, 1, 1)."""
    first = np.array([1.0, -1.0, 0.0]) / math.sqrt(2.0)
    second = np.array([1.0, 1.0, -2.0]) / math.sqrt(6.0)
    axis = math.cos(azimuth) * first + math.sin(azimuth) * second
    return turn(tilt * axis) @ zxz(*CENTRE, phi)


def random_rotation(rng):
    """Draw a rotation from the uniform distribution."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0.0 else -q


def reachable(R, g, slack=0.0):
    """Tell whether each Z3k is as far from its Z1k as the two links can span, by `slack` rad."""
    for first, third in zip(first_axes(), third_axes(R, g), strict=True):
        angle = math.acos(max(-1.0, min(1.0, first @ third)))
        if not (abs(g.alpha - g.beta) + slack <= angle
                <= min(g.alpha + g.beta, 2.0 * math.pi - g.alpha - g.beta) - slack):
            return False
    return True


def reachable_rotation(rng, g, slack=0.0, attempts=100000):
    """Draw a random rotation within reach, or None where none turns up."""
    for _ in range(attempts):
        R = random_rotation(rng)
        if reachable(R, g, slack):
            return R
    return None


def random_geometry(rng):
    """Draw a geometry with room to move: it reaches about one rotation in a hundred or more."""
    while True:
        g = Geometry(*rng.uniform(0.3, 2.4, 3))
        if reachable_rotation(rng, g, slack=0.05, attempts=100) is not None:
            return g
