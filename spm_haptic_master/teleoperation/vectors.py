# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three floats, and rotations between two orientations."""

from __future__ import annotations

from math import sqrt

from spm_haptic_master.kinematics.number_backends import Quaternion, Vector
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    rotation_from_quaternion,
    vector_from_quaternion,
)
from spm_haptic_master.kinematics.vectors import times

ZERO: Vector[float] = (0.0, 0.0, 0.0)


def norm(vector: Vector[float]) -> float:
    """Return the length of a vector."""
    x, y, z = vector
    return sqrt(x * x + y * y + z * z)


def scaled(vector: Vector[float], factor: float) -> Vector[float]:
    """Return a vector times a number."""
    x, y, z = vector
    return factor * x, factor * y, factor * z


def total(a: Vector[float], b: Vector[float]) -> Vector[float]:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def difference(a: Vector[float], b: Vector[float]) -> Vector[float]:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def rotate(rotation: Quaternion[float], vector: Vector[float]) -> Vector[float]:
    """Return R v, with the rotation R as a unit quaternion x, y, z, w."""
    return times(rotation_from_quaternion(*rotation), vector)


def rotation_between(one: Quaternion[float], other: Quaternion[float]) -> Vector[float]:
    """Return the rotation vector, rad, in the base frame, that turns one rotation to the other."""
    return vector_from_quaternion(*multiply_quaternions(other, conjugate(one)))


def moved_toward(before: Vector[float], wanted: Vector[float], gain: float) -> Vector[float]:
    """Return the vector nearest to the wanted one that differs from `before` by `gain` at most."""
    change = difference(wanted, before)
    size = norm(change)
    if size <= gain:
        return wanted
    return total(before, scaled(change, gain / size))
