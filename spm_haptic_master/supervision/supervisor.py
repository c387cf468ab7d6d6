# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which orientations may go out, and how wrong one faulty sensor could have made them."""

from __future__ import annotations

from collections import Counter
from enum import Enum
from math import degrees, inf, isfinite
from typing import NamedTuple, NoReturn

from spm_haptic_master.exceptions import AmbiguousError, RejectedError, SpmError
from spm_haptic_master.joints import ALL_JOINT_NAMES, JOINT_NAMES
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.supervision.consistency_monitor import ConsistencyMonitor
from spm_haptic_master.supervision.continuity_monitor import ContinuityMonitor
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault_latch import FaultLatch, SPIKE_SAMPLES
from spm_haptic_master.supervision.joint_monitors import JointMonitors, long_gap, NOISE_PERIOD
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.norm_monitor import NormMonitor
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.remaining_sensors import Isolation
from spm_haptic_master.supervision.sample_clock import SampleClock
from spm_haptic_master.supervision.solver import (
    Angles,
    Quaternion,
    Solution,
    Solver,
    total_deviation,
)
from spm_haptic_master.supervision.symptom import Symptom

# Consistent samples after a single bad one before orientations go out again (samples). A small
# step of a sensor shows in single samples first; by then the window detects it.
SETTLING_SAMPLES = 10
# Time unchecked that is a caution (s): less is a moment on the way through a singularity.
UNCHECKED_CAUTION = 1.0
# Consistent samples in a row that end a series of spikes (samples).
REPEATED_SAMPLES = 100


class State(Enum):
    """Where the supervision is; docs/safety has the diagram."""

    STARTING = 'starting'
    HEALTHY = 'healthy'
    SETTLING = 'settling'
    FAULT = 'fault'
    DEGRADED = 'degraded'


class Verified(NamedTuple):
    """
    An orientation that may go out.

    Attributes
    ----------
    estimate : SampleEstimate
        Orientation, continuous in sign with the last one, and its covariance.
    protection_level : float
        Largest error, rad, that a single undetected fault of a checked sensor, noise and nominal
        bias may have made.

    """

    estimate: SampleEstimate
    protection_level: float


class Supervisor:
    """
    Passes the orientation of a joint sample, or withholds it and reports why.

    Parameters
    ----------
    solver : Solver
        The forward model.
    sigma : tuple of N float
        Standard deviations of the noise of the N = 4, 5 or 6 sensors, rad.
    limits : Limits
        What is healthy.

    Attributes
    ----------
    alert_limit : float
        Largest protection level of an orientation that is published, rad.
    state : str
        'starting', 'healthy', 'degraded: ...' or 'silent: ...'.
    parity : float or None
        Of the latest sample that has one, in standard deviations.

    """

    def __init__(self, solver: Solver, sigma: tuple[float, ...], limits: Limits) -> None:
        self._solver = solver
        self._limits = limits
        self.alert_limit = limits.alert_limit
        self._names = ALL_JOINT_NAMES[:len(sigma)]
        self._is_four = len(sigma) == len(JOINT_NAMES)
        threshold = limits.norm_threshold(len(sigma) - 3)
        self._reach = threshold + MISSED_DETECTION
        self._joints = JointMonitors(sigma, limits)
        self._clock = SampleClock()
        self._consistency = ConsistencyMonitor(threshold, limits.window)
        self._norm = NormMonitor(threshold, limits.window)
        self._continuity = ContinuityMonitor(limits.joint_speed)
        self._exposure = Exposure(len(sigma), limits.window)
        self._isolation = Isolation(solver, limits, len(sigma))
        self._latch = FaultLatch()
        self.parity: float | None = None
        self._since: int | None = None
        self._clean = self._refused = 0
        self._needed = limits.start_samples
        self._may_go_on = False
        self._others_bad = self._samples = 0
        self._spikes: Counter[int | None] = Counter()
        self._enter(State.STARTING, 'starting')

    # One sample ---------------------------------------------------------------------------------

    def take(self, stamp: int, angles: Angles) -> Verified:
        """
        Return the orientation of a sample, if it may go out.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns; it has to grow from call to call.
        angles : tuple of N float
            Readings, rad: th1A, th1B, th1C, th3A, and th3B and th3C of such sensors.

        Raises
        ------
        RejectedError
            Nothing may go out for this sample.

        """
        dt = self._step(stamp, angles)
        symptoms = self._joints.check(angles, dt, self._clock)
        estimate, level = None, 0.0
        try:
            solution = self._solver.solve(angles, self._continuity.prior(stamp))
        except SpmError as error:
            self._interrupt_checks()
            self._note_unsolved(stamp, error, symptoms)
        else:
            estimate = solution.estimate
            worth = self._integrity(solution)
            self._check_consistency(stamp, estimate, worth, symptoms)
            level = self._protection_level(stamp, worth, symptoms)
        if symptoms:
            if self._clean > REPEATED_SAMPLES:
                self._spikes.clear()
            self._clean = 0
            self._continuity.following = False
            # More than four sensors isolate the faulty one by what they measure.
            self._latch.note(symptoms, self._joints.innovations() if self._is_four else ())
        else:
            self._clean += 1
            self._latch.note(symptoms, ())
            self._follow(stamp, estimate)

        if self._latch.fault is not None:
            estimate, level = self._during_fault(stamp, angles, symptoms, estimate, level, dt)
        elif symptoms:
            self._withhold(symptoms)
        elif self._clean < self._needed:
            raise RejectedError(self._state.value, f'{self._clean} consistent samples of '
                                f'{self._needed}')
        estimate = self._worthy(stamp, estimate, level)
        if self._latch.fault is None:
            self._enter(State.HEALTHY, 'healthy')
            self._needed = 0
        return self._publish(stamp, estimate, level)

    def _publish(self, stamp: int, estimate: SampleEstimate, level: float) -> Verified:
        self._refused = 0
        quaternion = self._continuity.publish(stamp, estimate.quaternion)
        if quaternion is not estimate.quaternion:
            # As _replace does, at a fifth of its cost.
            estimate = SampleEstimate(quaternion, *estimate[1:])
        return Verified(estimate, level)

    def accepted(self) -> tuple[Quaternion, Angles] | None:
        """
        Return orientation and readings (rad) of the latest sample.

        None unless it is healthy and its orientation is that of all sensors. The samples leave
        behind what is read here: it costs them nothing.
        """
        quaternion = self._continuity.at(self._clock.stamp)
        if self._state is not State.HEALTHY or quaternion is None:
            return None
        return quaternion, self._joints.latest()

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked by the others; inf before."""
        return self._exposure.times(self._clock.stamp or 0)

    def acknowledge(self) -> bool:
        """Clear what only a person may clear, two sensors that jumped; whether there was any."""
        waiting = self._latch.acknowledge
        self._latch.acknowledge = False
        if waiting:
            self._find_faulty()
        return waiting

    def noise(self) -> tuple[float, ...]:
        """Return the standard deviation of each sensor's noise as measured, rad."""
        return self._joints.measured()

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations go out, by kind, in words."""
        found = self._joints.cautions()
        for name, time in zip(self._names, self.unchecked(), strict=True):
            if time > UNCHECKED_CAUTION:
                found[f'unchecked {name}'] = f'{name} unchecked ' + (
                    'since the start' if time == inf else f'for {time:.0f} s')
        return found

    # The stamp ----------------------------------------------------------------------------------

    def _step(self, stamp: int, angles: Angles) -> float:
        """Return the time since the last sample, s; reset what a gap has made worthless."""
        if not isfinite(sum(angles)):
            # Of four, none can be left out: the driver gives no such set.
            missing = [name for name, angle in zip(self._names, angles, strict=True)
                       if angle != angle and not self._is_four]
            self._refuse(f'{", ".join(missing)} missing' if missing else 'angle not finite',
                         f'{list(angles)} rad')
        dt = self._clock.step(stamp)
        if dt < 0.0:
            if self._clock.was_set_back():
                self._restart()
                self._continuity.forget()
            raise RejectedError('sample not newer than the last', f'{-dt:.6f} s older')
        if dt == inf:
            self._restart()
            dt = 0.0
        if self._since is None:
            self._since = stamp
        if long_gap(dt, self._clock.period):
            self._settle_pending(angles)
        return dt

    def _settle_pending(self, angles: Angles) -> None:
        """After a gap, drop spikes of joints that are back; the other pending ones are a fault."""
        for sensor in self._joints.back_after_gap(angles):
            self._latch.clear_pending(sensor)
        if self._state is not State.STARTING and self._latch.latch_pending():
            self._may_go_on = False
            self._find_faulty()
            self._enter(State.FAULT, f'silent: {self._latch.words}')
        self._joints.reset_coasting()

    def _restart(self) -> None:
        """Reset the motion state; a fault stays latched, and what is pending becomes one."""
        if self._state is not State.STARTING:
            self._latch.latch_pending()
        self._clean = self._refused = 0
        self._needed = self._limits.start_samples
        self._may_go_on = self._continuity.following = False
        self._since = None
        self._consistency.restart()
        self._norm.restart()
        self._find_faulty()
        self._exposure.restart()
        self._clock.restart()
        self._joints.reset_motion()
        if self._latch.fault is None:
            self._enter(State.STARTING, 'starting')
        else:
            self._enter(State.FAULT, f'silent: {self._latch.words}')

    # Symptoms -----------------------------------------------------------------------------------

    def _integrity(self, solution: Solution) -> Integrity:
        """Return what the sample's orientation is worth, with noise and delays as they are."""
        self._samples += 1
        if self._samples >= NOISE_PERIOD:
            self._samples = 0
            self._joints.follow_noise()
        worth = integrity(solution.estimate, self._joints.bias(), self._joints.noise)
        if solution.apart:
            # Beside what a fault does to the orientation of all four sensors.
            worth = worth._replace(healthy=worth.healthy + solution.apart)
        return worth

    def _note_unsolved(self, stamp: int, error: SpmError, symptoms: list[Symptom]) -> None:
        """Add that no orientation fits, unless that happens to healthy sensors here."""
        if not symptoms and self._latch.fault is None and (
                isinstance(error, AmbiguousError) or self._continuity.was_undetermined(stamp)):
            # Two solutions meet, or a leg is at the edge of its working mode.
            self._refuse('orientation not determined', str(error))
        symptoms.append(Symptom('no orientation fits', str(error)))

    def _check_consistency(self, stamp: int, estimate: SampleEstimate, worth: Integrity,
                           symptoms: list[Symptom]) -> None:
        """Hold the angles against each other, and the orientation against the last one."""
        parity = estimate.parity
        if parity is None:
            return
        self.parity = parity
        noise = self._joints.noise
        if self._is_four:
            symptom = self._consistency.check(stamp, parity, worth.bias, noise)
        else:
            symptom = self._norm.check(stamp, estimate.parity_vector, worth.bias, noise)
        if symptom is None:
            symptom = self._continuity.check(stamp, estimate.quaternion, noise * worth.deviation)
            if symptom is not None and self._continuity.following and not symptoms:
                # Followed past what the sensors determine: no evidence against one of them.
                self._continuity.forget()
                self._exposure.interrupt()
                self._clean = 0
                self._needed = max(self._needed, self._limits.start_samples)
                self._refuse('orientation not determined', symptom.detail)
        if symptom is not None:
            symptoms.append(symptom)

    def _follow(self, stamp: int, estimate: SampleEstimate | None) -> None:
        """Let a consistent orientation continue the motion, though it may be withheld."""
        if estimate is None or self._latch.fault is not None:
            return
        if total_deviation(estimate) > self._limits.deviation:
            self._continuity.note_undetermined(stamp)
        if estimate.determined:
            self._continuity.follow(stamp, estimate.quaternion)

    def _protection_level(self, stamp: int, worth: Integrity, symptoms: list[Symptom]) -> float:
        """Return the protection level, rad, and note which sensors the others check."""
        if symptoms:
            self._interrupt_checks()
            return inf
        root = self._consistency.root if self._is_four else self._norm.root
        parts = worth.levels(self._reach * self._joints.noise / root)
        level = self._exposure.take(stamp, parts, self.alert_limit)
        return level if level > worth.healthy else worth.healthy

    def _interrupt_checks(self) -> None:
        """Start the checks again, unless the others go on without the faulty sensor."""
        if self._isolation.found is None:
            self._exposure.interrupt()

    # What follows from them ---------------------------------------------------------------------

    def _enter(self, state: State, words: str) -> None:
        self._state = state
        self.state = words

    def _withhold(self, symptoms: list[Symptom]) -> NoReturn:
        """Withhold a sample with symptoms; latch a fault where they last."""
        first = next((symptom for symptom in symptoms if symptom.fault), symptoms[0])
        lasting = self._latch.bad >= SPIKE_SAMPLES or self._returns(first)
        if self._state is State.STARTING and lasting and first.sensor is not None \
                and first.reason != 'out of range':
            # The first readings were wrong, not these.
            self._joints.restart_blamed(symptoms)
        elif first.fault or lasting:
            self._latch.latch(symptoms)
            self._may_go_on = self._limits.degraded and self._latch.fault is not None \
                and self._latch.fault.sensor is not None
            self._find_faulty()
            self._enter(State.FAULT, f'silent: {self._latch.words}')
            self._joints.restart(self._latch.fault.sensor if self._latch.fault else None)
        elif self._latch.bad and self._state is not State.STARTING:
            self._needed = SETTLING_SAMPLES
            self._state = State.SETTLING
        raise RejectedError(_undetermined(first), first.detail)

    def _returns(self, symptom: Symptom) -> bool:
        """Whether a spike is one of several: five or six sensors can do without that one."""
        if self._is_four or symptom.passive or self._latch.bad != 1:
            return False
        self._spikes[symptom.sensor] += 1
        return self._spikes[symptom.sensor] >= SPIKE_SAMPLES

    def _during_fault(self, stamp: int, angles: Angles, symptoms: list[Symptom],
                      estimate: SampleEstimate | None, level: float,
                      dt: float) -> tuple[SampleEstimate, float]:
        """Clear the fault, or go on without the faulty sensor, or withhold the sample."""
        latch = self._latch
        clean = not symptoms
        if clean and estimate is not None and not self._is_four:
            # The prior is that of the others: it does not select all legs' modes.
            clean = self._solver.in_mode(estimate, angles)
        if latch.recovered(clean, self.unchecked(), dt, self._limits.recovery) \
                and estimate is not None:
            self._may_go_on = False
            self._isolation.end()
            return estimate, level
        if not self._is_four:
            return self._with_others(stamp, angles, symptoms)
        if latch.bad >= SPIKE_SAMPLES:
            latch.widen(symptoms)
            self._may_go_on &= latch.fault is not None and latch.fault.sensor is not None
            self._joints.restart_blamed(symptoms)
        if not self._may_go_on or latch.fault is None:
            self._refuse_fault()
        return self._without_faulty(stamp, angles, symptoms, latch.fault)

    @property
    def _excluded(self) -> str | None:
        """Name of the sensor without which five or six go on."""
        found = self._isolation.found
        return None if found is None else found.name

    # Five and six sensors -----------------------------------------------------------------------

    def _find_faulty(self) -> None:
        """Begin to look for the faulty sensor; two that jumped are waited for."""
        self._isolation.begin(None if self._latch.acknowledge else self._latch.fault)

    def _with_others(self, stamp: int, angles: Angles,
                     symptoms: list[Symptom]) -> tuple[SampleEstimate, float]:
        """Return the orientation of all sensors but the faulty one, once it is known."""
        latch, isolation = self._latch, self._isolation
        prior = self._continuity.prior(stamp)
        symptom = isolation.take(stamp, angles, prior, self._joints.bias(), self._joints.factors)
        others = isolation.found
        if latch.bad >= SPIKE_SAMPLES:
            self._joints.restart_blamed(symptoms)
        if others is None or not self._limits.degraded:
            self._refuse_fault()
        if latch.fault is not None and latch.fault.sensor is None:
            latch.isolate(others.excluded)
        estimate = others.estimate
        if estimate is not None and symptom is None:
            deviation = others.noise * total_deviation(estimate)
            symptom = self._continuity.check(stamp, estimate.quaternion, deviation)
        if symptom is None:
            symptom = next((each for each in symptoms
                            if each.sensor not in (None, others.excluded)), None)
        if symptom is not None or estimate is None:
            self._lose_others(symptom, symptoms)
        self._others_bad = 0
        parts, healthy = others.levels()
        level = healthy
        if symptoms:
            level = max(level, self._exposure.take(stamp, parts, self.alert_limit))
        else:
            level = max(level, *(part for part in parts if part <= self.alert_limit), 0.0)
        self._enter(State.DEGRADED, f'degraded: {others.name} excluded')
        return estimate, level

    def _lose_others(self, symptom: Symptom | None, symptoms: list[Symptom]) -> NoReturn:
        """Withhold a sample that another sensor contradicts; stop where that lasts."""
        self._others_bad += 1
        self._exposure.interrupt()
        words = symptom.words if symptom is not None else 'no orientation from the others'
        if self._others_bad >= SPIKE_SAMPLES or (symptom is not None and symptom.fault):
            self._others_bad = 0
            if symptom is not None and symptom.sensor is None and self._isolation.chosen:
                # A small fault that grew shows that it was another sensor.
                self._latch.isolate(None)
                self._find_faulty()
            else:
                self._isolation.end()
                self._latch.widen(symptoms)
                self._latch.stop(f'and then {words}')
            self._enter(State.FAULT, f'silent: {self._latch.words}')
        raise RejectedError(words, symptom.detail if symptom is not None else '')

    def _refuse_fault(self) -> NoReturn:
        """Withhold a sample for the latched fault."""
        fault, words = self._latch.fault, self._latch.words
        self._enter(State.FAULT, f'silent: {words}')
        raise RejectedError(words, fault.detail if fault else '')

    # Three of four sensors ----------------------------------------------------------------------

    def _without_faulty(self, stamp: int, angles: Angles, symptoms: list[Symptom],
                        fault: Symptom) -> tuple[SampleEstimate, float]:
        """Return the orientation of the three healthy sensors, where that is allowed and good."""
        prior = self._continuity.prior(stamp)
        if prior is None or fault.sensor is None:
            self._stop('the motion was lost', 'no orientation a moment ago')
        other = next((each for each in symptoms if each.sensor not in (None, fault.sensor)), None)
        if other is not None:
            self._stop(f'and {other.words}', other.detail)
        try:
            estimate = self._solver.without(self._names[fault.sensor], angles, prior)
        except SpmError as error:
            self._stop('no orientation from the others', str(error))
        deviation, noise = total_deviation(estimate), self._joints.noise
        symptom = self._continuity.check(stamp, estimate.quaternion, noise * deviation)
        if symptom is not None:
            self._stop('the others do not continue the motion', symptom.detail)
        if not estimate.determined or deviation > self._limits.deviation:
            self._stop('the others do not determine it',
                       f'standard deviation {deviation:.4f} rad')
        self._enter(State.DEGRADED, f'degraded: {self._latch.words}')
        return estimate, MISSED_DETECTION * noise * deviation

    def _stop(self, reason: str, detail: str) -> NoReturn:
        """End the degraded operation: only all four sensors together can resume."""
        self._may_go_on = False
        self._latch.stop(reason)
        self._enter(State.FAULT, f'silent: {self._latch.words}')
        raise RejectedError(self._latch.words, detail)

    def _worthy(self, stamp: int, estimate: SampleEstimate | None,
                level: float) -> SampleEstimate:
        """Return the orientation if the sensors determine it and protect it; else withhold it."""
        if estimate is None:
            self._refuse('no orientation', 'no estimate')
        deviation = total_deviation(estimate)
        if not estimate.determined or deviation > self._limits.deviation:
            self._continuity.following = self._latch.fault is None
            self._refuse('orientation not determined', f'standard deviation {deviation:.4f} rad, '
                         f'limit {self._limits.deviation:g}')
        if level > self.alert_limit:
            self._continuity.following = self._latch.fault is None
            self._refuse('protection level above the alert limit', ', '.join([
                f'{degrees(level):.2f} deg, limit {degrees(self.alert_limit):g}',
                *self._joints.cautions().values()]))
        if self._limits.start_checked:
            never = [sensor for sensor in self._exposure.unchecked()
                     if self._names[sensor] != self._excluded]
            if never:
                name = self._names[never[0]]
                self._refuse(f'{name} not checked yet: {_how_to_check(name)}', 'start_checked')
        if self._limits.unchecked_limit:
            self._check_exposure(stamp)
        return estimate

    def _check_exposure(self, stamp: int) -> None:
        since = 0.0 if self._since is None else (stamp - self._since) * 1e-9
        limit = self._limits.unchecked_limit
        if since <= limit:
            return
        for name, time in zip(self._names, self.unchecked(), strict=True):
            if min(time, since) > limit and name != self._excluded:
                self._refuse(f'{name} unchecked for too long',
                             f'{min(time, since):.0f} s, limit {limit:g}')

    def _refuse(self, reason: str, detail: str) -> NoReturn:
        """Withhold a sample without a fault of a sensor; settle again if that lasts."""
        self._refused += 1
        if self._refused >= SPIKE_SAMPLES and self._latch.fault is None:
            self._enter(State.SETTLING, f'silent: {reason}')
            self._needed = max(self._needed, self._limits.start_samples)
            self._clean = 0
        if self._refused >= SPIKE_SAMPLES and self._may_go_on:
            self._stop(reason, detail)
        if self._refused >= SPIKE_SAMPLES and self._excluded is not None:
            self._enter(State.FAULT, f'silent: {self._excluded} excluded, {reason}')
        raise RejectedError(reason, detail)


def _undetermined(symptom: Symptom) -> str:
    """Return a symptom's words, with the note that it isolates no sensor."""
    if symptom.sensor is not None or symptom.reason.startswith('no orientation'):
        return symptom.words
    return f'{symptom.reason}, sensor undetermined'


def _how_to_check(name: str) -> str:
    """Return where the other sensors can check a sensor."""
    if name == 'joint_3a':
        return 'turn the handle about its axis, away from the singularity'
    return 'tilt the handle towards the centre of the workspace'
