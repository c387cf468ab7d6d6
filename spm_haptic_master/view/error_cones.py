# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""How far the handle's axis may be off: half angles of cones about it."""

from __future__ import annotations

from math import atan2, sqrt
from typing import NamedTuple

from spm_haptic_master.kinematics.number_backends import Rotation

# Standard deviations that the inner cone spans.
DEVIATIONS = 3.0


class Ellipse(NamedTuple):
    """
    Cone of the covariance, elliptic.

    Attributes
    ----------
    major, minor : float
        Half angles, rad.
    turn : float
        Angle about the platform's z from its x to the larger one, rad.

    """

    major: float
    minor: float
    turn: float


def axis_ellipse(covariance: Rotation[float], rotation: Rotation[float]) -> Ellipse:
    """
    Return the cone in which the platform's axis is, of a covariance of the orientation.

    Parameters
    ----------
    covariance : tuple of nine float
        Of the rotation error about the fixed axes, rad^2, row by row.
    rotation : tuple of nine float
        The orientation in the same frame, row by row.

    """
    # Rows of the platform's x and y in the fixed frame.
    x, y = rotation[0::3], rotation[1::3]

    def between(one: tuple[float, ...], other: tuple[float, ...]) -> float:
        return sum(one[i] * covariance[3 * i + j] * other[j] for i in range(3) for j in range(3))

    # A turn about x moves the axis along -y, and one about y along x.
    along_x, along_y, mixed = between(y, y), between(x, x), -between(x, y)
    middle, half = 0.5 * (along_x + along_y), 0.5 * (along_x - along_y)
    spread = sqrt(half * half + mixed * mixed)
    return Ellipse(DEVIATIONS * sqrt(max(0.0, middle + spread)),
                   DEVIATIONS * sqrt(max(0.0, middle - spread)), 0.5 * atan2(mixed, half))
