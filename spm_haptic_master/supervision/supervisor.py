# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Which orientations are published: the order in which a sample is evaluated.

A sample is withheld if a joint left its range, jumped, exceeded the human motion limits or repeats
a value while the others change, and if the angles contradict each other, at once or a little for a
while. Symptoms that last are a fault. It is isolated to one sensor where the evidence is that
sensor's own; the parity alone shows that one of four is faulty, and not which. Then the sensor is
undetermined and nothing is published: there is no guess.
"""

from __future__ import annotations

from math import isfinite
from typing import NoReturn

from spm_haptic_master.exceptions import RejectedError, SpmError
from spm_haptic_master.joints import JOINT_NAMES
from spm_haptic_master.kinematics.rotations import rotation_distance
from spm_haptic_master.kinematics.sample_estimation import SampleEstimate
from spm_haptic_master.supervision.fault_isolation import FAULT_SAMPLES, FaultIsolation
from spm_haptic_master.supervision.joint_monitor import JointMonitor
from spm_haptic_master.supervision.limits import Limits
from spm_haptic_master.supervision.parity_monitor import ParityMonitor
from spm_haptic_master.supervision.solver import Solver, total_deviation
from spm_haptic_master.supervision.symptom import Symptom

# Gap (ns) after which the supervisor restarts: the motion before it predicts nothing any more.
RESTART_GAP = 500_000_000
# Samples in a row with older stamps that are a clock set back.
OLDER_SAMPLES = 100
# Age (ns) up to which the last orientation is a prior for the next.
PRIOR_AGE = 100_000_000
# Standard deviations by which the orientation from three sensors may differ from the last one,
# in addition to what the human motion limit allows.
TURN_DEVIATIONS = 6.0


class Supervisor:
    """
    Passes the orientation of a joint sample, or raises the reason why it is withheld.

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
    parity : float or None
        Parity of the latest sample that has one, standard deviations.

    """

    def __init__(self, solver: Solver, sigma: tuple[float, float, float, float], limits: Limits):
        self._solver = solver
        self._limits = limits
        self._joints = JointMonitor(sigma, limits)
        self._parities = ParityMonitor(limits.threshold)
        self._faults = FaultIsolation(limits, self._joints)
        self.parity: float | None = None
        self._stamp: int | None = None
        # Samples in a row with older stamps, and samples rejected without a faulty sensor since
        # the last published one.
        self._older = self._rejected = 0
        self._published_stamp: int | None = None
        self._quaternion: tuple[float, float, float, float] | None = None

    @property
    def state(self) -> str:
        """Return 'starting', 'healthy', 'degraded: ...' or 'silent: ...'."""
        return self._faults.state

    def take(self, stamp: int, angles: tuple[float, float, float, float]) -> SampleEstimate:
        """
        Return the estimate whose orientation is published; its sign continues the last one's.

        Parameters
        ----------
        stamp : int
            Time at which the sample was taken, ns; it has to grow from call to call.
        angles : tuple of 4 float
            th1A, th1B, th1C, th3A, rad.

        Raises
        ------
        RejectedError
            The sample is withheld.

        """
        estimate = self._evaluate(stamp, angles)
        self._rejected = 0
        self._published_stamp = stamp
        quaternion = self._quaternion = _continued(estimate.quaternion, self._quaternion)
        if quaternion is estimate.quaternion:
            return estimate
        return estimate._replace(quaternion=quaternion)

    def _evaluate(self, stamp: int, angles: tuple[float, float, float, float]) -> SampleEstimate:
        """Return the estimate of a sample, or raise RejectedError."""
        if not all(map(isfinite, angles)):
            self._reject('angle not finite', f'{list(angles)} rad')
        dt = self._advance(stamp)
        faults = self._faults
        if self._joints.is_gap(dt):
            faults.clear_pending(self._joints.returned(angles))
            faults.latch_pending()
            self._joints.reset_motion()

        symptoms = self._joints.evaluate(angles, dt)
        estimate: SampleEstimate | None = None
        try:
            estimate = self._solver.solve(angles, self._prior(stamp))
        except SpmError as error:
            symptoms.append(Symptom('no orientation fits', str(error)))
        else:
            parity = self.parity = estimate.parity
            if parity is not None:
                symptoms += self._parities.evaluate(parity)
        faults.update(symptoms, self._joints.innovations)

        fault = faults.fault
        if fault is not None and not faults.clear(fault, estimate, symptoms, dt):
            faults.restart_persistent(symptoms)
            return self._estimate_from_three(stamp, angles, symptoms)
        if symptoms or estimate is None:
            faults.withhold(symptoms)
        faults.settle()
        self._check_deviation(estimate)
        faults.confirm()
        return estimate

    def _advance(self, stamp: int) -> float:
        """Return the time since the last sample, s; 0 after a restart."""
        last = self._stamp
        if last is not None and stamp <= last:
            self._reject_older(last, stamp)
        self._stamp = stamp
        self._older = 0
        if last is None:
            return 0.0
        if stamp - last > RESTART_GAP:
            self._restart()
            return 0.0
        return (stamp - last) * 1e-9

    def _prior(self, stamp: int) -> tuple[float, float, float, float] | None:
        """Return the last orientation while it is recent."""
        if self._published_stamp is None or stamp - self._published_stamp > PRIOR_AGE:
            return None
        return self._quaternion

    def _estimate_from_three(self, stamp: int, angles: tuple[float, float, float, float],
                             symptoms: list[Symptom]) -> SampleEstimate:
        """Return the estimate from the healthy sensors if it continues the motion, or raise."""
        faults = self._faults
        fault = faults.fault
        assert fault is not None
        if not faults.degraded_allowed or fault.sensor is None:
            raise RejectedError(fault.text, fault.detail)
        prior = self._prior(stamp)
        if prior is None or self._published_stamp is None:
            faults.stop_degraded(fault, 'the motion was lost',
                                 f'no orientation in the last {PRIOR_AGE * 1e-9:g} s')
        others = [s for s in symptoms if s.sensor not in (None, fault.sensor)]
        if others:
            faults.stop_degraded(fault, f'and {others[0].text}', others[0].detail)
        try:
            estimate = self._solver.without(JOINT_NAMES[fault.sensor], angles, prior)
        except SpmError as error:
            faults.stop_degraded(fault, 'no orientation from the other sensors', str(error))
        deviation = total_deviation(estimate)
        turn = rotation_distance(estimate.quaternion, prior)
        reach = self._limits.joint_speed * (stamp - self._published_stamp) * 1e-9
        if not turn <= reach + TURN_DEVIATIONS * deviation:
            faults.stop_degraded(fault, 'the other sensors do not continue the motion',
                                 f'{turn:.3f} rad from the last orientation')
        if not estimate.determined or deviation > self._limits.deviation:
            faults.stop_degraded(fault, 'the other sensors do not determine the orientation',
                                 f'standard deviation {deviation:.4f} rad')
        faults.confirm_degraded(fault)
        return estimate

    def _check_deviation(self, estimate: SampleEstimate) -> None:
        """Raise RejectedError for an orientation that is not determined well enough."""
        deviation = total_deviation(estimate)
        if not estimate.determined or deviation > self._limits.deviation:
            self._reject('orientation not determined', f'standard deviation {deviation:.4f} rad, '
                         f'limit {self._limits.deviation:g}')

    def _reject(self, reason: str, detail: str) -> NoReturn:
        """Raise RejectedError for a sample without a faulty sensor; restart if that lasts."""
        self._rejected += 1
        if self._rejected >= FAULT_SAMPLES and self._faults.fault is None \
                and not self._faults.starting:
            self._restart()
            self._faults.state = f'silent: {reason}'
        raise RejectedError(reason, detail)

    def _reject_older(self, last: int, stamp: int) -> NoReturn:
        """Raise RejectedError for a stamp that goes back; restart where the clock was set back."""
        self._older += 1
        if self._older >= OLDER_SAMPLES:
            self._restart()
            self._stamp = self._published_stamp = None
        raise RejectedError('sample not newer than the last',
                            f'{(last - stamp) * 1e-9:.6f} s older')

    def _restart(self) -> None:
        """Reset everything but a latched fault and the sign of the quaternion."""
        self._faults.restart()
        self._joints.restart()
        self._parities.restart()


def _continued(quaternion: tuple[float, float, float, float],
               last: tuple[float, float, float, float] | None,
               ) -> tuple[float, float, float, float]:
    """Return q or -q, whichever continues `last`; at the beginning the one with w >= 0."""
    x, y, z, w = quaternion
    along = w if last is None else x * last[0] + y * last[1] + z * last[2] + w * last[3]
    return quaternion if along >= 0.0 else (-x, -y, -z, -w)
