# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations may go out: the fourth sensor's redundancy, and each joint's motion so far.

A sample's findings keep it back: a joint that left its range, jumped or turned as no hand turns it,
or repeats a value while the others live; angles that contradict each other at once, or a little
for a while. Findings that last are a fault. The faulty sensor is named where the evidence is its
own; the parity alone says that one of four is wrong and not which. Then it is undetermined, and
nothing goes out: no guess.
"""

from __future__ import annotations

from collections import deque
from math import isfinite, sqrt
from typing import NamedTuple

from spm_haptic_master.exceptions import RejectedError, SpmError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.supervision.joint_tracker import BETA, INNOVATION_DEVIATION, JointTracker
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.solver import Solver, total_deviation

WINDOW = 20
"""Samples of the parity's duration test: 20 ms at 1 kHz."""

FIRST_TOGETHER = 5
"""Samples from which on, at the beginning, they are tested together."""

SPIKE_SAMPLES = 3
"""Samples in a row with a finding that are a fault; fewer are kept back, and that is all."""

SETTLING_SAMPLES = 10
"""
Consistent samples after a single bad one before orientations go out again.

A small step of a sensor shows in single samples first; by then the window has it.
"""

BACK = 0.5
"""Part of a jump's limit that a reading must come back to, to count as a spike that is over."""

HELD_REPEATS = 10
"""
Equal readings in a row from which a lively sensor's samples are kept back.

A healthy sensor with the paper's noise and 14 bits repeats itself ten times once in a quarter of an
hour at worst.
"""

MISSED_REPEATS, MISSED_DEVIATIONS = 4, 4.0
"""
Equal readings from which, and standard deviations of missed motion by which, they are so earlier.

At rest both come together once in half an hour.
"""

LIVELY = 0.6
"""Liveliness of the other three sensors with which one's repeats mean something (0 .. 1)."""

RESTART_GAP = 500_000_000
"""ns without a sample, after which what was known of the motion is of no use."""

OLDER_SAMPLES = 100
"""Samples in a row with stamps that go back, which are a clock that was set back."""

PRIOR_AGE = 100_000_000
"""ns; an orientation older than this no longer tells where the hand is now."""

PERIOD_SAMPLES = 50.0
"""Samples over which their usual distance in time is averaged."""

FORGET_PERIODS = 5.0
"""Periods without a sample, after which each joint's motion is learnt anew."""

GAP_PERIODS = 20.0
"""Periods that a longer gap counts for; it makes the average half as large again at most."""

RECHECK_SENSITIVITY = 0.1
"""
Share of a sensor in the parity (0 .. 1) with which consistency says something about it.

Near a parallel singularity the three active sensors cannot check th3A: its share is 0 there.
"""

CULPRIT_DEVIATIONS, WITNESS_DEVIATIONS = 5.0, 3.5
"""
Innovations at a fault's onset, in standard deviations, that tell who it was.

The one is above, all others below; a step that the parity sees at once moves its sensor by more
than eight.
"""

TURN_DEVIATIONS = 6.0
"""Deviations that the three-sensor orientation may be from the last one, beside a hand's motion."""


class Finding(NamedTuple):
    """
    What is wrong with a sample: in fixed words, with values, whose it is, whether a fault.

    `waits`: it says nothing of the samples before; `complete`: its words say whose it is.
    """

    reason: str
    detail: str
    sensor: int | None = None
    fault: bool = False
    waits: bool = False
    complete: bool = False


class Supervisor:
    """
    Passes the orientation of a joint sample, or keeps silent and says why.

    Parameters
    ----------
    solver : Solver
        The forward model.
    sigma : tuple of 4 float
        Standard deviations of the sensors, rad.
    limits : Limits
        What is healthy.

    Attributes
    ----------
    state : str
        'starting', 'healthy', 'degraded: ...' or 'silent: ...'.
    parity : float or None
        Of the latest sample that has one, in standard deviations.

    """

    def __init__(self, solver: Solver, sigma: tuple[float, float, float, float], limits: Limits):
        self._solver = solver
        self._limits = limits
        self._threshold = limits.threshold
        self._innovation_sigma = tuple(INNOVATION_DEVIATION * each for each in sigma)
        self._trackers = tuple(JointTracker() for _ in JOINT_NAMES)
        self._parities: deque[float] = deque(maxlen=WINDOW)
        self.parity: float | None = None
        self._fault: Finding | None = None
        # What was found with each sensor in the samples kept back just now.
        self._accused: dict[int, Finding] = {}
        self._stamp: int | None = None
        self._older = 0
        self._out_stamp: int | None = None
        self._quaternion: tuple[float, float, float, float] | None = None
        self._restart()

    def take(self, stamp: int, angles: tuple[float, float, float, float]) -> SampleEstimate:
        """
        Return the estimate whose orientation may go out; its quaternion continues the last one's.

        Parameters
        ----------
        stamp : int
            When the sample was taken, ns; it has to grow from call to call.
        angles : tuple of 4 float
            th1A, th1B, th1C, th3A, rad.

        Raises
        ------
        RejectedError
            Nothing may go out for this sample.

        """
        estimate = self._take(stamp, angles)
        self._refused = 0
        self._out_stamp = stamp
        quaternion = self._quaternion = _continued(estimate.quaternion, self._quaternion)
        if quaternion is estimate.quaternion:
            return estimate
        return estimate._replace(quaternion=quaternion)

    def _take(self, stamp: int, angles) -> SampleEstimate:
        if not all(map(isfinite, angles)):
            self._refuse('angle not finite', f'{list(angles)} rad')
        dt = 0.0
        if self._stamp is not None:
            if stamp <= self._stamp:
                self._refuse_older(stamp)
            dt = (stamp - self._stamp) * 1e-9
            if stamp - self._stamp > RESTART_GAP:
                self._restart()
                dt = 0.0
        self._stamp = stamp
        self._older = 0

        findings = self._examine_joints(angles, dt)
        estimate = None
        try:
            estimate = self._solver.solve(angles, self._prior(stamp))
        except SpmError as error:
            findings.append(Finding('no orientation fits', str(error)))
        else:
            findings += self._examine_parity(estimate)
        self._count(findings)

        if self._fault is not None and not self._recovered(estimate, findings, dt):
            self._follow_anew(findings)
            estimate = self._without_culprit(stamp, angles, findings)
        elif findings:
            self._keep_back(findings)
        elif self._clean < self._needed:
            raise RejectedError('starting' if self._starting else 'settling',
                                f'{self._clean} consistent samples of {self._needed}')
        self._check_deviation(estimate)
        if self._fault is None:
            self.state = 'healthy'
            self._starting = False
            self._needed = 0
        return estimate

    def _refuse_older(self, stamp: int) -> None:
        """Give nothing for a stamp that goes back; begin anew where the clock was set back."""
        back = (self._stamp - stamp) * 1e-9
        self._older += 1
        if self._older >= OLDER_SAMPLES:
            self._restart()
            self._stamp = self._out_stamp = None
            self._older = 0
        raise RejectedError('sample not newer than the last', f'{back:.6f} s older')

    def _restart(self) -> None:
        """Know nothing of the motion; a fault stays one."""
        self._convict_the_accused()
        self.state = f'silent: {_words(self._fault)}' if self._fault else 'starting'
        self._may_go_on = False
        self._starting = True
        self._needed = self._limits.start_samples
        self._clean = self._bad = self._refused = 0
        self._consistent = 0.0
        self._onset: tuple[float, ...] = ()
        self._parities.clear()
        self._period = 0.0
        for tracker in self._trackers:
            tracker.lose_motion()

    def _prior(self, stamp: int):
        """Return the last orientation while it still tells where the hand is."""
        if self._out_stamp is None or stamp - self._out_stamp > PRIOR_AGE:
            return None
        return self._quaternion

    # Findings -------------------------------------------------------------------------------

    def _examine_joints(self, angles, dt: float) -> list[Finding]:
        """Hold each reading against its joint's range and motion, and follow the motion."""
        limits = self._limits
        # What a hand's acceleration adds to the innovation of the tracker's gains.
        usual = self._period or dt
        if dt > FORGET_PERIODS * usual:
            # The velocity's error, so long carried on, would be taken for a jump.
            self._acquit_who_is_back(angles)
            self._convict_the_accused()
            for tracker in self._trackers:
                tracker.lose_motion()
        # A gap is not the usual distance, and must not make jumps pass for a while.
        self._period = usual + (min(dt, GAP_PERIODS * usual) - usual) / PERIOD_SAMPLES
        period = max(dt, self._period)
        allowance = limits.joint_acceleration * period * period / BETA
        findings: list[Finding] = []
        innovations = []
        for sensor, (tracker, reading, deviation) in enumerate(
                zip(self._trackers, angles, self._innovation_sigma, strict=True)):
            innovation = tracker.innovation(reading, dt)
            innovations.append(innovation / deviation)
            if not limits.joint_min[sensor] <= reading <= limits.joint_max[sensor]:
                findings.append(Finding(
                    'out of range', f'{JOINT_NAMES[sensor]} {reading:.4f} rad', sensor))
                tracker.coast(dt)
                continue
            # A joint that jumped is back only where it would have come without the jump.
            limit = self._threshold * deviation + allowance
            if abs(innovation) > (BACK * limit if tracker.coasting else limit):
                findings.append(Finding(
                    'jumped',
                    f'{JOINT_NAMES[sensor]} {innovation:+.4f} rad off its motion', sensor))
                tracker.coast(dt)
                continue
            tracker.follow(reading, innovation, dt, self._period)
            if abs(tracker.velocity) > limits.joint_speed:
                findings.append(Finding(
                    'too fast', f'{JOINT_NAMES[sensor]} {tracker.velocity:.1f} rad/s', sensor))
            elif self._frozen(tracker, MISSED_DEVIATIONS * deviation):
                findings.append(Finding(
                    'frozen',
                    f'{JOINT_NAMES[sensor]} {tracker.repeats + 1} times {reading:.6f} rad',
                    sensor, fault=tracker.repeats >= limits.frozen_samples, waits=True))
        if not self._bad:
            self._onset = tuple(innovations)
        return findings

    def _frozen(self, suspect: JointTracker, much: float) -> bool:
        """Tell whether a joint's repeats are more than its noise explains, as the others live."""
        return suspect.repeats >= MISSED_REPEATS and self._limits.frozen_samples > 0 \
            and (suspect.repeats >= HELD_REPEATS or suspect.missed_motion > much) \
            and all(tracker.liveliness > LIVELY
                    for tracker in self._trackers if tracker is not suspect)

    def _examine_parity(self, estimate: SampleEstimate) -> list[Finding]:
        """Hold the four angles against each other: this sample, and the last ones together."""
        self.parity = parity = estimate.parity
        if not abs(parity) <= self._threshold:
            return [Finding('inconsistent angles',
                            f'parity {parity:.1f} sigma, limit {self._threshold:.1f}')]
        self._parities.append(parity)
        count = len(self._parities)
        together = sum(self._parities) / sqrt(count)
        if count >= FIRST_TOGETHER and abs(together) > self._threshold:
            return [Finding('angles drifted apart', f'parity of {count} samples '
                            f'{together:.1f} sigma, limit {self._threshold:.1f}', fault=True)]
        return []

    def _count(self, findings: list[Finding]) -> None:
        if findings:
            self._accused.update({finding.sensor: finding for finding in findings
                                  if finding.sensor is not None and not finding.waits})
            self._clean = 0
            self._bad += not all(finding.waits for finding in findings)
        else:
            self._accused.clear()
            self._clean += 1
            self._bad = 0

    # What follows from them -----------------------------------------------------------------

    def _keep_back(self, findings: list[Finding]) -> None:
        """Give nothing for this sample, and see whether it is a fault by now."""
        first = next((finding for finding in findings if finding.fault), findings[0])
        if self._starting:
            self._follow_anew(findings)
        else:
            if first.fault or self._bad >= SPIKE_SAMPLES:
                self._begin_fault(first, findings)
            elif self._bad:
                self._needed = SETTLING_SAMPLES
        raise RejectedError(_words(first), first.detail)

    def _begin_fault(self, first: Finding, findings: list[Finding]) -> None:
        sensors = {finding.sensor for finding in findings if finding.sensor is not None}
        sensor = sensors.pop() if len(sensors) == 1 else None
        if not sensors and sensor is None:
            sensor = self._suspect()
        self._fault = first._replace(sensor=sensor)
        self._may_go_on = self._limits.degraded and sensor is not None
        self._consistent = 0.0
        self.state = f'silent: {_words(self._fault)}'
        for tracker in self._trackers if sensor is None else (self._trackers[sensor],):
            tracker.forget()

    def _acquit_who_is_back(self, angles) -> None:
        """After a gap: a joint that is where it was before its jump had a spike."""
        for sensor, (tracker, reading, deviation) in enumerate(
                zip(self._trackers, angles, self._innovation_sigma, strict=True)):
            limit = BACK * self._threshold * deviation
            if tracker.coasting and abs(tracker.offset(reading)) < limit:
                self._accused.pop(sensor, None)

    def _convict_the_accused(self) -> None:
        """Make a fault of what was found just now: the motion that would tell more is lost."""
        findings = list(self._accused.values())
        self._accused.clear()
        if not findings or self._starting:
            return
        if self._fault is None:
            self._begin_fault(findings[0], findings)
        else:
            self._widen_fault(findings)

    def _widen_fault(self, findings: list[Finding]) -> None:
        """Suspect every sensor, where another one than the fault's has gone wrong too."""
        fault = self._fault
        other = next((finding for finding in findings
                      if finding.sensor not in (None, fault.sensor)), None)
        if fault.sensor is not None and other is not None:
            self._may_go_on = False
            self._fault = fault._replace(
                sensor=None, reason=f'{_words(fault)} and {_words(other)}', complete=True)
            self.state = f'silent: {_words(self._fault)}'

    def _suspect(self) -> int | None:
        """Return the one sensor that left its motion at the fault's onset, if only one did."""
        moved = [sensor for sensor, deviations in enumerate(self._onset)
                 if abs(deviations) > WITNESS_DEVIATIONS]
        if len(moved) == 1 and abs(self._onset[moved[0]]) > CULPRIT_DEVIATIONS:
            return moved[0]
        return None

    def _recovered(self, estimate, findings: list[Finding], dt: float) -> bool:
        """Count the time of consistency, where the parity can see what was wrong."""
        if findings:
            self._consistent = 0.0
            return False
        sensors = range(len(JOINT_NAMES)) if self._fault.sensor is None else (self._fault.sensor,)
        if all(abs(estimate.sensitivity[sensor]) >= RECHECK_SENSITIVITY for sensor in sensors):
            self._consistent += min(dt, 2.0 * self._period)
            if self._consistent >= self._limits.recovery:
                self._fault = None
                self._may_go_on = False
                return True
        return False

    def _without_culprit(self, stamp: int, angles, findings: list[Finding]) -> SampleEstimate:
        """Return the orientation of the three healthy sensors, where that is allowed and good."""
        fault = self._fault
        if not self._may_go_on:
            raise RejectedError(_words(fault), fault.detail)
        prior = self._prior(stamp)
        if prior is None:
            self._stop('the motion was lost', 'no orientation a moment ago')
        others = [f for f in findings if f.sensor not in (None, fault.sensor)]
        if others:
            self._stop(f'and {_words(others[0])}', others[0].detail)
        try:
            estimate = self._solver.without(JOINT_NAMES[fault.sensor], angles, prior)
        except SpmError as error:
            self._stop('no orientation from the others', str(error))
        deviation = total_deviation(estimate)
        turn = rotation_distance(estimate.quaternion, prior)
        reach = self._limits.joint_speed * (stamp - self._out_stamp) * 1e-9
        if not turn <= reach + TURN_DEVIATIONS * deviation:
            self._stop('the others do not continue the motion', f'{turn:.3f} rad off')
        if not estimate.valid or deviation > self._limits.deviation:
            self._stop('the others do not determine it',
                       f'standard deviation {deviation:.4f} rad')
        self.state = f'degraded: {_words(fault)}'
        return estimate

    def _follow_anew(self, findings: list[Finding]) -> None:
        """Leave the old motion of joints that do not come back to it."""
        if self._bad >= SPIKE_SAMPLES:
            if self._fault is not None:
                self._widen_fault(findings)
            for finding in findings:
                if finding.sensor is not None:
                    self._trackers[finding.sensor].forget()

    def _stop(self, reason: str, detail: str) -> None:
        """End the degraded operation: only all four sensors can begin anew."""
        self._may_go_on = False
        self._fault = self._fault._replace(reason=f'{self._fault.reason}, {reason}')
        self.state = f'silent: {_words(self._fault)}'
        raise RejectedError(_words(self._fault), detail)

    def _check_deviation(self, estimate: SampleEstimate) -> None:
        deviation = total_deviation(estimate)
        if not estimate.valid or deviation > self._limits.deviation:
            self._refuse('orientation not determined', f'standard deviation {deviation:.4f} rad, '
                         f'limit {self._limits.deviation:g}')

    def _refuse(self, reason: str, detail: str) -> None:
        """Give nothing for a sample that no sensor is to blame for; begin anew if that lasts."""
        self._refused += 1
        if self._refused >= SPIKE_SAMPLES and self._fault is None and not self._starting:
            self._restart()
            self.state = f'silent: {reason}'
        raise RejectedError(reason, detail)


def _words(finding: Finding) -> str:
    """Return a finding in fixed words, with the sensor's name or that it is not known."""
    if finding.sensor is not None:
        return f'{JOINT_NAMES[finding.sensor]} {finding.reason}'
    if finding.complete or finding.reason.startswith('no orientation'):
        return finding.reason
    return f'{finding.reason}, sensor undetermined'


def _continued(quaternion, last):
    """Of q and -q return the one that continues `last`; at the beginning the one with w >= 0."""
    x, y, z, w = quaternion
    along = w if last is None else x * last[0] + y * last[1] + z * last[2] + w * last[3]
    return quaternion if along >= 0.0 else (-x, -y, -z, -w)
