# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which of the mounted sensors are in use: those with a reading that are trusted.

Another set of sensors takes over by a trial: it has to agree in every sample for its time. So a
faulty sensor is left out, one that was faulty is used again, or one replaces the other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from math import isnan, nan

from spm_haptic_master.kinematics.checks import LARGEST_ANGLE
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import FOUR_SENSORS, Limits, THREE_SENSORS
from spm_haptic_master.supervision.sample import Angles, Place, Sample
from spm_haptic_master.supervision.sensor_set import SensorSet
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld
from spm_haptic_master.supervision.trial import Trial

# Consecutive samples without a reading that are a missing sensor; fewer are lost frames.
MISSING_SAMPLES = 3
# Indices of the mounted sensors that a set leaves out, in ascending order.
LeftOut = tuple[int, ...]


@dataclass(slots=True)
class Distrust:
    """
    Why a sensor is not in use, and its trial with those in use.

    Attributes
    ----------
    word : str
        Word of `state`: missing or excluded.
    time : float
        Time of agreement with the others after which it is used again, s.
    trial : Trial or None
        Of the sensors in use and this one; None while they do not agree, or do not check it.

    """

    word: str
    time: float
    trial: Trial | None = None


class SensorsInUse:
    """
    The sensors in use and those left out, by their indices in ALL_JOINT_NAMES.

    Parameters
    ----------
    solver : Solver
        Orientations of a sample.
    sigma : tuple of float, length N
        Standard deviations of the mounted sensors, rad.
    limits : Limits
        Fewest sensors that go on, window and recovery.

    Attributes
    ----------
    used : SensorSet
        The set of those in use for the latest sample; the set before if fewer than three are left.
    missing : tuple of int
        Sensors without a reading in the latest sample.
    left_out : tuple of int
        Sensors not in use for it: missing or distrusted.
    distrusted : dict of int to Distrust
        Sensors left out for longer than a lost frame.
    words : str
        What is wrong with each distrusted sensor, in the words of `state`; empty without any.

    """

    def __init__(
        self,
        solver: Solver,
        sigma: tuple[float, ...],
        limits: Limits,
    ) -> None:
        self._make_set = partial(SensorSet, solver, sigma, limits)
        self._limits = limits
        self._sets: dict[LeftOut, SensorSet] = {}
        self._mounted = len(sigma)
        # Consecutive samples without a reading, by sensor.
        self._gaps = [0] * self._mounted
        self.missing: LeftOut = ()
        self.distrusted: dict[int, Distrust] = {}
        # Trials of the sets that may replace those in use, by what they leave out; none while the
        # sensors in use agree.
        self._trials: dict[LeftOut, Trial] = {}
        self.used = self._sets[()] = self._make_set()
        self._update()

    def restart(self) -> None:
        """Forget the samples of every set."""
        for sensor_set in self._sets.values():
            sensor_set.restart()
        self.end_trials()
        for distrust in self.distrusted.values():
            distrust.trial = None

    def without(self, *left_out: int) -> SensorSet:
        """Return the set without some sensors: three are left at least."""
        key = tuple(sorted(set(left_out)))
        if key not in self._sets:
            self._sets[key] = self._make_set(key)
        return self._sets[key]

    def one_less(self, sensor: int) -> SensorSet | None:
        """Return the sensors in use but one; None if fewer than three are left."""
        left_out = {sensor, *self.left_out}
        if self._mounted - len(left_out) < THREE_SENSORS:
            return None
        return self.without(*left_out)

    def _update(self) -> None:
        """Derive the sensors in use and the words from what is missing and distrusted."""
        self.left_out = tuple(sorted({*self.missing, *self.distrusted}))
        if self._mounted - len(self.left_out) >= THREE_SENSORS:
            self.used = self.without(*self.left_out)
        self.words = ', '.join(
            f'{ALL_JOINT_NAMES[sensor]} {self.distrusted[sensor].word}'
            for sensor in sorted(self.distrusted)
        )

    def note_readings(self, angles: Angles) -> Symptom | None:
        """
        Note which sensors have a reading, rad; return why they do not suffice, or None.

        A sensor without a reading for `MISSING_SAMPLES` is distrusted if four others are left.
        """
        if not self.missing and not isnan(sum(angles)):
            return self._too_few(angles)
        self.missing = tuple(sensor for sensor, angle in enumerate(angles) if isnan(angle))
        for sensor in range(self._mounted):
            self._gaps[sensor] = self._gaps[sensor] + 1 if sensor in self.missing else 0
            if self._gaps[sensor] == MISSING_SAMPLES:
                self._distrust_missing(sensor)
        self._update()
        return self._too_few(angles)

    def _too_few(self, angles: Angles) -> Symptom | None:
        """Return why the sensors in use do not suffice."""
        read = len(angles) - len(self.missing)
        used = len(angles) - len(self.left_out)
        if read >= FOUR_SENSORS and used >= min(FOUR_SENSORS, self._limits.fewest_sensors):
            return None
        first = self.missing[0] if self.missing else None
        return withheld(Reason.MISSING, f'{list(angles)} rad', first)

    def _distrust_missing(self, sensor: int) -> None:
        """Distrust a sensor without readings if four are left; end its trial."""
        not_used = {*self.missing, *self.distrusted}
        if sensor in self.distrusted:
            self.distrusted[sensor].trial = None
        elif self._mounted - len(not_used) >= FOUR_SENSORS:
            self.distrusted[sensor] = Distrust(Reason.MISSING.value, self._limits.window)

    # Trials --------------------------------------------------------------------------------------

    def try_others(
        self,
        sample: Sample,
        place_without: Callable[[int], Place | None],
    ) -> None:
        """
        Have every set that may replace the sensors in use follow a sample.

        Parameters
        ----------
        sample : Sample
            A sample with which the sensors in use do not agree, or a fault is not over.
        place_without : callable
            Returns, for a sensor, where the platform was last if that sensor is wrong; None if
            that is not known.

        """
        for left_out in self._alternatives():
            if not set(self.missing) <= set(left_out):
                continue
            if left_out not in self._trials:
                self._trials[left_out] = self._trial_without(left_out, sample, place_without)
            self._trials[left_out].follow(sample, self._limits.joint_speed)

    def _trial_without(
        self,
        left_out: LeftOut,
        sample: Sample,
        place_without: Callable[[int], Place | None],
    ) -> Trial:
        """
        Return a trial of the sensors that are not left out.

        If these are those in use but one, they agreed before, as those in use did.
        """
        (sensor,) = set(left_out) - set(self.distrusted)
        place = place_without(sensor)
        is_one_less = set(self.distrusted) <= set(left_out)
        since = None
        if is_one_less and place is not None and sample.follows(place.stamp):
            since = place.stamp
        return Trial(self.without(*left_out), place, since)

    @property
    def is_trying(self) -> bool:
        """Whether sets are on trial that may replace the sensors in use."""
        return bool(self._trials)

    def end_trials(self) -> None:
        """End the trials of the sets that may replace the sensors in use, because these agree."""
        self._trials.clear()

    def _alternatives(self) -> Iterator[LeftOut]:
        """Yield what else may be left out: one more, or one in place of another."""
        distrusted = set(self.distrusted)
        trusted = [sensor for sensor in range(self._mounted) if sensor not in distrusted]
        for sensor in trusted:
            if len(trusted) > THREE_SENSORS:
                yield tuple(sorted({*distrusted, sensor}))
            for back in distrusted:
                yield tuple(sorted({*distrusted, sensor} - {back}))

    def places_on_trial(self) -> dict[int, Place]:
        """
        Return where the platform is if a sensor is wrong, as its trial followed it.

        By sensor in use; only of those with a trial of the others that has a place.
        """
        if not self._trials:
            return {}
        return {
            sensor: trial.place for sensor, trial in self._without_one() if trial.place is not None
        }

    def passing(self, stamp: int, onset: int) -> list[int]:
        """Return the sensors without which the others pass their trial; see `Trial.passes`."""
        return [
            sensor
            for sensor, trial in self._without_one()
            if trial.passes(stamp, onset, self._limits.window)
        ]

    def standing(self, stamp: int, onset: int) -> list[int]:
        """Return the sensors that may be the faulty one: passing, or not contradicted yet."""
        return [
            sensor
            for sensor, trial in self._without_one()
            if not trial.has_failed or trial.passes(stamp, onset, self._limits.window)
        ]

    def _without_one(self) -> Iterator[tuple[int, Trial]]:
        """Yield each sensor in use with the trial of the others, if there is one."""
        for sensor in self.used.members:
            trial = self._trials.get(tuple(sorted({*self.distrusted, sensor})))
            if trial is not None:
                yield sensor, trial

    @property
    def are_trials_conclusive(self) -> bool:
        """
        Whether the trial without each sensor in use can show that the others agree.

        Of three others it cannot if the sensor may have drifted while it was hidden. It can if the
        sensor has a rival: it was wrong at the start or after a gap already, or is not.
        """
        return all(trial.is_conclusive for _, trial in self._without_one())

    def exclude(self, sensor: int) -> None:
        """Leave a faulty sensor out."""
        self.distrusted[sensor] = Distrust('excluded', self._limits.recovery)
        self.end_trials()
        self._update()

    def exchange(self, stamp: int) -> bool:
        """
        Leave a faulty sensor out, and use another one again; return whether one set passed.

        It is the only one that has agreed for as long as the other sensor's return takes.
        """
        passed = []
        for left_out, trial in self._trials.items():
            for sensor in set(self.distrusted) - set(left_out):
                if trial.has_agreed_for(stamp, self.distrusted[sensor].time):
                    passed.append((sensor, left_out))
        if len(passed) != 1:
            return False
        sensor, left_out = passed[0]
        faulty = set(left_out) - set(self.distrusted)
        del self.distrusted[sensor]
        self.exclude(*faulty)
        return True

    def readmit(
        self,
        sample: Sample,
        here: Place,
        alert_limit: float,
        has_returned: Callable[[int], bool],
    ) -> Symptom | None:
        """
        Use a sensor again once it has agreed with those in use for its time.

        Parameters
        ----------
        sample : Sample
            A sample with which those in use agree.
        here : Place
            Their orientation.
        alert_limit : float
            Largest part of the level with which the others check the sensor, rad.
        has_returned : callable
            Whether a sensor is back on the motion that it left.

        Returns
        -------
        Symptom or None
            INCONSISTENT if a sensor had come back, by its agreement or by its own motion, and
            disagrees with three others, which nothing else checks: one of them may be faulty.

        """
        symptom = None
        for sensor in sorted(set(self.distrusted) - set(self.missing)):
            distrust = self.distrusted[sensor]
            trial = distrust.trial or self._trial_with(sensor, here)
            distrust.trial = trial
            is_back = trial.has_agreed_for(sample.stamp, self._limits.window) or has_returned(
                sensor
            )
            # It continues the orientation of those in use, whatever its own was.
            trial.place = here
            agrees = trial.follow(sample, self._limits.joint_speed)
            if is_back and not agrees and not self.used.parity_count:
                symptom = Symptom(
                    Reason.INCONSISTENT,
                    f'{ALL_JOINT_NAMES[sensor]} had come back, and does not agree',
                    severity=Severity.LATCH,
                )
            if not agrees or not _is_checked(trial.sensor_set, sensor, sample, alert_limit):
                distrust.trial = None
            elif trial.has_agreed_for(sample.stamp, distrust.time):
                del self.distrusted[sensor]
        self._update()
        return symptom

    def _trial_with(self, sensor: int, here: Place) -> Trial:
        """Return a trial, from an orientation on, of those in use and one left-out sensor."""
        left_out = set(self.left_out) - {sensor}
        return Trial(self.without(*left_out), here, None)


def _is_checked(trial_set: SensorSet, sensor: int, sample: Sample, alert_limit: float) -> bool:
    """Whether the others of a set check a sensor, to a limit in rad, and it is not too noisy."""
    if trial_set.worth is None or trial_set.parts(trial_set.worth)[sensor] > alert_limit:
        return False
    noisy = trial_set.too_noisy(sample)
    return noisy is None or noisy.sensor != sensor


def plausible(angles: Angles) -> Angles:
    """
    Return readings, rad, with NaN for each beyond `LARGEST_ANGLE`, which no joint has.

    The same tuple if there is none.
    """
    for angle in angles:
        # NaN, a sensor without a reading, is not larger.
        if abs(angle) > LARGEST_ANGLE:
            return tuple([angle if abs(angle) <= LARGEST_ANGLE else nan for angle in angles])
    return angles
