# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which orientations may go out, and how wrong one faulty sensor could have made them."""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, inf, isfinite
from typing import NamedTuple

from spm_haptic_master.kinematics.estimation.gauss_newton import (
    DETERMINED_DEVIATION,
    SampleEstimate,
)
from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.parameters.fkm import FOUR, Limits, limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.anchor import Anchor, PRIOR_AGE, SAME_SOLUTION, within
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault import FaultLatch
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.orientation_state import HEALTHY, OrientationState, StateMachine
from spm_haptic_master.supervision.sensor_set import Angles, Sample, SensorSet, Solver
from spm_haptic_master.supervision.sensors_in_use import SensorsInUse
from spm_haptic_master.supervision.symptom import Reason, Symptom, withheld, worst

GAP_PERIODS = 5.0  # without a sample, which may hide whether a jump was a step
RESTART_GAP = 0.5  # s; the motion before such a gap is of no use
OLDER_SAMPLES = 100  # consecutive samples with older stamps: the clock was set back
PERIOD_SAMPLES = 50.0  # over which period and jitter are averaged
LONGEST_GAP = 20.0  # periods that a longer gap counts for in the average
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


class SampleClock:
    """
    Times between samples.

    `stamp` is the latest stamp, ns, None before the first; `period` the usual time between
    samples, s, 0 before the second; `jitter` the mean deviation from it, s.
    """

    def __init__(self) -> None:
        self.stamp: int | None = None
        # Stamps in a row that went back.
        self._older = 0
        self.restart()

    def restart(self) -> None:
        """Forget the period."""
        self.period = self.jitter = 0.0

    def step(self, stamp: int) -> float:
        """
        Return the time since the last sample, s, and take the stamp in.

        0 at the first sample, infinite after a gap that ends the motion, negative where the stamp
        does not grow (it is not taken in then), negative infinite once that shows that the clock
        was set back: the next sample is then the first one.
        """
        if self.stamp is None:
            self.stamp = stamp
            return 0.0
        dt = (stamp - self.stamp) * 1e-9
        if dt <= 0.0:
            self._older += 1
            if self._older < OLDER_SAMPLES:
                return dt or -1e-9
            self.stamp, self._older = None, 0
            return -inf
        self.stamp, self._older = stamp, 0
        if dt > RESTART_GAP:
            return inf
        period = self.period or dt
        self.period = period + (min(dt, LONGEST_GAP * period) - period) / PERIOD_SAMPLES
        if dt < 1.5 * period:
            self.jitter += (abs(dt - period) - self.jitter) / PERIOD_SAMPLES
        return dt


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
        self._exposure = Exposure(len(sigma), limits.window)
        self.latch = FaultLatch(self._sensors, self.joints, limits.recovery)
        self._state = StateMachine()
        self.parity: float | None = None
        self.parts = [inf] * len(sigma)
        # Stamp (ns) of the latest sample whose orientation the sensors did not determine.
        self._undetermined: int | None = None
        # Orientation published last, and its readings (rad).
        self._last: tuple[Quaternion[float], Angles] | None = None
        # Sensors that the parity could not check when all joints were last on their motion.
        self._hidden: Collection[int] = ()

    def take(self, stamp: int, angles: Angles) -> Verdict:
        """
        Decide about a sample.

        `stamp` is its time, ns, which has to grow; `angles` are th1A, th1B, th1C, th3A, and th3B
        and th3C of such sensors, rad; NaN of a sensor without a reading.
        """
        clock = self._clock
        dt = clock.step(stamp)
        if dt < 0.0:
            if dt == -inf:
                self._restart()
            return self._withhold(stamp, withheld(Reason.OLD, f'{-dt:.6f} s older'))
        sensors, joints = self._sensors, self.joints
        is_gap = dt > GAP_PERIODS * clock.period > 0.0
        suspected = self._jumps(True) if is_gap else []
        if dt == inf:
            self.latch.latch_suspected(suspected)
            self._restart()
            dt, suspected = 0.0, []
        if sensors.missing or not isfinite(sum(angles)):
            cause = sensors.note(angles)
            if cause is not None:
                return self._withhold(stamp, cause)
        away, symptoms = joints.check(
            angles, dt, clock.period or dt, clock.jitter, sensors.left_out
        )
        used = sensors.used
        # As Sample(...) and Verdict(...) do, without their calls.
        sample = tuple.__new__(
            Sample,
            (
                stamp,
                angles,
                self._anchor.prior(stamp),
                self._anchor.stamp,
                joints.bias,
                joints.factors,
                joints.parity_bias,
            ),
        )
        if joints.samples % NOISE_PERIOD == 0:
            joints.follow_noise(used.noise_bounds)
            noisy = used.too_noisy(sample)
            if noisy is not None and used.entries > 1 and self._may_exclude(sample):
                symptoms.append(noisy)
        self._solve(sample, used, symptoms)
        symptoms += [jump for jump in suspected if not joints.returned(jump.sensor)]
        if away:
            symptoms += self._jumps(is_gap)
        else:
            self._hidden = self._exposure.hidden
        if symptoms:
            sensor = self.latch.note_bad(sample, symptoms)
            if sensor is not None and self._may_exclude(sample):
                sensors.exclude(sensor)
                self.latch.end()
                used, symptoms = sensors.used, []
                self._solve(sample, used, symptoms)
        if sensors.distrusted:
            sensors.readmit(sample, dt, self.alert_limit, bool(symptoms) and used.entries > 0)
        if symptoms:
            self._exposure.interrupt()
            return self._withhold(stamp, worst(symptoms))
        return self._consistent(sample, used, dt)

    def _solve(self, sample: Sample, used: SensorSet, symptoms: list[Symptom]) -> None:
        """Solve a sample by the sensors in use; add what contradicts it."""
        symptom = used.take(sample)
        estimate, worth, last = used.estimate, used.worth, self._undetermined
        if estimate is not None and worth is not None:
            if estimate.parity is not None:
                self.parity = estimate.parity
            if symptom is None:
                symptom = self._anchor.check(sample.stamp, estimate.quaternion, worth.deviation)
        if symptom is None:
            return
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

    def _jumps(self, is_gap: bool) -> list[Symptom]:
        """Return the sensors that jumped alone, where the parity cannot see it."""
        if self._state.published is None:
            return []
        return self.joints.jumps(self._sensors.used.sensors.used, self._hidden, is_gap)

    def _may_exclude(self, sample: Sample) -> bool:
        """Whether the others can continue without a sensor; three need the last orientation."""
        count = self._sensors.used.sensors.count
        return count > self._limits.fewest_sensors and (count > FOUR or sample.prior is not None)

    def _consistent(self, sample: Sample, used: SensorSet, dt: float) -> Verdict:
        """Publish the orientation of a consistent sample, or withhold it for its worth."""
        stamp, estimate, worth = sample.stamp, used.estimate, used.worth
        latch, state = self.latch, self._state
        latch.note_consistent()
        if estimate is None or worth is None or not estimate.determined:
            self._undetermined = stamp
            self._anchor.restart()
            self._exposure.interrupt()
            return self._withhold(
                stamp,
                withheld(
                    Reason.UNDETERMINED, f'standard deviation above {DETERMINED_DEVIATION:g} rad'
                ),
            )
        quaternion = self._anchor.follow(stamp, estimate.quaternion, used.deviation)
        if self._anchor.stamp is None or worth.deviation > self._limits.deviation:
            self._undetermined = stamp
        # A fault of one sensor with which all fit another orientation needs a single parity.
        right = self._anchor.confirmed or used.entries > 1
        parts = self.parts = used.levels(worth)
        level = self._exposure.take(stamp, parts, self.alert_limit, right, worth.healthy)
        if latch.symptom is not None:
            # Not onto another orientation with which all angles fit.
            same = right or (
                self._last is not None and within(quaternion, self._last[0], SAME_SOLUTION)
            )
            if not latch.clears(lambda sensor: same and self._exposure.seen(sensor, stamp), dt):
                return self._withhold(stamp, latch.symptom)
            latch.end()
        cause = self._unworthy(stamp, worth.deviation, level)
        if cause is not None:
            if not used.entries:
                # Two solutions of three sensors may meet: only all sensors can continue after it.
                latch.latch(cause)
            return self._withhold(stamp, cause)
        if quaternion is not estimate.quaternion:
            estimate = estimate._replace(quaternion=quaternion)
        reservations = self._sensors.words or (SERIES if latch.is_series else '')
        self._last, state.published = (quaternion, sample.angles), stamp
        if state.announced is not HEALTHY or reservations:
            state.enter(stamp, '', None, reservations)
        return tuple.__new__(Verdict, (state.announced, estimate, level, None))

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

    def _withhold(self, stamp: int, cause: Symptom) -> Verdict:
        self._state.enter(stamp, self.latch.words, cause, '')
        return Verdict(self._state.announced, None, inf, cause)

    def _restart(self) -> None:
        """Reset what does not survive a pause of the samples; a fault stays latched."""
        for part in (
            self._state,
            self.latch,
            self._sensors,
            self._exposure,
            self._anchor,
            self._clock,
            self.joints,
        ):
            part.restart()

    def accepted(self) -> tuple[Quaternion[float], Angles] | None:
        """Return orientation and readings (rad) of the latest sample if it is healthy, of all."""
        state = self._state
        is_all = state.announced is HEALTHY and not self._sensors.left_out
        return self._last if is_all and state.published == self._clock.stamp else None

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked by the others; inf before."""
        return self._exposure.times(self._clock.stamp or 0)

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations go out, by kind, in words."""
        return self.joints.cautions() | self._exposure.cautions(
            self._clock.stamp or 0, self._anchor.confirmed
        )


def make_supervisor(values: Values) -> Supervisor:
    """Return the supervisor that checked settings describe; SettingError as `limits_from`."""
    limits, sigma = limits_from(values), sigma_from(values)
    solver = Solver(
        geometry_from(values), sigma, values['solver'], values['working_mode'], limits.bias
    )
    return Supervisor(solver, sigma, limits)
