# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Parts of the protection level of four sensors to the second order, and how near a fold is.

A turn e of the orientation, along the direction in which a fault of sensor i takes it, moves the
parity by e / slope_i - c_i e^2. The first order alone bounds an undetected fault where c_i is
small. Near a fold, where two solutions of the other sensors meet, the parity bends back: beyond
its largest value 1 / (4 slope_i^2 c_i) no fault of sensor i is detected, and the other solution
is 1 / (slope_i c_i) away. c_i is the size of the curvature: whichever sign that has, a fault of
one of the two signs is bent back.
"""

from __future__ import annotations

from math import hypot, inf, sqrt

from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within
from spm_haptic_master.supervision.protection import Integrity
from spm_haptic_master.supervision.sensor_set import SensorSet

# Turn of the platform (rad) after which the curvatures are computed anew: the least, near a fold,
# and the largest, far from all. Between them it is the turn in which the largest parity less the
# parity of an undetected fault changes by no more than this share of it (unit 1).
NEAR_TURN = 0.02
ANY_TURN = 0.2
REST_SHARE = 0.05
# Change of a curvature by a turn of 1 rad, over the length of the parity's derivative by the
# readings (1 / rad): the median of 2,900 poses to a tilt of 25 deg is 1, and 99 % are below this;
# the others are within degrees of where a leg's reach ends.
CURVATURE_CHANGE = 8.0
# Share of the computed way to another solution of the others (unit 1) from which on it has to be
# expected, where the bend grows by `CURVATURE_CHANGE`: of 4,700 such solutions within 9 deg of an
# orientation that checks the sensor, 99.5 % are no nearer.
REACH_SHARE = 0.5


class Folds:
    """
    Curvature of the parity along the turn that a fault of each of N sensors makes.

    A curvature takes three inverse models, so all of them are kept while the platform turns by
    less than what may matter: `NEAR_TURN` near a fold of any sensor, `ANY_TURN` far from all.
    """

    def __init__(self, sensors: int) -> None:
        self._sensors = sensors
        self.restart()

    def restart(self) -> None:
        """Forget the curvatures: other sensors are in use."""
        self._curvatures = [inf] * self._sensors
        # Orientation at which they were computed.
        self._computed_at: Quaternion[float] | None = None
        # Of each sensor slope_i c_i, 1 / rad, and by how much a turn of 1 rad changes it; infinite
        # if the others do not check it.
        self._bends = [0.0] * self._sensors
        self._changes = [0.0] * self._sensors
        # The largest of each, of the sensors that the others check.
        self._largest_bend = self._largest_change = 0.0

    def distance(self, sensor: int) -> float:
        """Return the angle to the solution of the others behind a sensor's fold, rad: 1 / bend."""
        bend = self._bends[sensor]
        return 1.0 / bend if bend else inf

    def may_reach(self, sensor: int, turn: float) -> bool:
        """Whether another solution of the others may be within a turn of the orientation, rad."""
        return turn * (self._bends[sensor] + turn * self._changes[sensor]) > REACH_SHARE

    def may_reach_any(self, turn: float) -> bool:
        """Whether that may be so of any sensor."""
        return turn * (self._largest_bend + turn * self._largest_change) > REACH_SHARE

    def parts(self, used: SensorSet, estimate: SampleEstimate, worth: Integrity) -> list[float]:
        """
        Return each sensor's part of the level of a sample.

        The part is the turn e at which e / slope - c e^2 reaches the parity of an undetected
        fault, plus what noise and bias of healthy sensors do.

        Parameters
        ----------
        used : SensorSet
            The sensors in use.
        estimate : SampleEstimate
            Their orientation.
        worth : Integrity
            What it is worth.

        Returns
        -------
        list of float
            Part of each of N sensors, rad; infinite if no fault of it is detected.

        """
        parts = used.parts(worth)
        # Largest change of a curvature by a turn of 1 rad.
        change = CURVATURE_CHANGE * hypot(*estimate.parity_sizes)
        turn = self._widen(parts, used, worth, change)
        here = estimate.quaternion
        if self._computed_at is None or not is_within(self._computed_at, here, turn):
            for sensor in used.members:
                self._curvatures[sensor] = used.solver.parity_curvature(estimate, sensor)
            self._computed_at = here
            parts = used.parts(worth)
            self._widen(parts, used, worth, change)
        return parts

    def _widen(
        self,
        parts: list[float],
        used: SensorSet,
        worth: Integrity,
        change: float,
    ) -> float:
        """
        Widen first-order parts to the second order; return for which turn (rad) that holds.

        With curvature c and slope s of a sensor, a turn e leaves the parity e / s - c e^2. What
        leaves no more than l / s, with the first-order part l, is at most
        2 l / (1 + sqrt(1 - 4 s c l)), if the share 4 s c l of the largest parity is below 1. A
        turn changes c by up to `change` a rad.
        """
        turn = ANY_TURN
        largest_bend = largest_slope = 0.0
        healthy = worth.healthy
        for sensor in used.members:
            linear = parts[sensor] - healthy
            if linear == inf:
                self._bends[sensor] = inf
                self._changes[sensor] = inf
                continue
            slope = worth.slopes[sensor]
            bend = slope * self._curvatures[sensor]
            self._bends[sensor] = bend
            self._changes[sensor] = slope * change
            if bend > largest_bend:
                largest_bend = bend
            if slope > largest_slope:
                largest_slope = slope
            share = 4.0 * bend * linear
            if share >= 1.0:
                parts[sensor] = inf
                turn = NEAR_TURN
                continue
            rest = 1.0 - share
            parts[sensor] = healthy + 2.0 * linear / (1.0 + sqrt(rest))
            changed = 4.0 * slope * linear * change * turn
            if changed > REST_SHARE * rest:
                turn *= REST_SHARE * rest / changed
        self._largest_bend = largest_bend
        self._largest_change = largest_slope * change
        return max(turn, NEAR_TURN)
