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
        self._taken = self._not_accepted = 0
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

    def publish(self, state: OrientationState, text: str, level: float | None) -> None:
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
        level_of_state = severity = LEVELS[state.condition]
        message = with_remedy(state.why, text)
        if state.publishes:
            cautions = self._supervisor.cautions()
        else:
            cautions = {}
        if state.publishes and self._watch.caution:
            cautions['calibration'] = f'calibration: {self._watch.caution}'
        self.caution = ', '.join(cautions.values())
        if cautions and severity == OK:
            severity, message = WARN, f'{text}; {self.caution}'
        # The figures in a caution grow: its sensors, not its words, decide whether it changed.
        subject = text + ', '.join(cautions)
        if self._publisher.is_due(severity, subject):
            logged = level_of_state, with_remedy(state.why, text)
            self._publisher.publish(
                severity,
                message,
                self._figures(level),
                subject,
                logged,
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
            **{f'rejected: {reason}': count for reason, count in self._rejected.items()},
        }
        if self.caution:
            figures[diagnostic_status.CAUTION_KEY] = self.caution
        if self.rejection is not None:
            figures['last rejected'] = str(self.rejection)
        if self._supervisor.parity is not None:
            figures['parity (sigma)'] = self._supervisor.parity
        figures['calibration: samples not accepted'] = self._not_accepted
        found = self._watch.evaluation
        if found is not None:
            figures |= {
                'calibration: slow parity (deg)': degrees(found.slow),
                'calibration: slow parity expected (deg)': degrees(found.expected),
                'calibration: figure of merit': found.merit,
            }
            for name, slip, visible in zip(
                self._names, found.slip.tolist(), found.visible.tolist(), strict=True
            ):
                if isfinite(visible):
                    figures[f'{name} drift (deg)'] = degrees(slip)
                    figures[f'{name} least drift that shows (deg)'] = degrees(visible)
        if level is not None:
            figures['protection level (deg)'] = degrees(level)
        for name, noise, unchecked in zip(
            self._names, self._supervisor.joints.noise(), self._supervisor.unchecked(), strict=True
        ):
            figures[f'{name} noise (deg)'] = degrees(noise)
            figures[f'{name} unchecked (s)'] = unchecked
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

    def __init__(self, node: Node, rate: float, latency_limit: float) -> None:
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
        self._count = self._missing = 0
        self._parity_sum = self._parity_squares = 0.0

    def add(self, stamp: int, now: int, parity: float) -> None:
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
        count = self._count
        last = self._last
        before = self._before
        self._all_missing += self._missing
        values: dict[str, object] = {
            'orientation rate (Hz)': self.published.rate(),
            'missed deadlines': self._all_missing,
            'missed in the last second': self._missing,
        }
        level = WARN
        text = 'no orientations'
        if count:
            percentiles = self.latency.percentiles(0.5, 0.9, 0.99, 1.0)
        else:
            percentiles = None
        if percentiles is not None:
            values |= {
                f'latency {name} (us)': value
                for name, value in zip(('p50', 'p90', 'p99', 'max'), percentiles, strict=True)
            }
            mean = self._parity_sum / count
            values |= {
                'parity mean (sigma)': mean,
                'parity deviation (sigma)': sqrt(
                    max(0.0, self._parity_squares / count - mean * mean)
                ),
            }
            p99 = percentiles[2]
            if p99 > self._latency_limit:
                text = f'{TOO_BUSY}: latency p99 {more_than(p99 / 1e6)}'
            elif self._missing > self._tolerated:
                text = self.busy or 'samples missing'
            # From the stamps: samples that a busy machine held up come in a burst.
            elif (
                last is not None
                and before is not None
                and last - before < count * self._least_span
            ):
                text = 'more samples than expected'
            else:
                level = OK
                text = 'in time'
        self._begin_period()
        self._status.publish(level, text, values)
