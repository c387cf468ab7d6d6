# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations are published, and how wrong one faulty sensor could have made them.

`Supervisor.take` is the whole decision about one sample. A sample is *bad* if it contradicts its
limits, the other sensors or the last orientation; it is *consistent* otherwise. A consistent
sample is still withheld while a fault is latched, or if its orientation is not worth enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import degrees, inf

from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import Limits, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.anchor import Anchor
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault import Acknowledgement, FaultLatch
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.orientation_state import HEALTHY, OrientationState, StateMachine
from spm_haptic_master.supervision.protection import Integrity, protection_level
from spm_haptic_master.supervision.rivals import Rivals
from spm_haptic_master.supervision.sample import Angles, Place, PRIOR_AGE, Sample
from spm_haptic_master.supervision.sample_clock import SampleClock, Tick
from spm_haptic_master.supervision.sensors_in_use import plausible, SensorsInUse
from spm_haptic_master.supervision.solver import Solver
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld, worst
from spm_haptic_master.supervision.unseen_jumps import UnseenJumps

GAP_PERIODS = 5.0  # periods without a sample after which fast motion and a step look alike
NOISE_PERIOD = 16  # samples between two evaluations of the noise
# Time (s), beside the periods of `start_samples`, after which bad samples are no part of a start.
START_TIME = 1.0
# Words of `state` for a series of bad samples between orientations that are published.
SERIES = 'inconsistent angles again and again'


@dataclass(slots=True)
class Verdict:
    """
    The decision about one sample.

    Attributes
    ----------
    announced : OrientationState
        State after this sample. A silence shorter than `BRIEF` does not change it.
    estimate : SampleEstimate or None
        The orientation to publish, R_base_platform, with a quaternion that is continuous in sign;
        None if the sample is withheld.
    protection_level : float
        Largest error, rad, that an undetected fault of one checked sensor, noise and nominal bias
        may cause; infinite if the sample is withheld.
    cause : Symptom or None
        Why the sample is withheld; None if it is published.

    """

    announced: OrientationState
    estimate: SampleEstimate | None
    protection_level: float
    cause: Symptom | None = None


class Supervisor:
    """
    Decides about each joint sample of N = 4, 5 or 6 mounted sensors.

    Parameters
    ----------
    solver : Solver
        Orientations of a sample, for the mechanism and its working mode.
    sigma : tuple of float, length N
        Standard deviations of th1A, th1B, th1C, th3A, th3B, th3C, rad.
    limits : Limits
        Limits of a healthy device and of a published orientation.

    Attributes
    ----------
    alert_limit : float
        Largest protection level of an orientation that is published, rad. It may be changed
        between two samples.
    parity : float or None
        Parity of the latest sample, in standard deviations; None if that has none, as of three
        sensors.
    parts : list of float, length N
        Parts of the protection level of the latest sample, rad: what an undetected fault of each
        sensor is bounded by. Infinite where nothing bounds it, or the sample is not consistent.
    joints : JointMonitors
        Each joint by itself, with the noise as measured.
    latch : FaultLatch
        The fault, if one is latched.

    """

    def __init__(
        self,
        solver: Solver,
        sigma: tuple[float, ...],
        limits: Limits,
    ) -> None:
        self._limits = limits
        self.alert_limit = limits.alert_limit
        self._clock = SampleClock()
        self.joints = JointMonitors(sigma, limits)
        self._sensors = SensorsInUse(solver, sigma, limits)
        self._anchor = Anchor(limits.joint_speed)
        self._rivals = Rivals(
            self._sensors,
            len(sigma),
            limits.joint_speed,
            limits.joint_acceleration,
        )
        self._exposure = Exposure(len(sigma), limits.window)
        self._unseen_jumps = UnseenJumps(self.joints, self._exposure, self._rivals)
        self.latch = FaultLatch(self._sensors, self.joints, limits.recovery)
        self._state = StateMachine()
        self.parity: float | None = None
        # Parts of a sample that is not consistent: nothing bounds a fault.
        self._unbounded = [inf] * len(sigma)
        self.parts = self._unbounded
        # Number of the sample at which the noise was evaluated last.
        self._noise_sample = 0
        # Stamp (ns) of the latest sample whose orientation the sensors did not determine.
        self._undetermined: int | None = None
        # Orientation published last, and its readings (rad).
        self._published: tuple[Quaternion[float], Angles] | None = None

    def take(self, stamp: int, angles: Angles) -> Verdict:
        """
        Decide about a sample.

        First the time, then each joint by itself, then all sensors together. Each step adds
        symptoms; with any of them the sample is bad.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns, which has to grow. A stamp that does not is withheld as old.
        angles : tuple of float, length N
            th1A, th1B, th1C, th3A, and th3B and th3C of such sensors, rad; NaN of a sensor without
            a reading.

        Returns
        -------
        Verdict
            The orientation, or None and the cause.

        """
        self.parity = None
        self.parts = self._unbounded
        clock = self._clock
        tick = clock.step(stamp)
        if tick.is_old:
            return self._withhold_old(tick)
        is_gap = tick.restarts or tick.elapsed > GAP_PERIODS * clock.period > 0.0
        jumps_in_gap = self._jumps_in_gap(tick) if is_gap else []
        readings = plausible(angles)
        cause = self._note_readings(readings, angles)
        is_away, symptoms = self.joints.follow(
            readings,
            tick.elapsed,
            clock.period,
            clock.jitter,
            self._sensors.left_out,
        )
        sample = self._sample(readings)
        if cause is not None:
            return self._decide_bad(sample, [cause])
        symptoms += self._contradictions(sample)
        if jumps_in_gap:
            symptoms += self._staying(jumps_in_gap)
        if is_away:
            # What the parity sees is bad anyway: the jump gives it its name.
            symptoms += self._jumps(is_gap, any_step=is_gap or bool(symptoms))
        else:
            self._unseen_jumps.note_undisturbed(sample.stamp)
        if symptoms:
            return self._decide_bad(sample, symptoms)
        return self._decide_consistent(sample)

    def _withhold_old(self, tick: Tick) -> Verdict:
        """Withhold a sample whose stamp does not grow; restart if the clock was set back."""
        if tick.restarts:
            self._restart()
        return self._withhold(withheld(Reason.OLD, f'{-tick.elapsed:.6f} s older'))

    def _jumps_in_gap(self, tick: Tick) -> list[Symptom]:
        """
        Return the jumps of sensors that were off their motion when the samples stopped.

        After a pause they are a fault at once, because nothing of the motion before it is left to
        compare the next samples with. After a shorter gap they count if the sensor is still off
        its motion with this sample: see `_staying`.
        """
        jumps = self._jumps(is_gap=True, any_step=True)
        if not tick.restarts:
            return jumps
        self.latch.latch_jumps(self._clock.now, jumps)
        self._restart()
        return []

    def _staying(self, jumps: list[Symptom]) -> list[Symptom]:
        """Return those of some jumps whose sensor is not back on its motion with this sample."""
        return [jump for jump in jumps if not self.joints.has_returned(jump.sensor)]

    def _note_readings(self, readings: Angles, given: Angles) -> Symptom | None:
        """
        Note which sensors have a reading; return why these do not suffice, or None.

        `given` are the readings as they came, with those that no joint has.
        """
        cause = self._sensors.note_readings(readings)
        if cause is not None and readings is not given:
            return withheld(Reason.NOT_FINITE, f'{list(given)} rad')
        return cause

    def _sample(self, angles: Angles) -> Sample:
        """Return the angles with what the solution of this sample has to allow for."""
        clock = self._clock
        joints = self.joints
        return Sample(
            stamp=clock.now,
            angles=angles,
            prior=self._anchor.prior(clock.now),
            bias=joints.bias,
            factors=joints.factors,
            parity_bias=joints.parity_bias,
            period=clock.period,
        )

    def _contradictions(self, sample: Sample) -> list[Symptom]:
        """Return what all sensors together show of a sample: noise, then its solution."""
        symptoms = self._too_noisy(sample), self._solve(sample)
        return [symptom for symptom in symptoms if symptom is not None]

    def _too_noisy(self, sample: Sample) -> Symptom | None:
        """
        Evaluate the joints' noise every `NOISE_PERIOD` samples; return a sensor that is too noisy.

        It waits for a sample after one with an orientation, which bounds the noise by the parity.
        Noise alone is a symptom only if the others can go on without that sensor. Otherwise it
        raises the protection level.
        """
        used = self._sensors.used
        if self.joints.samples - self._noise_sample < NOISE_PERIOD or used.estimate is None:
            return None
        self._noise_sample = self.joints.samples
        self.joints.follow_noise(used.noise_bounds())
        return used.too_noisy(sample) if used.parity_count > 1 and self._may_exclude() else None

    def _solve(self, sample: Sample) -> Symptom | None:
        """
        Solve a sample by the sensors in use; return what contradicts it.

        For `PRIOR_AGE` after a sample that did not determine the orientation, angles that fit no
        orientation, or one that does not continue the last, are undetermined rather than a fault.
        """
        used = self._sensors.used
        symptom = used.solve(sample)
        if used.estimate is not None:
            self.parity = used.estimate.parity
        if symptom is None:
            symptom = self._follow_orientation(sample)
        if symptom is None:
            return None
        last = self._undetermined
        if symptom.reason is Reason.UNDETERMINED:
            self._undetermined = sample.stamp
        elif (
            symptom.reason in (Reason.NO_FIT, Reason.DISCONTINUOUS)
            and last is not None
            and sample.stamp - last <= PRIOR_AGE
        ):
            # Near where the sensors determine nothing neither is evidence against one of them.
            self._anchor.restart()
            return withheld(Reason.UNDETERMINED, symptom.detail)
        return symptom

    def _follow_orientation(self, sample: Sample) -> Symptom | None:
        """
        Compare a consistent orientation with the last one; follow the other hypotheses.

        Those are its rivals and, while a fault is latched, the sets that may replace the sensors
        in use. They are followed only if the orientation continues the last one and is determined.
        """
        estimate = self._sensors.used.estimate
        worth = self._sensors.used.worth
        if estimate is None or worth is None:
            return None
        symptom = self._anchor.discontinuity(sample, estimate.quaternion, worth.deviation)
        if symptom is None and estimate.determined:
            if self.latch.fault is not None:
                self._sensors.try_others(sample, self._rivals.place_without)
            self.parts = self._rivals.follow(sample, self.alert_limit)
        return symptom

    def _jumps(self, is_gap: bool, any_step: bool) -> list[Symptom]:
        """Return the jumps that the parity cannot show; see `UnseenJumps.found`."""
        if self._state.published is None:
            # Before the first orientation there is no motion to compare with.
            return []
        return self._unseen_jumps.found(self._sensors.used.members, is_gap, any_step)

    def _may_exclude(self) -> bool:
        """Whether the others can go on without one of the sensors in use."""
        return self._sensors.used.sensors.count > self._limits.fewest_sensors

    def _decide_bad(self, sample: Sample, symptoms: list[Symptom]) -> Verdict:
        """
        Withhold a sample that is not consistent, unless others take over.

        The rivals and the trials follow it, so that the truth of each hypothesis is known when the
        samples agree again. Others take over in two cases: a sensor is isolated and left out, or,
        while a fault is latched, a set has passed its trial in which one sensor replaces another.
        """
        sensors = self._sensors
        self._follow_inconsistent(sample)
        sensor = self.latch.note_bad(sample, symptoms)
        if sensor is not None and self._may_exclude() and self._agree_without(sample, sensor):
            sensors.exclude(sensor)
            return self._go_on_with_others(sample)
        if self.latch.fault is not None and sensors.exchange(sample.stamp):
            return self._go_on_with_others(sample)
        self._exposure.interrupt()
        self.parts = self._unbounded
        return self._withhold(worst(symptoms))

    def _follow_inconsistent(self, sample: Sample) -> None:
        """Follow the other hypotheses through a sample without an orientation."""
        self._rivals.follow_inconsistent(sample)
        self._sensors.try_others(sample, self._rivals.place_without)

    def _agree_without(self, sample: Sample, sensor: int) -> bool:
        """
        Whether the others have passed their trial without a sensor.

        Three always agree: they may go on only if no other sensor can have been wrong before,
        unseen.
        """
        if not self._sensors.are_trials_conclusive:
            return False
        return sensor in self._sensors.passing(sample.stamp, self.latch.onset)

    def _go_on_with_others(self, sample: Sample) -> Verdict:
        """
        Go on with other sensors, which have passed their trial with this sample.

        The fault ends, because the faulty sensor is no longer in use. Every window of checks
        restarts.
        """
        self.latch.end()
        self._exposure.interrupt()
        estimate = self._sensors.used.estimate
        if estimate is not None:
            self._rivals.last = Place(sample.stamp, estimate.quaternion)
            self.parts = self._rivals.follow(sample, self.alert_limit)
        return self._decide_consistent(sample)

    def _decide_consistent(self, sample: Sample) -> Verdict:
        """
        Publish the orientation of a consistent sample, or withhold it for its worth.

        It becomes the orientation that the next one has to continue even if it is not published.
        It is withheld while a fault is latched that is not over, and if `_unworthy` has a reason.
        """
        estimate = self._sensors.used.estimate
        worth = self._sensors.used.worth
        if estimate is None or worth is None or not estimate.determined:
            return self._withhold_undetermined(sample)
        here = self._continue(sample, estimate, worth)
        self._exposure.note_consistent(sample.stamp, self.parts, self.alert_limit)
        symptom = self._watch_left_out(sample, here)
        if symptom is not None:
            return self._decide_bad(sample, [symptom])
        fault = self.latch.fault
        if fault is not None and not self.latch.end_if_over(self._exposure, sample.stamp):
            return self._withhold(fault.symptom)
        self._sensors.end_trials()
        level = protection_level(self.parts, self.alert_limit, worth.healthy)
        cause = self._unworthy(sample.stamp, worth.deviation, level)
        if cause is None:
            return self._publish(sample, estimate, here.quaternion, level)
        return self._withhold_unworthy(sample.stamp, cause)

    def _continue(self, sample: Sample, estimate: SampleEstimate, worth: Integrity) -> Place:
        """
        Let the next sample continue a consistent orientation; return it, continuous in sign.

        If noise or bias may take it to another solution, or its total standard deviation is too
        large, samples that do not continue it are no evidence of a fault.
        """
        self.latch.note_consistent()
        here = self._anchor.follow(sample.stamp, estimate.quaternion, worth.fold_share)
        if self._anchor.place is None or worth.deviation > self._limits.deviation:
            self._undetermined = sample.stamp
        self._rivals.last = here
        return here

    def _withhold_unworthy(self, stamp: int, cause: Symptom) -> Verdict:
        """Withhold a consistent orientation that is not worth enough."""
        is_unsure = cause.reason in (Reason.UNDETERMINED, Reason.UNPROTECTED)
        if is_unsure and not self._sensors.used.parity_count:
            # Two solutions of three sensors may meet here, and three cannot tell on which of them
            # they go on: the fault waits for all sensors.
            self.latch.latch(stamp, cause)
        return self._withhold(cause)

    def _watch_left_out(self, sample: Sample, here: Place) -> Symptom | None:
        """
        Note what the others find after a fault, and about the sensors that are left out.

        Returns a symptom if a sensor that had come back to three others contradicts them again.
        """
        if self.latch.fault is not None:
            parts = self._rivals.parts(here, self.latch.onset)
            self._exposure.note_after_fault(sample.stamp, parts, self.alert_limit)
        if not self._sensors.distrusted:
            return None
        return self._sensors.readmit(sample, here, self.alert_limit, self.joints.has_returned)

    def _publish(
        self,
        sample: Sample,
        estimate: SampleEstimate,
        quaternion: Quaternion[float],
        level: float,
    ) -> Verdict:
        """Publish an orientation, with a quaternion that is continuous in sign."""
        if quaternion is not estimate.quaternion:
            estimate = estimate.with_orientation(quaternion, estimate.covariance)
        reservations = self._sensors.words or (SERIES if self.latch.is_series else '')
        self._published = quaternion, sample.angles
        self._state.publish(sample.stamp, reservations)
        return Verdict(self._state.announced, estimate, level)

    def _withhold_undetermined(self, sample: Sample) -> Verdict:
        """Withhold an orientation that the sensors do not determine."""
        self._undetermined = sample.stamp
        self.latch.note_withheld()
        self._anchor.restart()
        self._exposure.interrupt()
        self._follow_inconsistent(sample)
        self.parts = self._unbounded
        detail = f'standard deviation above {DETERMINED_DEVIATION:g} rad'
        return self._withhold(withheld(Reason.UNDETERMINED, detail))

    def _unworthy(self, stamp: int, deviation: float, level: float) -> Symptom | None:
        """
        Return why a consistent orientation is not published; None if it is.

        In this order: too few consistent samples before the first orientation, a total standard
        deviation above the limit (rad), a protection level above the alert limit (rad), and a
        sensor that has not been checked, or not for too long.
        """
        limits = self._limits
        samples = self.latch.consistent
        due = limits.start_samples
        if self._state.published is None and samples < due:
            return withheld(Reason.STARTING, f'{samples} consistent samples of {due}')
        if deviation > limits.deviation:
            detail = f'standard deviation {deviation:.4f} rad, limit {limits.deviation:g}'
            return withheld(Reason.UNDETERMINED, detail)
        if level > self.alert_limit:
            detail = f'{degrees(level):.2f} deg, limit {degrees(self.alert_limit):g}'
            cautions = self.joints.cautions().values()
            return withheld(Reason.UNPROTECTED, ', '.join([detail, *cautions]))
        return self._exposure.overdue(stamp, limits, self._sensors.left_out)

    def _withhold(self, cause: Symptom) -> Verdict:
        """Return the verdict of a sample that is not published, and let the state follow."""
        fault = self.latch.words or self._interruption()
        self._state.withhold(self._clock.now, fault, cause)
        return Verdict(
            announced=self._state.announced, estimate=None, protection_level=inf, cause=cause
        )

    def _interruption(self) -> str:
        """
        Return what keeps interrupting the samples before the first orientation, in words.

        Empty if nothing does, or not for longer than `START_TIME` and the samples of a start.
        """
        cause = self.latch.latest_cause
        since = self._state.waiting_since
        due = self._limits.start_samples
        if cause is None or since is None or self._state.published is not None:
            return ''
        longest = START_TIME + due * self._clock.period
        is_start = (self._clock.now - since) * 1e-9 <= longest
        return '' if is_start or self.latch.consistent >= due else cause.words

    def _restart(self) -> None:
        """
        Reset what does not survive a pause of the samples; a fault stays latched.

        The sensors that are left out stay so, and the time since each sensor was last checked goes
        on.
        """
        self._state.restart()
        self.latch.restart()
        self._sensors.restart()
        self._exposure.restart()
        self._unseen_jumps.restart()
        self._anchor.restart()
        self._rivals.restart()
        self._clock.restart()
        self.joints.restart()

    def acknowledge(self) -> Acknowledgement:
        """
        Let a person end a fault that the samples cannot end.

        Returns
        -------
        Acknowledgement
            What it ended, and what the fault still waits for, in words.

        """
        return self.latch.acknowledge()

    def accepted(self) -> tuple[Quaternion[float], Angles] | None:
        """
        Return orientation and readings of the latest sample if it is healthy.

        Returns
        -------
        tuple or None
            Quaternion x, y, z, w of R_base_platform and the N readings, rad; None if the latest
            sample was withheld, the state is not healthy, or a sensor is left out.

        """
        state = self._state
        is_healthy = state.announced == HEALTHY and not self._sensors.left_out
        return self._published if is_healthy and state.published == self._clock.now else None

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked; inf before the first time."""
        return self._exposure.times(self._clock.now)

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations are published, by kind."""
        return self.joints.cautions() | self._exposure.cautions(self._clock.now)


def make_supervisor(values: Values) -> Supervisor:
    """
    Return the supervisor that checked settings describe.

    Parameters
    ----------
    values : mapping
        Checked values of `FKM_SETTINGS` by name.

    Returns
    -------
    Supervisor
        In its first state: no sample yet, no fault.

    Raises
    ------
    SettingError
        Settings contradict each other: see `limits_from`.

    """
    limits = limits_from(values)
    sigma = sigma_from(values)
    solver = Solver(geometry_from(values), sigma, values['working_mode'], limits.bias)
    return Supervisor(solver, sigma, limits)
