# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All joints by themselves: the symptoms of each, and the noise and delay to allow for."""

from __future__ import annotations

from math import degrees

from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.supervision.joint_monitor import FORGET_PERIODS, JointMonitor
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.sample_clock import JITTER_DEVIATIONS, SampleClock
from spm_haptic_master.supervision.solver import Angles
from spm_haptic_master.supervision.symptom import Symptom

# Equal readings before the latest one from which on a run is evaluated (samples).
FIRST_RUN = 4
# Samples between two evaluations of the noise (samples).
NOISE_PERIOD = 16
# Measured over configured noise from which on it is counted (unit 1): what an average over 256
# samples does not reach by chance, with the quantisation of a 12-bit encoder.
NOISE_FACTOR = 1.25
# The same from which on it is a caution (unit 1): jitter of the sampling may add a quarter.
NOISE_CAUTION = 1.5


class JointMonitors:
    """
    One monitor a joint.

    Parameters
    ----------
    sigma : tuple of N float
        Configured standard deviations of the sensors' noise, rad.
    limits : Limits
        What is healthy.

    Attributes
    ----------
    factors : tuple of N float
        Measured noise of each sensor over the configured one where it is well above, else 1.
    noise : float
        Largest of them.

    """

    def __init__(self, sigma: tuple[float, ...], limits: Limits) -> None:
        threshold = limits.threshold
        self._limits = limits
        self._sigma = sigma
        self._joints = tuple(
            JointMonitor(deviation, threshold, limits.joint_acceleration) for deviation in sigma)
        self.factors: tuple[float, ...] = (1.0,) * len(sigma)
        self.noise = 1.0

    # Symptoms -----------------------------------------------------------------------------------

    def check(self, angles: Angles, dt: float, clock: SampleClock) -> list[Symptom]:
        """Hold each reading against its joint's range and motion, and follow the motion."""
        limits = self._limits
        period = clock.period or dt
        timing = limits.skew + JITTER_DEVIATIONS * clock.jitter
        speed = limits.joint_speed
        symptoms: list[Symptom] = []
        for joint, reading, low, high in zip(  # noqa: B905, one each
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
        name = ALL_JOINT_NAMES[sensor]
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
                'frozen', f'{ALL_JOINT_NAMES[sensor]} {joint.run + 1} equal readings', sensor,
                fault=fault, passive=not fault))

    def innovations(self) -> list[float]:
        """Return how far each reading is off its joint's motion, in standard deviations."""
        return [joint.innovation for joint in self._joints]

    # What to allow for --------------------------------------------------------------------------

    def bias(self) -> tuple[float, ...]:
        """Return the nominal bias of each sensor, rad, with what it moved while it was late."""
        limits = self._limits
        bias, skew = limits.bias, limits.skew
        first, second, last, passive, *more = self._joints
        if not (skew or first.since or second.since or last.since or passive.since
                or (more and any(joint.since for joint in more))):
            return bias
        # A slower encoder than the bus repeats a reading: that may be so old.
        return tuple(each + abs(joint.velocity) * (skew + joint.since)
                     for each, joint in zip(bias, self._joints, strict=True))

    def follow_noise(self) -> None:
        """Let the limits allow for the noise as measured, where it is above the configured."""
        factors = []
        for joint, sigma in zip(self._joints, self._sigma, strict=True):
            noise = joint.noise
            loud = noise > NOISE_FACTOR * sigma
            joint.sigma = noise if loud else sigma
            factors.append(noise / sigma if loud else 1.0)
        self.factors = tuple(factors)
        self.noise = max(factors)

    def measured(self) -> tuple[float, ...]:
        """Return the standard deviation of each sensor's noise as measured, rad."""
        return tuple(joint.noise for joint in self._joints)

    def latest(self) -> tuple[float, ...]:
        """Return the latest readings, rad, 0 before the first."""
        return tuple(joint.last or 0.0 for joint in self._joints)

    def cautions(self) -> dict[str, str]:
        """Return which sensors have more noise than configured, by kind, in words."""
        return {f'noise {name}': f'noise of {name} {degrees(noise):.2f} deg, '
                                 f'configured {degrees(sigma):.2g}'
                for name, noise, sigma in zip(ALL_JOINT_NAMES, self.measured(), self._sigma,
                                              strict=False)
                if noise > NOISE_CAUTION * sigma}

    # Gaps and faults ----------------------------------------------------------------------------

    def back_after_gap(self, angles: Angles) -> list[int]:
        """Return the joints that jumped before a gap and are where they were before it."""
        return [sensor for sensor, (joint, reading)
                in enumerate(zip(self._joints, angles, strict=True))
                if joint.back_after_gap(reading)]

    def reset_coasting(self) -> None:
        """Forget the motion of joints whose latest reading was not taken in."""
        for joint in self._joints:
            if joint.coasting:
                joint.reset_motion()

    def reset_motion(self) -> None:
        """Forget every motion."""
        for joint in self._joints:
            joint.reset_motion()

    def restart(self, faulty: int | None) -> None:
        """Leave the old motion of one joint, or of all."""
        for sensor, joint in enumerate(self._joints):
            if faulty in (None, sensor):
                joint.restart()

    def restart_blamed(self, symptoms: list[Symptom]) -> None:
        """Leave the old motion of joints that do not come back to it."""
        for symptom in symptoms:
            if symptom.sensor is not None:
                self._joints[symptom.sensor].restart()


def long_gap(dt: float, period: float) -> bool:
    """Whether the joints' velocities of before the gap say nothing any more."""
    return dt > FORGET_PERIODS * period > 0.0
