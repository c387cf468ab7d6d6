# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Any three to six sensors in use: their orientation, whether they agree, and what it is worth.

They agree if the parity of a sample, and its mean over the window, are within their limits, and no
other orientation fits as well.
"""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, hypot, inf, pi, sqrt

from spm_haptic_master.exceptions import AmbiguousError, SpmError
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within
from spm_haptic_master.parameters.fkm import Limits
from spm_haptic_master.supervision.anchor import FOLD, TURN_DEVIATIONS
from spm_haptic_master.supervision.parity import ParityWindow
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.sample import Angles, Sample
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld

# Smallest share of a sensor's variance in the parity that counts.
VISIBLE_SHARE = 1e-6


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
        Rate of false alarms, window and human speed.
    left_out : collection of int
        Indices in ALL_JOINT_NAMES of the mounted sensors that are not in use.

    Attributes
    ----------
    sensors : UsedSensors
        Those in use.
    members : tuple of int
        Their indices in ALL_JOINT_NAMES.
    parity_count : int
        Length of the parity vector: the number of sensors in use beyond three. 0 with three, which
        cannot contradict each other.
    estimate : SampleEstimate or None
        Orientation of the latest sample; None if the sensors determine none.
    worth : Integrity or None
        What that orientation is worth; None with it.
    solver : Solver
        Further orientations of a sample.
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
        self.members = self.sensors.used
        self.parity_count = self.sensors.count - 3
        self.estimate: SampleEstimate | None = None
        self.worth: Integrity | None = None
        self.solver = solver
        self._speed = limits.joint_speed
        entries = max(self.parity_count, 1)
        self.threshold = limits.threshold(entries)
        self._window = ParityWindow(self.threshold, entries, limits.window)

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
        if not self.parity_count and sample.prior is None:
            return withheld(Reason.UNDETERMINED, 'three sensors need the last orientation')
        prior = None if sample.prior is None else sample.prior.quaternion
        try:
            estimate = self.solver.solve(sample.angles, self.sensors, prior)
        except AmbiguousError as error:
            # Two solutions meet, which happens to healthy sensors.
            return withheld(Reason.UNDETERMINED, str(error))
        except SpmError as error:
            return Symptom(Reason.NO_FIT, str(error))
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        self.estimate = estimate
        self.worth = worth
        symptom = None
        if self.parity_count:
            symptom = self._window.test(
                sample.stamp, estimate.parity_vector, worth.noise, worth.bias
            )
        return symptom or self._ambiguity(sample, estimate, worth)

    def _ambiguity(
        self,
        sample: Sample,
        estimate: SampleEstimate,
        worth: Integrity,
    ) -> Symptom | None:
        """
        Return a symptom if another solution fits that may continue the last orientation too.

        Here all sensors are healthy: the ambiguity is that of the mechanism. The other solution is
        about sigma / (FOLD x deviation) away, rad: see `FOLD`. It is not computed where human
        motion since the last orientation and `TURN_DEVIATIONS` do not reach so far.
        """
        prior = sample.prior
        turn = pi
        if prior is not None:
            turn = self._speed * sample.time_since(prior.stamp)
            deviation = worth.deviation
            reach = turn + TURN_DEVIATIONS * deviation
            if FOLD * deviation * reach < self.sensors.largest:
                return None
        for other in self._others(estimate, sample.angles):
            parity = hypot(*other.parity_vector)
            # What noise and bias do to the parity is another thing at another orientation.
            limit = self._parity_limit(sample, other)
            other_reach = turn + TURN_DEVIATIONS * other.total_deviation
            is_in_reach = prior is None or is_within(
                other.quaternion, prior.quaternion, other_reach
            )
            if parity <= limit and is_in_reach:
                return withheld(
                    Reason.UNDETERMINED,
                    f'another one fits, with a parity of {parity:.1f} sigma, limit {limit:.1f}',
                )
        return None

    def _others(self, found: SampleEstimate, angles: Angles) -> list[SampleEstimate]:
        """Return the solutions of a sample but the one found; duplicates are possible."""
        if self.parity_count:
            return self.solver.other_solutions(found, angles)
        near = TURN_DEVIATIONS * found.total_deviation
        return [
            solution
            for solution in self.solver.all_solutions(angles, self.sensors)
            if not is_within(solution.quaternion, found.quaternion, near)
        ]

    def agrees(self, sample: Sample, estimate: SampleEstimate) -> bool:
        """Whether the parity of a solution is within its limit, by this sample alone."""
        return hypot(*estimate.parity_vector) <= self._parity_limit(sample, estimate)

    def _parity_limit(self, sample: Sample, estimate: SampleEstimate) -> float:
        """Return the largest parity that healthy sensors have at a solution, in this sample."""
        worth = integrity(estimate, sample.bias, sample.factors, sample.parity_bias)
        return self._window.limit(worth.noise, worth.bias)

    def near(self, sample: Sample, quaternion: Quaternion[float]) -> SampleEstimate | None:
        """Return the solution next to an orientation if the sensors in use agree there."""
        try:
            estimate = self.solver.fit_near(quaternion, sample.angles, self.sensors)
        except SpmError:
            return None
        return estimate if self.agrees(sample, estimate) else None

    def explaining(
        self,
        sample: Sample,
        near: Quaternion[float] | None,
    ) -> Quaternion[float] | None:
        """
        Return an orientation with which the sensors in use agree, near another one; else None.

        It is found where they determine none, too. What noise and bias do to the parity there is
        not known: they are allowed for with the most that they can do anywhere.
        """
        sigma = self.sensors.sigma
        whitened = [sample.bias[sensor] / sigma[sensor] for sensor in self.members]
        limit = self._window.limit(max(sample.factors), hypot(*whitened))
        return self.solver.explaining_orientation(near, sample.angles, self.sensors, limit)

    def every(self, sample: Sample) -> list[SampleEstimate]:
        """Return every orientation with which the sensors in use agree."""
        return [
            estimate
            for estimate in self.solver.all_solutions(sample.angles, self.sensors)
            if self.agrees(sample, estimate)
        ]

    def parts(self, worth: Integrity) -> list[float]:
        """
        Return each mounted sensor's part of the protection level, rad; infinite if unchecked.

        The mean parity of an undetected fault is (k_fa + k_md) / sqrt(n) at most, in standard
        deviations and without bias, with the n samples of the window.
        """
        undetected = (self.threshold + MISSED_DETECTION) / self._window.root
        return worth.parts(undetected, self._window.mean_bias)

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
        excess = max(self._window.variance - 1.0, 0.0) * self.parity_count
        bounds = []
        for size, deviation in zip(self.estimate.parity_sizes, sigma, strict=True):
            share = (size * deviation) ** 2
            bounds.append(sqrt(1.0 + excess / share) if share > VISIBLE_SHARE else inf)
        return bounds

    def too_noisy(self, sample: Sample) -> Symptom | None:
        """
        Return the sensor whose noise alone most exceeds its part of the level; None if none does.

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
        parts = self.parts(nominal)

        def excess(sensor: int) -> float:
            """Return what the noise of a sensor does, over its part of the level."""
            noise = factors[sensor] * sigma[sensor]
            return MISSED_DETECTION * noise * estimate.gain_sizes[sensor] / parts[sensor]

        noisiest = max(self.members, key=excess)
        if excess(noisiest) <= 1.0:
            return None
        noise = degrees(factors[noisiest] * sigma[noisiest])
        return Symptom(Reason.NOISY, f'{noise:.2f} deg', noisiest, Severity.LATCH)
