# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Vectors of three plain floats, as a sample has them: numpy costs more on single ones."""

from __future__ import annotations

from math import hypot

from spm_haptic_master.kinematics.number_backends import Vector

NOTHING: Vector[float] = (0.0, 0.0, 0.0)


def added(u: Vector[float], v: Vector[float]) -> Vector[float]:
    """Return u + v."""
    ux, uy, uz = u
    vx, vy, vz = v
    return ux + vx, uy + vy, uz + vz


def scaled(factor: float, u: Vector[float]) -> Vector[float]:
    """Return a vector times a factor."""
    x, y, z = u
    return factor * x, factor * y, factor * z


def subtracted(u: Vector[float], v: Vector[float]) -> Vector[float]:
    """Return u - v."""
    ux, uy, uz = u
    vx, vy, vz = v
    return ux - vx, uy - vy, uz - vz


def shortened(u: Vector[float], limit: float) -> Vector[float]:
    """Return a vector in its direction, no longer than a limit."""
    length = hypot(*u)
    return scaled(limit / length, u) if length > limit else u


def moved(
    start: Vector[float],
    goal: Vector[float],
    step: float,
) -> Vector[float]:
    """Return the vector on the way from start to goal that is a step away, or the goal."""
    way = subtracted(goal, start)
    length = hypot(*way)
    return added(start, scaled(step / length, way)) if length > step else goal
