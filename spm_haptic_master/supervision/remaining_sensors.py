# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Five or six sensors without one: whether the others agree, and what their orientation is."""

from __future__ import annotations

from math import inf

from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics.sample_estimate import SampleEstimate
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.norm_monitor import NormMonitor
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.solver import Angles, Quaternion, Solver
from spm_haptic_master.supervision.symptom import Symptom

# Consistent samples from which on the only set that is left is the healthy one (samples).
ISOLATION_SAMPLES = 3
# Part of the window after which the best of several sets that agree is taken (unit 1). It may be
# the wrong one while a fault is small: its own tests and protection level cover that.
ISOLATION_WINDOW = 0.5
# Sensors that are left of which the best set may be taken: five check each other everywhere.
ENOUGH_SENSORS = 5


class RemainingSensors:
    """
    All sensors but one.

    Parameters
    ----------
    solver : Solver
        The forward model.
    limits : Limits
        What is healthy.
    sensors, excluded : int
        Number of all sensors, 5 or 6, and the place of the one that is left out.

    Attributes
    ----------
    estimate : SampleEstimate or None
        Orientation of the latest sample; None where the others give none.
    noise : float
        Largest measured noise of the others over the configured one, at least 1.

    """

    def __init__(self, solver: Solver, limits: Limits, sensors: int, excluded: int) -> None:
        threshold = limits.norm_threshold(sensors - 4)
        self.excluded = excluded
        self.name = ALL_JOINT_NAMES[excluded]
        self.estimate: SampleEstimate | None = None
        self.noise = 1.0
        self._solver = solver
        self._monitor = NormMonitor(threshold, limits.window)
        self._reach = threshold + MISSED_DETECTION
        self._worth: Integrity | None = None

    def take(self, stamp: int, angles: Angles, prior: Quaternion | None,
             bias: tuple[float, ...], factors: tuple[float, ...]) -> Symptom | None:
        """
        Return what contradicts these sensors in a sample, and keep its orientation.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        angles : tuple of N float
            Readings of all sensors, rad.
        prior : tuple of 4 float, or None
            The last orientation, if that is recent.
        bias : tuple of N float
            Nominal bias of each sensor, rad.
        factors : tuple of N float
            Measured noise of each sensor over the configured one, at least 1.

        """
        self.estimate = None
        excluded = self.excluded
        noise = self.noise = max(factors[:excluded] + factors[excluded + 1:])
        try:
            estimate = self._solver.without(self.name, angles, prior)
        except SpmError as error:
            return Symptom('no orientation fits', str(error))
        worth = integrity(estimate, bias, noise)
        symptom = self._monitor.check(stamp, estimate.parity_vector, worth.bias, noise)
        if symptom is None:
            self.estimate, self._worth = estimate, worth
        return symptom

    @property
    def disagreement(self) -> float:
        """Mean of what contradicts these sensors over the window, in standard deviations."""
        return self._monitor.size

    def levels(self) -> tuple[list[float], float]:
        """Return each sensor's part of the protection level, and the healthy part, rad."""
        worth = self._worth
        if worth is None:
            return [], inf
        parts = worth.levels(self._reach * self.noise / self._monitor.root)
        parts[self.excluded] = inf
        return parts, worth.healthy


class Isolation:
    """
    Finds the one sensor without which the others agree, and goes on without it.

    Parameters
    ----------
    solver, limits, sensors
        As of `RemainingSensors`; four sensors cannot isolate one.

    Attributes
    ----------
    found : RemainingSensors or None
        All sensors but the faulty one, once it is known.
    chosen : bool
        Whether it was the best of several sets that agreed.

    """

    def __init__(self, solver: Solver, limits: Limits, sensors: int) -> None:
        self._solver, self._limits, self._sensors = solver, limits, sensors
        self.found: RemainingSensors | None = None
        self._left: list[RemainingSensors] = []
        self._samples = 0
        self._begun: int | None = None
        self.chosen = False

    def begin(self, fault: Symptom | None) -> None:
        """Start the search for the faulty sensor; a fault that names one ends it at once."""
        self.end()
        if self._sensors <= len(JOINT_NAMES) or fault is None:
            return
        if fault.sensor is not None:
            self.found = self._without(fault.sensor)
        else:
            self._left = [self._without(each) for each in range(self._sensors)]

    def end(self) -> None:
        """Stop: nothing goes out before all sensors agree."""
        self.found = None
        self._left = []
        self._samples = 0
        self._begun = None
        self.chosen = False

    def _without(self, sensor: int) -> RemainingSensors:
        return RemainingSensors(self._solver, self._limits, self._sensors, sensor)

    def take(self, stamp: int, angles: Angles, prior: Quaternion | None,
             bias: tuple[float, ...], factors: tuple[float, ...]) -> Symptom | None:
        """Take a sample in; return what contradicts the sensors that are left, once found."""
        if self.found is not None:
            return self.found.take(stamp, angles, prior, bias, factors)
        self._left = [each for each in self._left
                      if each.take(stamp, angles, prior, bias, factors) is None]
        self._samples += 1
        if self._begun is None:
            self._begun = stamp
        if self._left and self._samples >= ISOLATION_SAMPLES and (
                len(self._left) == 1 or self._may_choose(stamp - self._begun)):
            self.found = min(self._left, key=lambda each: each.disagreement)
            self.chosen = len(self._left) > 1
            self._left = []
        return None

    def _may_choose(self, since: int) -> bool:
        """Whether the best of several sets may be taken, so many ns after the beginning."""
        return self._sensors > ENOUGH_SENSORS \
            and since >= ISOLATION_WINDOW * self._limits.window * 1e9
