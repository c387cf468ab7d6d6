# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""One orientation that may be the true one, if one sensor alone is wrong."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, remainder
from typing import NamedTuple

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within, rotation_distance
from spm_haptic_master.supervision.sample import Place

# Turn of the platform (rad) after which a rival is computed anew.
TRACKED_TURN = 0.02


class Interval(NamedTuple):
    """
    Values that a constant angle may have.

    Attributes
    ----------
    low, high : float
        Ends, rad; `low` above `high` is empty, infinite ends are any value.

    """

    low: float = -inf
    high: float = inf

    def narrowed(self, value: float, margin: float) -> Interval:
        """
        Return the part of the interval within a margin of a value, rad.

        The value is an angle: whole turns are added to it until it is nearest to the middle of an
        interval of less than a turn.
        """
        if self.high - self.low < 2.0 * pi:
            middle = 0.5 * (self.low + self.high)
            value = middle + remainder(value - middle, 2.0 * pi)
        low = max(self.low, value - margin)
        high = min(self.high, value + margin)
        return Interval(low, high)

    def joined(self, other: Interval) -> Interval:
        """Return the smallest interval that contains both."""
        low = min(self.low, other.low)
        high = max(self.high, other.high)
        return Interval(low, high)

    @property
    def is_empty(self) -> bool:
        """Whether no value is left."""
        return self.low > self.high


ANY = Interval()


@dataclass(slots=True, eq=False)  # two rivals may have equal values for a moment
class Rival:
    """
    An orientation that may be the true one, if one sensor alone is wrong.

    A constant fault has to explain every sample, so each interval is the intersection over all
    samples at which the rival was computed, and shrinks. Where two rivals of a sensor meet, one
    stays, with the intervals joined.

    Attributes
    ----------
    sensor : int
        Index in ALL_JOINT_NAMES of the sensor that is wrong in this hypothesis.
    place : Place or None
        Orientation R_base_platform and its time. While the rival is not `found`, where the
        platform was when it was last known; None: anywhere.
    found : bool
        Whether `place` is a solution of the other sensors that follows the motion.
    born : int
        Stamp at which it was first found, ns; 0 before.
    offset : Interval
        Constant faults of the sensor, rad, that explain all samples since.
    stuck : Interval
        Constant readings of the sensor, rad, that explain all samples since.
    misses : int
        While it is lost, how often it was searched for among all solutions.
    computed_at : tuple of four float, or None
        Published orientation for which it was computed last; None: compute it at once.
    healthy : float
        What noise and nominal bias of the other sensors do to it, rad.
    least_step : float
        Least step of the sensor that leads from the orientation to the rival, rad, as computed
        last.

    """

    sensor: int
    place: Place | None
    found: bool = False
    born: int = 0
    offset: Interval = ANY
    stuck: Interval = ANY
    misses: int = 0
    computed_at: Quaternion[float] | None = None
    healthy: float = 0.0
    least_step: float = 0.0

    @property
    def is_contradicted(self) -> bool:
        """Whether neither a constant offset nor a stuck reading explains all samples."""
        return self.offset.is_empty and self.stuck.is_empty

    def is_current(self, here: Place) -> bool:
        """Whether the platform turned by less than `TRACKED_TURN` since it was computed last."""
        computed_at = self.computed_at
        return computed_at is not None and is_within(computed_at, here.quaternion, TRACKED_TURN)

    def part(self, here: Place) -> float:
        """
        Return what the fault of its sensor is bounded by at an orientation, rad.

        It is the distance to the rival as computed last, with what the platform turned since;
        infinite while the rival is lost.
        """
        if not self.found or self.place is None or self.computed_at is None:
            return inf
        apart = rotation_distance(self.place.quaternion, here.quaternion)
        turned = rotation_distance(self.computed_at, here.quaternion)
        return apart + turned + self.healthy
