# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Orientations without one sensor: next to a place, behind a fold, and all of them.

A human can turn the platform only so far in a time. So a solution of the other sensors is what the
platform may have turned to, from a place where it was, only within that reach.
"""

from __future__ import annotations

from collections.abc import Iterable

from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within
from spm_haptic_master.supervision.anchor import TURN_DEVIATIONS
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse


class RivalSearch:
    """
    Solutions of a sample by the sensors in use but one.

    Parameters
    ----------
    sensors : SensorsInUse
        Has the sets without one sensor.
    speed : float
        Human motion limit of the rotation, rad/s.

    """

    def __init__(self, sensors: SensorsInUse, speed: float) -> None:
        self._sensors = sensors
        self._speed = speed

    def reach(self, sample: Sample, place: Place) -> float:
        """Return by how much a human can have turned the platform since a place, rad."""
        return self._speed * sample.time_since(place.stamp)

    def next_to(self, sample: Sample, sensor: int, place: Place) -> SampleEstimate | None:
        """Return the solution without a sensor that continues a place; None if none does."""
        others = self._sensors.one_less(sensor)
        solution = None if others is None else others.near(sample, place.quaternion)
        if solution is None or not self._is_in_reach(sample, place, solution):
            return None
        return solution

    def every(self, sample: Sample, sensor: int) -> list[SampleEstimate]:
        """Return all solutions without a sensor; they take tens of estimates."""
        others = self._sensors.one_less(sensor)
        return [] if others is None else others.every(sample)

    def reached(
        self,
        sample: Sample,
        place: Place | None,
        solutions: Iterable[SampleEstimate | None],
    ) -> list[SampleEstimate]:
        """Return the solutions to which a human can have turned the platform from a place."""
        return [
            solution
            for solution in solutions
            if solution is not None and self._is_in_reach(sample, place, solution)
        ]

    def recent(
        self,
        sample: Sample,
        sensor: int,
        place: Place,
        here: Place,
        starts: Iterable[Quaternion[float]],
    ) -> list[SampleEstimate] | None:
        """
        Return where the truth may be if a sensor stepped after the platform was at a place.

        The solution next to the orientation is none of these: what the sensor does to that the
        parity shows.

        Parameters
        ----------
        sample : Sample
            The sample.
        sensor : int
            Index in ALL_JOINT_NAMES of the sensor.
        place : Place
            Where the platform was.
        here : Place
            The orientation of the sample, by all sensors in use.
        starts : iterable of quaternions
            Further orientations from which Gauss-Newton starts.

        Returns
        -------
        list of SampleEstimate, or None
            None if no solution, or one out of reach, is next to the place: it is not known then.

        """
        others = self._sensors.one_less(sensor)
        if others is None:
            return None
        first = others.near(sample, place.quaternion)
        beside = others.near(sample, here.quaternion)
        if not _are_same(first, beside) and not self.reached(sample, place, [first]):
            return None
        further = [others.near(sample, start) for start in starts]
        return [
            solution
            for solution in self.reached(sample, place, [first, *further])
            if not _are_same(solution, beside)
        ]

    def _is_in_reach(
        self,
        sample: Sample,
        place: Place | None,
        solution: SampleEstimate,
    ) -> bool:
        """Whether a human can have turned the platform from a place, or any, to a solution."""
        if place is None:
            return True
        turn = self.reach(sample, place) + TURN_DEVIATIONS * solution.total_deviation
        return is_within(solution.quaternion, place.quaternion, turn)


def _are_same(one: SampleEstimate | None, other: SampleEstimate | None) -> bool:
    """Whether two results of Gauss-Newton are one solution; None is no solution."""
    if one is None or other is None:
        return False
    return is_within(one.quaternion, other.quaternion, other.total_deviation)
