# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientation of one joint sample, by the chosen forward model."""

from __future__ import annotations

from math import sqrt
from typing import TypeAlias

from spm_haptic_master.exceptions import SingularityError
from spm_haptic_master.kinematics import rotations
from spm_haptic_master.kinematics.assembly_modes import track_mode
from spm_haptic_master.kinematics.closed_form import theta3a_quaternion
from spm_haptic_master.kinematics.estimation.estimates import estimate_sample
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import theta3a_gains
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion

# Readings of four, five or six sensors, rad: th1A, th1B, th1C, th3A, th3B, th3C.
Angles: TypeAlias = tuple[float, ...]

# Difference between another method and the estimate (standard deviations) up to which they are the
# same assembly mode.
AGREEMENT_DEVIATIONS = 6.0
# Square of the last Gauss-Newton step over the smallest standard deviation (1 / rad): the step
# leaves about its square. In all of the workspace to a tilt of 30 deg 0.12 % of the orientation's
# standard deviation is left (rms), 2.4 % at most; and one sample in 25 takes a second step.
REMAINDER = 0.01
TH3A = 3  # its place among the sensors


class Solver:
    """
    Orientation, covariance and parity of one sample, in plain floats.

    `sigma` are the standard deviations of the N sensors th1A, th1B, th1C, th3A, th3B, th3C, rad;
    `method` is one of `METHODS`; `working_mode` has the signs of B_kk of the legs A, B, C (eq.
    10), and a solution in another working mode is none.
    """

    def __init__(self, geometry: Geometry, sigma: tuple[float, ...],
                 method: str = 'estimate',
                 working_mode: tuple[int, int, int] = RIG_WORKING_MODE):
        self._geometry, self._working_mode = geometry, working_mode
        self._sigma, self._method = sigma, method
        self._active = UsedSensors(sigma[:4], (TH3A,))
        self._last_step = sqrt(REMAINDER * min(sigma))

    def solve(self, angles: Angles, sensors: UsedSensors,
              prior: Quaternion[float] | None) -> tuple[SampleEstimate, float]:
        """
        Return the orientation of a sample by the chosen method.

        Its parity and gains are those of all sensors in use. The angle, rad, is between the
        method's orientation and that of all sensors in use. `angles` are N readings, rad; those of
        sensors that are not in use are ignored. `prior` is the unit quaternion x, y, z, w of the
        last orientation, if that is recent. SpmError where the angles determine no orientation, or
        close no mechanism, or only in another working mode, or the methods contradict each other.
        """
        estimate = estimate_sample(
            angles, sensors, self._geometry, prior, self._working_mode, self._last_step)
        if self._method == 'estimate' or not sensors.usual:
            return estimate, 0.0
        other = self._case_2(angles, estimate) if self._method == 'theta3a' else \
            self._classic(angles, prior or estimate.quaternion)
        apart = rotations.rotation_distance(other.quaternion, estimate.quaternion)
        limit = AGREEMENT_DEVIATIONS * (total_deviation(estimate) + total_deviation(other))
        if apart > limit:
            raise SingularityError(f'{self._method} is {apart:.4f} rad from the estimate of all '
                                   f'four sensors, limit {limit:.4f}')
        return estimate._replace(quaternion=other.quaternion, covariance=other.covariance,
                                 determined=other.determined), apart

    def _case_2(self, angles: Angles, estimate: SampleEstimate) -> SampleEstimate:
        """Return the orientation of Case 2 with the covariance of its own gains."""
        a, b, c, third = angles[:4]
        gains = theta3a_gains(a, b, c, third, self._geometry)
        variances = [sigma * sigma for sigma in self._sigma]
        xx, xy, xz, yx, yy, yz, zx, zy, zz = (
            sum(gain[row] * gain[column] * variance
                for gain, variance in zip(gains, variances, strict=False))
            for row in range(3) for column in range(3))
        result = estimate._replace(
            quaternion=theta3a_quaternion(a, b, c, third, self._geometry),
            covariance=(xx, xy, xz, yx, yy, yz, zx, zy, zz))
        return result._replace(
            determined=estimate.determined and total_deviation(result) < DETERMINED_DEVIATION)

    def _classic(self, angles: Angles, prior: Quaternion[float]) -> SampleEstimate:
        """Return the tracked mode's orientation with the covariance of three sensors there."""
        tracked = track_mode(angles[:3], rotations.matrix_from_quaternion(prior), self._geometry)
        if tracked.ambiguous:
            raise SingularityError('two assembly modes of the active joints are too close to '
                                   'distinguish')
        x, y, z, w = rotations.quaternion_from_matrix(tracked.rotation).tolist()
        three = estimate_sample(angles[:4], self._active, self._geometry, (x, y, z, w))
        return three._replace(quaternion=(x, y, z, w))


def total_deviation(estimate: SampleEstimate) -> float:
    """Return the total standard deviation of an estimate's rotation, rad."""
    covariance = estimate.covariance
    return sqrt(covariance[0] + covariance[4] + covariance[8])
