# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""From symptoms to a fault: pending, latched, isolated to a sensor, widened, cleared."""

from __future__ import annotations

from collections.abc import Sequence

from spm_haptic_master.supervision.symptom import Symptom

# Samples in a row with a symptom that are a fault; fewer are withheld, and that is all.
SPIKE_SAMPLES = 3
# Innovations at a fault's onset (standard deviations) that isolate it to one sensor: that one's is
# above the first, all others' below the second. A step that the parity detects at once moves its
# sensor by more than eight.
FAULTY_DEVIATIONS, HEALTHY_DEVIATIONS = 5.0, 3.5


class FaultLatch:
    """
    The symptoms of the latest samples, and the fault that they have become.

    Attributes
    ----------
    fault : Symptom or None
        The latched fault.
    acknowledge : bool
        Whether only an acknowledgement clears it: two sensors jumped, which may cancel in the
        parity.
    bad : int
        Samples in a row with a symptom.

    """

    def __init__(self) -> None:
        self.fault: Symptom | None = None
        self.acknowledge = False
        self.bad = 0
        self._pending: dict[int, Symptom] = {}
        self._jumped: set[int | None] = set()
        self._onset: tuple[float, ...] = ()
        self._consistent = 0.0

    @property
    def words(self) -> str:
        """Return the fault in the words of `state`."""
        fault = self.fault
        if fault is None:
            return ''
        words = fault.words
        if fault.sensor is None and not fault.reason.startswith('no orientation') \
                and ' and ' not in words:
            words += ', sensor undetermined'
        return f'{words}, to be acknowledged' if self.acknowledge else words

    def note(self, symptoms: list[Symptom], innovations: Sequence[float]) -> None:
        """
        Take the symptoms of a sample in.

        `innovations` are those of the joints, in standard deviations; those of the first sample
        with symptoms isolate the faulty sensor.
        """
        if not symptoms:
            if self.bad:
                self.bad = 0
            if self._pending:
                self._pending.clear()
            return
        if not self.bad:
            self._onset = tuple(innovations)
        for symptom in symptoms:
            if symptom.sensor is not None and not symptom.passive:
                self._pending[symptom.sensor] = symptom
        self.bad += not all(symptom.passive for symptom in symptoms)

    def clear_pending(self, sensor: int) -> None:
        """Drop the symptom of a sensor that turned out to have had a spike."""
        self._pending.pop(sensor, None)

    def latch(self, symptoms: list[Symptom]) -> None:
        """Make a fault of the symptoms of this sample and the pending ones."""
        first = next((symptom for symptom in symptoms if symptom.fault), symptoms[0])
        sensors = {symptom.sensor for symptom in symptoms if symptom.sensor is not None}
        sensors |= set(self._pending)
        sensor = next(iter(sensors)) if len(sensors) == 1 else None
        if not sensors:
            sensor = self._isolated()
        self.fault = first._replace(sensor=sensor)
        self._consistent = 0.0
        self._jumped.clear()
        self._note_jumps((*symptoms, *self._pending.values()))

    def latch_pending(self) -> bool:
        """Make a fault of what is pending, before its motion is lost; whether there was any."""
        symptoms = list(self._pending.values())
        self._pending.clear()
        if not symptoms:
            return False
        if self.fault is None:
            self.latch(symptoms)
        else:
            self.widen(symptoms)
        return True

    def widen(self, symptoms: list[Symptom]) -> None:
        """Suspect every sensor, where another one than the fault's went wrong too."""
        fault = self.fault
        if fault is None:
            return
        other = next((symptom for symptom in symptoms
                      if symptom.sensor not in (None, fault.sensor)), None)
        if fault.sensor is not None and other is not None:
            self.fault = fault._replace(sensor=None, reason=f'{fault.words} and {other.words}')
        self._note_jumps(symptoms)

    def isolate(self, sensor: int | None) -> None:
        """Name the faulty sensor: the others agree without it. None: they do not."""
        if self.fault is not None:
            self.fault = self.fault._replace(sensor=sensor)

    def stop(self, reason: str) -> None:
        """Add why even the three other sensors publish nothing."""
        if self.fault is not None:
            self.fault = self.fault._replace(reason=f'{self.fault.reason}, {reason}')

    def recovered(self, clean: bool, checked: Sequence[float], dt: float, time: float) -> bool:
        """
        Clear the fault after a time of consistency, where the parity can see what was wrong.

        Parameters
        ----------
        clean : bool
            Whether this sample has no symptom.
        checked : sequence of float
            Seconds since each sensor was last checked by the others.
        dt : float
            Time since the last sample, s.
        time : float
            Time of consistency that clears a fault, s.

        """
        fault = self.fault
        if fault is None:
            return True
        if not clean:
            self._consistent = 0.0
            return False
        suspects = checked if fault.sensor is None else checked[fault.sensor:fault.sensor + 1]
        if max(suspects) <= dt:
            self._consistent += dt
        if self._consistent < time or self.acknowledge:
            return False
        self.fault = None
        return True

    def _isolated(self) -> int | None:
        """Return the one sensor that left its motion at the fault's onset, if only one did."""
        moved = [sensor for sensor, deviations in enumerate(self._onset)
                 if abs(deviations) > HEALTHY_DEVIATIONS]
        if len(moved) == 1 and abs(self._onset[moved[0]]) > FAULTY_DEVIATIONS:
            return moved[0]
        return None

    def _note_jumps(self, symptoms: Sequence[Symptom]) -> None:
        self._jumped |= {symptom.sensor for symptom in symptoms if symptom.reason == 'jumped'}
        self.acknowledge |= len(self._jumped) > 1
