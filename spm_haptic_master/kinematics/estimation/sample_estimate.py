# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The maximum-likelihood orientation of one sample, as values in plain floats."""

from __future__ import annotations

from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.linearisation import Row
from spm_haptic_master.kinematics.estimation.normal_equations import Motions
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation, Vector

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
    parity_changes : tuple of tuples of N float
        Change of each entry of the parity vector with each reading, 1 / rad; 0 for a sensor that
        is left out.
    gain_sizes : tuple of N float
        Lengths of the gains (unit 1).
    rows, motions
        Of `linearise` and `in_base_frame`: what the gains are made of.

    """

    quaternion: Quaternion[float]
    covariance: Rotation[float]
    parity: float | None
    parity_vector: tuple[float, ...]
    determined: bool
    sensors: UsedSensors
    parity_changes: tuple[tuple[float, ...], ...]
    gain_sizes: tuple[float, ...]
    rows: tuple[Row[float], ...]
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
        if not self.parity_changes:
            return ((),) * len(self.sensors.sigma)
        return tuple(zip(*self.parity_changes, strict=True))
