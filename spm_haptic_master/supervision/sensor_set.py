# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any three to six sensors in use: their orientation by the chosen model, and its worth."""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, hypot, inf, pi, sqrt
from operator import mul
from typing import NamedTuple, TypeAlias

from spm_haptic_master.exceptions import AmbiguousError, SingularityError, SpmError
from spm_haptic_master.kinematics import rotations
from spm_haptic_master.kinematics.assembly_modes import track_mode
from spm_haptic_master.kinematics.closed_form import theta3a_quaternion
from spm_haptic_master.kinematics.estimation.estimates import (
    CONSISTENT,
    estimate_sample,
    other_solutions,
)
from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.estimation.normal_equations import theta3a_gains
from spm_haptic_master.kinematics.geometry import Geometry
from spm_haptic_master.kinematics.inverse_model import RIG_WORKING_MODE
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import Limits
from spm_haptic_master.supervision.anchor import FOLD, SAME_SOLUTION, TURN_DEVIATIONS, within
from spm_haptic_master.supervision.parity import padded, Parity, ParityWindow
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

# Readings of four, five or six sensors, rad: th1A, th1B, th1C, th3A, th3B, th3C.
Angles: TypeAlias = tuple[float, ...]

# Standard deviations from another method to the estimate up to which the assembly mode is one.
AGREEMENT_DEVIATIONS = 6.0
# Square of the last Gauss-Newton step over the smallest standard deviation (1 / rad): to a tilt of
# 30 deg, 0.12 % of the orientation's standard deviation is left (rms), 2.4 % at most.
REMAINDER = 0.01
TH3A = 3  # its place among the sensors
# Smallest share of a sensor's variance in the parity that counts.
VISIBLE_SHARE = 1e-6
# Largest turn from the last orientation to that of the sensors without a faulty one, beside noise
# (rad): what a human turns in three samples, and no more than where another solution may be.
CONTINUING_TURN = 0.06


class Solver:
    """
    Orientation, covariance and parity of one sample, in plain floats.

    `sigma` are the standard deviations of the N sensors th1A, th1B, th1C, th3A, th3B, th3C, rad;
    `method` is one of `METHODS`; `working_mode` has the signs of B_kk of the legs A, B, C (eq.
    10); a solution in another working mode is rejected. `bias` are the nominal biases of the
    sensors, rad: the last orientation selects among solutions that they and the noise allow.
    """

    def __init__(
        self,
        geometry: Geometry,
        sigma: tuple[float, ...],
        method: str = 'estimate',
        working_mode: tuple[int, int, int] = RIG_WORKING_MODE,
        bias: tuple[float, ...] = (),
    ):
        self._geometry, self._working_mode = geometry, working_mode
        self._sigma, self._method = sigma, method
        self._active = UsedSensors(sigma[:4], (TH3A,))
        self._last_step = sqrt(REMAINDER * min(sigma))
        self._consistent = CONSISTENT + hypot(
            *(each / deviation for each, deviation in zip(bias, sigma, strict=False))
        )

    def solve(
        self, angles: Angles, sensors: UsedSensors, prior: Quaternion[float] | None
    ) -> tuple[SampleEstimate, float]:
        """
        Return the orientation of a sample by the chosen method, and its angle to the estimate.

        Parity and gains are those of all sensors in use. `angles` are N readings, rad; those not
        in use are ignored. `prior` is the last orientation, if that is recent. SpmError where the
        angles determine no orientation, or only in another working mode, or methods disagree.
        """
        estimate = estimate_sample(
            angles,
            sensors,
            self._geometry,
            prior,
            self._working_mode,
            self._last_step,
            self._consistent,
        )
        if self._method == 'estimate' or not sensors.usual:
            return estimate, 0.0
        other = (
            self._case_2(angles, estimate)
            if self._method == 'theta3a'
            else self._classic(angles, prior or estimate.quaternion)
        )
        apart = rotations.rotation_distance(other.quaternion, estimate.quaternion)
        limit = AGREEMENT_DEVIATIONS * (total_deviation(estimate) + total_deviation(other))
        if apart > limit:
            raise SingularityError(
                f'{self._method} is {apart:.4f} rad from the estimate of all '
                f'four sensors, limit {limit:.4f}'
            )
        return estimate._replace(
            quaternion=other.quaternion, covariance=other.covariance, determined=other.determined
        ), apart

    def others(self, found: SampleEstimate, angles: Angles) -> list[SampleEstimate]:
        """Return the solutions of a sample but the one `found`."""
        return other_solutions(found, angles, self._geometry, self._working_mode)

    def _case_2(self, angles: Angles, estimate: SampleEstimate) -> SampleEstimate:
        """Return the orientation of Case 2 with the covariance of its own gains."""
        a, b, c, third = angles[:4]
        gains = theta3a_gains(a, b, c, third, self._geometry)
        variances = [sigma * sigma for sigma in self._sigma]
        xx, xy, xz, yx, yy, yz, zx, zy, zz = (
            sum(
                gain[row] * gain[column] * variance
                for gain, variance in zip(gains, variances, strict=False)
            )
            for row in range(3)
            for column in range(3)
        )
        result = estimate._replace(
            quaternion=theta3a_quaternion(a, b, c, third, self._geometry),
            covariance=(xx, xy, xz, yx, yy, yz, zx, zy, zz),
        )
        return result._replace(
            determined=estimate.determined and total_deviation(result) < DETERMINED_DEVIATION
        )

    def _classic(self, angles: Angles, prior: Quaternion[float]) -> SampleEstimate:
        """Return the tracked mode's orientation with the covariance of three sensors there."""
        tracked = track_mode(angles[:3], rotations.matrix_from_quaternion(prior), self._geometry)
        if tracked.ambiguous:
            raise SingularityError(
                'two assembly modes of the active joints are too close to distinguish'
            )
        x, y, z, w = rotations.quaternion_from_matrix(tracked.rotation).tolist()
        three = estimate_sample(angles[:4], self._active, self._geometry, (x, y, z, w))
        return three._replace(quaternion=(x, y, z, w))


def total_deviation(estimate: SampleEstimate) -> float:
    """Return the total standard deviation of an estimate's rotation, rad."""
    covariance = estimate.covariance
    return sqrt(covariance[0] + covariance[4] + covariance[8])


class Sample(NamedTuple):
    """One sample of N mounted sensors, and what to allow for."""

    stamp: int  # ns
    angles: Angles  # rad; NaN of a sensor without a reading
    prior: Quaternion[float] | None  # the last orientation if that is recent: x, y, z, w
    followed: int | None  # ns, stamp of that orientation
    bias: tuple[float, ...]  # rad, nominal bias of each of the N sensors
    factors: tuple[float, ...]  # measured noise of each over the configured one, at least 1
    parity_bias: float = pi  # rad, bound of the biases' part that no motion explains


class SensorSet:
    """
    The sensors in use, and whether a sample is consistent with itself.

    `sigma` are the standard deviations of the N mounted sensors, rad, `left_out` the places of
    those not in use. `entries` is the length of the parity vector. `estimate` is the orientation
    of the latest sample, `worth` what it is worth; None where the sensors determine none.
    `deviation` is the total standard deviation by all sensors in use, whatever the method, rad.
    """

    def __init__(
        self,
        solver: Solver,
        sigma: tuple[float, ...],
        limits: Limits,
        left_out: Collection[int] = (),
    ) -> None:
        self.sensors = UsedSensors(sigma, left_out)
        self.entries = self.sensors.count - 3
        self.estimate: SampleEstimate | None = None
        self.worth: Integrity | None = None
        self.deviation = inf
        self._solver, self._speed = solver, limits.joint_speed
        self._threshold = limits.threshold(max(self.entries, 1))
        self._reach = self._threshold + MISSED_DETECTION
        self._window = ParityWindow(self._threshold, max(self.entries, 1), limits.window)

    def restart(self) -> None:
        """Forget the samples."""
        self._window.restart()

    def take(self, sample: Sample) -> Symptom | None:
        """Solve a sample; return what contradicts it. Sensors that are not in use are ignored."""
        if not self.entries and sample.prior is None:
            self.estimate = self.worth = None
            return withheld(Reason.UNDETERMINED, 'three sensors need the last orientation')
        try:
            estimate, apart = self._solver.solve(sample.angles, self.sensors, sample.prior)
        except SpmError as error:
            self.estimate = self.worth = None
            if isinstance(error, AmbiguousError):
                # Two solutions meet, which happens to healthy sensors.
                return withheld(Reason.UNDETERMINED, str(error))
            return Symptom(Reason.NO_FIT, str(error))
        self.estimate = estimate
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        self.deviation = worth.deviation
        if apart:
            # Beside what a fault does to the orientation of all sensors.
            worth = worth._replace(healthy=worth.healthy + apart)
            self.deviation = hypot(*map(mul, estimate.gain_sizes, self.sensors.sigma))
        self.worth = worth
        if not self.entries:
            return None
        return self._window.check(
            sample.stamp, estimate.parity_vector, worth.noise, worth.bias
        ) or self._rival(sample, estimate, worth)

    def _rival(self, sample: Sample, estimate: SampleEstimate, worth: Integrity) -> Symptom | None:
        """Return a symptom if another solution fits that may continue the last orientation too."""
        prior, limit = sample.prior, self._window.limit(worth.noise, worth.bias)
        turn = pi
        if prior is not None and sample.followed is not None:
            turn = self._speed * (sample.stamp - sample.followed) * 1e-9
            if (
                FOLD * self.deviation * (turn + TURN_DEVIATIONS * self.deviation)
                < self.sensors.largest
            ):
                return None
        for other in self._solver.others(estimate, sample.angles):
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

    def levels(self, worth: Integrity) -> list[float]:
        """Return each mounted sensor's part of the protection level, rad; inf if unchecked."""
        return worth.levels(self._reach / self._window.root)

    def noise_bounds(self) -> list[float]:
        """
        Return the largest noise of each sensor, over the configured one, that the parity allows.

        A joint that seems noisier vibrates. Infinite for a sensor that the parity does not see.
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
        """Return the sensor whose noise alone exceeds its part of the level most."""
        estimate, sigma, factors = self.estimate, self.sensors.sigma, sample.factors
        if estimate is None or max(factors) <= 1.0:
            return None
        nominal = integrity(estimate, sample.bias, (1.0,) * len(sigma), sample.parity_bias)
        parts = self.levels(nominal)
        excess, worst = max(
            (
                MISSED_DETECTION
                * factors[sensor]
                * sigma[sensor]
                * estimate.gain_sizes[sensor]
                / parts[sensor],
                sensor,
            )
            for sensor in self.sensors.used
        )
        return (
            Symptom(
                Reason.NOISY,
                f'{degrees(factors[worst] * sigma[worst]):.2f} deg',
                worst,
                Severity.LATCH,
            )
            if excess > 1.0
            else None
        )

    def evidence(self, symptom: Symptom) -> tuple[Parity, float] | None:
        """Return the parity vector that made a symptom, and its limit."""
        estimate, worth = self.estimate, self.worth
        if estimate is None or worth is None or not self.entries:
            return None
        if symptom.reason is Reason.DRIFTED:
            count = self._window.root * self._window.root
            return self._window.mean, self._window.limit(worth.noise, worth.bias, count)
        return padded(estimate.parity_vector), self._window.limit(worth.noise, worth.bias)

    def unexplained(self, sensor: int, parity: Parity) -> float:
        """Return the length of the part of a parity vector that no fault of a sensor makes."""
        square = sum(part * part for part in parity)
        gains = () if self.estimate is None else self.estimate.parity_gains[sensor]
        size = sum(gain * gain for gain in gains)
        along = sum(part * gain for part, gain in zip(parity, gains, strict=False))
        return sqrt(max(square - along * along / size, 0.0)) if size else sqrt(square)

    def fits(self, sample: Sample) -> bool:
        """Whether one sample is consistent, and its orientation continues the last one."""
        try:
            estimate, _ = self._solver.solve(sample.angles, self.sensors, sample.prior)
        except SpmError:
            return False
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        age = 0.0 if sample.followed is None else (sample.stamp - sample.followed) * 1e-9
        turn = min(max(CONTINUING_TURN, self._speed * age), SAME_SOLUTION)
        if sample.prior is not None and not within(
            estimate.quaternion, sample.prior, turn + TURN_DEVIATIONS * worth.deviation
        ):
            return False
        size = sqrt(sum(part * part for part in estimate.parity_vector))
        return size <= self._window.limit(worth.noise, worth.bias)
