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

The fault of a sensor with a rival is bounded by the distance to it, and no sensor is checked whose
rivals are not known yet.

A hypothesis passes three states. It has no entry while its truth is beside the orientation. It is
*lost* once the truth may have left: a `Rival` that is not `found`, with the place from which it
left. A lost one is resolved by the solutions of the other sensors in reach of that place: it ends
if none of them is away from the orientation, and each other one is a found rival. A found rival
then follows the motion by Gauss-Newton without sensor i.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf, pi, remainder

from spm_haptic_master.exceptions import SpmError
from spm_haptic_master.kinematics.estimation.gauss_newton import SampleEstimate
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.kinematics.rotations import is_within, rotation_distance
from spm_haptic_master.supervision.anchor import TURN_DEVIATIONS
from spm_haptic_master.supervision.folds import Folds
from spm_haptic_master.supervision.protection import integrity
from spm_haptic_master.supervision.rival import Rival, TRACKED_TURN
from spm_haptic_master.supervision.rival_search import RivalSearch
from spm_haptic_master.supervision.sample import Place, Sample
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse

# Largest turn between two samples that keeps the truth of every hypothesis beside the orientation
# (rad): a solution of the others that is nearer, and behind no fold, is within the level.
SAME_TURN = 0.01
# How far a human can have turned the platform from where a rival was lost (rad), if it is searched
# for among all solutions only once.
NEAR_REACH = 0.1
# Times that a lost rival is searched for among all solutions before it is over: noise alone can
# hide a solution near another one of the same sensors.
MISSES = 3
# Shares of the way to a solution behind a fold at which Gauss-Newton starts: the fold is half way,
# and the way known to the second order.
OVER_FOLD = 0.6, 1.5
# Share of the least step of a sensor that leads to a rival, from which the parity may not show a
# step: a smaller one is nearer to the orientation, whose parity then shows it.
HALF_WAY = 0.5
# Most places from which the truth of one hypothesis may have left; with more it may be anywhere.
MOST_PLACES = 4


class Rivals:
    """
    The rivals of every sensor in use; see the module.

    Parameters
    ----------
    sensors : SensorsInUse
        Has the sets without one sensor, and their trials.
    count : int
        Number N of mounted sensors.
    speed, acceleration : float
        Human motion limits of the rotation, rad/s and rad/s^2.

    Attributes
    ----------
    last : Place or None
        The latest consistent orientation, which the next sample follows; None before the first.
        The supervisor assigns it, once it is known that the sample is consistent.
    unseen_steps : dict of int to float
        By sensor, the least step of it, rad, that the parity may not show at the latest sample
        that `follow` took; it shows any step of another sensor in use.

    """

    def __init__(
        self,
        sensors: SensorsInUse,
        count: int,
        speed: float,
        acceleration: float,
    ) -> None:
        self._sensors = sensors
        self._count = count
        self._speed = speed
        self._search = RivalSearch(sensors, speed)
        self._acceleration = acceleration
        self._folds = Folds(count)
        # Of the latest sample: alert limit, the parts without any rival, and how far from the
        # orientation the truth may be if a sensor stepped in it, rad.
        self._alert_limit = 0.0
        self._parts = [inf] * count
        self._apart = inf
        self.unseen_steps: dict[int, float] = {}
        self.restart()

    def restart(self) -> None:
        """Know nothing: the truth of every hypothesis may be anywhere."""
        self.last: Place | None = None
        # Stamp (ns) of the latest sample that the rivals followed, and the platform's speed then.
        self._followed = 0
        self._platform_speed = self._speed
        # Where the platform was when each sensor became hidden.
        self._hidden: dict[int, Place] = {}
        # Where the truth of each sensor's hypothesis was, as its trial followed it last.
        self._on_trial: dict[int, Place] = {}
        self._rivals = [Rival(sensor, None) for sensor in range(self._count)]
        # Indices of the sensors in use; none with three, which have no parity.
        self._used: tuple[int, ...] = ()
        self._folds.restart()

    def follow(self, sample: Sample, alert_limit: float) -> list[float]:
        """
        Follow the rivals with a sample with which all sensors in use agree.

        The parts without a rival come first (`Folds`). Then hypotheses whose truth may have left
        are lost, found rivals follow the motion, all solutions are computed without one sensor at
        most, and the parts are widened.

        Parameters
        ----------
        sample : Sample
            The sample, which the sensors in use have solved.
        alert_limit : float
            Largest part with which a sensor counts as checked, rad.

        Returns
        -------
        list of float, length N
            What an undetected fault of each sensor is bounded by, rad. Infinite while its rivals
            are not known, and for all if three sensors are in use, which nothing checks.

        """
        used = self._sensors.used
        if used.estimate is None or used.worth is None or not used.parity_count:
            self._used = ()
            self._parts = [inf] * self._count
            self.unseen_steps = {}
            return self._parts
        if used.members != self._used:
            self._change_sensors(used.members)
        here = Place(sample.stamp, used.estimate.quaternion)
        self._parts = self._folds.parts(used, used.estimate, used.worth)
        self._alert_limit = alert_limit
        self._note_lost(sample, here)
        if self._rivals:
            self._note_gap(sample)
            self._track(sample, here)
            self._find_recent(sample, here)
            self._find_in_all(sample, here)
        self.unseen_steps = self._least_steps()
        self._followed = sample.stamp
        return self.parts(here)

    def parts(self, here: Place, born_after: int = -1) -> list[float]:
        """
        Return what an undetected fault of each sensor is bounded by at an orientation, rad.

        Parameters
        ----------
        here : Place
            Orientation of the latest sample that `follow` took.
        born_after : int
            Stamp, ns: found rivals from before it do not count. Lost ones do.

        Returns
        -------
        list of float, length N
            The parts without rivals, widened to those that count.

        """
        parts = list(self._parts)
        for rival in self._rivals:
            if not rival.found or rival.born > born_after:
                parts[rival.sensor] = max(parts[rival.sensor], rival.part(here))
        return parts

    def _least_steps(self) -> dict[int, float]:
        """
        Return the least step, rad, that the parity may not show, of the sensors that have one.

        A step that leads to a rival fits; one of less than half of that does not.
        """
        steps: dict[int, float] = {}
        for rival in self._rivals:
            step = HALF_WAY * rival.least_step if rival.found else 0.0
            steps[rival.sensor] = min(step, steps.get(rival.sensor, inf))
        for sensor in self._used:
            if self._parts[sensor] > self._alert_limit:
                steps[sensor] = 0.0
        return steps

    def follow_inconsistent(self, sample: Sample) -> None:
        """
        Follow the rivals through a sample that is not consistent.

        Each is continued without its sensor. One that the others do not continue is lost again,
        from its last place. So a glitch leaves no rival behind.
        """
        for rival, place in self._found():
            solution = self._search.next_to(sample, rival.sensor, place)
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

    def born_since(self, stamp: int) -> set[int]:
        """Return the sensors with a rival that was first found after a time, ns."""
        return {rival.sensor for rival in self._rivals if rival.found and rival.born > stamp}

    def _found(self) -> list[tuple[Rival, Place]]:
        """Return the rivals that follow the motion, with their orientations."""
        return [
            (rival, rival.place)
            for rival in self._rivals
            if rival.found and rival.place is not None
        ]

    def _change_sensors(self, used: tuple[int, ...]) -> None:
        """
        Begin with other sensors: those with rivals may have more, as fewer readings have to fit.

        Sensors without a rival keep that: the truth of their hypothesis is beside the orientation,
        whichever others are in use.
        """
        unsure = {rival.sensor for rival in self._rivals}
        self._rivals = [Rival(sensor, None) for sensor in used if sensor in unsure]
        self._hidden = {sensor: at for sensor, at in self._hidden.items() if sensor in used}
        self._used = used
        self._folds.restart()

    # Where the truth may have left the orientation ----------------------------------------------

    def _note_lost(self, sample: Sample, here: Place) -> None:
        """
        Note the hypotheses whose truth may have left the orientation since the last one.

        A trial without the sensor that was followed through bad samples says where its truth is.
        Else it may have left after a gap, a turn of more than `SAME_TURN`, where a human may have
        turned the platform to the other side of the sensor's fold, and after a time in which the
        sensor was hidden if the platform turned in it: see `_is_beside`.
        """
        last = self.last
        if last is None:
            self._apart = inf
            return
        is_gap = not sample.follows(last.stamp)
        turn = rotation_distance(here.quaternion, last.quaternion)
        self._note_apart(turn, sample, last, is_gap=is_gap)
        left = self._used if is_gap or turn > SAME_TURN else self._behind_folds()
        if not left and self._are_all_beside():
            return
        on_trial = self._sensors.places_on_trial()
        for sensor in self._used:
            place = on_trial.get(sensor)
            if place is not None and place != self._on_trial.get(sensor):
                self._note_on_trial(sensor, place, here)
            elif sensor in left:
                self._lose(sensor, last)
            self._note_hidden(sensor, here, last)

    def _note_apart(self, turn: float, sample: Sample, last: Place, *, is_gap: bool) -> None:
        """
        Note how far the truth may be from the orientation if a sensor stepped in this sample.

        The orientation turned. The truth went on as the platform did before, to what a human can
        accelerate it: v t + a t^2 in a period t, as at the end of the period before the speed was
        up to a t / 2 above its mean v. After a gap this is about the latest sample of a
        trial, before which the speed may be any that a human reaches in the gap.

        Parameters
        ----------
        turn : float
            Turn of the orientation since the last one, rad.
        sample : Sample
            The sample.
        last : Place
            The last orientation.
        is_gap : bool
            Whether the sample does not follow it shortly.

        """
        elapsed = sample.time_since(last.stamp)
        period = elapsed
        speed = self._platform_speed
        if is_gap:
            period = sample.short_time * 1e-9
            speed = min(speed + self._acceleration * elapsed, self._speed)
        moved = speed * period + self._acceleration * period * period
        self._apart = turn + max(turn, moved)
        if sample.stamp > last.stamp:
            self._platform_speed = turn / elapsed

    def _behind_folds(self) -> tuple[int, ...]:
        """Return the sensors behind whose folds the truth may be; none at usual rates."""
        if not self._folds.may_reach_any(self._apart):
            return ()
        return tuple(filter(self._may_cross, self._used))

    def _are_all_beside(self) -> bool:
        """Whether no sensor is hidden or on trial: each truth is beside the orientation then."""
        if self._hidden or self._sensors.is_trying:
            return False
        return max([self._parts[sensor] for sensor in self._used]) <= self._alert_limit

    def _note_on_trial(self, sensor: int, place: Place, here: Place) -> None:
        """Note where the truth of a hypothesis is, as its trial followed it."""
        self._on_trial[sensor] = place
        is_same = self._is_same(sensor, place, here)
        if not is_same or place.stamp < here.stamp or self._may_cross(sensor):
            self._lose(sensor, place)

    def _may_cross(self, sensor: int) -> bool:
        """
        Whether the truth may be behind the fold of a sensor.

        Where a fault of the sensor may go undetected its part is infinite anyway.
        """
        return self._parts[sensor] < inf and self._folds.may_reach(sensor, self._apart)

    def _note_hidden(self, sensor: int, here: Place, last: Place) -> None:
        """Note since where a sensor is hidden; if it no longer is, its truth may have left."""
        if self._parts[sensor] > self._alert_limit:
            self._hidden.setdefault(sensor, last)
            return
        began = self._hidden.pop(sensor, None)
        if began is not None and not self._is_beside(here, began, sensor):
            self._lose(sensor, began)

    def _is_beside(self, here: Place, began: Place, sensor: int) -> bool:
        """
        Whether the platform turned so little that the truth of a hypothesis stays beside it.

        That is less than `TRACKED_TURN`, and less than half of the way to the sensor's fold, which
        is half way to the other solution.
        """
        turn = min(TRACKED_TURN, 0.25 * self._folds.distance(sensor))
        return is_within(here.quaternion, began.quaternion, turn)

    def _is_same(self, sensor: int, place: Place, here: Place) -> bool:
        """
        Whether a place is the orientation itself: no further than the sensor's part and the limit.

        Nor behind the sensor's fold, half way to the other solution: the part may cover that one
        now, and shrink while the truth stays there.
        """
        fold = 0.5 * self._folds.distance(sensor)
        turn = min(self._parts[sensor], self._alert_limit, fold)
        return is_within(place.quaternion, here.quaternion, turn)

    def _lose(self, sensor: int, place: Place) -> None:
        """
        Count the hypothesis of a sensor as lost, from a place of the platform on.

        With more than `MOST_PLACES` for one sensor, they are replaced by one: anywhere.
        """
        lost = [rival for rival in self._rivals if rival.sensor == sensor and not rival.found]
        places = [rival.place for rival in lost]
        if None in places or place in places:
            return
        if len(places) < MOST_PLACES:
            self._rivals.append(Rival(sensor, place))
            return
        self._rivals = [rival for rival in self._rivals if rival not in lost]
        self._rivals.append(Rival(sensor, None))

    def _note_gap(self, sample: Sample) -> None:
        """After a gap a rival may be any solution in reach of where it was."""
        if sample.follows(self._followed):
            return
        for rival, place in self._found():
            rival.place = Place(self._followed, place.quaternion)
            rival.found = False
            rival.computed_at = None

    # Finding them -------------------------------------------------------------------------------

    def _waiting(self, here: Place) -> list[Rival]:
        """
        Return the lost rivals to be found now: not again before the platform has moved.

        Where no fault of a sensor is detected its rivals wait.
        """
        return [
            rival
            for rival in self._rivals
            if not rival.found and self._parts[rival.sensor] < inf and not rival.is_current(here)
        ]

    def _find_recent(self, sample: Sample, here: Place) -> None:
        """
        Find each rival that was lost shortly before: the solution next to its place.

        And those behind a fold, on both sides along the turn that a fault of the sensor makes.
        """
        for rival in self._waiting(here):
            place = rival.place
            if place is None or not sample.follows(place.stamp):
                continue
            starts = self._beyond_fold(rival.sensor)
            found = self._search.recent(sample, rival.sensor, place, here, starts)
            if found is not None:
                self._rivals.remove(rival)
                for solution in found:
                    self._add(replace(rival), sample, here, solution)

    def _beyond_fold(self, sensor: int) -> list[Quaternion[float]]:
        """Return starts from which Gauss-Newton leads to where the truth may be behind a fold."""
        used = self._sensors.used
        if used.estimate is None or not self._may_cross(sensor):
            return []
        apart = min(self._apart, self._folds.distance(sensor))
        starts: list[Quaternion[float]] = []
        for share in OVER_FOLD:
            starts += used.solver.turned_by_fault(used.estimate, sensor, share * apart)
        return starts

    def _find_in_all(self, sample: Sample, here: Place) -> None:
        """
        Find what else is lost, of one sensor a sample, in all solutions of the others.

        They take tens of estimates. The other sensors wait, with an infinite part.
        """
        waiting = self._waiting(here)
        if not waiting:
            return
        sensor = waiting[0].sensor
        solutions = self._search.every(sample, sensor)
        for rival in waiting:
            if rival.sensor == sensor:
                self._find_among(solutions, rival, sample, here)

    def _find_among(
        self,
        solutions: list[SampleEstimate],
        rival: Rival,
        sample: Sample,
        here: Place,
    ) -> None:
        """
        Add the solutions in reach of a lost rival; it is over once that is certain.

        One that had been found is over with a solution, or after `MISSES` places of the platform.
        Any other is searched for in one sample after another, see `_tries`.
        """
        reached = self._search.reached(sample, rival.place, solutions)
        rival.misses += 1
        if rival.born:
            rival.computed_at = here.quaternion
            is_over = bool(reached) or rival.misses >= MISSES
        else:
            is_over = rival.misses >= self._tries(rival, sample)
        if is_over:
            self._rivals.remove(rival)
        for solution in reached:
            self._add(replace(rival), sample, here, solution)

    def _tries(self, rival: Rival, sample: Sample) -> int:
        """
        Return in how many samples a hypothesis that was never found is searched for.

        Where two solutions of three sensors nearly meet, noise makes them a complex pair in some
        samples. The best fit of more sensors is there with noise as well. Within `NEAR_REACH` a
        solution that is not found next to its place has met another one, which the part of the
        sensor allows for.
        """
        place = rival.place
        if self._sensors.used.parity_count > 1:
            return 1
        is_near = place is not None and self._search.reach(sample, place) <= NEAR_REACH
        return 1 if is_near else MISSES

    def _add(
        self,
        rival: Rival,
        sample: Sample,
        here: Place,
        solution: SampleEstimate,
    ) -> None:
        """Add a solution as a rival unless it is the orientation itself, or is contradicted."""
        if self._ends_at(rival, sample, here, solution):
            return
        rival.found = True
        rival.misses = 0
        rival.born = rival.born or here.stamp
        same = self._found_before(rival, solution)
        if same is None:
            self._rivals.append(rival)
        else:
            same.offset = same.offset.joined(rival.offset)
            same.stuck = same.stuck.joined(rival.stuck)

    def _found_before(self, rival: Rival, solution: SampleEstimate) -> Rival | None:
        """Return the found rival of the same sensor at a solution, but for noise; else None."""
        turn = TURN_DEVIATIONS * solution.total_deviation
        for other, place in self._found():
            if other.sensor != rival.sensor:
                continue
            if is_within(place.quaternion, solution.quaternion, turn):
                return other
        return None

    def _ends_at(
        self,
        rival: Rival,
        sample: Sample,
        here: Place,
        solution: SampleEstimate,
    ) -> bool:
        """
        Move a rival to a solution; return whether it is over there.

        It is over if no constant fault of its sensor explains all samples, or if the solution is
        the orientation itself.
        """
        rival.place = Place(sample.stamp, solution.quaternion)
        rival.computed_at = here.quaternion
        rival.healthy = integrity(solution, sample.bias, sample.factors).healthy
        self._narrow(rival, sample, solution)
        return rival.is_contradicted or self._is_same(rival.sensor, rival.place, here)

    def _narrow(self, rival: Rival, sample: Sample, solution: SampleEstimate) -> None:
        """
        Narrow the faults of the sensor that would explain a rival at a solution.

        The others imply an angle of the sensor there. Its reading less that angle is the fault
        now, to the noise and bias of all: a constant offset has to be there each time. A stuck
        sensor has a constant reading instead. As the platform turns, the implied fault of a wrong
        rival changes, and a reading that is not stuck does.
        """
        sensor = rival.sensor
        used = self._sensors.used
        try:
            fault = used.solver.implied_fault(solution, sensor, sample)
        except SpmError:
            # At the edge of a leg's reach any fault explains it.
            rival.least_step = 0.0
            return
        deviations = used.threshold * max(sample.factors)
        margin = deviations * fault.deviation + fault.bias
        rival.offset = rival.offset.narrowed(fault.fault, margin)
        step = abs(remainder(fault.fault, 2.0 * pi))
        rival.least_step = max(step - margin, 0.0)
        sigma = solution.sensors.sigma[sensor]
        rival.stuck = rival.stuck.narrowed(sample.angles[sensor], deviations * sigma)

    def _track(self, sample: Sample, here: Place) -> None:
        """Let the rivals follow the motion; those that it contradicts are over."""
        for rival, place in self._found():
            if rival.is_current(here):
                continue
            solution = self._search.next_to(sample, rival.sensor, place)
            if solution is None:
                rival.found = False
            elif self._ends_at(rival, sample, here, solution):
                self._rivals.remove(rival)
