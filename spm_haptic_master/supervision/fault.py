# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bad samples that are a fault: what latches it, what it is, and what clears it."""

from __future__ import annotations

from collections.abc import Callable, Collection

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.isolation import Isolation
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.sensor_set import Sample, SensorSet
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

# Consecutive bad samples that latch a fault; a shorter run only withholds them.
FAULT_SAMPLES = 3
# Runs of bad samples that are a series, and consistent samples that end it.
SERIES_RUNS, SERIES_END = 3, 100

# Reasons that blame no sensor.
UNBLAMED = frozenset((Reason.NO_FIT, Reason.UNPROTECTED, Reason.UNDETERMINED))
# Symptoms that name no sensor themselves.
UNNAMED = frozenset((Reason.INCONSISTENT, Reason.DRIFTED, Reason.NO_FIT, Reason.DISCONTINUOUS))
# Sensors that jumped and may cancel in one parity.
PAIR = 2


class Fault:
    """
    A latched fault, until it is cleared.

    `jumped` are the sensors that left their motion; two of them may cancel where there is one
    parity. `by_jump`: the sensor is isolated because it alone left its motion.
    """

    def __init__(self, symptom: Symptom, jumped: Collection[int], cancels: bool,
                 by_jump: bool = False) -> None:
        if by_jump and symptom.reason in UNNAMED:
            symptom = symptom._replace(reason=Reason.JUMPED)
        self.symptom = symptom
        self._jumped = set(jumped)
        # Whether it began so: a glitch in another fault does not explain that.
        self._any_jumped = bool(jumped)
        self._cancels = cancels
        self._consistent = 0.0

    @property
    def waits(self) -> bool:
        """Whether only a person may clear it: two sensors jumped, stay, and may cancel."""
        return self._cancels and len(self._jumped) >= PAIR

    @property
    def words(self) -> str:
        """Return the fault in the words of `state`."""
        if self.waits:
            names = ' and '.join(ALL_JOINT_NAMES[sensor] for sensor in sorted(self._jumped))
            return f'{names} jumped, to be acknowledged'
        symptom = self.symptom
        if symptom.sensor is None and symptom.reason not in UNBLAMED:
            return f'{symptom.words}, sensor undetermined'
        return symptom.words

    def acknowledge(self) -> None:
        """Let consistency clear it."""
        self._jumped.clear()
        self._any_jumped = False

    def widen(self, jumped: Collection[int], named: Collection[int | None],
              isolated: int | None = None) -> None:
        """
        Add a further bad sample: sensors that left their motion, and those that it names.

        Every sensor is suspected where it names another one, until one is isolated.
        """
        self._consistent = 0.0
        self._jumped.update(jumped)
        sensor = self.symptom.sensor
        if sensor is not None and any(each not in (None, sensor) for each in named):
            sensor = None
        self.symptom = self.symptom._replace(sensor=isolated if sensor is None else sensor)

    def clears(self, seen: Callable[[int], bool], returned: Callable[[int], bool],
               used: Collection[int], dt: float, recovery: float) -> bool:
        """
        Count a consistent sample, `dt` after the last one (s); return whether the fault is over.

        The samples count for the recovery time (s) while the others see what was wrong, or if all
        that was wrong is that sensors jumped and jumped back. `seen` and `returned` decide that of
        a sensor; `used` are those in use.
        """
        self._jumped = {sensor for sensor in self._jumped if not returned(sensor)}
        if self.waits:
            return False
        suspects = used if self.symptom.sensor is None else (self.symptom.sensor,)
        is_over = self._any_jumped and not self._jumped
        if is_over or all(map(seen, suspects)):
            self._consistent += dt
        return self._consistent >= recovery


class FaultLatch:
    """
    Counts bad samples, and latches a fault.

    Attributes
    ----------
    fault : Fault or None
        The latched fault.
    clean : int
        Consecutive consistent samples.

    """

    def __init__(self, isolation: Isolation, joints: JointMonitors) -> None:
        self._isolation, self._joints = isolation, joints
        self.fault: Fault | None = None
        self.restart()

    def restart(self) -> None:
        """Forget the samples; a fault stays latched."""
        # Consecutive bad samples, and runs of them.
        self._bad = self._runs = self.clean = 0
        self._isolation.restart()

    def end(self) -> None:
        """Clear the fault."""
        self.fault = None
        self._bad = self._runs = 0
        self._isolation.restart()

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

    def note_bad(self, sample: Sample, used: SensorSet, symptoms: list[Symptom]) -> int | None:
        """Count a bad sample, and latch a fault if it lasts; return the faulty sensor if known."""
        worst = max(symptom.severity for symptom in symptoms)
        if worst is Severity.WITHHOLD:
            return None
        alone = self._joints.alone(used.sensors.used)
        if not self._bad and any(symptom.sensor is None for symptom in symptoms):
            self._runs += 1
            if self._runs == 1:
                self._isolation.restart()
        self._bad += 1
        self.clean = 0
        self._isolation.note(used, symptoms, alone)
        lasts = self._bad >= FAULT_SAMPLES or worst is Severity.LATCH
        single = used.entries < 2
        if not lasts and self.fault is None and (single or not self.is_series):
            return None
        # One parity shows a second fault, and not which.
        sensor = None if self.fault is not None and single else self._isolation.faulty(
            used, symptoms, sample)
        left = self._joints.left(used.sensors.used)
        if self.fault is not None:
            self.fault.widen(left, {symptom.sensor for symptom in symptoms}, sensor)
        elif lasts:
            symptom = max(symptoms, key=weight)._replace(sensor=sensor)
            self.fault = Fault(symptom, left, single, sensor in alone)
        return sensor

    def latch_suspected(self, jumps: list[Symptom], single: bool) -> None:
        """
        Latch the jumps that a pause has hidden; `single`: they may cancel in one parity.

        In a series of bad samples a jump is one of many: two programs that publish at once.
        """
        if jumps and self.fault is None and not self.is_series:
            symptom = jumps[0] if len(jumps) == 1 else jumps[0]._replace(sensor=None)
            self.fault = Fault(
                symptom, [jump.sensor for jump in jumps if jump.sensor is not None], single)


def weight(symptom: Symptom) -> tuple[int, bool]:
    """Return what makes one symptom the cause rather than another."""
    return symptom.severity, symptom.sensor is not None
