# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation of one joint sample, by the chosen forward model."""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple, TypeAlias

from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics.closed_form import theta3a_gains, theta3a_quaternion
from spm_haptic_master.kinematics.estimation.sample_estimate import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.sample_estimation import estimate_sample
from spm_haptic_master.kinematics.estimation.used_sensors import UsedSensors
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.mode_tracking import track_mode
from spm_haptic_master.kinematics.rotations import (
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotation_distance,
)

# Readings of four, five or six sensors, rad: th1A, th1B, th1C, th3A, th3B, th3C.
Angles: TypeAlias = tuple[float, ...]
Quaternion: TypeAlias = tuple[float, float, float, float]

# Difference between another method and the estimate (standard deviations) up to which they are the
# same assembly mode.
AGREEMENT_DEVIATIONS = 6.0
# Square of the last Gauss-Newton step over the smallest standard deviation (1 / rad): the step
# leaves about its square. In all of the workspace to a tilt of 30 deg 0.12 % of the orientation's
# standard deviation is left (rms), 2.4 % at most; and one sample in 25 takes a second step.
REMAINDER = 0.01
# Place of th3A.
TH3A = 3


class Solution(NamedTuple):
    """
    Orientation of a sample by the chosen method, beside that of all sensors in use.

    Attributes
    ----------
    estimate : SampleEstimate
        Orientation and covariance of the method; parity and gains of all sensors in use.
    apart : float
        Angle between the method's orientation and that of all sensors in use, rad.

    """

    estimate: SampleEstimate
    apart: float


class Solver:
    """
    Orientation, covariance and parity of one sample, in plain floats.

    Parameters
    ----------
    geometry : Geometry
        Link angles.
    sigma : tuple of N float
        Standard deviations of th1A, th1B, th1C, th3A, and of th3B and th3C where there are such
        sensors, rad.
    method : str
        One of `METHODS`.
    working_mode : tuple of 3 int
        Signs of B_kk of the legs A, B, C (eq. 10); a solution in another working mode is none.

    """

    def __init__(self, geometry: Geometry, sigma: tuple[float, ...],
                 method: str = 'estimate',
                 working_mode: tuple[int, int, int] = RIG_WORKING_MODE):
        self._geometry = geometry
        self._sigma = sigma
        self._active = UsedSensors(sigma[:4], (TH3A,))
        self._method = method
        self._working_mode = working_mode
        self._last_step = sqrt(REMAINDER * min(sigma))

    def solve(self, angles: Angles, sensors: UsedSensors,
              prior: Quaternion | None) -> Solution:
        """
        Return the orientation of a sample by the chosen method.

        Parameters
        ----------
        angles : tuple of N float
            Readings, rad; those of sensors that are not in use are ignored.
        sensors : UsedSensors
            The sensors in use.
        prior : tuple of 4 float, or None
            Unit quaternion x, y, z, w of the last orientation, if that is recent.

        Raises
        ------
        SpmError
            The angles determine no orientation, or do not close the mechanism, or only in another
            working mode, or the methods contradict each other.

        """
        estimate = estimate_sample(
            angles, sensors, self._geometry, prior, self._working_mode, self._last_step)
        if self._method == 'estimate' or not sensors.usual:
            # As Solution(...) does, without its call.
            return tuple.__new__(Solution, (estimate, 0.0))
        if self._method == 'theta3a':
            a, b, c, third = angles[:4]
            quaternion = theta3a_quaternion(a, b, c, third, self._geometry)
            other = self._closed_form(angles, estimate)
        else:
            quaternion, other = self._classic(angles, prior or estimate.quaternion)
        apart = rotation_distance(quaternion, estimate.quaternion)
        limit = AGREEMENT_DEVIATIONS * (total_deviation(estimate) + total_deviation(other))
        if apart > limit:
            raise SingularityError(f'{self._method} is {apart:.4f} rad from the estimate of all '
                                   f'four sensors, limit {limit:.4f}')
        result = estimate._replace(
            quaternion=quaternion, covariance=other.covariance, determined=other.determined)
        return Solution(result, apart)

    def _closed_form(self, angles: Angles, estimate: SampleEstimate) -> SampleEstimate:
        """Return the estimate with the covariance of Case 2: its own gains, not the estimate's."""
        a, b, c, third = angles[:4]
        gains = theta3a_gains(a, b, c, third, self._geometry)
        variances = [sigma * sigma for sigma in self._sigma]
        xx, xy, xz, yx, yy, yz, zx, zy, zz = (
            sum(gain[row] * gain[column] * variance
                for gain, variance in zip(gains, variances, strict=False))
            for row in range(3) for column in range(3))
        result = estimate._replace(covariance=(xx, xy, xz, yx, yy, yz, zx, zy, zz))
        return result._replace(
            determined=estimate.determined and total_deviation(result) < DETERMINED_DEVIATION)

    def _classic(self, angles: Angles, prior: Quaternion) -> tuple[Quaternion, SampleEstimate]:
        """Return the tracked mode's orientation, and the estimate of three sensors there."""
        tracked = track_mode(angles[:3], matrix_from_quaternion(prior), self._geometry)
        if tracked.ambiguous:
            raise SingularityError('two assembly modes of the active joints are too close to '
                                   'distinguish')
        x, y, z, w = quaternion_from_matrix(tracked.rotation).tolist()
        quaternion = x, y, z, w
        return quaternion, estimate_sample(
            angles[:4], self._active, self._geometry, quaternion)


def total_deviation(estimate: SampleEstimate) -> float:
    """Return the total standard deviation of an estimate's rotation, rad."""
    covariance = estimate.covariance
    return sqrt(covariance[0] + covariance[4] + covariance[8])
