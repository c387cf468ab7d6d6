# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Bad samples that are a fault: what latches it, which sensor it is, and what ends it.

A fault ends once all sensors in use have agreed for the recovery, and the others have checked each
suspect once since the last bad sample: the isolated sensor, or every one. A rival from before the
fault does not count in these checks: it is declared, as it was.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import NamedTuple

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.sample import Sample
from spm_haptic_master.supervision.sample_clock import RESTART_GAP
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.symptom import (
    how_to_check,
    Reason,
    Severity,
    Symptom,
    worst,
)

# Bad samples in a row that latch a fault; a shorter run only withholds them. Samples that suspect
# no sensor may lie between two of them, for so long (ns): motion from before a longer gap is of no
# use.
FAULT_SAMPLES = 3
RUN_GAP = round(RESTART_GAP * 1e9)
# Runs of bad samples that are a series, and consistent samples that end it.
SERIES_RUNS = 3
SERIES_END = 100
# Reasons that blame no sensor.
UNBLAMED = frozenset((Reason.NO_FIT, Reason.UNPROTECTED, Reason.UNDETERMINED))
# Reasons that the jump of a sensor explains.
OF_A_JUMP = frozenset(
    (
        Reason.JUMPED,
        Reason.INCONSISTENT,
        Reason.NO_FIT,
        Reason.DISCONTINUOUS,
        Reason.OUT_OF_RANGE,
    )
)


class Acknowledgement(NamedTuple):
    """
    What an acknowledgement did, in words; empty where there is nothing to say.

    Attributes
    ----------
    ended : str
        What it ended.
    waits : str
        What the fault still waits for.

    """

    ended: str = ''
    waits: str = ''


@dataclass(slots=True)
class Fault:
    """
    A latched fault.

    Attributes
    ----------
    symptom : Symptom
        Its reason, and the faulty sensor if that is isolated.
    last_bad : int
        Stamp of its latest bad sample, ns.
    is_single_parity : bool
        Whether two sensors may cancel in the parity, as it has one entry at most.
    jumped : dict of int to int
        Sensors that left their motion, with the number of the departure.
    agreed_from : int or None
        Stamp of the first of the latest consistent samples in a row, ns; None before. A sample
        that suspects no sensor ends the row as well.
    acknowledged : int or None
        `last_bad` when a person ended the wait for checks of the suspects, ns; None before.
    waiting : tuple of int
        Suspects whose check was all that it waited for after its latest recovery; empty before,
        and after a bad sample. One that is only withheld begins the recovery again and leaves
        them, so that `state` goes on saying how to move.

    """

    symptom: Symptom
    last_bad: int
    is_single_parity: bool
    jumped: dict[int, int] = field(default_factory=dict)
    agreed_from: int | None = None
    acknowledged: int | None = None
    waiting: tuple[int, ...] = ()

    @property
    def is_acknowledged(self) -> bool:
        """Whether a person ended the wait for checks, and no bad sample came since."""
        return self.acknowledged == self.last_bad

    @property
    def needs_person(self) -> bool:
        """
        Whether only a person may clear it: two sensors jumped and did not come back.

        Their errors may cancel in a single parity, so that agreement shows nothing.
        """
        return self.is_single_parity and len(self.jumped) > 1

    @property
    def words(self) -> str:
        """Return the fault in the words of `state`."""
        if self.needs_person:
            return f'{_names(self.jumped)} jumped, to be acknowledged'
        symptom = self.symptom
        known = symptom.sensor is not None or symptom.reason in UNBLAMED
        words = symptom.words + ('' if known else ', sensor undetermined')
        if not self.waiting:
            return words
        return (
            f'{words}; waits until checked: {_names(self.waiting)}; {how_to_check(self.waiting)}'
        )


def _explains(jumped: Collection[int], symptoms: list[Symptom]) -> bool:
    """
    Whether jumps of sensors that left their motion alone explain all symptoms of a sample.

    They explain neither a symptom of another sensor nor a drift, which takes many samples.
    """
    return bool(jumped) and all(
        symptom.severity is Severity.WITHHOLD
        or (symptom.reason in OF_A_JUMP and symptom.sensor in (None, *jumped))
        for symptom in symptoms
    )


def _names(sensors: Collection[int]) -> str:
    return ' and '.join(ALL_JOINT_NAMES[sensor] for sensor in sorted(sensors))


class FaultLatch:
    """
    Counts bad samples, isolates the faulty sensor, and latches a fault until it is over.

    Parameters
    ----------
    sensors : SensorsInUse
        Has the trials of the sets that may take over.
    joints : JointMonitors
        Has the joints that left their motion.
    recovery : float
        Time of consistency that clears a fault, s.

    Attributes
    ----------
    fault : Fault or None
        The latched one.
    consistent : int
        Consistent samples since the latest bad one; those that are only withheld do not count.
    latest_cause : Symptom or None
        Cause of the latest bad sample since a restart; None before.
    onset : int
        Stamp of the first bad sample of the latest run without a fault, ns; 0 before. While a
        fault is latched, that of the run with which it began.

    """

    def __init__(self, sensors: SensorsInUse, joints: JointMonitors, recovery: float) -> None:
        self._sensors = sensors
        self._joints = joints
        self._recovery = recovery
        self.fault: Fault | None = None
        self.onset = 0
        # Stamps (ns): the latest bad sample, and the latest that no jump explains.
        self._last_bad = self._unexplained = 0
        self.restart()

    def restart(self) -> None:
        """Forget the samples; a fault stays latched."""
        self.consistent = 0
        self.latest_cause: Symptom | None = None
        # Bad samples in a row, and runs of them without `SERIES_END` consistent samples between.
        self._bad = self._runs = 0
        # Sensors that left their motion, all others on theirs, when the latest run began.
        self._alone: list[int] = []
        if self.fault is not None:
            self.fault.agreed_from = None

    @property
    def words(self) -> str:
        """Return the fault in the words of `state`; empty without one."""
        return '' if self.fault is None else self.fault.words

    def latch(
        self,
        stamp: int,
        symptom: Symptom,
        jumped: Collection[int] = (),
    ) -> None:
        """Latch a fault at a stamp, ns; `jumped` are the sensors that left their motion."""
        self.fault = Fault(
            symptom,
            stamp,
            is_single_parity=self._sensors.used.parity_count < 2,
            jumped={sensor: self._joints.departure(sensor) for sensor in jumped},
        )
        if not jumped:
            self._unexplained = stamp

    def acknowledge(self) -> Acknowledgement:
        """
        Let a person end what only he can: first two jumps, then the wait for checks.

        Consistent samples are needed in any case.
        """
        fault = self.fault
        if fault is None:
            return Acknowledgement()
        if fault.needs_person:
            ended = f'{_names(fault.jumped)} jumped'
            fault.jumped.clear()
            self._unexplained = fault.last_bad
            return Acknowledgement(ended, self._waits(fault))
        if not fault.is_acknowledged:
            fault.acknowledged = fault.last_bad
            fault.waiting = ()
            return Acknowledgement(fault.words, self._waits(fault))
        return Acknowledgement(waits=self._waits(fault))

    def _waits(self, fault: Fault) -> str:
        """Return what a fault still waits for, in words."""
        waits = f'{self._recovery:g} s of samples that agree'
        if fault.is_acknowledged:
            return waits
        suspects = self._suspects(fault)
        return f'{waits}, and a check of {_names(suspects)}: {how_to_check(suspects)}'

    def _suspects(self, fault: Fault) -> tuple[int, ...]:
        """Return the sensors that have to be checked: the isolated one, or all in use."""
        sensor = fault.symptom.sensor
        return self._sensors.used.members if sensor is None else (sensor,)

    def end_if_over(self, exposure: Exposure, stamp: int) -> bool:
        """Note a consistent sample at a stamp, ns; return whether the fault is over and ended."""
        is_over = self.fault is None or self._is_over(self.fault, exposure, stamp)
        if is_over:
            self.end()
        return is_over

    def _is_over(self, fault: Fault, exposure: Exposure, stamp: int) -> bool:
        """
        Note a consistent sample at a stamp, ns; return whether a fault is over with it.

        Two sensors of a single parity that jumped wait for a person. Any other fault waits for the
        recovery. After it, a fault of which jumps explain every bad sample is over if all of them
        returned to the motion that they left, and one that a person acknowledged is over as well.
        Else the others have to have checked each suspect since the latest bad sample.
        """
        self._forget_returned(fault)
        if fault.needs_person or not self._note_recovery(fault, stamp):
            return False
        # No bad sample since the onset is one that a jump does not explain.
        is_explained = self._unexplained < self.onset
        if fault.is_acknowledged or (is_explained and not fault.jumped):
            return True
        fault.waiting = tuple(
            sensor
            for sensor in self._suspects(fault)
            if not exposure.is_cleared(sensor, fault.last_bad)
        )
        return not fault.waiting

    def _forget_returned(self, fault: Fault) -> None:
        """Remove the jumps of sensors that are back on the motion that they left."""
        for sensor, departure in list(fault.jumped.items()):
            if self._joints.has_returned(sensor, departure):
                del fault.jumped[sensor]

    def _note_recovery(self, fault: Fault, stamp: int) -> bool:
        """Note a sample that agrees, at a stamp, ns; return whether the recovery is complete."""
        if fault.agreed_from is None:
            fault.agreed_from = stamp
        return stamp - fault.agreed_from >= round(self._recovery * 1e9)

    def end(self) -> None:
        """Clear the fault."""
        self.fault = None
        self._bad = self._runs = 0

    def note_consistent(self) -> None:
        """Count a consistent sample."""
        self._bad = 0
        self.consistent += 1
        if self.consistent > SERIES_END:
            self._runs = 0

    @property
    def is_series(self) -> bool:
        """Whether `SERIES_RUNS` runs of bad samples came, with few consistent samples between."""
        return self._runs >= SERIES_RUNS

    def note_bad(self, sample: Sample, symptoms: list[Symptom]) -> int | None:
        """
        Count a bad sample, and latch a fault if it lasts; return the faulty sensor if known.

        `FAULT_SAMPLES` in a row latch, or a symptom that is certain by itself. A sample that is
        only withheld suspects no sensor and does not count. With two and more parities a sensor is
        already isolated in a series of short runs.

        Parameters
        ----------
        sample : Sample
            The bad sample.
        symptoms : list of Symptom
            What contradicts it, one at least.

        Returns
        -------
        int or None
            Index of the faulty sensor in ALL_JOINT_NAMES; None if it is not isolated.

        """
        cause = worst(symptoms)
        if cause.severity is Severity.WITHHOLD:
            self.note_withheld()
            return None
        self._count(sample.stamp, symptoms)
        self.consistent = 0
        self.latest_cause = cause
        if self.fault is not None:
            return self._widen(self.fault, sample, symptoms)
        if self._bad >= FAULT_SAMPLES or cause.severity is Severity.LATCH:
            return self._latch_isolated(sample, symptoms, cause)
        if self._sensors.used.parity_count > 1 and self.is_series:
            return self._isolated(sample, symptoms)
        return None

    def note_withheld(self) -> None:
        """Note a sample that is withheld and suspects no sensor: the recovery begins again."""
        if self.fault is not None:
            self.fault.agreed_from = None

    def _count(self, stamp: int, symptoms: list[Symptom]) -> None:
        """Count a bad sample at a stamp, ns, and a run of them that begins with it."""
        alone = self._joints.alone(self._sensors.used.members)
        if not self._bad or stamp - self._last_bad > RUN_GAP:
            self._bad = 0
            if self.fault is None:
                self.onset = stamp
            self._alone = alone
            if any(symptom.sensor is None for symptom in symptoms):
                self._runs += 1
        self._bad += 1
        self._last_bad = stamp
        if not _explains(alone, symptoms):
            self._unexplained = stamp

    def _latch_isolated(
        self,
        sample: Sample,
        symptoms: list[Symptom],
        cause: Symptom,
    ) -> int | None:
        """Latch a fault of the sensor that the evidence isolates; return that sensor, or None."""
        sensor = self._isolated(sample, symptoms)
        reason = cause.reason
        if cause.sensor is None and sensor in self._alone:
            reason = Reason.JUMPED
        symptom = cause._replace(reason=reason, sensor=sensor)
        self.latch(sample.stamp, symptom, self._joints.left(self._sensors.used.members))
        return sensor

    def _widen(self, fault: Fault, sample: Sample, symptoms: list[Symptom]) -> int | None:
        """
        Add a bad sample to a fault; return the sensor that it isolates, or None.

        If its symptoms name another sensor than the fault, all become suspects again.
        """
        fault.last_bad = sample.stamp
        fault.agreed_from = None
        fault.waiting = ()
        for left in self._joints.left(self._sensors.used.members):
            fault.jumped.setdefault(left, self._joints.departure(left))
        named = {symptom.sensor for symptom in symptoms} - {None}
        # One parity shows a second fault, and not which.
        isolated = None if fault.is_single_parity else self._isolated(sample, symptoms)
        sensor = fault.symptom.sensor
        if sensor is None or not named <= {sensor}:
            sensor = isolated
        fault.symptom = fault.symptom._replace(sensor=sensor)
        return isolated

    def _isolated(self, sample: Sample, symptoms: list[Symptom]) -> int | None:
        """
        Return the faulty sensor; None if the evidence does not isolate one.

        If symptoms name one sensor, it is that one; if they name several, none. Else it is the one
        sensor without which the trial of the others stands. Of four sensors several trials may
        stand, because any three agree: then it is the one that left its motion alone when the run
        of bad samples began.
        """
        standing = self._sensors.standing(sample.stamp, self.onset)
        named = {
            symptom.sensor
            for symptom in symptoms
            if symptom.sensor is not None and symptom.severity > Severity.WITHHOLD
        }
        suspects = named or set(standing)
        if not named and len(suspects) > 1 and self._sensors.used.parity_count < 2:
            suspects &= set(self._alone)
        return suspects.pop() if len(suspects) == 1 else None

    def latch_jumps(self, stamp: int, jumps: list[Symptom]) -> None:
        """Latch jumps in a pause, unless a series of bad samples before it makes them doubtful."""
        if not jumps or self.fault is not None or self.is_series:
            return
        symptom = jumps[0]
        if len(jumps) > 1:
            symptom = symptom._replace(sensor=None)
        self.onset = stamp
        self.latch(stamp, symptom, self._joints.left(self._sensors.used.members))
