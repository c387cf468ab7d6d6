# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Which orientations may go out, and how wrong one faulty sensor could have made them."""

from __future__ import annotations

from collections.abc import Collection
from math import degrees, inf, isfinite

from spm_haptic_master.kinematics.number_backends import Quaternion
from spm_haptic_master.supervision.anchor import Anchor, PRIOR_AGE, SAME_SOLUTION, within
from spm_haptic_master.supervision.exposure import Exposure
from spm_haptic_master.supervision.fault import Fault, FaultLatch, weight
from spm_haptic_master.supervision.isolation import Isolation
from spm_haptic_master.supervision.joint_monitors import JointMonitors
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.sample_clock import SampleClock
from spm_haptic_master.supervision.sensor_set import Sample, SensorSet
from spm_haptic_master.supervision.sensors_in_use import FOUR, SensorsInUse
from spm_haptic_master.supervision.solver import Angles, Solver
from spm_haptic_master.supervision.state_machine import StateMachine
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom, withheld
from spm_haptic_master.supervision.verdict import State, Verdict

# Periods without a sample that may hide whether a jump was a step (unit 1).
GAP_PERIODS = 5.0
# Samples between two evaluations of the noise.
NOISE_PERIOD = 16
# What is to do before any of four sensors counts as checked.
UNCONFIRMED = 'no sensor is checked before the handle has turned by 5 deg'
# What `state` says of a series of bad samples while the others go out.
SERIES = 'inconsistent angles again and again'


class Supervisor:
    """
    Decides about each joint sample of N = 4, 5 or 6 mounted sensors.

    Attributes
    ----------
    alert_limit : float
        Largest protection level of an orientation that is published, rad.
    parity : float or None
        Of the latest sample that has one, in standard deviations.
    parts : list of N float
        What an undetected fault of each sensor is bounded by, rad: its part of the protection
        level of the latest consistent sample; infinite where nothing bounds it.

    """

    def __init__(self, solver: Solver, sigma: tuple[float, ...], limits: Limits) -> None:
        self._limits, self._fewest = limits, min(FOUR, limits.fewest_sensors)
        self.alert_limit = limits.alert_limit
        self._clock = SampleClock()
        self._joints = JointMonitors(sigma, limits)
        self._sensors = SensorsInUse(solver, sigma, limits)
        self._anchor = Anchor(limits.joint_speed)
        self._exposure = Exposure(len(sigma), limits.window)
        self._latch = FaultLatch(Isolation(self._sensors), self._joints)
        self.parity: float | None = None
        self.parts = [inf] * len(sigma)
        # Stamp (ns) of the latest sample whose orientation the sensors did not determine.
        self._undetermined: int | None = None
        # Orientation published last.
        self._last: Quaternion[float] | None = None
        # Sensors that the parity could not check when all joints were last on their motion.
        self._hidden: Collection[int] = ()
        self._state = StateMachine()

    # One sample ---------------------------------------------------------------------------------

    def take(self, stamp: int, angles: Angles) -> Verdict:
        """
        Decide about a sample.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns; it has to grow from call to call.
        angles : tuple of N float
            Readings, rad: th1A, th1B, th1C, th3A, and th3B and th3C of such sensors; NaN of a
            sensor without a reading.

        """
        dt = self._clock.step(stamp)
        if dt < 0.0:
            if self._clock.was_set_back():
                self._restart()
            return self._withhold(stamp, withheld(Reason.OLD, f'{-dt:.6f} s older'))
        sensors = self._sensors
        is_gap = dt > GAP_PERIODS * self._clock.period > 0.0
        suspected = self._jumps(True) if is_gap else []
        if dt == inf:
            self._latch.latch_suspected(
                suspected, sensors.used is None or sensors.used.entries <= 1)
            self._restart()
            dt, suspected = 0.0, []
        if self._state.since is None:
            self._state.since = stamp
        if sensors.any_missing or not isfinite(sum(angles)):
            cause = sensors.note(angles)
            if cause is not None:
                return self._withhold(stamp, cause)
        away, symptoms = self._joints.check(angles, dt, self._clock, sensors.left_out)
        used = sensors.used
        if used is None or used.sensors.count < self._fewest:
            return self._withhold(stamp, withheld(Reason.MISSING, 'too few sensors in use'))
        # As Sample(...) and Verdict(...) do, without their calls.
        sample = tuple.__new__(Sample, (
            stamp, angles, self._anchor.prior(stamp), self._anchor.stamp, self._joints.bias,
            self._joints.factors))
        if self._joints.samples % NOISE_PERIOD == 0:
            self._joints.follow_noise(used.noise_bounds)
            symptoms += self._noisy(used, sample)
        self._solve(sample, used, symptoms)
        if suspected:
            symptoms += [jump for jump in suspected
                         if jump.sensor is None or not self._joints.returned(jump.sensor)]
        if away:
            symptoms += self._jumps(is_gap)
        else:
            self._hidden = self._exposure.hidden
        if symptoms:
            others = self._exclude(sample, used, symptoms)
            if others is not None:
                used, symptoms = others, []
                self._solve(sample, used, symptoms)
        if sensors.distrusted:
            sensors.readmit(sample, dt, self.alert_limit, bool(symptoms) and used.entries > 0)
        if symptoms:
            self._exposure.interrupt()
            return self._withhold(stamp, max(symptoms, key=weight))
        return self._consistent(stamp, used, dt)

    def _solve(self, sample: Sample, used: SensorSet, symptoms: list[Symptom]) -> None:
        """Solve a sample by the sensors in use; add what contradicts it."""
        symptom = used.take(sample)
        estimate, worth = used.estimate, used.worth
        excused = not symptoms
        if estimate is not None and worth is not None:
            if estimate.parity is not None:
                self.parity = estimate.parity
            excused = symptom is None
            if symptom is None:
                symptom = self._anchor.check(sample.stamp, estimate.quaternion, worth.deviation)
        if symptom is None:
            return
        last = self._undetermined
        if excused and last is not None and sample.stamp - last <= PRIOR_AGE:
            # Followed past what the sensors determine: no evidence against one of them.
            symptom = symptom._replace(reason=Reason.UNDETERMINED, severity=Severity.WITHHOLD)
            if estimate is not None:
                self._anchor.restart()
        symptoms.append(symptom)

    def _noisy(self, used: SensorSet, sample: Sample) -> list[Symptom]:
        """Return the sensor whose noise is beyond its part, if the others can do without it."""
        sensor = used.too_noisy(sample) if used.entries > 1 and self._may_go_on(used) else None
        if sensor is None:
            return []
        return [Symptom(Reason.NOISY, f'{degrees(self._joints.measured()[sensor]):.2f} deg',
                        sensor, Severity.LATCH)]

    def _jumps(self, is_gap: bool) -> list[Symptom]:
        """Return the sensors that jumped alone, where the parity cannot see it."""
        used = self._sensors.used
        if self._state.published is None or used is None:
            return []
        return self._joints.jumps(used.sensors.used, self._hidden, is_gap)

    def _exclude(self, sample: Sample, used: SensorSet,
                 symptoms: list[Symptom]) -> SensorSet | None:
        """Count a bad sample; return the sensors without the faulty one, if they can go on."""
        sensor = self._latch.note_bad(sample, used, symptoms)
        if sensor is None or not self._may_go_on(used) or (
                used.sensors.count <= FOUR and sample.prior is None):
            return None
        self._sensors.exclude(sensor)
        self._latch.end()
        return self._sensors.used

    def _may_go_on(self, used: SensorSet) -> bool:
        return used.sensors.count > self._limits.fewest_sensors

    # What is published --------------------------------------------------------------------------

    def _consistent(self, stamp: int, used: SensorSet, dt: float) -> Verdict:
        """Publish the orientation of a consistent sample, or withhold it for its worth."""
        estimate, worth = used.estimate, used.worth
        if estimate is None or worth is None:
            return self._withhold(stamp, withheld(Reason.UNDETERMINED, 'no estimate'))
        self._latch.note_consistent()
        deviation = worth.deviation
        if deviation > self._limits.deviation:
            self._undetermined = stamp
        if not estimate.determined:
            self._exposure.interrupt()
            return self._withhold(stamp, withheld(
                Reason.UNDETERMINED, f'standard deviation {deviation:.4f} rad'))
        quaternion = self._anchor.follow(stamp, estimate.quaternion)
        # A fault of one sensor with which all fit another orientation needs a single parity.
        right = self._anchor.confirmed or used.entries > 1
        parts = self.parts = used.levels()
        level = self._exposure.take(stamp, parts, self.alert_limit, right)
        if level < worth.healthy:
            level = worth.healthy
        fault = self._latch.fault
        if fault is not None:
            # Not onto another orientation with which all angles fit.
            same = right or (self._last is not None
                             and within(quaternion, self._last, SAME_SOLUTION))
            if not fault.clears(lambda sensor: same and self._exposure.seen(sensor, stamp),
                                self._joints.returned, used.sensors.used, dt,
                                self._limits.recovery):
                return self._withhold(stamp, fault.symptom)
            self._latch.end()
        cause = self._unworthy(stamp, deviation, level)
        if cause is not None:
            if not used.entries:
                # Two solutions of three sensors may meet: only all sensors can go on behind it.
                self._latch.fault = Fault(cause, (), True)
            return self._withhold(stamp, cause)
        if quaternion is not estimate.quaternion:
            estimate = estimate._replace(quaternion=quaternion)
        reservations = self._sensors.words if self._sensors.distrusted else \
            SERIES if self._latch.is_series else ''
        state, self._last = self._state, quaternion
        state.published = stamp
        if state.state is not State.HEALTHY or reservations:
            state.enter(stamp, None, None, reservations)
        return tuple.__new__(Verdict, (
            state.state, state.announced, estimate, level, None,
            self._sensors.names() if self._sensors.distrusted else ()))

    def _unworthy(self, stamp: int, deviation: float, level: float) -> Symptom | None:
        """Return why a consistent orientation is not published."""
        limits = self._limits
        if self._state.published is None and self._latch.clean < limits.start_samples:
            return withheld(Reason.STARTING, f'{self._latch.clean} consistent samples of '
                            f'{limits.start_samples}')
        if deviation > limits.deviation:
            return withheld(Reason.UNDETERMINED, f'standard deviation {deviation:.4f} rad, '
                            f'limit {limits.deviation:g}')
        if level > self.alert_limit:
            return withheld(Reason.UNPROTECTED, ', '.join([
                f'{degrees(level):.2f} deg, limit {degrees(self.alert_limit):g}',
                *self._joints.cautions().values()]))
        return self._exposure.overdue(stamp, limits, self._sensors.left_out)

    def _withhold(self, stamp: int, cause: Symptom) -> Verdict:
        self._state.enter(stamp, self._latch.fault, cause, '')
        return Verdict(self._state.state, self._state.announced, None, inf, cause,
                       self._sensors.names())

    def _restart(self) -> None:
        """Reset what does not survive a pause of the samples; a fault stays latched."""
        for part in (self._state, self._latch, self._sensors, self._exposure, self._anchor,
                     self._clock):
            part.restart()
        self._joints.reset_motion()

    # For those outside --------------------------------------------------------------------------

    def accepted(self) -> tuple[Quaternion[float], Angles] | None:
        """
        Return orientation and readings (rad) of the latest sample.

        None unless it is healthy and its orientation is that of all sensors.
        """
        quaternion = self._anchor.at(self._clock.stamp)
        if self._state.state is not State.HEALTHY or self._sensors.left_out or quaternion is None:
            return None
        return quaternion, self._joints.latest()

    def unchecked(self) -> tuple[float, ...]:
        """Return the seconds since each sensor was last checked by the others; inf before."""
        return self._exposure.times(self._clock.stamp or 0)

    def acknowledge(self) -> bool:
        """Let consistency clear two sensors that jumped; return whether a fault waited for it."""
        if self._latch.fault is None or not self._latch.fault.waits:
            return False
        self._latch.fault.acknowledge()
        return True

    def noise(self) -> tuple[float, ...]:
        """Return the standard deviation of each sensor's noise as measured, rad."""
        return self._joints.measured()

    def cautions(self) -> dict[str, str]:
        """Return what an engineer should check although orientations go out, by kind, in words."""
        if min(self.unchecked()) == inf and not self._anchor.confirmed:
            return self._joints.cautions() | {'unconfirmed': UNCONFIRMED}
        return self._joints.cautions() | self._exposure.cautions(self._clock.stamp or 0)
