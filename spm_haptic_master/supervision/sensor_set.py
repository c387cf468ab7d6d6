# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Any three to six sensors in use: their orientation, their consistency, what it is worth."""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, inf, sqrt
from typing import NamedTuple

from spm_haptic_master.exceptions import AmbiguousError, SpmError
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.joints import UsedSensors
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import Limits
from spm_haptic_master.supervision.anchor import SAME_SOLUTION, TURN_DEVIATIONS, within
from spm_haptic_master.supervision.parity import padded, Parity, ParityWindow
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.solver import Angles, Solver
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

# Smallest share of a sensor's variance in the parity that counts (unit 1).
VISIBLE_SHARE = 1e-6
# Largest turn from the last orientation to that of the sensors without a faulty one, beside noise
# (rad): what a human turns in three samples, and no more than where another solution may be.
CONTINUING_TURN = 0.06


class Sample(NamedTuple):
    """One sample of N mounted sensors, and what to allow for."""

    stamp: int  # ns
    angles: Angles  # rad; NaN of a sensor without a reading
    prior: Quaternion[float] | None  # the last orientation if that is recent: x, y, z, w
    followed: int | None  # ns, stamp of that orientation
    bias: tuple[float, ...]  # rad, nominal bias of each of the N sensors
    factors: tuple[float, ...]  # measured noise of each over the configured one, at least 1


class SensorSet:
    """
    The sensors in use, and whether a sample is consistent with itself.

    Made of the forward model, the standard deviations of the N mounted sensors (rad), the limits
    of a healthy device, and the places of the sensors that are not in use. `entries` is the length
    of the parity vector: sensors in use beyond three. `estimate` is the orientation of the latest
    sample, `worth` what it is worth; None where the sensors determine none.
    """

    def __init__(self, solver: Solver, sigma: tuple[float, ...], limits: Limits,
                 left_out: Collection[int] = ()) -> None:
        self.sensors = UsedSensors(sigma, left_out)
        self.entries = self.sensors.count - 3
        self.estimate: SampleEstimate | None = None
        self.worth: Integrity | None = None
        self._solver, self._speed = solver, limits.joint_speed
        self._threshold = limits.threshold(max(self.entries, 1))
        self._reach = self._threshold + MISSED_DETECTION
        self._window = ParityWindow(self._threshold, max(self.entries, 1), limits.window)

    def restart(self) -> None:
        """Forget the samples."""
        self._window.restart()

    def take(self, sample: Sample) -> Symptom | None:
        """Solve a sample; return what contradicts it. Sensors that are not in use are ignored."""
        try:
            estimate, apart = self._solver.solve(sample.angles, self.sensors, sample.prior)
        except SpmError as error:
            self.estimate = self.worth = None
            if isinstance(error, AmbiguousError):
                # Two solutions meet, which happens to healthy sensors.
                return Symptom(Reason.UNDETERMINED, str(error), severity=Severity.WITHHOLD)
            return Symptom(Reason.NO_FIT, str(error))
        self.estimate = estimate
        worth = integrity(estimate, sample.bias, sample.factors)
        if apart:
            # Beside what a fault does to the orientation of all sensors.
            worth = worth._replace(healthy=worth.healthy + apart)
        self.worth = worth
        if not self.entries:
            return None
        return self._window.check(sample.stamp, estimate.parity_vector, worth.noise, worth.bias)

    def levels(self) -> list[float]:
        """
        Return each mounted sensor's part of the protection level, rad.

        Infinite for a sensor that the others cannot check, and for one that is not in use.
        """
        if self.worth is None:
            return [inf] * len(self.sensors.sigma)
        return self.worth.levels(self._reach / self._window.root)

    def noise_bounds(self) -> list[float]:
        """
        Return the largest noise of each sensor, over the configured one, that the parity allows.

        Motion does not change the parity, but all noise does: where a joint seems noisier than
        this, it vibrates. Infinite for a sensor that the parity does not see.
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
        Return the sensor whose noise is most beyond its part of the protection level, if any.

        What its measured noise does to the orientation is compared with its part at the configured
        noise of all sensors.
        """
        estimate, sigma, factors = self.estimate, self.sensors.sigma, sample.factors
        if estimate is None or not self.entries or max(factors) <= 1.0:
            return None
        parts = integrity(estimate, sample.bias, (1.0,) * len(sigma)).levels(
            self._reach / self._window.root)
        excess, worst = max((
            MISSED_DETECTION * factors[sensor] * sigma[sensor] * estimate.gain_sizes[sensor]
            / parts[sensor], sensor) for sensor in self.sensors.used)
        return Symptom(Reason.NOISY, f'{degrees(factors[worst] * sigma[worst]):.2f} deg', worst,
                       Severity.LATCH) if excess > 1.0 else None

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
        if not self.entries:
            return False
        try:
            estimate, _ = self._solver.solve(sample.angles, self.sensors, sample.prior)
        except SpmError:
            return False
        worth = integrity(estimate, sample.bias, sample.factors)
        age = 0.0 if sample.followed is None else (sample.stamp - sample.followed) * 1e-9
        turn = min(max(CONTINUING_TURN, self._speed * age), SAME_SOLUTION)
        if sample.prior is not None and not within(
                estimate.quaternion, sample.prior, turn + TURN_DEVIATIONS * worth.deviation):
            return False
        size = sqrt(sum(part * part for part in estimate.parity_vector))
        return size <= self._window.limit(worth.noise, worth.bias)
