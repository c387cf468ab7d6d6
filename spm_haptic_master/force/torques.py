# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Torques in plain floats: their arithmetic, for a sample."""

from __future__ import annotations

from typing import TypeAlias

from spm_haptic_master.kinematics.number_backends import Rotation, Vector

# Of the motors th1A, th1B, th1C, and th3A of a fourth one.
Torques: TypeAlias = tuple[float, ...]
NOTHING: Vector[float] = (0.0, 0.0, 0.0)


def smoothstep(x: float) -> float:
    """Return 0 below 0, 1 above 1, and 3 x^2 - 2 x^3 between them: continuous in its slope."""
    if x <= 0.0:
        return 0.0
    return 1.0 if x >= 1.0 else x * x * (3.0 - 2.0 * x)


def clipped(value: float, limit: float) -> float:
    """Return a value within -limit and limit; of a product with a ratio, only rounding is cut."""
    return -limit if value < -limit else limit if value > limit else value


def rotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    x, y, z = vector
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def unrotated(matrix: Rotation[float], vector: Vector[float]) -> Vector[float]:
    """Return a vector, turned by the inverse of a rotation that is given row by row."""
    a, b, c, d, e, f, g, h, i = matrix
    return rotated((a, d, g, b, e, h, c, f, i), vector)
