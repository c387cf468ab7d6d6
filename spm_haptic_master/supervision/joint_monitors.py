# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""All joints by themselves: the symptoms of each, and the noise and delay to allow for."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from math import degrees, hypot, inf
from operator import add

from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import FOUR_SENSORS, Limits
from spm_haptic_master.supervision.joint_monitor import JointMonitor, Step
from spm_haptic_master.supervision.sample import Angles
from spm_haptic_master.supervision.symptom import Reason, Severity, Symptom

# Largest innovation of a quiet joint, in standard deviations: a healthy one exceeds it once in two
# million samples.
HEALTHY_DEVIATIONS = 5.0
# Samples after which a quiet joint is on its motion: half a period of 50 Hz at 1 kHz.
QUIET_SAMPLES = 10
JITTER_DEVIATIONS = 4.0  # mean deviations of the jitter that a stamp may be off by
# Measured over configured noise: above the first the limits widen, above the second it is a
# caution. An average over 256 samples does not reach the first by chance, with 12 bits; jitter of
# the sampling may add a quarter.
NOISE_FACTOR = 1.25
NOISE_CAUTION = 1.5


class JointMonitors:
    """
    A monitor for each joint, and what they show beside each other.

    Parameters
    ----------
    sigma : tuple of float, length N
        Configured standard deviations of the sensors, rad.
    limits : Limits
        Ranges of the joints, human motion limits, nominal biases.

    Attributes
    ----------
    factors : tuple of float, length N
        Measured noise of each sensor over the configured one where it exceeds `NOISE_FACTOR`, else
        1.
    bias : tuple of float, length N
        Nominal bias of each sensor, rad, with what it moved while its reading was late.
    parity_bias : float
        Bound of that part of all of these that no motion of the device explains, rad.
    samples : int
        Number of the latest sample.

    """

    def __init__(self, sigma: tuple[float, ...], limits: Limits) -> None:
        self._limits = limits
        self._sigma = sigma
        # Repeats of a reading after which a joint with rare repeats is frozen.
        self._frozen_run = limits.frozen_samples or inf
        threshold = limits.threshold()
        self._joints = tuple(
            JointMonitor(deviation, threshold, limits.joint_acceleration, limits.joint_speed)
            for deviation in sigma
        )
        # By sensor, its joint with the ends of its range, rad.
        self._watched = tuple(
            enumerate(zip(self._joints, limits.joint_min, limits.joint_max, strict=True))
        )
        self.factors: tuple[float, ...] = (1.0,) * len(sigma)
        self.bias = limits.bias
        self.parity_bias = limits.parity_bias
        self.samples = 0
        # Number of the sample in which each joint was last not quiet.
        self._disturbed = [0] * len(sigma)
        # Whether the device vibrates, as of the latest `follow_noise`: a joint seems noisier than
        # the parity allows.
        self._vibrates = False

    def follow(
        self,
        angles: Angles,
        dt: float,
        period: float,
        jitter: float,
        left_out: Collection[int],
    ) -> tuple[bool, list[Symptom]]:
        """
        Follow each joint's motion; return whether one is away from it, and what those in use show.

        A joint away from its motion is no symptom by itself: see `alone`.

        Parameters
        ----------
        angles : tuple of float, length N
            Readings, rad; NaN without one, which resets the motion of that joint.
        dt : float
            Time since the last sample, s.
        period : float
            Usual time between samples, s.
        jitter : float
            Mean deviation of the time between samples from the period, s.
        left_out : collection of int
            Sensors not in use: their motion is followed and their symptoms do not count.

        Returns
        -------
        tuple of bool and list of Symptom
            Whether a joint in use is away from its motion; readings that are frozen or out of
            range.

        """
        timing = self._limits.skew + JITTER_DEVIATIONS * jitter
        is_away = False
        symptoms: list[Symptom] = []
        self.samples += 1
        for sensor, (joint, low, high) in self._watched:
            reading = angles[sensor]
            if reading != reading:
                joint.reset_motion()
                continue
            joint.follow(reading, dt, period, timing)
            if joint.innovation > HEALTHY_DEVIATIONS:
                self._disturbed[sensor] = self.samples
            if sensor in left_out:
                continue
            if joint.away:
                is_away = True
            readings = joint.readings
            if readings.repeats >= self._frozen_run and readings.repeats_are_rare:
                symptoms.append(_frozen(sensor, readings.repeats + 1))
            if not low <= reading <= high:
                symptoms.append(_out_of_range(sensor, reading))
        self._allow_for_delay()
        return is_away, symptoms

    def _allow_for_delay(self) -> None:
        """
        Widen the biases by what the joints move in the skew, and while a reading is late.

        A slower encoder than the bus repeats a reading, which may be that old.
        """
        self.bias = self._limits.bias
        self.parity_bias = self._limits.parity_bias
        delays = [self._limits.skew + joint.reading_age for joint in self._joints]
        if any(delays):
            moved = [
                abs(joint.velocity) * delay
                for joint, delay in zip(self._joints, delays, strict=True)
            ]
            self.bias = tuple(map(add, self.bias, moved))
            self.parity_bias += hypot(*moved)

    def left(self, used: Collection[int]) -> list[int]:
        """Return the sensors that left their motion."""
        return [sensor for sensor in used if self._joints[sensor].away]

    def alone(self, used: Collection[int], samples: int = 1) -> list[int]:
        """
        Return the sensors that left their motion, if all others have been quiet for some samples.

        An impact or a vibration of the device moves every joint; a fault moves only its own.
        """
        left = self.left(used)
        others = [sensor for sensor in used if sensor not in left]
        latest = self.samples - samples
        are_quiet = all(self._disturbed[sensor] <= latest for sensor in others)
        is_vibration = self._vibrates and samples > 1
        return left if others and are_quiet and not is_vibration else []

    def jumps(
        self,
        used: Collection[int],
        unseen: Collection[int],
        is_gap: bool,
    ) -> list[Symptom]:
        """
        Return the sensors that left their motion alone, each by a step, where no parity shows it.

        Parameters
        ----------
        used : collection of int
            Indices of the sensors in use.
        unseen : collection of int
            Sensors whose jump the parity may not show.
        is_gap : bool
            Whether samples are missing, which may hide whether it was a step: it is a fault at
            once then.

        """
        alone = self.alone(used, QUIET_SAMPLES)
        is_single = len(alone) == 1
        if is_single:
            may_be_unseen = alone[0] in unseen
        else:
            # Several jumps may cancel in the one parity of four sensors.
            may_be_unseen = len(used) == FOUR_SENSORS
        if not may_be_unseen:
            return []
        least = Step.SUSPECTED if is_gap or is_single else Step.CERTAIN
        if any(self._joints[sensor].step < least for sensor in alone):
            return []
        return [
            Symptom(
                Reason.JUMPED,
                f'{self._joints[sensor].innovation:.1f} sigma off its motion',
                sensor,
                Severity.LATCH if is_gap else Severity.PENDING,
            )
            for sensor in alone
        ]

    def distance(self, sensor: int) -> float:
        """Return how far a sensor that is away is from the motion that it left, rad."""
        return self._joints[sensor].distance

    def departure(self, sensor: int) -> int:
        """Return the number of the latest motion that a sensor left."""
        return self._joints[sensor].departures

    def has_returned(self, sensor: int | None, departure: int | None = None) -> bool:
        """Whether a sensor jumped back to the motion that it left, the latest by default."""
        if sensor is None:
            return False
        joint = self._joints[sensor]
        if departure is None:
            departure = joint.departures
        return joint.returned == departure > 0

    def follow_noise(self, bounds: Sequence[float]) -> None:
        """
        Let the limits allow for the noise as measured, where it is above the configured.

        Parameters
        ----------
        bounds : sequence of float, length N
            Largest factor of each sensor's noise that the parity allows: a joint that seems
            noisier vibrates. Infinite for a sensor that the parity does not see: where any other
            joint vibrates, it is assumed to vibrate as well.

        """
        self._vibrates = any(
            joint.readings.noise > NOISE_FACTOR * joint.readings.expected and bound <= NOISE_FACTOR
            for joint, bound in zip(self._joints, bounds, strict=True)
        )
        factors = []
        for joint, sigma, bound in zip(self._joints, self._sigma, bounds, strict=True):
            if bound == inf and self._vibrates:
                bound = 1.0
            factor = min(joint.readings.noise / sigma, bound)
            factors.append(factor if factor > NOISE_FACTOR else 1.0)
            joint.allow(factors[-1] * sigma)
        self.factors = tuple(factors)

    def noise(self) -> tuple[float, ...]:
        """Return the standard deviation of each sensor's noise as measured, rad."""
        return tuple(joint.readings.noise for joint in self._joints)

    def cautions(self) -> dict[str, str]:
        """Return which sensors have more noise than configured, by kind, in words."""
        return {
            f'noise {name}': f'noise of {name} {degrees(factor * sigma):.2f} deg, '
            f'configured {degrees(sigma):.2g}'
            for name, factor, sigma in zip(
                ALL_JOINT_NAMES, self.factors, self._sigma, strict=False
            )
            if factor > NOISE_CAUTION
        }

    def restart(self) -> None:
        """Forget every motion."""
        for joint in self._joints:
            joint.reset_motion()


def _frozen(sensor: int, readings: int) -> Symptom:
    """Return the symptom of a sensor with so many equal readings."""
    detail = f'{ALL_JOINT_NAMES[sensor]} {readings} equal readings'
    return Symptom(Reason.FROZEN, detail, sensor, Severity.LATCH)


def _out_of_range(sensor: int, reading: float) -> Symptom:
    """Return the symptom of a sensor whose reading, rad, no joint has."""
    return Symptom(Reason.OUT_OF_RANGE, f'{ALL_JOINT_NAMES[sensor]} {reading:.4f} rad', sensor)
