# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The slow watch on the calibration, as part of fkm's entry on /diagnostics."""

from __future__ import annotations

from math import degrees, isfinite

from spm_haptic_master.calibration.watch.calibration_watch import CalibrationWatch
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES
from spm_haptic_master.parameters.geometry import geometry_from
from spm_haptic_master.parameters.limits import limits_from, sigma_from
from spm_haptic_master.parameters.setting import Values
from spm_haptic_master.supervision.supervisor import Supervisor

# Samples taken between two evaluations (samples): ten seconds, and an evaluation costs as much as
# two samples.
EVALUATION_SAMPLES = 10


class CalibrationStatus:
    """
    Watches the calibration by the latest accepted sample, asked for once a second.

    The caller guards the supervisor, which has the samples.
    """

    def __init__(self, supervisor: Supervisor, values: Values) -> None:
        self._supervisor = supervisor
        self._names = ALL_JOINT_NAMES[:values['sensors']]
        self._watch = CalibrationWatch(
            sigma_from(values), limits_from(values).bias, geometry_from(values),
            values['working_mode'])
        self._taken = self._not_accepted = 0

    def poll(self) -> None:
        """Take the latest sample if it is accepted."""
        accepted = self._supervisor.accepted()
        if accepted is None:
            self._not_accepted += 1
        elif self._watch.take(*accepted):
            self._taken += 1
            if self._taken % EVALUATION_SAMPLES == 0:
                self._watch.evaluate()

    def cautions(self) -> dict[str, str]:
        """Return what drifted, by kind, in words."""
        caution = self._watch.caution
        return {'calibration': f'calibration: {caution}'} if caution else {}

    def figures(self) -> dict[str, object]:
        """Return the key/value pairs of the entry."""
        figures: dict[str, object] = {'calibration: samples not accepted': self._not_accepted}
        found = self._watch.evaluation
        if found is None:
            return figures
        figures |= {
            'calibration: slow parity (deg)': degrees(found.slow),
            'calibration: slow parity expected (deg)': degrees(found.expected),
            'calibration: figure of merit': found.merit,
        }
        for name, slip, visible in zip(
                self._names, found.slip.tolist(), found.visible.tolist(), strict=True):
            if isfinite(visible):
                figures[f'{name} drift (deg)'] = degrees(slip)
                figures[f'{name} least drift that shows (deg)'] = degrees(visible)
        return figures
