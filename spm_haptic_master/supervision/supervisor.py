# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which orientations may go out, and how wrong one faulty sensor could have made them."""

from __future__ import annotations

from enum import Enum
from math import degrees, inf, isfinite
from typing import NamedTuple, NoReturn

from spm_haptic_master.exceptions import AmbiguousError, RejectedError, SpmError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.supervision.consistency_monitor import (
    ConsistencyMonitor,
)
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault_latch import FaultLatch, SPIKE_SAMPLES
from spm_haptic_master.supervision.joint_monitor import FORGET_PERIODS, JointMonitor
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.protection import Integrity, integrity, MISSED_DETECTION
from spm_haptic_master.supervision.sample_clock import JITTER_DEVIATIONS, SampleClock
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
# Age of an orientation from which on it no longer selects among solutions (ns).
PRIOR_AGE = 100_000_000
# Standard deviations that an orientation may be from the last one, beside human motion.
TURN_DEVIATIONS = 6.0
# Time unchecked that is a caution (s): less is a moment on the way through a singularity.
UNCHECKED_CAUTION = 1.0
# Equal readings before the latest one from which on a run is evaluated (samples).
FIRST_RUN = 4
# Samples between two evaluations of the noise (samples).
NOISE_PERIOD = 16
# Measured over configured noise from which on it is counted (unit 1): what an average over 256
# samples does not reach by chance, with the quantisation of a 12-bit encoder.
NOISE_FACTOR = 1.25
# The same from which on it is a caution (unit 1): jitter of the sampling may add a quarter.
NOISE_CAUTION = 1.5


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
    sigma : tuple of 4 float
        Standard deviations of the sensors' noise, rad.
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

    def __init__(self, solver: Solver, sigma: Angles, limits: Limits) -> None:
        self._solver = solver
        self._sigma = sigma
        self._limits = limits
        self.alert_limit = limits.alert_limit
        threshold = limits.threshold
        self._reach = threshold + MISSED_DETECTION
        self._joints = tuple(
            JointMonitor(deviation, threshold, limits.joint_acceleration) for deviation in sigma)
        self._clock = SampleClock()
        self._consistency = ConsistencyMonitor(threshold, limits.window)
        self._exposure = Exposure(len(JOINT_NAMES), limits.window)
        self._latch = FaultLatch()
        self.parity: float | None = None
        self._noise = 1.0
        self._noise_samples = 0
        self._out_stamp: int | None = None
        self._quaternion: Quaternion | None = None
        self._undetermined_stamp: int | None = None
        # Whether orientations are withheld for their worth alone, without a symptom since.
        self._following = False
        self._since: int | None = None
        self._clean = self._refused = 0
        self._needed = limits.start_samples
        self._may_go_on = False
        self._enter(State.STARTING, 'starting')

    # One sample ---------------------------------------------------------------------------------

    def take(self, stamp: int, angles: Angles) -> Verified:
        """
        Return the orientation of a sample, if it may go out.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns; it has to grow from call to call.
        angles : tuple of 4 float
            th1A, th1B, th1C, th3A, rad.

        Raises
        ------
        RejectedError
            Nothing may go out for this sample.

        """
        dt = self._step(stamp, angles)
        symptoms = self._check_joints(angles, dt)
        estimate, level = None, 0.0
        try:
            solution = self._solver.solve(angles, self._prior(stamp))
        except SpmError as error:
            self._exposure.interrupt()
            if not symptoms and self._latch.fault is None and (
                    isinstance(error, AmbiguousError) or self._was_undetermined(stamp)):
                # Healthy sensors: two solutions meet, or a leg is at the edge of its mode.
                self._refuse('orientation not determined', str(error))
            symptoms.append(Symptom('no orientation fits', str(error)))
        else:
            estimate = solution.estimate
            worth = self._integrity(solution)
            self._check_consistency(stamp, estimate, worth, symptoms)
            level = self._protection_level(stamp, worth, symptoms)
        if symptoms:
            self._clean = 0
            self._following = False
            self._latch.note(symptoms, [joint.innovation for joint in self._joints])
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

    def _follow(self, stamp: int, estimate: SampleEstimate | None) -> None:
        """Let an orientation that is withheld for its worth alone continue the last one."""
        if estimate is None or self._latch.fault is not None:
            return
        if total_deviation(estimate) > self._limits.deviation:
            self._undetermined_stamp = stamp
        if self._following and estimate.determined and self._prior(stamp) is not None:
            self._out_stamp = stamp
            self._quaternion = _continued(estimate.quaternion, self._quaternion)

    def _was_undetermined(self, stamp: int) -> bool:
        """Return whether the sensors did not determine the orientation a moment ago."""
        last = self._undetermined_stamp
        return last is not None and stamp - last <= PRIOR_AGE

    def _publish(self, stamp: int, estimate: SampleEstimate, level: float) -> Verified:
        self._refused = 0
        self._out_stamp = stamp
        self._following = False
        quaternion = self._quaternion = _continued(estimate.quaternion, self._quaternion)
        if quaternion is not estimate.quaternion:
            # As _replace does, at a fifth of its cost.
            estimate = SampleEstimate(quaternion, *estimate[1:])
        return Verified(estimate, level)

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked by the others; inf before."""
        return self._exposure.times(self._clock.stamp or 0)

    def acknowledge(self) -> bool:
        """Clear what only a person may clear, two sensors that jumped; whether there was any."""
        waiting = self._latch.acknowledge
        self._latch.acknowledge = False
        return waiting

    def noise(self) -> tuple[float, ...]:
        """Return the standard deviation of each sensor's noise as measured, rad."""
        return tuple(joint.noise for joint in self._joints)

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations go out, by kind, in words."""
        found = {}
        for name, joint, sigma in zip(JOINT_NAMES, self._joints, self._sigma, strict=True):
            if joint.noise > NOISE_CAUTION * sigma:
                found[f'noise {name}'] = (f'noise of {name} {degrees(joint.noise):.2f} deg, '
                                          f'configured {degrees(sigma):.2g}')
        for name, time in zip(JOINT_NAMES, self.unchecked(), strict=True):
            if time > UNCHECKED_CAUTION:
                found[f'unchecked {name}'] = f'{name} unchecked ' + (
                    'since the start' if time == inf else f'for {time:.0f} s')
        return found

    # The stamp ----------------------------------------------------------------------------------

    def _step(self, stamp: int, angles: Angles) -> float:
        """Return the time since the last sample, s; reset what a gap has made worthless."""
        a, b, c, third = angles
        if not isfinite(a + b + c + third):
            self._refuse('angle not finite', f'{list(angles)} rad')
        dt = self._clock.step(stamp)
        if dt < 0.0:
            if self._clock.was_set_back():
                self._restart()
                self._out_stamp = None
            raise RejectedError('sample not newer than the last', f'{-dt:.6f} s older')
        if dt == inf:
            self._restart()
            dt = 0.0
        if self._since is None:
            self._since = stamp
        if dt > FORGET_PERIODS * self._clock.period > 0.0:
            self._settle_pending(angles)
        return dt

    def _settle_pending(self, angles: Angles) -> None:
        """After a gap, drop spikes of joints that are back; the other pending ones are a fault."""
        for sensor, (joint, reading) in enumerate(zip(self._joints, angles, strict=True)):
            if joint.back_after_gap(reading):
                self._latch.clear_pending(sensor)
        if self._state is not State.STARTING and self._latch.latch_pending():
            self._may_go_on = False
            self._enter(State.FAULT, f'silent: {self._latch.words}')
        for joint in self._joints:
            if joint.coasting:
                joint.reset_motion()

    def _restart(self) -> None:
        """Reset the motion state; a fault stays latched, and what is pending becomes one."""
        if self._state is not State.STARTING:
            self._latch.latch_pending()
        self._clean = self._refused = 0
        self._needed = self._limits.start_samples
        self._may_go_on = self._following = False
        self._since = None
        self._consistency.restart()
        self._exposure.restart()
        self._clock.restart()
        for joint in self._joints:
            joint.reset_motion()
        if self._latch.fault is None:
            self._enter(State.STARTING, 'starting')
        else:
            self._enter(State.FAULT, f'silent: {self._latch.words}')

    def _prior(self, stamp: int) -> Quaternion | None:
        """Return the last orientation while it still selects among solutions."""
        if self._out_stamp is None or stamp - self._out_stamp > PRIOR_AGE:
            return None
        return self._quaternion

    # Symptoms -----------------------------------------------------------------------------------

    def _check_joints(self, angles: Angles, dt: float) -> list[Symptom]:
        """Hold each reading against its joint's range and motion, and follow the motion."""
        limits = self._limits
        period = self._clock.period or dt
        timing = limits.skew + JITTER_DEVIATIONS * self._clock.jitter
        speed = limits.joint_speed
        symptoms: list[Symptom] = []
        for joint, reading, low, high in zip(  # noqa: B905, four each
                self._joints, angles, limits.joint_min, limits.joint_max):
            jumped = joint.jumped(reading, dt, period, timing)
            if jumped or joint.run >= FIRST_RUN or not -speed <= joint.velocity <= speed \
                    or not low <= reading <= high:
                self._describe(joint, reading, jumped, symptoms)
        return symptoms

    def _describe(self, joint: JointMonitor, reading: float, jumped: bool,
                  symptoms: list[Symptom]) -> None:
        """Add the symptoms of one joint."""
        limits = self._limits
        sensor = self._joints.index(joint)
        name = JOINT_NAMES[sensor]
        if jumped:
            symptoms.append(Symptom(
                'jumped', f'{name} {joint.innovation:.1f} sigma off its motion', sensor))
        elif abs(joint.velocity) > limits.joint_speed:
            symptoms.append(Symptom('too fast', f'{name} {joint.velocity:.1f} rad/s', sensor))
        elif joint.run >= FIRST_RUN and limits.frozen_samples:
            self._check_run(sensor, joint, symptoms)
        if not limits.joint_min[sensor] <= reading <= limits.joint_max[sensor]:
            symptoms.append(Symptom('out of range', f'{name} {reading:.4f} rad', sensor))

    def _check_run(self, sensor: int, joint: JointMonitor, symptoms: list[Symptom]) -> None:
        """Report a run of equal readings that the sensor's noise has never made."""
        withheld, frozen = joint.withheld_run, joint.frozen_run
        if withheld is not None and frozen is not None and joint.run >= withheld:
            fault = joint.run >= max(frozen, self._limits.frozen_samples)
            symptoms.append(Symptom(
                'frozen', f'{JOINT_NAMES[sensor]} {joint.run + 1} equal readings', sensor,
                fault=fault, passive=not fault))

    def _integrity(self, solution: Solution) -> Integrity:
        """Return what the sample's orientation is worth, with noise and delays as they are."""
        self._noise_samples += 1
        if self._noise_samples >= NOISE_PERIOD:
            self._noise_samples = 0
            self._follow_noise()
        limits = self._limits
        bias, skew = limits.bias, limits.skew
        first, second, last, passive = self._joints
        if skew or first.since or second.since or last.since or passive.since:
            # A slower encoder than the bus repeats a reading: that may be so old.
            a, b, c, third = (each + abs(joint.velocity) * (skew + joint.since)
                              for each, joint in zip(bias, self._joints, strict=True))
            bias = a, b, c, third
        worth = integrity(solution.estimate, bias, self._noise)
        if solution.apart:
            # Beside what a fault does to the orientation of all four sensors.
            worth = worth._replace(healthy=worth.healthy + solution.apart)
        return worth

    def _follow_noise(self) -> None:
        """Let the limits allow for the noise as measured, where it is above the configured."""
        self._noise = 1.0
        for joint, sigma in zip(self._joints, self._sigma, strict=True):
            noise = joint.noise
            joint.sigma = sigma
            if noise > NOISE_FACTOR * sigma:
                joint.sigma = noise
                self._noise = max(self._noise, noise / sigma)

    def _check_consistency(self, stamp: int, estimate: SampleEstimate, worth: Integrity,
                           symptoms: list[Symptom]) -> None:
        """Hold the angles against each other, and the orientation against the last one."""
        parity = estimate.parity
        if parity is None:
            return
        self.parity = parity
        symptom = self._consistency.check(stamp, parity, worth.bias, self._noise)
        if symptom is None:
            symptom = self._check_turn(stamp, estimate, worth.deviation)
            if symptom is not None and self._following and not symptoms:
                # Followed past what the sensors determine: no evidence against one of them.
                self._lose_motion()
                self._refuse('orientation not determined', symptom.detail)
        if symptom is not None:
            symptoms.append(symptom)

    def _lose_motion(self) -> None:
        """Have the next orientation start as the first one did."""
        self._out_stamp = None
        self._following = False
        self._clean = 0
        self._needed = max(self._needed, self._limits.start_samples)
        self._exposure.interrupt()

    def _check_turn(self, stamp: int, estimate: SampleEstimate,
                    deviation: float) -> Symptom | None:
        """Hold an orientation against the last one and the human motion limit."""
        prior = self._prior(stamp)
        if prior is None or self._out_stamp is None:
            return None
        reach = self._limits.joint_speed * (stamp - self._out_stamp) * 1e-9 \
            + TURN_DEVIATIONS * self._noise * deviation
        x, y, z, w = estimate.quaternion
        cosine = x * prior[0] + y * prior[1] + z * prior[2] + w * prior[3]
        # sin(half the turn)^2 against (half the reach)^2.
        if 1.0 - cosine * cosine <= 0.25 * reach * reach:
            return None
        turn = rotation_distance(estimate.quaternion, prior)
        return Symptom('orientation does not continue the motion',
                       f'{turn:.3f} rad off the last one, limit {reach:.3f}')

    def _protection_level(self, stamp: int, worth: Integrity, symptoms: list[Symptom]) -> float:
        """Return the protection level, rad, and note which sensors the others check."""
        if symptoms:
            self._exposure.interrupt()
            return inf
        parts = worth.levels(self._reach * self._noise / self._consistency.root)
        level = self._exposure.take(stamp, parts, self.alert_limit)
        return level if level > worth.healthy else worth.healthy

    # What follows from them ---------------------------------------------------------------------

    def _enter(self, state: State, words: str) -> None:
        self._state = state
        self.state = words

    def _withhold(self, symptoms: list[Symptom]) -> NoReturn:
        """Withhold a sample with symptoms; latch a fault where they last."""
        first = next((symptom for symptom in symptoms if symptom.fault), symptoms[0])
        lasting = self._latch.bad >= SPIKE_SAMPLES
        if self._state is State.STARTING and lasting and first.sensor is not None:
            # The first readings were wrong, not these.
            self._restart_joints(symptoms)
        elif first.fault or lasting:
            self._latch.latch(symptoms)
            self._may_go_on = self._limits.degraded and self._latch.fault is not None \
                and self._latch.fault.sensor is not None
            self._enter(State.FAULT, f'silent: {self._latch.words}')
            faulty = self._latch.fault.sensor if self._latch.fault else None
            for sensor, joint in enumerate(self._joints):
                if faulty in (None, sensor):
                    joint.restart()
        elif self._latch.bad and self._state is not State.STARTING:
            self._needed = SETTLING_SAMPLES
            self._state = State.SETTLING
        raise RejectedError(_undetermined(first), first.detail)

    def _restart_joints(self, symptoms: list[Symptom]) -> None:
        """Leave the old motion of joints that do not come back to it."""
        for symptom in symptoms:
            if symptom.sensor is not None:
                self._joints[symptom.sensor].restart()

    def _during_fault(self, stamp: int, angles: Angles, symptoms: list[Symptom],
                      estimate: SampleEstimate | None, level: float,
                      dt: float) -> tuple[SampleEstimate, float]:
        """Clear the fault, or go on without the faulty sensor, or withhold the sample."""
        latch = self._latch
        if latch.recovered(not symptoms, self.unchecked(), dt, self._limits.recovery) \
                and estimate is not None:
            self._may_go_on = False
            return estimate, level
        if latch.bad >= SPIKE_SAMPLES:
            latch.widen(symptoms)
            self._may_go_on &= latch.fault is not None and latch.fault.sensor is not None
            self._restart_joints(symptoms)
        if not self._may_go_on or latch.fault is None:
            self._enter(State.FAULT, f'silent: {latch.words}')
            raise RejectedError(latch.words, latch.fault.detail if latch.fault else '')
        return self._without_faulty(stamp, angles, symptoms, latch.fault)

    def _without_faulty(self, stamp: int, angles: Angles, symptoms: list[Symptom],
                        fault: Symptom) -> tuple[SampleEstimate, float]:
        """Return the orientation of the three healthy sensors, where that is allowed and good."""
        prior = self._prior(stamp)
        if prior is None or fault.sensor is None:
            self._stop('the motion was lost', 'no orientation a moment ago')
        other = next((each for each in symptoms if each.sensor not in (None, fault.sensor)), None)
        if other is not None:
            self._stop(f'and {other.words}', other.detail)
        try:
            estimate = self._solver.without(JOINT_NAMES[fault.sensor], angles, prior)
        except SpmError as error:
            self._stop('no orientation from the others', str(error))
        deviation = total_deviation(estimate)
        symptom = self._check_turn(stamp, estimate, deviation)
        if symptom is not None:
            self._stop('the others do not continue the motion', symptom.detail)
        if not estimate.determined or deviation > self._limits.deviation:
            self._stop('the others do not determine it',
                       f'standard deviation {deviation:.4f} rad')
        self._enter(State.DEGRADED, f'degraded: {self._latch.words}')
        return estimate, MISSED_DETECTION * self._noise * deviation

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
            self._following = self._latch.fault is None
            self._refuse('orientation not determined', f'standard deviation {deviation:.4f} rad, '
                         f'limit {self._limits.deviation:g}')
        if level > self.alert_limit:
            self._following = self._latch.fault is None
            noisy = [text for kind, text in self.cautions().items() if kind.startswith('noise')]
            self._refuse('protection level above the alert limit', ', '.join(
                [f'{degrees(level):.2f} deg, limit {degrees(self.alert_limit):g}', *noisy]))
        if self._limits.start_checked:
            never = self._exposure.unchecked()
            if never:
                self._refuse(f'{JOINT_NAMES[never[0]]} not checked yet: {_how_to_check(never[0])}',
                             'start_checked')
        if self._limits.unchecked_limit:
            self._check_exposure(stamp)
        return estimate

    def _check_exposure(self, stamp: int) -> None:
        since = 0.0 if self._since is None else (stamp - self._since) * 1e-9
        limit = self._limits.unchecked_limit
        if since <= limit:
            return
        for name, time in zip(JOINT_NAMES, self.unchecked(), strict=True):
            if min(time, since) > limit:
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
        raise RejectedError(reason, detail)


def _undetermined(symptom: Symptom) -> str:
    """Return a symptom's words, with the note that it isolates no sensor."""
    if symptom.sensor is not None or symptom.reason.startswith('no orientation'):
        return symptom.words
    return f'{symptom.reason}, sensor undetermined'


def _how_to_check(sensor: int) -> str:
    """Return where the other sensors can check a sensor."""
    if JOINT_NAMES[sensor] == 'joint_3a':
        return 'turn the handle about its axis, away from the singularity'
    return 'tilt the handle towards the centre of the workspace'


def _continued(quaternion: Quaternion, last: Quaternion | None) -> Quaternion:
    """Of q and -q return the one that continues `last`; at the beginning the one with w >= 0."""
    x, y, z, w = quaternion
    along = w if last is None else x * last[0] + y * last[1] + z * last[2] + w * last[3]
    return quaternion if along >= 0.0 else (-x, -y, -z, -w)
