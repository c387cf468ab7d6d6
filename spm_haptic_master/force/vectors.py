# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Limits of the vectors of force feedback, each of three plain floats."""

from __future__ import annotations

from math import hypot

from spm_haptic_master.kinematics.number_backends import Vector
from spm_haptic_master.kinematics.vectors import added, scaled, subtracted

NOTHING: Vector[float] = (0.0, 0.0, 0.0)


def shortened(u: Vector[float], limit: float) -> Vector[float]:
    """Return a vector in its direction, no longer than a limit."""
    length = hypot(*u)
    return scaled(limit / length, u) if length > limit else u


def moved(start: Vector[float], goal: Vector[float], step: float) -> Vector[float]:
    """Return the vector on the way from start to goal that is a step away, or the goal."""
    way = subtracted(goal, start)
    length = hypot(*way)
    return added(start, scaled(step / length, way)) if length > step else goal
