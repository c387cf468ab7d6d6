# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three floats, and rotations between two orientations."""

from __future__ import annotations

from math import sqrt
from typing import TypeAlias

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    vector_from_quaternion,
)

# Numbers of the 1 kHz path: x, y, z, and x, y, z, w of a rotation.
FloatVector: TypeAlias = Vector[float]
FloatQuaternion: TypeAlias = Quaternion[float]
ZERO: FloatVector = (0.0, 0.0, 0.0)


def norm(vector: FloatVector) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def scaled(vector: FloatVector, factor: float) -> FloatVector:
    """Return a vector times a number."""
    x, y, z = vector
    return factor * x, factor * y, factor * z


def total(a: FloatVector, b: FloatVector) -> FloatVector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def difference(a: FloatVector, b: FloatVector) -> FloatVector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


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


def rotation_between(one: FloatQuaternion, other: FloatQuaternion) -> FloatVector:
    """Return the rotation vector, rad, in the base frame, that turns one rotation to the other."""
    return vector_from_quaternion(*multiply_quaternions(other, conjugate(one)))


def moved_toward(
    before: FloatVector,
    wanted: FloatVector,
    gain: float,
) -> FloatVector:
    """Return the vector nearest to the wanted one that differs from `before` by `gain` at most."""
    change = difference(wanted, before)
    size = norm(change)
    if size <= gain:
        return wanted
    return total(before, scaled(change, gain / size))
