# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The mounting: constant rotations of the base on its table and of the handle on the platform.

    R_table_handle = R_table_base R_base_platform R_platform_handle
"""

from __future__ import annotations

from dataclasses import dataclass

from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion, Rotation
from spm_haptic_master.kinematics.rotations import (
    conjugate,
    multiply_quaternions,
    rotation_from_quaternion,
)

# Quaternion of no rotation.
IDENTITY = (0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Mounting:
    """
    Constant rotations on both sides of R_base_platform, in plain floats.

    Attributes
    ----------
    base : tuple of four float
        Unit quaternion x, y, z, w of R_table_base.
    handle : tuple of four float
        Unit quaternion x, y, z, w of R_platform_handle.

    """

    base: Quaternion[float] = IDENTITY
    handle: Quaternion[float] = IDENTITY

    def mounted(self, quaternion: Quaternion[float]) -> Quaternion[float]:
        """Return the quaternion of R_table_handle from that of R_base_platform."""
        return multiply_quaternions(multiply_quaternions(self.base, quaternion), self.handle)

    def unmounted(self, quaternion: Quaternion[float]) -> Quaternion[float]:
        """Return the quaternion of R_base_platform from that of R_table_handle."""
        return multiply_quaternions(
            multiply_quaternions(conjugate(self.base), quaternion), conjugate(self.handle)
        )

    def covariance(self, covariance: Rotation[float]) -> Rotation[float]:
        """Covariance of the rotation error in the table's frame, from that in the base's."""
        # The handle does not matter: the error is a rotation vector left of R_base_platform.
        m = rotation_from_quaternion(*self.base)
        half = [
            sum(m[3 * i + k] * covariance[3 * k + j] for k in range(3))
            for i in range(3)
            for j in range(3)
        ]
        xx, xy, xz, yx, yy, yz, zx, zy, zz = (
            sum(half[3 * i + k] * m[3 * j + k] for k in range(3))
            for i in range(3)
            for j in range(3)
        )
        return xx, xy, xz, yx, yy, yz, zx, zy, zz

    def applied(self, estimate: SampleEstimate) -> SampleEstimate:
        """Return an estimate with orientation and covariance as mounted."""
        return estimate.with_orientation(
            quaternion=self.mounted(estimate.quaternion),
            covariance=self.covariance(estimate.covariance),
        )
