# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""What `fkm` reports on /diagnostics: state, cautions and figures, and whether it is in time."""

from __future__ import annotations

from collections import Counter
from math import degrees, isfinite, sqrt

from rclpy.node import Node
from spm_haptic_master.calibration.watch.calibration_watch import CalibrationWatch
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.fkm import limits_from, sigma_from
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros import diagnostic_status
from spm_haptic_master.ros.diagnostic_status import ERROR, OK, WARN
from spm_haptic_master.ros.overload import more_than, TOO_BUSY
from spm_haptic_master.supervision.orientation_state import Condition, OrientationState
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.supervision.symptom import with_remedy
from spm_haptic_master.timing import LatencyMeter, RateMeter, SECOND

# Levels of the states.
LEVELS = {
    Condition.STARTING: WARN,
    Condition.HEALTHY: OK,
    Condition.DEGRADED: WARN,
    Condition.SILENT: ERROR,
}
# Samples taken between two evaluations of the calibration (samples): ten seconds, and an
# evaluation costs as much as two samples.
EVALUATION_SAMPLES = 10
# Share of the samples of one period that may be missing without a warning (unit 1).
MISSING_TOLERATED = 0.02
# Share by which the samples of one period may exceed `rate` (unit 1): SYNC comes from another
# clock, and a driver on a busy machine has jitter; a rate set wrong is off by more.
EXCESS_TOLERATED = 0.1
# Stamps further apart than this have samples missing between them (sample periods).
GAP = 1.5


class OrientationStatus:
    """
    Publishes the entry `fkm: orientation`, and counts what it reports of the samples.

    Parameters
    ----------
    node : Node
        The node of the entry.
    values : mapping
        Checked settings of `fkm`.
    supervisor : Supervisor
        Decides about the samples; the caller guards it against other threads.
    constants : dict
        Values of the entry that do not change.

    """

    def __init__(
        self,
        node: Node,
        values: Values,
        supervisor: Supervisor,
        constants: dict[str, str],
    ) -> None:
        self._supervisor = supervisor
        self._constants = constants
        self._watch = CalibrationWatch(
            sigma=sigma_from(values),
            bias=limits_from(values).bias,
            geometry=geometry_from(values),
            working_mode=values['working_mode'],
        )
        # Samples that the watch has taken, and those that were not accepted when it was due.
        self._taken = 0
        self._not_accepted = 0
        self._names = ALL_JOINT_NAMES[: values['sensors']]
        self._publisher = diagnostic_status.StatusPublisher(
            node=node,
            aspect='orientation',
            hardware_id=diagnostic_status.MECHANISM,
        )
        # Samples received; the caller counts them.
        self.received = RateMeter()
        self._rejected: Counter[str] = Counter()
        # Why a sample was withheld last; None before the first.
        self.rejection: RejectedError | None = None
        # Warnings beside published orientations, in words; empty if there are none.
        self.caution = ''

    def reject(self, rejection: RejectedError) -> None:
        """
        Count a sample that was withheld.

        Parameters
        ----------
        rejection : RejectedError
            Reason, which is counted, and detail.

        """
        self._rejected[rejection.reason] += 1
        self.rejection = rejection

    def watch_calibration(self) -> None:
        """Have the latest sample watched, if it is accepted; call it once a second."""
        accepted = self._supervisor.accepted()
        if accepted is None:
            self._not_accepted += 1
        elif self._watch.take(*accepted):
            self._taken += 1
            if self._taken % EVALUATION_SAMPLES == 0:
                self._watch.evaluate()

    def publish(
        self,
        state: OrientationState,
        text: str,
        level: float | None,
    ) -> None:
        """
        Publish the entry if it is due.

        Parameters
        ----------
        state : OrientationState
            The state, as on the topic `state`.
        text : str
            The state in words; on a machine that is too busy with what that lost.
        level : float or None
            Protection level of the latest orientation, rad; None before the first.

        """
        level_of_state = LEVELS[state.condition]
        with_cure = with_remedy(state.why, text)
        cautions: dict[str, str] = {}
        if state.publishes:
            cautions = self._supervisor.cautions()
            if self._watch.caution:
                cautions['calibration'] = f'calibration: {self._watch.caution}'
        self.caution = ', '.join(cautions.values())
        severity = level_of_state
        message = with_cure
        if cautions and severity == OK:
            severity = WARN
            message = f'{text}; {self.caution}'
        # The figures in a caution grow: its sensors, not its words, decide whether it changed.
        subject = text + ', '.join(cautions)
        if self._publisher.is_due(severity, subject):
            self._publisher.publish(
                severity,
                message,
                self._figures(level),
                subject,
                (level_of_state, with_cure),
                starting=state.condition is Condition.STARTING,
            )

    def _figures(self, level: float | None) -> dict[str, object]:
        """
        Return the values of the entry: counts, parity, calibration, level, each sensor.

        Parameters
        ----------
        level : float or None
            Protection level of the latest orientation, rad; None before the first.

        Returns
        -------
        dict
            Values by key; angles in deg, times in s.

        """
        figures: dict[str, object] = {
            **self._constants,
            'sample rate (Hz)': self.received.rate(),
            'samples rejected': self._rejected.total(),
        }
        for reason, count in self._rejected.items():
            figures[f'rejected: {reason}'] = count
        if self.caution:
            figures[diagnostic_status.CAUTION_KEY] = self.caution
        if self.rejection is not None:
            figures['last rejected'] = str(self.rejection)
        if self._supervisor.parity is not None:
            figures['parity (sigma)'] = self._supervisor.parity
        figures['calibration: samples not accepted'] = self._not_accepted
        figures |= self._figures_of_calibration()
        if level is not None:
            figures['protection level (deg)'] = degrees(level)
        noises = self._supervisor.joints.noise()
        unchecked = self._supervisor.unchecked()
        for index, name in enumerate(self._names):
            figures[f'{name} noise (deg)'] = degrees(noises[index])
            figures[f'{name} unchecked (s)'] = unchecked[index]
        return figures

    def _figures_of_calibration(self) -> dict[str, object]:
        """Return what the calibration watch has found; nothing before its first evaluation."""
        found = self._watch.evaluation
        if found is None:
            return {}
        figures: dict[str, object] = {
            'calibration: slow parity (deg)': degrees(found.slow),
            'calibration: slow parity expected (deg)': degrees(found.expected),
            'calibration: figure of merit': found.merit,
        }
        slips = found.slip.tolist()
        visibles = found.visible.tolist()
        for name, slip, visible in zip(self._names, slips, visibles, strict=True):
            if isfinite(visible):
                figures[f'{name} drift (deg)'] = degrees(slip)
                figures[f'{name} least drift that shows (deg)'] = degrees(visible)
        return figures


class LatencyStatus:
    """
    The entry `fkm: timing` on /diagnostics, and the measurements behind it.

    Parameters
    ----------
    node : Node
        The node of the entry.
    rate : float
        Rate of the samples, Hz.
    latency_limit : float
        Largest 99th percentile of the latency without a warning, s.

    """

    def __init__(
        self,
        node: Node,
        rate: float,
        latency_limit: float,
    ) -> None:
        # Times from sample stamp to publication, and orientations published.
        self.latency = LatencyMeter()
        self.published = RateMeter()
        # Parity of the latest orientation, sigma; None before the first.
        self.parity: float | None = None
        self._period = SECOND / rate
        self._gap = GAP * self._period
        self._tolerated = MISSING_TOLERATED * rate * diagnostic_status.REPEAT_PERIOD
        self._latency_limit = latency_limit * 1e6  # us
        self._least_span = self._period / (1.0 + EXCESS_TOLERATED)
        # Stamp of the latest orientation, ns, and samples missing since the start.
        self._last: int | None = None
        self._all_missing = 0
        self._begin_period()
        self._status = diagnostic_status.StatusPublisher(
            node=node,
            aspect='timing',
            hardware_id=diagnostic_status.MECHANISM,
            logs=False,
        )

    def _begin_period(self) -> None:
        """Set the sums of a period to zero."""
        # Why samples were missing; empty if it is not known.
        self.busy = ''
        # Stamp of the latest orientation before the period, ns; its orientations and gaps.
        self._before = self._last
        self._count = 0
        self._missing = 0
        self._parity_sum = 0.0
        self._parity_squares = 0.0

    def add(
        self,
        stamp: int,
        now: int,
        parity: float,
    ) -> None:
        """
        Count an orientation.

        Parameters
        ----------
        stamp : int
            Time of the sample, ns.
        now : int
            Time of the publication, ns.
        parity : float
            Normalised residual of the sample, in standard deviations.

        """
        self.latency.add(now - stamp)
        self.published.count += 1
        self._count += 1
        if self._last is not None and stamp - self._last > self._gap:
            self._missing += round((stamp - self._last) / self._period) - 1
        self._last = stamp
        self.parity = parity
        self._parity_sum += parity
        self._parity_squares += parity * parity

    def publish(self) -> None:
        """Publish the entry; call it every `diagnostic_status.REPEAT_PERIOD`."""
        self._all_missing += self._missing
        values: dict[str, object] = {
            'orientation rate (Hz)': self.published.rate(),
            'missed deadlines': self._all_missing,
            'missed in the last second': self._missing,
        }
        level = WARN
        text = 'no orientations'
        percentiles = None
        if self._count:
            percentiles = self.latency.percentiles(0.5, 0.9, 0.99, 1.0)
        if percentiles is not None:
            half, most, nearly_all, longest = percentiles
            mean = self._parity_sum / self._count
            variance = max(0.0, self._parity_squares / self._count - mean * mean)
            values |= {
                'latency p50 (us)': half,
                'latency p90 (us)': most,
                'latency p99 (us)': nearly_all,
                'latency max (us)': longest,
                'parity mean (sigma)': mean,
                'parity deviation (sigma)': sqrt(variance),
            }
            text = self._complaint(nearly_all)
            if not text:
                level = OK
                text = 'in time'
        self._begin_period()
        self._status.publish(level, text, values)

    def _complaint(self, p99: float) -> str:
        """Return what was wrong in the period, by its latency, us; empty if nothing was."""
        if p99 > self._latency_limit:
            return f'{TOO_BUSY}: latency p99 {more_than(p99 / 1e6)}'
        if self._missing > self._tolerated:
            return self.busy or 'samples missing'
        if self._last is None or self._before is None:
            return ''
        # From the stamps: samples that a busy machine held up come in a burst.
        span = self._last - self._before
        if span < self._count * self._least_span:
            return 'more samples than expected'
        return ''
