# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Any three to six sensors in use: their orientation, whether they agree, and what it is worth.

`Solver` has the mechanism and returns orientations. `SensorSet` adds the judgement of one set of
sensors: the parity test of a sample and of the window, and the integrity of the orientation.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from math import degrees, hypot, inf, pi, sqrt
from typing import TypeAlias

from spm_haptic_master.exceptions import AmbiguousError, SpmError
from spm_haptic_master.kinematics.estimation.estimates import (
    CONSISTENT,
    estimate_sample,
    other_solutions,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.estimation.solutions import (
    all_solutions,
    fit_near,
    implied_fault,
    ImpliedFault,
    parity_curvature,
)
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import Limits
from spm_haptic_master.supervision.anchor import FOLD, TURN_DEVIATIONS, within
from spm_haptic_master.supervision.parity import ParityWindow
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

# Readings of four, five or six sensors, rad: th1A, th1B, th1C, th3A, th3B, th3C.
Angles: TypeAlias = tuple[float, ...]

# Iterate again while step^2 / sigma exceeds this (1 / rad): to a tilt of 30 deg, 0.12 % of the
# orientation's standard deviation is left (rms), 2.4 % at most.
REMAINDER = 0.01
# Smallest share of a sensor's variance in the parity that counts.
VISIBLE_SHARE = 1e-6


class Solver:
    """
    Orientations of one sample, in plain floats.

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
        and the noise allow. Empty for none.

    """

    def __init__(
        self,
        geometry: Geometry,
        sigma: tuple[float, ...],
        working_mode: tuple[int, int, int] = RIG_WORKING_MODE,
        bias: tuple[float, ...] = (),
    ):
        self._geometry = geometry
        self._working_mode = working_mode
        self._last_step = sqrt(REMAINDER * min(sigma))
        self._consistent = CONSISTENT + hypot(
            *(offset / deviation for offset, deviation in zip(bias, sigma, strict=False))
        )

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
            self._last_step,
            self._consistent,
        )

    def others(self, found: SampleEstimate, angles: Angles) -> list[SampleEstimate]:
        """
        Return the solutions of a sample but the one `found`, some of them twice.

        It takes as long as tens of estimates. Four sensors at least have to be in use.
        """
        return other_solutions(found, angles, self._geometry, self._working_mode)

    def near(
        self,
        quaternion: Quaternion[float],
        angles: Angles,
        sensors: UsedSensors,
    ) -> SampleEstimate:
        """Return the solution of a sample next to an orientation; SpmError as of `fit_near`."""
        return fit_near(quaternion, angles, sensors, self._geometry, self._working_mode)

    def every(self, angles: Angles, sensors: UsedSensors) -> list[SampleEstimate]:
        """
        Return all solutions of a sample in the working mode, by the closed forms and Gauss-Newton.

        It takes as long as tens of estimates.
        """
        return all_solutions(angles, sensors, self._geometry, self._working_mode)

    def fault(self, others: SampleEstimate, sensor: int, sample: Sample) -> ImpliedFault:
        """
        Return what an orientation by the others says of a sensor; see `implied_fault`.

        Parameters
        ----------
        others : SampleEstimate
            An orientation that other sensors determine.
        sensor : int
            Place in ALL_JOINT_NAMES of the sensor, which those do not include.
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

    def curvature(self, estimate: SampleEstimate, sensor: int) -> float:
        """
        Return how much the parity bends along the turn that a fault of a sensor makes, 1 / rad^2.

        It is the size of `parity_curvature`; infinite if the device cannot turn that way.
        """
        try:
            return abs(parity_curvature(estimate, sensor, self._geometry, self._working_mode))
        except (SpmError, ZeroDivisionError):
            return inf


def total_deviation(estimate: SampleEstimate) -> float:
    """
    Return the total standard deviation of an estimate's rotation, rad.

    It is the root of the trace of the covariance: the rms length of the rotation error.
    """
    covariance = estimate.covariance
    return sqrt(covariance[0] + covariance[4] + covariance[8])


@dataclass(slots=True)
class Sample:
    """
    One sample of N mounted sensors, and what to allow for.

    Attributes
    ----------
    stamp : int
        Time by the supervision's clock (`SampleClock.now`), ns.
    angles : tuple of float
        Readings of the N sensors, rad; NaN of a sensor without a reading.
    prior : tuple of four float, or None
        The last orientation, x, y, z, w of R_base_platform; None if it is older than `PRIOR_AGE`.
    followed : int or None
        Stamp of that orientation, ns; None if there is none that this sample could continue.
    bias : tuple of float
        Nominal bias of each of the N sensors, rad, with what it moved while its reading was late.
    factors : tuple of float
        Measured noise of each sensor over the configured one, at least 1.
    parity_bias : float
        Bound of the biases' part that no motion explains, rad.
    period : float
        Usual time between samples, s; 0 if that is not known.

    """

    stamp: int
    angles: Angles
    prior: Quaternion[float] | None
    followed: int | None
    bias: tuple[float, ...]
    factors: tuple[float, ...]
    parity_bias: float = pi
    period: float = 0.0

    def since(self, stamp: int) -> float:
        """Return the time since a sample at an earlier stamp, s: at least a period."""
        return max((self.stamp - stamp) * 1e-9, self.period)


class SensorSet:
    """
    The sensors in use, and whether a sample is consistent with itself.

    Parameters
    ----------
    solver : Solver
        Orientations of a sample.
    sigma : tuple of float, length N
        Standard deviations of the N mounted sensors, rad.
    limits : Limits
        Rate of false alarms, window and human motion limits.
    left_out : collection of int
        Places in ALL_JOINT_NAMES of the mounted sensors that are not in use.

    Attributes
    ----------
    sensors : UsedSensors
        Those in use.
    places : tuple of int
        Their places in ALL_JOINT_NAMES.
    entries : int
        Length of the parity vector: the number of sensors in use beyond three. None with three,
        which cannot contradict each other.
    estimate : SampleEstimate or None
        Orientation of the latest sample; None if the sensors determine none.
    worth : Integrity or None
        What that orientation is worth; None with it.
    solver : Solver
        Gives further orientations.
    threshold : float
        Norm of the parity vector that healthy noise of unit variance never exceeds.

    """

    def __init__(
        self,
        solver: Solver,
        sigma: tuple[float, ...],
        limits: Limits,
        left_out: Collection[int] = (),
    ) -> None:
        self.sensors = UsedSensors(sigma, left_out)
        self.places = self.sensors.used
        self.entries = self.sensors.count - 3
        self.estimate: SampleEstimate | None = None
        self.worth: Integrity | None = None
        self.solver = solver
        self._speed = limits.joint_speed
        self.threshold = limits.threshold(max(self.entries, 1))
        self._reach = self.threshold + MISSED_DETECTION
        self._window = ParityWindow(self.threshold, max(self.entries, 1), limits.window)

    def restart(self) -> None:
        """Forget the samples of the window; `estimate` and `worth` stay until the next sample."""
        self._window.restart()

    def solve(self, sample: Sample) -> Symptom | None:
        """
        Solve a sample; return what contradicts it. Sensors that are not in use are ignored.

        Parameters
        ----------
        sample : Sample
            With a prior if three sensors are in use: they have several solutions.

        Returns
        -------
        Symptom or None
            No orientation fits, two meet, the parity is beyond its limit in this sample or over
            the window, or another solution fits as well. None if the sensors agree.

        """
        self.estimate = self.worth = None
        if not self.entries and sample.prior is None:
            return withheld(Reason.UNDETERMINED, 'three sensors need the last orientation')
        try:
            estimate = self.solver.solve(sample.angles, self.sensors, sample.prior)
        except AmbiguousError as error:
            # Two solutions meet, which happens to healthy sensors.
            return withheld(Reason.UNDETERMINED, str(error))
        except SpmError as error:
            return Symptom(Reason.NO_FIT, str(error))
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        self.estimate = estimate
        self.worth = worth
        symptom = None
        if self.entries:
            symptom = self._window.check(
                sample.stamp, estimate.parity_vector, worth.noise, worth.bias
            )
        return symptom or self._rival(sample, estimate, worth)

    def _rival(self, sample: Sample, estimate: SampleEstimate, worth: Integrity) -> Symptom | None:
        """
        Return a symptom if another solution fits that may continue the last orientation too.

        All sensors are healthy in this hypothesis: the ambiguity is that of the mechanism. The
        other solution is about sigma / (FOLD x deviation) away, rad. It is not computed where
        human motion since the last orientation and `TURN_DEVIATIONS` do not reach so far.
        """
        prior = sample.prior
        turn = pi
        if prior is not None and sample.followed is not None:
            turn = self._speed * sample.since(sample.followed)
            deviation = worth.deviation
            apart = FOLD * deviation * (turn + TURN_DEVIATIONS * deviation)
            if apart < self.sensors.largest:
                return None
        others = (
            self.solver.others(estimate, sample.angles)
            if self.entries
            else self._others_of_three(estimate, sample.angles)
        )
        limit = self._window.limit(worth.noise, worth.bias)
        for other in others:
            parity = hypot(*other.parity_vector)
            if parity <= limit and (
                prior is None
                or within(other.quaternion, prior, turn + TURN_DEVIATIONS * total_deviation(other))
            ):
                return withheld(
                    Reason.UNDETERMINED,
                    f'another one fits, with a parity of {parity:.1f} sigma, limit {limit:.1f}',
                )
        return None

    def _others_of_three(self, found: SampleEstimate, angles: Angles) -> list[SampleEstimate]:
        """Return the solutions of three sensors that are not the one found."""
        near = TURN_DEVIATIONS * total_deviation(found)
        return [
            solution
            for solution in self.solver.every(angles, self.sensors)
            if not within(solution.quaternion, found.quaternion, near)
        ]

    def agrees(self, sample: Sample, estimate: SampleEstimate) -> bool:
        """
        Whether the parity of a solution is within its limit, by this sample alone.

        Three sensors always agree.
        """
        if not self.entries:
            return True
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        parity = hypot(*estimate.parity_vector)
        return parity <= self._window.limit(worth.noise, worth.bias)

    def near(self, sample: Sample, quaternion: Quaternion[float]) -> SampleEstimate | None:
        """Return the solution next to an orientation if the sensors in use agree there."""
        try:
            estimate = self.solver.near(quaternion, sample.angles, self.sensors)
        except SpmError:
            return None
        return estimate if self.agrees(sample, estimate) else None

    def every(self, sample: Sample) -> list[SampleEstimate]:
        """Return every orientation with which the sensors in use agree."""
        return [
            estimate
            for estimate in self.solver.every(sample.angles, self.sensors)
            if self.agrees(sample, estimate)
        ]

    @property
    def reach(self) -> float:
        """
        Largest mean parity of an undetected fault, in standard deviations, without bias.

        (k_fa + k_md) / sqrt(n), with the n samples of the window, `WINDOW_SAMPLES` at least.
        """
        return self._reach / self._window.root

    def levels(self, worth: Integrity) -> list[float]:
        """Return each mounted sensor's part of the protection level, rad; inf if unchecked."""
        return worth.levels(self.reach, self._window.mean_bias)

    def noise_bounds(self) -> list[float]:
        """
        Return the largest noise of each sensor, over the configured one, that the parity allows.

        A sensor with the share s of the n entries' variances and noise f times the configured one
        makes their sum n + s (f^2 - 1). So the measured variance bounds f, as if all its excess
        were of this sensor. A joint that seems noisier than that vibrates: its motion is real, and
        the parity does not see it. Infinite for a sensor that the parity does not see either.
        """
        sigma = self.sensors.sigma
        if self.estimate is None:
            return [inf] * len(sigma)
        excess = max(self._window.variance - 1.0, 0.0) * self.entries
        bounds = []
        for size, deviation in zip(self.estimate.parity_sizes, sigma, strict=True):
            share = (size * deviation) ** 2
            bounds.append(sqrt(1.0 + excess / share) if share > VISIBLE_SHARE else inf)
        return bounds

    def too_noisy(self, sample: Sample) -> Symptom | None:
        """
        Return the sensor whose noise alone exceeds its part of the level most; None if none does.

        The noise counts by `MISSED_DETECTION` standard deviations, turned into an error of the
        orientation by the sensor's gain. The part is that of nominal noise.
        """
        estimate = self.estimate
        sigma = self.sensors.sigma
        factors = sample.factors
        if estimate is None or max(factors) <= 1.0:
            return None
        configured_noise = (1.0,) * len(sigma)
        nominal = integrity(estimate, sample.bias, configured_noise, sample.parity_bias)
        parts = self.levels(nominal)

        def excess(sensor: int) -> float:
            """Return what the noise of a sensor does, over its part of the level."""
            noise = factors[sensor] * sigma[sensor]
            return MISSED_DETECTION * noise * estimate.gain_sizes[sensor] / parts[sensor]

        noisiest = max(self.places, key=excess)
        if excess(noisiest) <= 1.0:
            return None
        noise = degrees(factors[noisiest] * sigma[noisiest])
        return Symptom(Reason.NOISY, f'{noise:.2f} deg', noisiest, Severity.LATCH)
