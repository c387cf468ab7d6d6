# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The maximum-likelihood orientation of one sample, as values in plain floats."""

from __future__ import annotations

import math
from typing import NamedTuple

from spm_haptic_master.kinematics.normal_equations import (
    consistency,
    gauss_newton_step,
    Legs,
    Symmetric,
)
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector
from spm_haptic_master.kinematics.passive_sensors import (
    normal_equations_of_more,
    parity_of_more,
    six_weights,
    Thirds,
)

# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1

# Largest parity of healthy sensors (unit 1): noise alone exceeds it once in 4e11 samples.
CONSISTENT_PARITY = 7.0


class SampleEstimate(NamedTuple):
    """
    Maximum-likelihood orientation of one sample, in plain floats.

    Attributes
    ----------
    quaternion : tuple of four float
        Unit quaternion x, y, z, w of R_base_platform, of either sign.
    covariance : tuple of nine float
        Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    parity : float or None
        Signed residual of four sensors over its standard deviation (unit 1); unit variance for
        healthy sensors. The norm of `parity_vector` with more. None with three sensors: they
        cannot contradict each other.
    determined : bool
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree: see `consistent`.
    slopes : tuple of two tuples of four float
        Legs B and C: rates of th1B and th1C along th1A, th2A, th3A, from the second entry on
        (unit 1).
    weights : tuple of N float
        1 / sigma^2 of the sensors, 0 of a missing one, 1 / rad^2.
    motions : tuple of three vectors
        Covariance of the rotation error with the errors of th1A, th2A, th3A, rad^2.
    parity_vector : tuple of float
        Whitened residuals (unit 1), one for each sensor beyond three: independent, of unit
        variance for healthy sensors. The first is that of the first four sensors; each further
        one is what the next sensor differs by from the estimate of those before it.
    thirds : tuple of two tuples of four float
        Sensors on th3B and th3C: rates along th1A, th2A, th3A, from the second entry on (unit 1).
    entries, determinant : tuple of six float, float
        Covariance of th1A, th2A, th3A, as of `inverse_normal`.

    """

    quaternion: Quaternion[float]
    covariance: Rotation[float]
    parity: float | None
    determined: bool
    slopes: Legs[float]
    weights: tuple[float, ...]
    motions: tuple[Vector[float], Vector[float], Vector[float]]
    parity_vector: tuple[float, ...]
    thirds: Thirds[float]
    entries: Symmetric[float]
    determinant: float

    @property
    def consistent(self) -> bool:
        """
        Whether the sensors agree and determine the orientation: parity up to `CONSISTENT_PARITY`.

        False with three sensors: nothing checks them.
        """
        return self.determined and self.parity is not None and (
            -CONSISTENT_PARITY <= self.parity <= CONSISTENT_PARITY)

    @property
    def sensitivity(self) -> tuple[float, ...] | None:
        """
        Change of the parity of four sensors for an error of one standard deviation of each.

        A unit vector of four floats. The other sensors cannot check a sensor with an entry near
        zero. None with a sensor missing, and with more sensors: see `directions`.
        """
        if self.parity is None or len(self.weights) > 4:
            return None
        entries = [coefficient / math.sqrt(weight) for coefficient, weight in zip(
            consistency(self.slopes), self.weights, strict=True)]
        norm = math.sqrt(sum(entry * entry for entry in entries))
        return tuple(entry / norm for entry in entries)

    @property
    def rows(self) -> tuple[Vector[float], ...]:
        """Rates of the N sensors along th1A, th2A, th3A (unit 1)."""
        return ((1.0, 0.0, 0.0), self.slopes[0][1:], self.slopes[1][1:], (0.0, 0.0, 1.0),
                *(each[1:] for each in self.thirds[:len(self.weights) - 4]))

    @property
    def directions(self) -> tuple[tuple[float, ...], ...]:
        """
        Change of the parity vector for an error of one standard deviation of each of N sensors.

        A fault moves the parity vector along the direction of its sensor. The scalar product of
        two directions is the sensors' entry of P = I - H K (unit 1); a missing sensor has zeros.
        Empty with three sensors.
        """
        if len(self.weights) == 4:
            return tuple((entry,) for entry in self.sensitivity or ())
        weights = six_weights(self.weights)
        found = []
        for sensor, weight in enumerate(self.weights):
            size = 1.0 / math.sqrt(weight) if weight else 0.0
            a, b, c, third, third_b, third_c = (
                size if each == sensor else 0.0 for each in range(6))
            residuals = a, b, c, third
            (_, b1, b2, b3), (_, c1, c2, c3) = self.thirds
            thirds = (third_b, b1, b2, b3), (third_c, c1, c2, c3)
            _, right = normal_equations_of_more(residuals, self.slopes, thirds, weights)
            step = gauss_newton_step(right, self.slopes, self.entries, self.determinant)
            found.append(parity_of_more(
                residuals, self.slopes, thirds, weights, self.entries, self.determinant, step,
                FLOATS))
        return tuple(found)
