# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bad samples that are a fault: what latches it, which sensor it is, and what clears it.

A fault of sensor i moves the parity vector along column i of P = I - H K. What of a parity vector
is perpendicular to that column, no fault of sensor i explains. With one parity every fault of
every sensor explains it; then the sensor that left its motion alone is the faulty one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.parity import Parity
from spm_haptic_master.supervision.sensor_set import Sample
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, worst

# Consecutive bad samples that latch a fault; a shorter run only withholds them.
FAULT_SAMPLES = 3
# Runs of bad samples that are a series, and consistent samples that end it.
SERIES_RUNS, SERIES_END = 3, 100
EVIDENCE_SAMPLES = 3  # latest bad samples whose parity vectors are evidence
# Entries of the parity vector with which the best of several explanations is taken: the others
# check each other everywhere.
ENOUGH_ENTRIES = 3
# Reasons that blame no sensor.
UNBLAMED = frozenset((Reason.NO_FIT, Reason.UNPROTECTED, Reason.UNDETERMINED))


class FaultLatch:
    """
    Counts bad samples, isolates the faulty sensor, and latches a fault until it is cleared.

    `symptom` is that of the latched fault; `clean` the number of consecutive consistent samples;
    `recovery` the time of consistency that clears a fault, s.
    """

    def __init__(self, sensors: SensorsInUse, joints: JointMonitors, recovery: float) -> None:
        self._sensors, self._joints, self._recovery = sensors, joints, recovery
        self._evidence: deque[tuple[Parity, float]] = deque(maxlen=EVIDENCE_SAMPLES)
        self.symptom: Symptom | None = None
        self._jumped: set[int] = set()
        self.restart()

    def restart(self) -> None:
        """Forget the samples; a fault stays latched."""
        self.clean = 0
        self._forget()

    def _forget(self) -> None:
        # Consecutive bad samples, runs of them, and the sensors off their motion in the first.
        self._bad = self._runs = 0
        self._alone: list[int] = []
        self._evidence.clear()

    def latch(self, symptom: Symptom, jumped: Collection[int] = ()) -> None:
        """Latch a fault; `jumped` are the sensors that left their motion."""
        self.symptom, self._jumped = symptom, set(jumped)
        # Whether it began so: a glitch in another fault does not explain that.
        self._began_by_jump, self._consistent = bool(jumped), 0.0
        # Two sensors may cancel in one parity.
        self._cancels = self._sensors.used.entries < 2

    @property
    def waits(self) -> bool:
        """Whether only a person may clear it: two sensors jumped, stay, and may cancel."""
        return self.symptom is not None and self._cancels and len(self._jumped) > 1

    @property
    def words(self) -> str:
        """Return the fault in the words of `state`; empty without one."""
        symptom = self.symptom
        if symptom is None:
            return ''
        if self.waits:
            names = ' and '.join(ALL_JOINT_NAMES[sensor] for sensor in sorted(self._jumped))
            return f'{names} jumped, to be acknowledged'
        known = symptom.sensor is not None or symptom.reason in UNBLAMED
        return symptom.words + ('' if known else ', sensor undetermined')

    def acknowledge(self) -> bool:
        """Let consistency clear a fault that waits for a person; return whether it did."""
        if not self.waits:
            return False
        self._jumped.clear()
        self._began_by_jump = False
        return True

    def widen(
        self,
        fault: Symptom,
        jumped: Collection[int],
        named: Collection[int | None],
        sensor: int | None = None,
    ) -> None:
        """Add a bad sample; if it names another sensor, all are suspects until one is isolated."""
        self._consistent = 0.0
        self._jumped.update(jumped)
        if fault.sensor is not None and all(each in (None, fault.sensor) for each in named):
            sensor = fault.sensor
        self.symptom = fault._replace(sensor=sensor)

    def clears(self, seen: Callable[[int], bool], dt: float) -> bool:
        """
        Count a consistent sample, `dt` after the last one (s); return whether the fault is over.

        It counts while the others see what was wrong, or if all sensors that jumped are back.
        """
        self._jumped = {each for each in self._jumped if not self._joints.returned(each)}
        if self.waits or self.symptom is None:
            return False
        sensor = self.symptom.sensor
        suspects = self._sensors.used.sensors.used if sensor is None else (sensor,)
        if (self._began_by_jump and not self._jumped) or all(map(seen, suspects)):
            self._consistent += dt
        return self._consistent >= self._recovery

    def end(self) -> None:
        """Clear the fault."""
        self.symptom = None
        self._forget()

    def note_consistent(self) -> None:
        """Count a consistent sample."""
        self._bad = 0
        self.clean += 1
        if self.clean > SERIES_END:
            self._runs = 0

    @property
    def is_series(self) -> bool:
        """Whether bad samples come again and again."""
        return self._runs >= SERIES_RUNS

    def note_bad(self, sample: Sample, symptoms: list[Symptom]) -> int | None:
        """Count a bad sample, and latch a fault if it lasts; return the faulty sensor if known."""
        used, cause = self._sensors.used, worst(symptoms)
        if cause.severity is Severity.WITHHOLD:
            return None
        if not self._bad and any(symptom.sensor is None for symptom in symptoms):
            if not self._runs:
                self._forget()
            self._runs += 1
        self._bad += 1
        self.clean = 0
        alone = self._joints.alone(used.sensors.used)
        if not self._evidence:
            self._alone = alone
        for symptom in symptoms:
            evidence = used.evidence(symptom) if symptom.sensor is None else None
            if evidence is not None:
                self._evidence.append(evidence)
        fault, lasts = self.symptom, self._bad >= FAULT_SAMPLES or cause.severity is Severity.LATCH
        if not lasts and fault is None and (used.entries < 2 or not self.is_series):
            return None
        # One parity shows a second fault, and not which.
        sensor = (
            None if fault is not None and used.entries < 2 else self._isolated(sample, symptoms)
        )
        left = self._joints.left(used.sensors.used)
        if fault is not None:
            self.widen(fault, left, {symptom.sensor for symptom in symptoms}, sensor)
        elif lasts:
            reason = Reason.JUMPED if cause.sensor is None and sensor in alone else cause.reason
            self.latch(cause._replace(reason=reason, sensor=sensor), left)
        return sensor

    def _isolated(self, sample: Sample, symptoms: list[Symptom]) -> int | None:
        """Return the faulty sensor; None if the evidence does not isolate one."""
        named = {
            symptom.sensor
            for symptom in symptoms
            if symptom.sensor is not None and symptom.severity > Severity.WITHHOLD
        }
        if named:
            return named.pop() if len(named) == 1 else None
        sensors, used = self._sensors, self._sensors.used
        if used.entries < 2:
            return self._alone[0] if len(self._alone) == 1 else None
        fitting = [
            sensor
            for sensor in used.sensors.used
            if sensors.without(sensor, *sensors.left_out).fits(sample)
        ]
        if len(fitting) < 2 or not self._evidence:
            return fitting[0] if len(fitting) == 1 else None
        costs = {
            sensor: [used.unexplained(sensor, vector) / limit for vector, limit in self._evidence]
            for sensor in fitting
        }
        explaining = [sensor for sensor in fitting if max(costs[sensor]) <= 1.0]
        if len(explaining) == 1 or (explaining and used.entries >= ENOUGH_ENTRIES):
            return min(explaining, key=lambda sensor: sum(costs[sensor]))
        return None

    def latch_suspected(self, jumps: list[Symptom]) -> None:
        """Latch jumps that a pause has hidden; in a series of bad samples they are no evidence."""
        if jumps and self.symptom is None and not self.is_series:
            self.latch(
                jumps[0] if len(jumps) == 1 else jumps[0]._replace(sensor=None),
                self._joints.left(self._sensors.used.sensors.used),
            )
