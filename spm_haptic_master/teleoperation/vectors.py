# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three floats, and rotations of them."""

from __future__ import annotations

from math import sqrt
from typing import TypeAlias

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.vectors import added, scaled, subtracted

# Numbers of the 1 kHz path: x, y, z, and x, y, z, w of a rotation.
FloatVector: TypeAlias = Vector[float]
FloatQuaternion: TypeAlias = Quaternion[float]
ZERO: FloatVector = (0.0, 0.0, 0.0)


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
    before: FloatVector,
    wanted: FloatVector,
    gain: float,
) -> FloatVector:
    """Return the vector nearest to the wanted one that differs from `before` by `gain` at most."""
    change = subtracted(wanted, before)
    size = norm(change)
    if size <= gain:
        return wanted
    return added(before, scaled(gain / size, change))
