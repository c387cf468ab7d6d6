# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The maximum-likelihood orientation of one sample, as values in plain floats."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.normal_equations import (
    Motions,
    parities,
    Row,
    Symmetric,
)
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.number_backends import FLOATS, Quaternion, Rotation, Vector

# Largest total standard deviation of a determined orientation (rad): beyond some 6 deg the
# first-order covariance does not describe the error.
DETERMINED_DEVIATION = 0.1


class SampleEstimate(NamedTuple):
    """
    Maximum-likelihood orientation of one sample of N mounted sensors, in plain floats.

    Attributes
    ----------
    quaternion : tuple of four float
        Unit quaternion x, y, z, w of R_base_platform, of either sign.
    covariance : tuple of nine float
        Covariance of the rotation error, a rotation vector in the base frame, rad^2, row by row.
    parity : float or None
        As of `Estimate`; None with three sensors.
    parity_vector : tuple of float
        Whitened residuals (unit 1), one for each sensor in use beyond three: see `Estimate`.
    determined : bool
        Whether the sensors determine the orientation: total deviation below
        `DETERMINED_DEVIATION`. It does not say whether they agree.
    sensors : UsedSensors
        The sensors in use.
    parity_sizes, gain_sizes : tuple of N float
        Lengths of the parity gains (1 / rad) and of the gains (unit 1); 0 for a sensor that is
        left out.
    rows, spread, motions
        Of `linearise`, `gauss_newton_step` and `in_base_frame`: what the gains are made of.

    """

    quaternion: Quaternion[float]
    covariance: Rotation[float]
    parity: float | None
    parity_vector: tuple[float, ...]
    determined: bool
    sensors: UsedSensors
    parity_sizes: tuple[float, ...]
    gain_sizes: tuple[float, ...]
    rows: tuple[Row[float], ...]
    spread: Symmetric[float]
    motions: Motions[float]

    @property
    def gains(self) -> tuple[Vector[float], ...]:
        """Change of the rotation vector in the base frame with each of the N readings (unit 1)."""
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = self.motions
        return tuple([
            (weight * (x * ax + y * bx + z * cx), weight * (x * ay + y * by + z * cy),
             weight * (x * az + y * bz + z * cz)) for _, x, y, z, weight in self.rows])

    @property
    def parity_gains(self) -> tuple[tuple[float, ...], ...]:
        """Change of the parity vector with each of the N readings, 1 / rad."""
        _, changes = parities(self.rows, self.sensors, self.spread, FLOATS)
        return tuple(zip(*changes, strict=True)) if changes else ((),) * len(self.rows)
