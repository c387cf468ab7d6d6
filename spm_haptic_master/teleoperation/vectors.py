# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three floats, and unit quaternions that rotate them."""

from __future__ import annotations

from math import sqrt
from typing import TypeAlias

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.vectors import added, scaled, subtracted

# Numbers of the 1 kHz path: x, y, z, and x, y, z, w of a rotation.
FloatVector: TypeAlias = Vector[float]
FloatQuaternion: TypeAlias = Quaternion[float]
ZERO: FloatVector = (0.0, 0.0, 0.0)
# Largest deviation of a pose's squared norm from 1 (unit 1): a controller in single precision
# passes, a quaternion of zeros or of other numbers does not.
NORM_TOLERANCE = 1e-3


def norm(vector: FloatVector) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def rotate(rotation: FloatQuaternion, vector: FloatVector) -> FloatVector:
    """Return R v = v + 2 w (q x v) + 2 q x (q x v), R as a unit quaternion q = x, y, z; w."""
    x, y, z, w = rotation
    a, b, c = vector
    # 2 (q x v)
    d = 2.0 * (y * c - z * b)
    e = 2.0 * (z * a - x * c)
    f = 2.0 * (x * b - y * a)
    return (
        a + w * d + y * f - z * e,
        b + w * e + z * d - x * f,
        c + w * f + x * e - y * d,
    )


def moved_toward(
    start: FloatVector,
    goal: FloatVector,
    step: float,
) -> FloatVector:
    """Return the vector on the way from start to goal that is a step away, or the goal."""
    way = subtracted(goal, start)
    length = norm(way)
    if length <= step:
        return goal
    return added(start, scaled(step / length, way))


def unit_quaternion(quaternion: FloatQuaternion) -> FloatQuaternion | None:
    """
    Normalise a quaternion that another program sent.

    Parameters
    ----------
    quaternion
        Four numbers x, y, z, w.

    Returns
    -------
    tuple of float, or None
        The quaternion of norm 1; None for one that is not finite or too far from it.

    """
    x, y, z, w = quaternion
    square = x * x + y * y + z * z + w * w
    # Also false where a component is not a number.
    if not abs(square - 1.0) < NORM_TOLERANCE:
        return None
    scale = 1.0 / sqrt(square)
    return scale * x, scale * y, scale * z, scale * w
