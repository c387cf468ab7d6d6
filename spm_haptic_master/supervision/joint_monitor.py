# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""Each joint by itself: range, jump, speed, frozen value."""

from __future__ import annotations

from collections.abc import Iterable

from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.supervision.joint_tracker import BETA, INNOVATION_DEVIATION, JointTracker
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.symptom import Symptom

# Fraction of a jump's limit (unit 1) within which a reading must return for the jump to count as
# a spike that is over.
RETURN_FRACTION = 0.5
# Equal readings in a row beyond the first from which a sensor is frozen. A healthy sensor with the
# paper's noise and 14 bits repeats itself ten times once in a quarter of an hour at worst.
FROZEN_REPEATS = 10
# The same, and the missed motion (standard deviations of the innovation) that a sensor must exceed
# as well to be frozen earlier. At rest both come together once in half an hour.
EARLY_REPEATS = 4
EARLY_DEVIATIONS = 4.0
# Liveliness (0 .. 1) that the other three sensors must exceed for equal readings to be a symptom.
MIN_LIVELINESS = 0.6
# Samples over which the sampling period is averaged.
PERIOD_SAMPLES = 50.0
# Gap (sampling periods) after which the motion state is reset: the error of the velocity,
# extrapolated for longer, would look like a jump.
RESET_PERIODS = 5.0
# Longest gap (sampling periods) that enters the average: a longer one makes it half as large again
# at most, and does not let jumps pass for a while.
GAP_PERIODS = 20.0


class JointMonitor:
    """
    Evaluates the reading of each joint against its range and against its motion so far.

    Parameters
    ----------
    sigma : tuple of 4 float
        Standard deviations of the sensors, rad.
    limits : Limits
        Ranges, human motion limits, repeats that are a fault.

    Attributes
    ----------
    period : float
        Average sampling period, s; 0 before the second sample.
    innovations : tuple of 4 float
        Latest readings minus their predictions, standard deviations of the innovation.

    """

    def __init__(self, sigma: tuple[float, float, float, float], limits: Limits):
        self._limits = limits
        self._threshold = limits.threshold
        self._innovation_sigma = tuple(INNOVATION_DEVIATION * each for each in sigma)
        self._trackers = tuple(JointTracker() for _ in JOINT_NAMES)
        self.period = 0.0
        self.innovations: tuple[float, ...] = ()

    def restart(self) -> None:
        """Reset the motion state of all joints and the sampling period."""
        self.period = 0.0
        self.reset_motion()

    def reset_motion(self) -> None:
        """Reset the motion state of all joints."""
        for tracker in self._trackers:
            tracker.reset_motion()

    def restart_sensors(self, sensors: Iterable[int]) -> None:
        """Restart the trackers of these sensors, their repeats included."""
        for sensor in sensors:
            self._trackers[sensor].restart()

    def is_gap(self, dt: float) -> bool:
        """Return whether the motion cannot be extrapolated over `dt`, s."""
        return dt > RESET_PERIODS * (self.period or dt)

    def returned(self, angles: tuple[float, ...]) -> list[int]:
        """Return the sensors that jumped and, after a gap, are back where they were before."""
        return [sensor for sensor, (tracker, reading, deviation) in enumerate(
                    zip(self._trackers, angles, self._innovation_sigma, strict=True))
                if tracker.coasting
                and abs(tracker.offset(reading)) < RETURN_FRACTION * self._threshold * deviation]

    def evaluate(self, angles: tuple[float, ...], dt: float) -> list[Symptom]:
        """
        Return the symptoms of the readings, and update the motion of the joints without any.

        Parameters
        ----------
        angles : tuple of 4 float
            th1A, th1B, th1C, th3A, rad, finite.
        dt : float
            Time since the last sample, s; 0 for the first one.

        """
        limits = self._limits
        usual = self.period or dt
        self.period = usual + (min(dt, GAP_PERIODS * usual) - usual) / PERIOD_SAMPLES
        # What the human motion limit adds to the innovation of a tracker with these gains.
        period = max(dt, self.period)
        allowance = limits.joint_acceleration * period * period / BETA
        symptoms: list[Symptom] = []
        innovations = []
        for sensor, (tracker, reading, deviation) in enumerate(
                zip(self._trackers, angles, self._innovation_sigma, strict=True)):
            innovation = tracker.innovation(reading, dt)
            innovations.append(innovation / deviation)
            if not limits.joint_min[sensor] <= reading <= limits.joint_max[sensor]:
                symptoms.append(Symptom(
                    'out of range', f'{JOINT_NAMES[sensor]} {reading:.4f} rad', sensor))
                tracker.coast(dt)
                continue
            # A joint that jumped has returned only where it would be without the jump.
            limit = self._threshold * deviation + allowance
            if abs(innovation) > (RETURN_FRACTION * limit if tracker.coasting else limit):
                symptoms.append(Symptom(
                    'jumped',
                    f'{JOINT_NAMES[sensor]} {innovation:+.4f} rad off its motion', sensor))
                tracker.coast(dt)
                continue
            tracker.update(reading, innovation, dt, self.period)
            if abs(tracker.velocity) > limits.joint_speed:
                symptoms.append(Symptom(
                    'too fast', f'{JOINT_NAMES[sensor]} {tracker.velocity:.1f} rad/s', sensor))
            elif self._frozen(tracker, EARLY_DEVIATIONS * deviation):
                symptoms.append(Symptom(
                    'frozen',
                    f'{JOINT_NAMES[sensor]} {tracker.repeats + 1} times {reading:.6f} rad',
                    sensor, fault=tracker.repeats >= limits.frozen_samples, self_timed=True))
        self.innovations = tuple(innovations)
        return symptoms

    def _frozen(self, tracker: JointTracker, missed_limit: float) -> bool:
        """Return whether a joint repeats more than its noise explains while the others change."""
        return tracker.repeats >= EARLY_REPEATS and self._limits.frozen_samples > 0 \
            and (tracker.repeats >= FROZEN_REPEATS or tracker.missed_motion > missed_limit) \
            and all(other.liveliness > MIN_LIVELINESS
                    for other in self._trackers if other is not tracker)
