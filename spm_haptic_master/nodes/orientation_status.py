# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The entry 'orientation' of `fkm` on /diagnostics: state, cautions and figures."""

from __future__ import annotations

from collections import Counter
from math import degrees

from rclpy.node import Node
from spm_haptic_master.exceptions import RejectedError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.nodes.calibration_status import CalibrationStatus
from spm_haptic_master.orientation_state import Condition, OrientationState
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.ros.diagnostic_status import (
    CAUTION_KEY,
    ERROR,
    MECHANISM,
    OK,
    StatusPublisher,
    WARN,
)
from spm_haptic_master.supervision.supervisor import Supervisor
from spm_haptic_master.supervision.symptom import with_remedy
from spm_haptic_master.timing import RateMeter

# Levels of the states.
LEVELS = {Condition.STARTING: WARN, Condition.HEALTHY: OK, Condition.DEGRADED: WARN,
          Condition.SILENT: ERROR}


class OrientationStatus:
    """
    Publishes the entry, and counts what it reports of the samples.

    Parameters
    ----------
    node : Node
        Node that publishes the orientation.
    values : mapping
        Checked values of `FKM_SETTINGS`.
    supervisor : Supervisor
        Which has the samples; the caller guards it.
    constants : mapping of str to str
        What does not change, by key: mechanism, frames of the mounting.

    Attributes
    ----------
    received : RateMeter
        Samples received; the caller counts them.
    rejection : RejectedError or None
        Why a sample was withheld last; None before the first.
    caution : str
        What should be investigated although orientations are published; empty if nothing.

    """

    def __init__(self, node: Node, values: Values, supervisor: Supervisor,
                 constants: dict[str, str]) -> None:
        self._supervisor, self._constants = supervisor, constants
        self._calibration = CalibrationStatus(supervisor, values)
        self._names = ALL_JOINT_NAMES[:values['sensors']]
        self._publisher = StatusPublisher(node, 'orientation', MECHANISM)
        self.received = RateMeter()
        self._rejected: Counter[str] = Counter()
        self.rejection: RejectedError | None = None
        self.caution = ''

    def reject(self, rejection: RejectedError) -> None:
        """Count a sample that was withheld."""
        self._rejected[rejection.reason] += 1
        self.rejection = rejection

    def watch_calibration(self) -> None:
        """Take the latest sample for the slow watch on the calibration, once a second."""
        self._calibration.poll()

    def publish(self, state: OrientationState, text: str, published: RateMeter,
                level: float | None) -> None:
        """
        Publish the entry if it changed or is due.

        Parameters
        ----------
        state : OrientationState
            State of the orientation.
        text : str
            The state in words, as logged.
        published : RateMeter
            Orientations published.
        level : float or None
            Protection level of the latest orientation, rad; None before the first.

        """
        severity = LEVELS[state.condition]
        logged = severity, text
        message = with_remedy(state.why, text)
        cautions: dict[str, str] = {}
        if state.publishes:
            cautions = self._supervisor.cautions() | self._calibration.cautions()
        self.caution = ', '.join(cautions.values())
        if cautions and severity == OK:
            severity, message = WARN, f'{text}; {self.caution}'
        # The figures in a caution grow; which sensors it names is what changes.
        subject = text + ', '.join(cautions)
        if self._publisher.is_due(severity, subject):
            self._publisher.publish(
                severity, message, self._figures(published, level), subject, logged)

    def _figures(self, published: RateMeter, level: float | None) -> dict[str, object]:
        figures: dict[str, object] = {
            **self._constants,
            'sample rate (Hz)': self.received.rate(),
            'orientation rate (Hz)': published.rate(),
            'samples rejected': self._rejected.total(),
            **{f'rejected: {reason}': count for reason, count in self._rejected.items()},
        }
        if self.caution:
            figures[CAUTION_KEY] = self.caution
        if self.rejection is not None:
            figures['last rejected'] = str(self.rejection)
        if self._supervisor.parity is not None:
            figures['parity (sigma)'] = self._supervisor.parity
        figures |= self._calibration.figures()
        if level is not None:
            figures['protection level (deg)'] = degrees(level)
        supervisor = self._supervisor
        for name, noise, unchecked in zip(
                self._names, supervisor.joints.noise(), supervisor.unchecked(), strict=True):
            figures[f'{name} noise (deg)'] = degrees(noise)
            figures[f'{name} unchecked (s)'] = unchecked
        return figures
