# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which sensor is faulty: the one without which the others agree.

A fault of sensor i moves the parity vector along column i of P = I - H K. What of a parity vector
is perpendicular to that column, no fault of sensor i explains. With one parity every fault of
every sensor explains it; then the sensor that left its motion alone is the faulty one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from spm_haptic_master.supervision.parity import Parity
from spm_haptic_master.supervision.sensor_set import Sample, SensorSet
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.symptom import Severity, Symptom

# Latest bad samples whose parity vectors are evidence.
EVIDENCE_SAMPLES = 3
# Entries of the parity vector with which the best of several explanations is taken: without the
# sensor, the others still check each other everywhere.
ENOUGH_ENTRIES = 3


class Isolation:
    """Evidence of the latest bad samples, and the sensor that it names."""

    def __init__(self, sensors: SensorsInUse) -> None:
        self._sensors = sensors
        self._vectors: deque[tuple[Parity, float]] = deque(maxlen=EVIDENCE_SAMPLES)
        self._alone: list[int] = []

    def restart(self) -> None:
        """Forget the evidence."""
        self._vectors.clear()
        self._alone = []

    def note(self, used: SensorSet, symptoms: Sequence[Symptom], alone: list[int]) -> None:
        """Add the evidence of a bad sample; `alone` are the sensors that left their motion."""
        if not self._vectors:
            self._alone = alone
        for symptom in symptoms:
            evidence = used.evidence(symptom) if symptom.sensor is None else None
            if evidence is not None:
                self._vectors.append(evidence)

    def faulty(self, used: SensorSet, symptoms: Sequence[Symptom], sample: Sample) -> int | None:
        """Return the place of the faulty sensor; None if the evidence does not isolate one."""
        named = {symptom.sensor for symptom in symptoms
                 if symptom.sensor is not None and symptom.severity > Severity.WITHHOLD}
        if named:
            return named.pop() if len(named) == 1 else None
        if used.entries < 2:
            return self._alone[0] if len(self._alone) == 1 else None
        fitting = []
        for sensor in used.sensors.used:
            others = self._sensors.without(sensor, *self._sensors.left_out)
            if others is not None and others.fits(sample):
                fitting.append(sensor)
        if len(fitting) < 2:
            return fitting[0] if fitting else None
        if not self._vectors:
            return None
        costs = {sensor: [used.unexplained(sensor, vector) / limit
                          for vector, limit in self._vectors] for sensor in fitting}
        explaining = [sensor for sensor in fitting if max(costs[sensor]) <= 1.0]
        if len(explaining) == 1 or (explaining and used.entries >= ENOUGH_ENTRIES):
            return min(explaining, key=lambda sensor: sum(costs[sensor]))
        return None
