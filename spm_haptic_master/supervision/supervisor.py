# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which orientations may go out, and how wrong one faulty sensor could have made them."""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, inf
from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import Limits, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.anchor import Anchor, PRIOR_AGE
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault import Acknowledgement, FaultLatch
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.orientation_state import HEALTHY, OrientationState, StateMachine
from spm_haptic_master.supervision.rivals import FRESH_PERIODS, FRESH_TIME, Rivals
from spm_haptic_master.supervision.sample_clock import SampleClock, Tick
from spm_haptic_master.supervision.sensor_set import Angles, Sample, SensorSet, Solver
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld, worst
from spm_haptic_master.supervision.trial import Place

GAP_PERIODS = 5.0  # periods without a sample after which fast motion and a step look alike
NOISE_PERIOD = 16  # samples between two evaluations of the noise
# What `state` says of a series of bad samples while the others go out.
SERIES = 'inconsistent angles again and again'


class Verdict(NamedTuple):
    """The decision about one sample."""

    announced: OrientationState  # a silence shorter than `BRIEF` does not change it
    estimate: SampleEstimate | None  # continuous in sign; None where the sample is withheld
    # Largest error, rad, that an undetected fault of one checked sensor, noise and nominal bias
    # may cause; infinite where the sample is withheld.
    protection_level: float
    cause: Symptom | None = None  # why the sample is withheld


class Supervisor:
    """
    Decides about each joint sample of N = 4, 5 or 6 mounted sensors.

    `alert_limit` is the largest protection level of an orientation that is published, rad;
    `parity` that of the latest sample that has one, in standard deviations; `parts` (N) the parts
    of the protection level of the latest consistent sample, rad: what an undetected fault of each
    sensor is bounded by. `joints` have the noise as measured, `latch` has the fault.
    """

    def __init__(self, solver: Solver, sigma: tuple[float, ...], limits: Limits) -> None:
        self._limits, self.alert_limit = limits, limits.alert_limit
        self._clock = SampleClock()
        self.joints = JointMonitors(sigma, limits)
        self._sensors = SensorsInUse(solver, sigma, limits)
        self._anchor = Anchor(limits.joint_speed, max(sigma), max(limits.bias))
        self._rivals = Rivals(self._sensors, len(sigma), limits.joint_speed)
        self._exposure = Exposure(len(sigma), limits.window)
        self.latch = FaultLatch(self._sensors, self.joints, limits.recovery)
        self._state = StateMachine()
        self.parity: float | None = None
        self.parts = [inf] * len(sigma)
        # Stamp (ns) of the latest sample whose orientation the sensors did not determine.
        self._undetermined: int | None = None
        # Orientation published last, and its readings (rad).
        self._last: tuple[Quaternion[float], Angles] | None = None
        # Sensors that the parity could not check when all joints were last on their motion, and
        # the stamp (ns) of that sample.
        self._hidden: Collection[int] = ()
        self._undisturbed = 0

    def take(self, stamp: int, angles: Angles) -> Verdict:
        """
        Decide about a sample.

        `stamp` is its time, ns, which has to grow; `angles` are th1A, th1B, th1C, th3A, and th3B
        and th3C of such sensors, rad; NaN of a sensor without a reading.
        """
        clock = self._clock
        tick = clock.step(stamp)
        if tick.is_old:
            if tick.restarts:
                self._restart()
            return self._withhold(withheld(Reason.OLD, f'{-tick.elapsed:.6f} s older'))
        is_gap = tick.restarts or tick.elapsed > GAP_PERIODS * clock.period > 0.0
        suspected = self._jumps(is_gap=True) if is_gap else []
        if tick.restarts:
            self.latch.latch_suspected(clock.now, suspected)
            self._restart()
            suspected = []
        cause = self._sensors.note(angles)
        if cause is not None and cause.reason is Reason.NOT_FINITE:
            return self._withhold(cause)
        away, symptoms = self.joints.check(
            angles,
            tick.elapsed,
            clock.period or tick.elapsed,
            clock.jitter,
            self._sensors.left_out,
        )
        sample = self._sample(angles)
        if cause is not None:
            return self._bad(sample, tick, [cause])
        self._check_noise(sample, symptoms)
        self._solve(sample, symptoms)
        symptoms += [jump for jump in suspected if not self.joints.has_returned(jump.sensor)]
        if away:
            symptoms += self._jumps(is_gap)
        else:
            self._hidden, self._undisturbed = self._exposure.hidden, sample.stamp
        if symptoms:
            return self._bad(sample, tick, symptoms)
        return self._consistent(sample, tick)

    def _sample(self, angles: Angles) -> Sample:
        now = self._clock.now
        return Sample(
            now,
            angles,
            self._anchor.prior(now),
            self._anchor.stamp,
            self.joints.bias,
            self.joints.factors,
            self.joints.parity_bias,
            self._clock.period,
        )

    @property
    def _fresh(self) -> int:
        """Longest time between two samples that follow shortly, ns."""
        return min(round(FRESH_PERIODS * self._clock.period * 1e9), FRESH_TIME)

    def _check_noise(self, sample: Sample, symptoms: list[Symptom]) -> None:
        """Evaluate the joints' noise from time to time; add the sensor that is too noisy."""
        if self.joints.samples % NOISE_PERIOD:
            return
        used = self._sensors.used
        self.joints.follow_noise(used.noise_bounds)
        noisy = used.too_noisy(sample)
        if noisy is not None and used.entries > 1 and self._may_exclude():
            symptoms.append(noisy)

    def _solve(self, sample: Sample, symptoms: list[Symptom]) -> None:
        """Solve a sample by the sensors in use; add what contradicts it."""
        used = self._sensors.used
        symptom = used.take(sample)
        if symptom is None:
            symptom = self._continued(sample, used)
        elif used.estimate is not None:
            self.parity = used.estimate.parity or self.parity
        if symptom is None:
            return
        last = self._undetermined
        if symptom.reason is Reason.UNDETERMINED:
            self._undetermined = sample.stamp
        elif (
            symptom.reason in (Reason.NO_FIT, Reason.DISCONTINUOUS)
            and last is not None
            and sample.stamp - last <= PRIOR_AGE
        ):
            # Where the sensors determine nothing it is no evidence against one of them.
            symptom = withheld(Reason.UNDETERMINED, symptom.detail)
            self._anchor.restart()
        symptoms.append(symptom)

    def _continued(self, sample: Sample, used: SensorSet) -> Symptom | None:
        """Compare a consistent orientation with the last one, and with its rivals."""
        estimate, worth = used.estimate, used.worth
        if estimate is None or worth is None:
            return None
        if estimate.parity is not None:
            self.parity = estimate.parity
        symptom = self._anchor.check(
            sample.stamp, sample.period, estimate.quaternion, worth.deviation
        )
        if symptom is None and estimate.determined:
            if self.latch.fault is not None:
                self._sensors.try_others(sample, self._rivals.place_without, self._fresh)
            self.parts = self._rivals.look(sample, used, estimate, self.alert_limit, self._fresh)
        return symptom

    def _jumps(self, is_gap: bool) -> list[Symptom]:
        """Return the sensors that jumped alone, where the parity cannot see it."""
        if self._state.published is None:
            return []
        hidden = {*self._hidden, *self._rivals.born_since(self._undisturbed)}
        return self.joints.jumps(self._sensors.used.sensors.used, hidden, is_gap)

    def _may_exclude(self) -> bool:
        """Whether the others can go on without one of the sensors in use."""
        return self._sensors.used.sensors.count > self._limits.fewest_sensors

    def _bad(self, sample: Sample, tick: Tick, symptoms: list[Symptom]) -> Verdict:
        """Withhold a sample that is not consistent, unless others take over."""
        sensors = self._sensors
        self._rivals.withheld(sample)
        sensors.try_others(sample, self._rivals.place_without, self._fresh)
        sensor = self.latch.note_bad(sample, symptoms)
        if sensor is not None and self._may_exclude() and self._passes(sample, sensor):
            sensors.exclude(sensor)
            return self._taken_over(sample, tick)
        if self.latch.fault is not None and sensors.exchange(sample.stamp):
            return self._taken_over(sample, tick)
        self._exposure.interrupt()
        return self._withhold(worst(symptoms))

    def _passes(self, sample: Sample, sensor: int) -> bool:
        return sensor in self._sensors.passing(sample.stamp, self.latch.onset)

    def _taken_over(self, sample: Sample, tick: Tick) -> Verdict:
        """Go on with other sensors, which have passed their trial with this sample."""
        self.latch.end()
        self._exposure.interrupt()
        used = self._sensors.used
        estimate = used.estimate
        if estimate is None or used.worth is None:
            return self._withhold(withheld(Reason.UNDETERMINED, 'no orientation'))
        self._rivals.accept(sample, estimate)
        self.parts = self._rivals.look(sample, used, estimate, self.alert_limit, self._fresh)
        return self._consistent(sample, tick)

    def _consistent(self, sample: Sample, tick: Tick) -> Verdict:
        """Publish the orientation of a consistent sample, or withhold it for its worth."""
        used, stamp = self._sensors.used, sample.stamp
        estimate, worth = used.estimate, used.worth
        self.latch.note_consistent()
        if estimate is None or worth is None or not estimate.determined:
            return self._undetermine(sample)
        quaternion = self._anchor.follow(stamp, estimate.quaternion, worth.deviation)
        if self._anchor.stamp is None or worth.deviation > self._limits.deviation:
            self._undetermined = stamp
        self._rivals.accept(sample, estimate)
        level = self._exposure.take(stamp, self.parts, self.alert_limit, worth.healthy)
        symptom = self._watch_left_out(sample, quaternion)
        if symptom is not None:
            return self._bad(sample, tick, [symptom])
        if not self.latch.clears(self._exposure, stamp):
            return self._withhold(self.latch.fault.symptom if self.latch.fault else None)
        if self.latch.fault is not None:
            self.latch.end()
        self._sensors.end_trials()
        cause = self._unworthy(stamp, worth.deviation, level)
        if cause is None:
            return self._publish(sample, estimate, quaternion, level)
        if not used.entries:
            # Two solutions of three sensors may meet: only all sensors can continue after it.
            self.latch.latch(stamp, cause)
        return self._withhold(cause)

    def _watch_left_out(self, sample: Sample, quaternion: Quaternion[float]) -> Symptom | None:
        """Note what the others see after a fault, and of the sensors that are left out."""
        here = Place(sample.stamp, quaternion)
        if self.latch.fault is not None:
            parts = self._rivals.parts_since(here, self.latch.onset)
            self._exposure.take_after_fault(sample.stamp, parts, self.alert_limit)
        if not self._sensors.distrusted:
            return None
        return self._sensors.readmit(sample, here, self.alert_limit)

    def _publish(
        self,
        sample: Sample,
        estimate: SampleEstimate,
        quaternion: Quaternion[float],
        level: float,
    ) -> Verdict:
        """Publish an orientation, with a quaternion that is continuous in sign."""
        if quaternion is not estimate.quaternion:
            estimate = estimate._replace(quaternion=quaternion)
        reservations = self._sensors.words or (SERIES if self.latch.is_series else '')
        self._last, self._state.published = (quaternion, sample.angles), sample.stamp
        if self._state.announced is not HEALTHY or reservations:
            self._state.enter(sample.stamp, '', None, reservations)
        return Verdict(self._state.announced, estimate, level)

    def _undetermine(self, sample: Sample) -> Verdict:
        """Withhold an orientation that the sensors do not determine."""
        self._undetermined = sample.stamp
        self._anchor.restart()
        self._exposure.interrupt()
        self._rivals.withheld(sample)
        self._sensors.try_others(sample, self._rivals.place_without, self._fresh)
        detail = f'standard deviation above {DETERMINED_DEVIATION:g} rad'
        return self._withhold(withheld(Reason.UNDETERMINED, detail))

    def _unworthy(self, stamp: int, deviation: float, level: float) -> Symptom | None:
        """Return why a consistent orientation is not published."""
        limits, clean = self._limits, self.latch.clean
        if self._state.published is None and clean < limits.start_samples:
            return withheld(
                Reason.STARTING, f'{clean} consistent samples of {limits.start_samples}'
            )
        if deviation > limits.deviation:
            return withheld(
                Reason.UNDETERMINED,
                f'standard deviation {deviation:.4f} rad, limit {limits.deviation:g}',
            )
        if level > self.alert_limit:
            return withheld(
                Reason.UNPROTECTED,
                ', '.join(
                    [
                        f'{degrees(level):.2f} deg, limit {degrees(self.alert_limit):g}',
                        *self.joints.cautions().values(),
                    ]
                ),
            )
        return self._exposure.overdue(stamp, limits, self._sensors.left_out)

    def _withhold(self, cause: Symptom | None) -> Verdict:
        self._state.enter(self._clock.now, self.latch.words, cause, '')
        return Verdict(self._state.announced, None, inf, cause)

    def _restart(self) -> None:
        """Reset what does not survive a pause of the samples; a fault stays latched."""
        self._undetermined = None
        for part in (
            self._state,
            self.latch,
            self._sensors,
            self._exposure,
            self._anchor,
            self._rivals,
            self._clock,
            self.joints,
        ):
            part.restart()

    def acknowledge(self) -> Acknowledgement:
        """Let a person end a fault that the samples cannot end."""
        return self.latch.acknowledge()

    def accepted(self) -> tuple[Quaternion[float], Angles] | None:
        """Return orientation and readings (rad) of the latest sample if it is healthy, of all."""
        state = self._state
        is_all = state.announced is HEALTHY and not self._sensors.left_out
        return self._last if is_all and state.published == self._clock.now else None

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked by the others; inf before."""
        return self._exposure.times(self._clock.now)

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations go out, by kind, in words."""
        return self.joints.cautions() | self._exposure.cautions(self._clock.now)


def make_supervisor(values: Values) -> Supervisor:
    """Return the supervisor that checked settings describe; SettingError as `limits_from`."""
    limits, sigma = limits_from(values), sigma_from(values)
    solver = Solver(geometry_from(values), sigma, values['working_mode'], limits.bias)
    return Supervisor(solver, sigma, limits)
