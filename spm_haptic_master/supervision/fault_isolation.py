# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
From symptoms to a fault: pending symptoms, latch, isolation of the sensor, widening, clearing.

    starting --(start_samples without a symptom)--> healthy
    healthy --(symptom)--> withhold the sample, settle --(clean samples)--> healthy
    healthy --(symptoms in a row, or one that is a fault)--> silent, fault latched
    silent --(allowed, and one faulty sensor isolated)--> degraded
    degraded --(second fault, or no orientation from three sensors)--> silent
    silent, degraded --(recovery time of consistency)--> fault cleared, healthy
    any --(long gap, clock set back)--> starting; a fault stays latched
"""

from __future__ import annotations

from typing import NoReturn

from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.supervision.joint_monitor import JointMonitor
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.symptom import Symptom

# Bad samples in a row that are a fault; fewer are a spike, which is withheld and no more.
FAULT_SAMPLES = 3
# Clean samples after a spike before orientations are published again. A small step of a sensor
# shows in single samples first; within these the parity's window detects it.
SETTLING_SAMPLES = 10
# Innovations at a fault's onset (standard deviations) that isolate it to one sensor: its own is
# larger than the first, all others stay below the second. A step that the parity detects at once
# moves its sensor by more than eight.
FAULTY_DEVIATIONS = 5.0
HEALTHY_DEVIATIONS = 3.5
# Sensitivity of the parity to a sensor (0 .. 1) from which consistency checks that sensor. Near a
# parallel singularity the three active sensors cannot check th3A: it is 0 there.
MIN_SENSITIVITY = 0.1
# Longest time (sampling periods) that one consistent sample counts for the recovery: a gap is no
# consistency.
RECOVERY_PERIODS = 2.0


class FaultIsolation:
    """
    Latches faults from symptoms, isolates them to a sensor and clears them.

    Parameters
    ----------
    limits : Limits
        Samples to start, recovery time, permission of degraded operation.
    joints : JointMonitor
        The monitor whose trackers restart where a fault begins.

    Attributes
    ----------
    state : str
        'starting', 'healthy', 'degraded: ...' or 'silent: ...'.
    fault : Symptom or None
        The latched fault.
    starting : bool
        Whether no sample since the last restart has been healthy; no fault is latched meanwhile.
    degraded_allowed : bool
        Whether the three healthy sensors may continue the motion.

    """

    def __init__(self, limits: Limits, joints: JointMonitor):
        self._limits = limits
        self._joints = joints
        self.fault: Symptom | None = None
        # Latest symptom of each sensor in the samples withheld just now: a fault if a gap follows.
        self._pending: dict[int, Symptom] = {}
        # Innovations of the latest sample before any bad one, and of the first bad one after it.
        self._onset: tuple[float, ...] = ()
        self.restart()

    def restart(self) -> None:
        """Latch what is pending, and start as if no sample had been evaluated; keep the fault."""
        self.latch_pending()
        self.state: str = f'silent: {self.fault.text}' if self.fault else 'starting'
        self.degraded_allowed: bool = False
        self.starting: bool = True
        # Clean and bad samples in a row, and the clean ones that are due.
        self._clean = 0
        self._bad = 0
        self._clean_needed = self._limits.start_samples
        # Consistency since the last symptom of a latched fault, s.
        self._consistent = 0.0

    def update(self, symptoms: list[Symptom], innovations: tuple[float, ...]) -> None:
        """Count clean and bad samples in a row, and note what is pending."""
        if not self._bad:
            self._onset = innovations
        if symptoms:
            self._pending.update({symptom.sensor: symptom for symptom in symptoms
                                  if symptom.sensor is not None and not symptom.self_timed})
            self._clean = 0
            self._bad += not all(symptom.self_timed for symptom in symptoms)
        else:
            self._pending.clear()
            self._clean += 1
            self._bad = 0

    # Without a fault ------------------------------------------------------------------------

    def withhold(self, symptoms: list[Symptom]) -> NoReturn:
        """Raise RejectedError for a sample with symptoms; latch a fault if they have lasted."""
        first = next((symptom for symptom in symptoms if symptom.fault), symptoms[0])
        if self.starting:
            self.restart_persistent(symptoms)
        elif first.fault or self._bad >= FAULT_SAMPLES:
            self._latch(first, symptoms)
        elif self._bad:
            self._clean_needed = SETTLING_SAMPLES
        raise RejectedError(first.text, first.detail)

    def settle(self) -> None:
        """Raise RejectedError while clean samples are due, at the start and after a spike."""
        if self._clean < self._clean_needed:
            raise RejectedError('starting' if self.starting else 'settling',
                                f'{self._clean} consistent samples of {self._clean_needed}')

    def confirm(self) -> None:
        """Report a sample without a fault as healthy."""
        self.state = 'healthy'
        self.starting = False
        self._clean_needed = 1

    # Latch ----------------------------------------------------------------------------------

    def clear_pending(self, sensors: list[int]) -> None:
        """Drop what is pending for sensors that had a spike only."""
        for sensor in sensors:
            self._pending.pop(sensor, None)

    def latch_pending(self) -> None:
        """Latch what is pending: the motion that would confirm or clear it is lost."""
        symptoms = list(self._pending.values())
        self._pending.clear()
        if not symptoms or self.starting:
            return
        if self.fault is None:
            self._latch(symptoms[0], symptoms)
        else:
            self._widen(self.fault, symptoms)

    def _latch(self, first: Symptom, symptoms: list[Symptom]) -> None:
        """Latch a fault, isolated to one sensor where the symptoms or the onset allow it."""
        sensors = {symptom.sensor for symptom in symptoms if symptom.sensor is not None}
        sensor = sensors.pop() if len(sensors) == 1 else None
        if not sensors and sensor is None:
            sensor = self._sensor_at_onset()
        fault = self.fault = first._replace(sensor=sensor)
        self.degraded_allowed = self._limits.degraded and sensor is not None
        self._consistent = 0.0
        self.state = f'silent: {fault.text}'
        self._joints.restart_sensors(range(len(JOINT_NAMES)) if sensor is None else (sensor,))

    def _sensor_at_onset(self) -> int | None:
        """Return the only sensor that left its motion at the fault's onset, if there is one."""
        moved = [sensor for sensor, deviations in enumerate(self._onset)
                 if abs(deviations) > HEALTHY_DEVIATIONS]
        if len(moved) == 1 and abs(self._onset[moved[0]]) > FAULTY_DEVIATIONS:
            return moved[0]
        return None

    # With a fault ---------------------------------------------------------------------------

    def clear(self, fault: Symptom, estimate: SampleEstimate | None, symptoms: list[Symptom],
              dt: float) -> bool:
        """
        Return whether the fault is cleared: after the recovery time of consistency.

        Only samples count whose parity is sensitive to the faulty sensor, to all if undetermined.
        """
        if symptoms or estimate is None:
            self._consistent = 0.0
            return False
        sensors = range(len(JOINT_NAMES)) if fault.sensor is None else (fault.sensor,)
        sensitivity = estimate.sensitivity
        if sensitivity is not None \
                and all(abs(sensitivity[sensor]) >= MIN_SENSITIVITY for sensor in sensors):
            self._consistent += min(dt, RECOVERY_PERIODS * self._joints.period)
            if self._consistent >= self._limits.recovery:
                self.fault = None
                self.degraded_allowed = False
                return True
        return False

    def restart_persistent(self, symptoms: list[Symptom]) -> None:
        """Widen the fault and restart joints whose symptoms last: they will not return."""
        if self._bad >= FAULT_SAMPLES:
            if self.fault is not None:
                self._widen(self.fault, symptoms)
            self._joints.restart_sensors(
                symptom.sensor for symptom in symptoms if symptom.sensor is not None)

    def _widen(self, fault: Symptom, symptoms: list[Symptom]) -> None:
        """Make the sensor undetermined where another than the faulty one has symptoms, too."""
        other = next((symptom for symptom in symptoms
                      if symptom.sensor not in (None, fault.sensor)), None)
        if fault.sensor is not None and other is not None:
            self.degraded_allowed = False
            fault = self.fault = fault._replace(
                sensor=None, reason=f'{fault.text} and {other.text}', complete=True)
            self.state = f'silent: {fault.text}'

    def confirm_degraded(self, fault: Symptom) -> None:
        """Report a sample whose orientation comes from the three healthy sensors."""
        self.state = f'degraded: {fault.text}'

    def stop_degraded(self, fault: Symptom, reason: str, detail: str) -> NoReturn:
        """Raise RejectedError and end degraded operation: only all four sensors can restart."""
        self.degraded_allowed = False
        fault = self.fault = fault._replace(reason=f'{fault.reason}, {reason}')
        self.state = f'silent: {fault.text}'
        raise RejectedError(fault.text, detail)
