# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Other orientations that may be the true one: what a fault of one sensor can hide from the parity.

Hypothesis of sensor i: it alone is wrong, by anything. The truth is then one of the orientations
that fit all other sensors in use (solution separation of RAIM, with all solutions of each subset).
While every sample follows shortly after the last one, the truth of each hypothesis stays beside
the published orientation. Where it may have left it - a start, a gap, a fast turn, a time in which
sensor i could not be checked, bad samples - every orientation in reach is a rival until the motion
contradicts it: no constant offset and no stuck value of sensor i explains all samples.

A sensor with a rival is off by the distance to it at most, and no sensor is checked whose rivals
are not known yet.

A hypothesis passes three states. It has no entry while its truth is beside the orientation. It is
*lost* once the truth may have left: a `Rival` that is not `found`, with the place from which it
left. A lost one is resolved by the solutions of the other sensors in reach of that place: none of
them away from the orientation ends it, each other one is a found rival. A found rival then follows
the motion by Gauss-Newton without sensor i.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf, pi, remainder
from typing import NamedTuple

from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.supervision.anchor import TURN_DEVIATIONS, within
from spm_haptic_master.supervision.folds import Folds
from spm_haptic_master.supervision.protection import integrity
from spm_haptic_master.supervision.sensor_set import Sample, SensorSet, total_deviation
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.trial import Place

# Periods after which a sample does not follow shortly: one lost sample is no gap; and the longest
# time (ns), at any rate.
FRESH_PERIODS = 2.5
FRESH_TIME = 60_000_000
# Largest turn between two samples that keeps the truth of every hypothesis beside the orientation
# (rad): other solutions of the others are further away, but near a fold.
SAME_TURN = 0.1
# Turn of the platform (rad) after which rivals are computed anew.
TRACKED_TURN = 0.02
# Times that a hypothesis is enumerated, or a rival not found in a row, before it is over: noise
# alone can hide a solution near another one of the same sensors.
MISSES = 3
# Share of the way to a rival from which a step may be one onto it.
HALF_WAY = 0.5
# Places from which the truth of one hypothesis may have left; with more it may be anywhere.
WAITING = 4


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
        Return what is left if the constant is a value, to a margin, rad.

        The value is an angle: in an interval of less than a whole turn it counts by the turn that
        is nearest to the middle.
        """
        if self.high - self.low < 2.0 * pi:
            middle = 0.5 * (self.low + self.high)
            value = middle + remainder(value - middle, 2.0 * pi)
        low = max(self.low, value - margin)
        high = min(self.high, value + margin)
        return Interval(low, high)

    def joined(self, other: Interval) -> Interval:
        """Return the smallest interval that has both."""
        low = min(self.low, other.low)
        high = max(self.high, other.high)
        return Interval(low, high)

    @property
    def is_empty(self) -> bool:
        """Whether no value is left."""
        return self.low > self.high


ANY = Interval()


@dataclass(slots=True)
class Rival:
    """
    An orientation that may be the true one, if one sensor alone is wrong.

    The intervals are the intersection over all samples at which the rival was computed: a constant
    fault has to explain every one of them, so each becomes smaller. Only where two rivals of a
    sensor meet, one is left, with the intervals joined.

    Attributes
    ----------
    sensor : int
        Place in ALL_JOINT_NAMES of the sensor that is wrong in this hypothesis.
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
        Times in a row that it was not found; of one that is lost, enumerations so far.
    at : tuple of four float, or None
        Published orientation for which it was computed last; None to compute it at once.
    healthy : float
        What noise and nominal bias of the other sensors do to it, rad.
    way : float
        Least step of the sensor that leads to it from the orientation, rad, as computed last.

    """

    sensor: int
    place: Place | None
    found: bool = False
    born: int = 0
    offset: Interval = ANY
    stuck: Interval = ANY
    misses: int = 0
    at: Quaternion[float] | None = None
    healthy: float = 0.0
    way: float = 0.0


class Rivals:
    """
    The rivals of every sensor in use; see the module.

    Parameters
    ----------
    sensors : SensorsInUse
        Has the sets without one sensor, and their trials.
    count : int
        Number N of mounted sensors.
    speed : float
        Human motion limit of the rotation, rad/s.

    Attributes
    ----------
    last : Place or None
        The latest consistent orientation; None before the first.
    unseen : dict of int to float
        By sensor, the least step of it, rad, that the parity may not show at the latest sample
        that `follow` took; it shows any step of another sensor in use.

    """

    def __init__(self, sensors: SensorsInUse, count: int, speed: float) -> None:
        self._sensors = sensors
        self._count = count
        self._speed = speed
        self._folds = Folds(count)
        # Alert limit of the latest sample, rad.
        self._limit = 0.0
        # Parts of the latest sample without any rival, rad.
        self._parts = [inf] * count
        self.unseen: dict[int, float] = {}
        self.restart()

    def restart(self) -> None:
        """Know nothing: the truth of every hypothesis may be anywhere."""
        self.last: Place | None = None
        # Stamp (ns) of the latest sample that the rivals followed.
        self._followed = 0
        # Where the platform was when each sensor became hidden.
        self._hidden: dict[int, Place] = {}
        # Where the truth of each sensor's hypothesis was, as followed through bad samples.
        self._left: dict[int, Place] = {}
        self._rivals = [Rival(sensor, None) for sensor in range(self._count)]
        self._used: tuple[int, ...] = ()
        self._folds.restart()

    def follow(
        self,
        sample: Sample,
        used: SensorSet,
        estimate: SampleEstimate,
        limit: float,
        fresh: int,
    ) -> list[float]:
        """
        Follow the rivals with a sample with which all sensors in use agree.

        The parts without a rival come first (`Folds`). Then hypotheses whose truth may have left
        are lost, at most one sensor is enumerated, found rivals follow the motion, and the parts
        are widened.

        Parameters
        ----------
        sample : Sample
            The sample.
        used : SensorSet
            The sensors in use, with what their orientation is worth.
        estimate : SampleEstimate
            Their orientation.
        limit : float
            Alert limit, rad.
        fresh : int
            Longest time between samples that follow shortly, ns.

        Returns
        -------
        list of float, length N
            What an undetected fault of each sensor is bounded by, rad. Infinite while its rivals
            are not known, and for all if three sensors are in use, which nothing checks.

        """
        if used.worth is None or not used.entries:
            self._used = ()
            self._parts = [inf] * self._count
            self.unseen = {}
            return [inf] * self._count
        if used.places != self._used:
            self._change_sensors(used.places)
        here = Place(sample.stamp, estimate.quaternion)
        parts = self._folds.parts(used, estimate, used.worth)
        self._parts = list(parts)
        self._limit = limit
        self._note_lost(here, parts, fresh)
        if self._rivals:
            self._note_gap(sample.stamp, fresh)
            self._find_recent(sample, here, parts, fresh)
            self._find_in_all(sample, here, parts)
            self._track(sample, here, parts)
            self._widen(here, parts)
        self.unseen = self._least_steps()
        self._followed = sample.stamp
        return parts

    def _least_steps(self) -> dict[int, float]:
        """
        Return the least step, rad, that the parity may not show, of the sensors that have one.

        A step onto a rival fits; one of half the way, or less, does not.
        """
        steps: dict[int, float] = {}
        for rival in self._rivals:
            way = HALF_WAY * rival.way if rival.found else 0.0
            if way < steps.get(rival.sensor, inf):
                steps[rival.sensor] = way
        for sensor in self._used:
            if self._parts[sensor] > self._limit:
                steps[sensor] = 0.0
        return steps

    def accept(self, sample: Sample, estimate: SampleEstimate) -> None:
        """Let a consistent orientation be the one that the next sample follows."""
        self.last = Place(sample.stamp, estimate.quaternion)

    def withheld(self, sample: Sample) -> None:
        """
        Follow the rivals through a sample that is not consistent.

        Each is continued without its sensor. One that the others do not continue is lost again,
        from its last place. So a glitch leaves no rival behind.
        """
        for rival in self._rivals:
            if rival.found and rival.place is not None:
                solution = self._near(sample, rival.sensor, rival.place)
                if solution is None:
                    rival.found = False
                else:
                    rival.place = Place(sample.stamp, solution.quaternion)
        self._followed = sample.stamp

    def place_without(self, sensor: int) -> Place | None:
        """
        Return the latest orientation that is the truth if a sensor is wrong; else None.

        A sensor with a rival, found or lost, may be wrong without that orientation being true. One
        that is hidden may have drifted since: then it is the one with which it became hidden.
        """
        if any(rival.sensor == sensor for rival in self._rivals):
            return None
        began = self._hidden.get(sensor)
        last = self.last
        if began is None or last is None or self._is_beside(last, began, sensor):
            return last
        return began

    def _is_beside(self, here: Place, began: Place, sensor: int) -> bool:
        """Whether the platform turned so little that the truth of a hypothesis stays beside it."""
        turn = min(TRACKED_TURN, 0.25 * self._folds.distance(sensor))
        return within(here.quaternion, began.quaternion, turn)

    def born_since(self, stamp: int) -> set[int]:
        """Return the sensors with a rival that was first found after a time, ns."""
        return {rival.sensor for rival in self._rivals if rival.found and rival.born > stamp}

    def _change_sensors(self, used: tuple[int, ...]) -> None:
        """
        Begin with other sensors: those with rivals may have others, for fewer to fit.

        Sensors without a rival keep that: the truth of their hypothesis is beside the orientation,
        whichever others are in use.
        """
        unsure = {rival.sensor for rival in self._rivals}
        self._rivals = [Rival(sensor, None) for sensor in used if sensor in unsure]
        self._hidden = {sensor: at for sensor, at in self._hidden.items() if sensor in used}
        self._used = used
        self._folds.restart()

    # Where the truth may have left the orientation ----------------------------------------------

    def _note_lost(
        self,
        here: Place,
        parts: list[float],
        fresh: int,
    ) -> None:
        """
        Note the hypotheses whose truth may have left the orientation since the last one.

        A trial without the sensor that was followed through bad samples says where its truth is.
        Else it may have left after a gap, a turn of more than `SAME_TURN`, a turn of half the way
        to where two solutions of the others meet, and behind a time in which the sensor was
        hidden, in which the platform turned by more than `TRACKED_TURN`, or a quarter of that way.
        """
        last = self.last
        if last is None:
            return
        is_gap = here.stamp - last.stamp > fresh
        turn = rotation_distance(here.quaternion, last.quaternion)
        if not is_gap and self._stays(turn, parts):
            return
        followed_without = self._sensors.followed()
        for sensor in self._used:
            followed = followed_without.get(sensor)
            if followed is not None and followed != self._left.get(sensor):
                self._note_followed(sensor, followed, here, parts[sensor])
            elif is_gap or turn > SAME_TURN:
                self._lose(sensor, last)
            if parts[sensor] > self._limit:
                self._hidden.setdefault(sensor, last)
            else:
                self._note_seen(sensor, here, last, turn)

    def _note_followed(
        self,
        sensor: int,
        followed: Place,
        here: Place,
        part: float,
    ) -> None:
        """Note where the truth of a hypothesis is, as its trial followed it: it is there, once."""
        self._left[sensor] = followed
        is_same = within(followed.quaternion, here.quaternion, min(part, self._limit))
        if not is_same or followed.stamp < here.stamp:
            self._lose(sensor, followed)

    def _note_seen(
        self,
        sensor: int,
        here: Place,
        last: Place,
        turn: float,
    ) -> None:
        """Note a sensor that is not hidden: its truth may have left before, or by this turn."""
        began = self._hidden.pop(sensor, None)
        if began is not None and not self._is_beside(here, began, sensor):
            self._lose(sensor, began)
        elif turn > SAME_TURN or turn > 0.5 * self._folds.distance(sensor):
            self._lose(sensor, last)

    def _stays(self, turn: float, parts: list[float]) -> bool:
        """Whether after such a turn (rad) the truth of every hypothesis stays where it was."""
        if self._hidden or self._sensors.is_trying:
            return False
        if turn > min(SAME_TURN, 0.5 * self._folds.nearest):
            return False
        return max(parts[sensor] for sensor in self._used) <= self._limit

    def _lose(self, sensor: int, place: Place) -> None:
        """
        Look for the truth of a sensor's hypothesis, from where it was.

        With more than `WAITING` places for one sensor, they are replaced by one: anywhere.
        """
        waiting = [
            rival.place for rival in self._rivals if rival.sensor == sensor and not rival.found
        ]
        if None in waiting or place in waiting:
            return
        if len(waiting) < WAITING:
            self._rivals.append(Rival(sensor, place))
            return
        self._rivals = [rival for rival in self._rivals if rival.sensor != sensor or rival.found]
        self._rivals.append(Rival(sensor, None))

    def _note_gap(self, stamp: int, fresh: int) -> None:
        """After a gap a rival may be any solution in reach of where it was."""
        if stamp - self._followed <= fresh:
            return
        for rival in self._rivals:
            if rival.found and rival.place is not None:
                rival.place = Place(self._followed, rival.place.quaternion)
                rival.found = False
                rival.at = None

    # Finding them -------------------------------------------------------------------------------

    def _find_recent(
        self,
        sample: Sample,
        here: Place,
        parts: list[float],
        fresh: int,
    ) -> None:
        """Find what was seen shortly before, `fresh` ns at most: the solution next to it."""
        for rival in self._waiting(here, parts):
            place = rival.place
            if place is None or here.stamp - place.stamp > fresh:
                continue
            solution = self._near(sample, rival.sensor, place)
            if solution is not None:
                self._rivals.remove(rival)
                self._add(replace(rival), sample, here, solution, parts)

    def _find_in_all(
        self,
        sample: Sample,
        here: Place,
        parts: list[float],
    ) -> None:
        """
        Find what else is lost, of one sensor a sample, in all solutions of the others.

        They take tens of estimates. The other sensors wait, with an infinite part.
        """
        waiting = self._waiting(here, parts)
        if not waiting:
            return
        sensor = waiting[0].sensor
        others = self._sensors.one_less(sensor)
        solutions = [] if others is None else others.every(sample)
        for rival in waiting:
            if rival.sensor == sensor:
                self._find_among(rival, solutions, sample, here, parts)

    def _find_among(
        self,
        rival: Rival,
        solutions: list[SampleEstimate],
        sample: Sample,
        here: Place,
        parts: list[float],
    ) -> None:
        """
        Add the solutions in reach of a lost rival; it is over once that is certain.

        One that had been found is over with a solution, or after `MISSES` places of the platform.
        Any other is looked for in one sample after another, see `_looks`.
        """
        reached = [each for each in solutions if self._in_reach(sample, rival.place, each)]
        rival.misses += 1
        if rival.born:
            rival.at = here.quaternion
            is_over = bool(reached) or rival.misses >= MISSES
        else:
            is_over = rival.misses >= self._looks(rival, sample)
        if is_over:
            self._rivals.remove(rival)
        for solution in reached:
            self._add(replace(rival), sample, here, solution, parts)

    def _looks(self, rival: Rival, sample: Sample) -> int:
        """
        Return in how many samples a hypothesis that was never found is looked for.

        Noise can hide a solution of three sensors that is near another one of them: they are
        complex then. More sensors have no such pairs. Within `SAME_TURN` there are no other
        solutions, but behind a fold, which the part of the sensor allows for.
        """
        place = rival.place
        if self._sensors.used.entries > 1:
            return 1
        is_near = place is not None and self._speed * sample.since(place.stamp) <= SAME_TURN
        return 1 if is_near else MISSES

    def _waiting(self, here: Place, parts: list[float]) -> list[Rival]:
        """
        Return the rivals to be found now: not again before the platform has moved.

        Where no fault of a sensor is detected its rivals wait.
        """
        return [
            rival for rival in self._rivals if not rival.found and self._is_due(rival, here, parts)
        ]

    def _is_due(
        self,
        rival: Rival,
        here: Place,
        parts: list[float],
    ) -> bool:
        """Whether a rival that is not found is to be found with this sample."""
        if parts[rival.sensor] == inf:
            return False
        return rival.at is None or not within(rival.at, here.quaternion, TRACKED_TURN)

    def _near(self, sample: Sample, sensor: int, place: Place) -> SampleEstimate | None:
        """Return the solution without a sensor that continues a place."""
        others = self._sensors.one_less(sensor)
        if others is None:
            return None
        solution = others.near(sample, place.quaternion)
        if solution is None or not self._in_reach(sample, place, solution):
            return None
        return solution

    def _in_reach(
        self,
        sample: Sample,
        place: Place | None,
        solution: SampleEstimate,
    ) -> bool:
        """Whether a human can have turned the platform from a place to a solution."""
        if place is None:
            return True
        turn = self._speed * sample.since(place.stamp)
        turn += TURN_DEVIATIONS * total_deviation(solution)
        return within(solution.quaternion, place.quaternion, turn)

    def _add(
        self,
        rival: Rival,
        sample: Sample,
        here: Place,
        solution: SampleEstimate,
        parts: list[float],
    ) -> None:
        """Add a solution as a rival unless it is the orientation itself, or is contradicted."""
        self._place(rival, sample, here, solution)
        if self._is_over(rival, here, parts):
            return
        rival.found = True
        rival.misses = 0
        rival.born = rival.born or here.stamp
        same = self._same(rival, solution)
        if same is None:
            self._rivals.append(rival)
        else:
            same.offset = same.offset.joined(rival.offset)
            same.stuck = same.stuck.joined(rival.stuck)

    def _same(self, rival: Rival, solution: SampleEstimate) -> Rival | None:
        """Return the rival that was found before where a solution is, but for noise; else None."""
        turn = TURN_DEVIATIONS * total_deviation(solution)
        for other in self._rivals:
            if other.sensor != rival.sensor or not other.found or other.place is None:
                continue
            if within(other.place.quaternion, solution.quaternion, turn):
                return other
        return None

    def _place(
        self,
        rival: Rival,
        sample: Sample,
        here: Place,
        solution: SampleEstimate,
    ) -> None:
        """
        Move a rival to a solution, and narrow the faults of its sensor that would explain it.

        At the rival the others imply an angle of the sensor. Its reading less that angle is the
        fault now, to the noise and bias of all: a constant offset has to be there each time. A
        stuck sensor has a constant reading instead. As the platform turns, the implied fault of a
        wrong rival changes, and a reading that is not stuck does.
        """
        sensor = rival.sensor
        solver = self._sensors.used.solver
        rival.place = Place(sample.stamp, solution.quaternion)
        rival.at = here.quaternion
        rival.healthy = integrity(solution, sample.bias, sample.factors).healthy
        reading = sample.angles[sensor]
        noise = max(sample.factors)
        try:
            fault = solver.fault(solution, sensor, sample)
        except SpmError:
            # At the edge of a leg's reach any fault explains it.
            rival.way = 0.0
            return
        threshold = self._sensors.used.threshold
        margin = threshold * noise * fault.deviation + fault.bias
        rival.offset = rival.offset.narrowed(fault.fault, margin)
        step = abs(remainder(fault.fault, 2.0 * pi))
        rival.way = max(step - margin, 0.0)
        sigma = solution.sensors.sigma[sensor]
        rival.stuck = rival.stuck.narrowed(reading, threshold * noise * sigma)

    def _is_over(
        self,
        rival: Rival,
        here: Place,
        parts: list[float],
    ) -> bool:
        """
        Whether no constant fault explains a rival, or it is the orientation itself.

        It is the orientation itself within the part of its sensor, and within the alert limit.
        """
        if rival.offset.is_empty and rival.stuck.is_empty:
            return True
        if rival.place is None:
            return False
        part = min(parts[rival.sensor], self._limit)
        return within(rival.place.quaternion, here.quaternion, part)

    def _track(
        self,
        sample: Sample,
        here: Place,
        parts: list[float],
    ) -> None:
        """Let the rivals follow the motion; those that it contradicts are over."""
        for rival in list(self._rivals):
            if not rival.found or rival.place is None or rival.at is None:
                continue
            if within(rival.at, here.quaternion, TRACKED_TURN):
                continue
            solution = self._near(sample, rival.sensor, rival.place)
            if solution is None:
                rival.found = False
                continue
            self._place(rival, sample, here, solution)
            if self._is_over(rival, here, parts):
                self._rivals.remove(rival)

    def parts_since(self, here: Place, stamp: int) -> list[float]:
        """
        Return the parts without the rivals from before a stamp, ns, in rad.

        They are those of the latest sample that `follow` took with four or more sensors in use.
        Lost hypotheses still count: their part is infinite.
        """
        parts = list(self._parts)
        self._widen(here, parts, stamp)
        return parts

    def _widen(
        self,
        here: Place,
        parts: list[float],
        since: int = -1,
    ) -> None:
        """
        Widen the part of each sensor to its rivals that were found after a stamp, ns.

        The distance to a rival is that of its latest computation, so what the platform turned
        since is added.
        """
        for rival in self._rivals:
            if rival.found and rival.born <= since:
                continue
            if not rival.found or rival.place is None or rival.at is None:
                parts[rival.sensor] = inf
                continue
            apart = rotation_distance(rival.place.quaternion, here.quaternion)
            moved = rotation_distance(rival.at, here.quaternion)
            part = apart + moved + rival.healthy
            parts[rival.sensor] = max(parts[rival.sensor], part)
