# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameter file of a calibration from free motion."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import degrees, tau
from typing import Any

import numpy as np
from spm_haptic_master.calibration.calibration_file import file_text, rounded, sensors_entry
from spm_haptic_master.calibration.motion.calibration import MotionCalibration
from spm_haptic_master.calibration.motion.error_bound import Region, WORKSPACE
from spm_haptic_master.calibration.motion.mechanism_parameters import Array
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Number of values of a table: exact for a constant, the first and the second harmonic.
TABLE_VALUES = 5


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a calibration comes from."""

    date: str  # ISO 8601 with the offset to UTC
    recording: str  # name of the log, or of the bus
    checksum: str  # SHA-256 of the log; empty for a bus
    version: str  # of this package
    counts_per_turn: tuple[int, ...]  # scale of each encoder, (N,)
    settings: Mapping[str, Any]  # further parameters that it rests on: bus, frames of the encoders


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a calibration is good for."""

    alert_limit_deg: float  # smallest one with which fkm publishes in the region, deg
    published: float  # share of the recorded motion that fkm publishes (unit 1)
    target_deg: float  # wanted error of the orientation, deg rms
    reached_deg: float  # predicted error over the region, deg rms
    region: Region  # where it holds

    @property
    def text(self) -> str:
        """Return for what it is good, in one line."""
        where = 'over the workspace' if self.region == WORKSPACE else 'ONLY for the region moved'
        return (f'Good for an alert limit of {self.alert_limit_deg:g} deg or more, {where}: '
                f'{self.region.text}.')

    @property
    def reached(self) -> str:
        """Return target and reached error, in one line."""
        verb = 'reached' if self.reached_deg <= self.target_deg else 'NOT reached'
        return (f'Predicted error of the orientation: {self.reached_deg:.3f} deg rms over the '
                f'region, target {self.target_deg:g} deg {verb}.')


def zero_counts(calibration: MotionCalibration,
                counts_per_turn: Sequence[int]) -> tuple[tuple[int, ...], Array]:
    """Return the whole zero counts, and the reading that they leave at joint angle 0, rad."""
    zeros = calibration.vector[calibration.layout.slices['zeros']]
    whole, rest = [], []
    for zero, sign, per_turn in zip(zeros, calibration.direction, counts_per_turn, strict=True):
        counts = sign * zero * per_turn / tau
        whole.append(round(counts) % per_turn)
        # reading = direction (count - zero count) tau / counts per turn
        rest.append(sign * (counts - round(counts)) * tau / per_turn)
    return tuple(whole), np.array(rest)


def motion_parameters(calibration: MotionCalibration, origin: Origin) -> dict[str, Any]:
    """Return the parameters of a calibration, by dotted name."""
    c, layout = calibration, calibration.layout
    zeros, rest = zero_counts(c, origin.counts_per_turn)
    first, _ = layout.harmonics(c.vector)
    geometry = layout.geometry(c.vector)
    joints = ALL_JOINT_NAMES[:layout.sensors]
    # The second harmonic, and what the whole zero count leaves.
    second = c.vector.copy()
    second[layout.slices['first harmonics']] = 0.0
    at = np.arange(TABLE_VALUES)[:, None] * tau / TABLE_VALUES
    tables = {f'encoders.table_deg.{joint}': rounded(values) for joint, values in zip(
        joints, (rest + layout.harmonic_deviation(at, second)[0]).T, strict=True)}
    return {
        'calibration': f'motion, {origin.date}', **sensors_entry(joints),
        **dict(sorted(origin.settings.items())),
        'sigma_deg': rounded(c.noise), 'bias_deg': rounded(c.bias),
        'geometry.proximal_deg': rounded(geometry.alphas),
        'geometry.distal_deg': rounded(geometry.betas),
        'geometry.base_axes': _flat(geometry.base_axes),
        'geometry.platform_axes': _flat(geometry.platform_axes),
        'encoders.counts_per_turn': origin.counts_per_turn,
        'encoders.direction': c.direction,
        'encoders.direction_verified': [True] * len(joints),
        'encoders.zero_count': zeros,
        'encoders.harmonic_cos_deg': rounded(first[:, 0]),
        'encoders.harmonic_sin_deg': rounded(first[:, 1]), **tables}


def motion_text(calibration: MotionCalibration, origin: Origin, verdict: Verdict) -> str:
    """Return the text of the parameter file."""
    c, region = calibration, calibration.region
    left = '; '.join(f'{group}: {reason}' for group, reason in c.left.items()) or 'none'
    return file_text(
        (f'Calibration of {origin.date} from free motion, a parameter file for all nodes: '
         '--params-file.', verdict.text, verdict.reached,
         f'bias_deg bounds the error of each sensor for {region.text}.',
         *(f'CAUTION: {caution}' for caution in c.cautions)),
        motion_parameters(c, origin),
        {'method': 'motion', 'date': origin.date, 'recording': origin.recording,
         'checksum': origin.checksum, 'version': origin.version,
         'received_sets': c.readings.sets, 'seconds': round(float(c.readings.seconds[-1]), 1),
         'cut_percent': round(100.0 * c.cut, 2),
         'alert_limit_deg': verdict.alert_limit_deg,
         'published_percent': round(100.0 * verdict.published, 2),
         'region_tilt_deg': region.tilt_deg, 'region_phi_deg': [region.from_deg, region.to_deg],
         'target_deg': verdict.target_deg,
         'region_error_deg': round(degrees(c.region_error), 6),
         'predicted_error_deg': round(degrees(c.error), 6),
         'parity_deg': round(degrees(float(np.sqrt(np.nanmean(c.parity ** 2)))), 6),
         'left_as_drawn': left, 'advice': c.advice[0].text if c.advice else '',
         'cautions': '; '.join(c.cautions),
         'parameters': c.layout.names, 'values_deg': rounded(c.vector),
         'deviations_deg': rounded(c.deviations)})


def _flat(axes: Iterable[Iterable[float]]) -> list[float]:
    return [round(float(component), 12) for axis in axes for component in axis]
