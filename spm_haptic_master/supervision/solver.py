# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The orientations of one sample, and what they say of its sensors, for one mechanism."""

from __future__ import annotations

from math import hypot, inf, sqrt

from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.checks import WorkingMode
from spm_haptic_master.kinematics.estimation.damped_fit import explaining_orientation
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.estimation.sample_estimates import (
    estimate_sample,
    SELECTABLE_PARITY,
)
from spm_haptic_master.kinematics.estimation.sensor_faults import (
    implied_fault,
    ImpliedFault,
    parity_curvature,
    turned_by_fault,
)
from spm_haptic_master.kinematics.estimation.solutions import (
    all_solutions,
    fit_near,
    other_solutions,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.supervision.sample import Angles, Sample

# Iterate again while step^2 / sigma exceeds this (rad): to a tilt of 30 deg, 0.12 % of the
# orientation's standard deviation is left (rms), 2.4 % at most.
REMAINDER = 0.01


class Solver:
    """
    The models of `kinematics.estimation` with the mechanism, noise and bias of one device.

    Parameters
    ----------
    geometry : Geometry
        The mechanism.
    sigma : tuple of float, length N
        Standard deviations of the sensors th1A, th1B, th1C, th3A, th3B, th3C, rad.
    working_mode : tuple of three int
        Signs of B_kk of the legs A, B, C (eq. 10); a solution in another working mode is rejected.
    bias : tuple of float, length N
        Nominal biases of the sensors, rad: the last orientation selects among solutions that they
        and the noise allow.

    """

    def __init__(
        self,
        geometry: Geometry,
        sigma: tuple[float, ...],
        working_mode: WorkingMode,
        bias: tuple[float, ...],
    ) -> None:
        self._geometry = geometry
        self._working_mode = working_mode
        # A Gauss-Newton step that is shorter is the last one, rad.
        self._last_step = sqrt(REMAINDER * min(sigma))
        whitened = [offset / deviation for offset, deviation in zip(bias, sigma, strict=True)]
        # Largest parity of a solution that the last orientation may select (unit 1).
        self._selectable_parity = SELECTABLE_PARITY + hypot(*whitened)

    def solve(
        self,
        angles: Angles,
        sensors: UsedSensors,
        prior: Quaternion[float] | None,
    ) -> SampleEstimate:
        """
        Return the maximum-likelihood orientation of a sample.

        Parameters
        ----------
        angles : tuple of float, length N
            Readings, rad; those not in use are ignored.
        sensors : UsedSensors
            The sensors in use.
        prior : tuple of four float, or None
            The last orientation, x, y, z, w of R_base_platform, if that is recent. It selects
            among solutions and has no weight in the result.

        Returns
        -------
        SampleEstimate
            Orientation, covariance and parity.

        Raises
        ------
        SpmError
            The angles determine no orientation, or only in another working mode. AmbiguousError if
            two explain them equally well and there is no prior.

        """
        return estimate_sample(
            angles,
            sensors,
            self._geometry,
            prior,
            self._working_mode,
            last_step=self._last_step,
            selectable_parity=self._selectable_parity,
        )

    def other_solutions(self, found: SampleEstimate, angles: Angles) -> list[SampleEstimate]:
        """
        Return the solutions of a sample but the one `found`, some of them twice.

        It takes as long as tens of estimates. Four sensors at least have to be in use.
        """
        return other_solutions(found, angles, self._geometry, self._working_mode)

    def fit_near(
        self,
        quaternion: Quaternion[float],
        angles: Angles,
        sensors: UsedSensors,
    ) -> SampleEstimate:
        """Return the solution of a sample next to an orientation; SpmError as of `fit_near`."""
        return fit_near(quaternion, angles, sensors, self._geometry, self._working_mode)

    def explaining_orientation(
        self,
        near: Quaternion[float] | None,
        angles: Angles,
        sensors: UsedSensors,
        most: float,
    ) -> Quaternion[float] | None:
        """Return an orientation that explains a sample; see `explaining_orientation`."""
        return explaining_orientation(
            near, angles, sensors, self._geometry, self._working_mode, most
        )

    def all_solutions(self, angles: Angles, sensors: UsedSensors) -> list[SampleEstimate]:
        """
        Return all solutions of a sample in the working mode, by the closed forms and Gauss-Newton.

        It takes as long as tens of estimates.
        """
        return all_solutions(angles, sensors, self._geometry, self._working_mode)

    def implied_fault(self, others: SampleEstimate, sensor: int, sample: Sample) -> ImpliedFault:
        """
        Return the fault of a sensor if an orientation by the others is right; see `implied_fault`.

        Parameters
        ----------
        others : SampleEstimate
            An orientation that other sensors determine.
        sensor : int
            Index in ALL_JOINT_NAMES of the sensor, which those do not include.
        sample : Sample
            Has the sensor's reading and the nominal biases.

        Returns
        -------
        ImpliedFault
            Reading less the angle at that orientation, rad, with its deviation and bias.

        Raises
        ------
        SpmError
            A leg does not reach the orientation, or is on the boundary of its working mode.

        """
        return implied_fault(
            others,
            sensor,
            sample.angles[sensor],
            sample.bias,
            sample.parity_bias,
            self._geometry,
            self._working_mode,
        )

    def parity_curvature(self, estimate: SampleEstimate, sensor: int) -> float:
        """
        Return how much the parity bends along the turn that a fault of a sensor makes, 1 / rad^2.

        It is the size of `parity_curvature`; infinite if the device cannot turn that way.
        """
        try:
            return abs(parity_curvature(estimate, sensor, self._geometry, self._working_mode))
        except (SpmError, ZeroDivisionError):
            return inf

    def turned_by_fault(
        self,
        estimate: SampleEstimate,
        sensor: int,
        turn: float,
    ) -> tuple[Quaternion[float], ...]:
        """Return where a fault of a sensor turns an orientation by so much, rad, either way."""
        try:
            return turned_by_fault(estimate, sensor, turn, self._geometry, self._working_mode)
        except (SpmError, ZeroDivisionError):
            return ()
