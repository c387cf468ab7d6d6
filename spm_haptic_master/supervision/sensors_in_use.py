# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which of the mounted sensors are in use: not one without a reading, or that is not trusted."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from math import inf

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import FOUR, Limits, THREE
from spm_haptic_master.supervision.sensor_set import Angles, Sample, SensorSet, Solver
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld

# Consecutive samples without a reading that are a missing sensor; fewer are lost frames.
MISSING_SAMPLES = 3


@dataclass(slots=True)
class Distrust:
    """Why a sensor with a reading is not in use: a word of `state`, and its time to agree."""

    word: str
    time: float  # s, of agreement with the others after which it is used again
    agreed: float = 0.0  # s, for which it has agreed


class SensorsInUse:
    """
    The sensors in use and those left out, by their places in ALL_JOINT_NAMES.

    `used` are those in use for this sample, those before if fewer than three are left; `missing`
    have no reading in it, `left_out` are not in use for it, and `distrusted` are so for longer
    than a lost frame. `words` have what is wrong with each of these.
    """

    def __init__(self, solver: Solver, sigma: tuple[float, ...], limits: Limits) -> None:
        self._make, self._limits = partial(SensorSet, solver, sigma, limits), limits
        self._sets: dict[tuple[int, ...], SensorSet] = {}
        # Consecutive samples without a reading, by place.
        self._gone = [0] * len(sigma)
        self.missing: tuple[int, ...] = ()
        self.distrusted: dict[int, Distrust] = {}
        self.used = self._sets[()] = self._make()
        self._update()

    def restart(self) -> None:
        """Forget the samples of every set."""
        for each in self._sets.values():
            each.restart()

    def without(self, *left_out: int) -> SensorSet:
        """Return the set without some sensors: three are left at least."""
        key = tuple(sorted(set(left_out)))
        if key not in self._sets:
            self._sets[key] = self._make(key)
        return self._sets[key]

    def _update(self) -> None:
        self.left_out = tuple(sorted({*self.missing, *self.distrusted}))
        if len(self._gone) - len(self.left_out) >= THREE:
            self.used = self.without(*self.left_out)
        self.words = ', '.join(
            f'{ALL_JOINT_NAMES[place]} {self.distrusted[place].word}'
            for place in sorted(self.distrusted)
        )

    def note(self, angles: Angles) -> Symptom | None:
        """Note which sensors have a reading; return why they do not suffice."""
        if any(angle in (inf, -inf) for angle in angles):
            return withheld(Reason.NOT_FINITE, f'{list(angles)} rad')
        missing = self.missing = tuple(
            place for place, angle in enumerate(angles) if angle != angle
        )
        for place in range(len(angles)):
            self._gone[place] = self._gone[place] + 1 if place in missing else 0
            if self._gone[place] != MISSING_SAMPLES:
                continue
            if place in self.distrusted:
                self.distrusted[place].agreed = 0.0
            elif len(angles) - len({*missing, *self.distrusted}) >= FOUR:
                self.distrusted[place] = Distrust(Reason.MISSING.value, self._limits.window)
        self._update()
        if len(angles) - len(missing) < FOUR or len(angles) - len(self.left_out) < min(
            FOUR, self._limits.fewest_sensors
        ):
            return withheld(Reason.MISSING, f'{list(angles)} rad', *missing[:1])
        return None

    def exclude(self, sensor: int) -> None:
        """Leave a faulty sensor out."""
        self.distrusted[sensor] = Distrust('excluded', self._limits.recovery)
        self._update()

    def readmit(self, sample: Sample, dt: float, alert_limit: float, bad: bool) -> None:
        """
        Use a sensor again once it has agreed with the others for its time; `dt` is s.

        Its part of the level has to be within the alert limit, rad; `bad` others agree with none.
        """
        for sensor in [each for each in self.distrusted if each not in self.missing]:
            trial, distrust = self.without(*{*self.left_out} - {sensor}), self.distrusted[sensor]
            agrees = (
                not bad
                and trial.take(sample) is None
                and trial.worth is not None
                and trial.levels(trial.worth)[sensor] <= alert_limit
                and ((noisy := trial.too_noisy(sample)) is None or noisy.sensor != sensor)
            )
            distrust.agreed = distrust.agreed + dt if agrees else 0.0
            if distrust.agreed >= distrust.time:
                del self.distrusted[sensor]
        self._update()
