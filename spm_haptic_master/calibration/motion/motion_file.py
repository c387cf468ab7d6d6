# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The parameter file of a calibration from free motion, and what the calibration is good for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, tau
from typing import Any

import numpy as np
from spm_haptic_master.calibration.calibration_file import file_text, rounded, sensors_entry
from spm_haptic_master.calibration.motion import coverage
from spm_haptic_master.calibration.motion.calibration import MotionCalibration, rms
from spm_haptic_master.calibration.motion.model import Array
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Number of values of a table: exact for a constant, the first and the second harmonic.
TABLE_VALUES = 5


@dataclass(frozen=True, slots=True)
class Origin:
    """
    Where a calibration comes from.

    Attributes
    ----------
    date : str
        Time of the calibration, ISO 8601 with the offset to UTC.
    recording : str
        Name of the log, or of the bus.
    checksum : str
        SHA-256 of the log; empty for a bus.
    version : str
        Version of this package.
    counts_per_turn : tuple of int, shape (N,)
        Counts of each encoder in a turn.
    settings : mapping of str to object
        Further parameters that it rests on: bus, frames of the encoders.

    """

    date: str
    recording: str
    checksum: str
    version: str
    counts_per_turn: tuple[int, ...]
    settings: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Checked:
    """
    Where in the region of a calibration the other sensors check each of N sensors.

    Attributes
    ----------
    alert_limit_deg : float
        Alert limit of the task, to which `share` belongs, deg.
    share : tuple of float, shape (N,)
        Share of the region where each sensor is checked with that limit, 0 to 1.
    least_limit_deg : float
        Smallest limit with which every sensor is checked somewhere, deg.

    """

    alert_limit_deg: float
    share: tuple[float, ...]
    least_limit_deg: float

    @property
    def caution(self) -> str:
        """Return which sensors are checked nowhere; empty if all are checked somewhere."""
        nowhere = ', '.join(
            joint for joint, share in zip(ALL_JOINT_NAMES, self.share, strict=False) if not share
        )
        if not nowhere:
            return ''
        return (
            f'with alert_limit_deg {self.alert_limit_deg:g} nothing checks {nowhere} anywhere in '
            'the region: with start_checked (columns phantom and patient of bringup.md) fkm '
            f'publishes nothing; alert_limit_deg {self.least_limit_deg:.2f} is the smallest with '
            'which all are checked somewhere'
        )

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the share of each sensor, a line each."""
        return tuple(
            f'{joint} is checked in {100.0 * share:.0f} % of the region'
            for joint, share in zip(ALL_JOINT_NAMES, self.share, strict=False)
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """
    Use of a calibration: alert limit, region, error.

    Attributes
    ----------
    calibration : MotionCalibration
        Result of the motion.
    origin : Origin
        Where it comes from.
    alert_limit_deg : float
        Smallest alert limit with which fkm publishes in the region, deg.
    published : float
        Share of the recorded motion that fkm publishes (unit 1).
    target_deg : float
        Wanted error of the orientation, deg rms.
    checked : Checked
        Where in its region the other sensors check each one.

    """

    calibration: MotionCalibration
    origin: Origin
    alert_limit_deg: float
    published: float
    target_deg: float
    checked: Checked

    @property
    def cautions(self) -> tuple[str, ...]:
        """Return warnings for an engineer, a sentence each."""
        cautions = self.calibration.cautions
        if self.checked.caution:
            return (*cautions, self.checked.caution)
        return cautions

    @property
    def text(self) -> str:
        """Return alert limit and region, in one line."""
        region = self.calibration.region
        where = (
            'over the workspace' if region == coverage.WORKSPACE else 'ONLY for the region moved'
        )
        return (
            f'Good for an alert limit of {self.alert_limit_deg:g} deg or more, {where}: '
            f'{region.text}.'
        )

    @property
    def reached(self) -> str:
        """Return target and reached error, in one line."""
        error = degrees(self.calibration.region_error)
        verb = 'reached' if error <= self.target_deg else 'NOT reached'
        return (
            f'Predicted error of the orientation: {error:.3f} deg rms over the region, target '
            f'{self.target_deg:g} deg {verb}.'
        )


def zero_counts(
    calibration: MotionCalibration,
    counts_per_turn: Sequence[int],
) -> tuple[tuple[int, ...], Array]:
    """
    Return the whole zero counts, and what rounding them leaves.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    counts_per_turn : sequence of int
        Counts of each encoder in a turn, N values.

    Returns
    -------
    counts : tuple of int
        Zero counts, in [0, counts per turn).
    rest : ndarray, shape (N,)
        Reading that they leave at joint angle 0, rad; a table corrects it.

    """
    sign = np.array(calibration.direction)
    per_turn = np.array(counts_per_turn)
    counts = sign * calibration.vector[calibration.layout.slices['zeros']] * per_turn / tau
    whole = np.rint(counts).astype(int)
    # reading = direction (count - zero count) tau / counts per turn
    return tuple((whole % per_turn).tolist()), sign * (counts - whole) * tau / per_turn


def motion_parameters(
    calibration: MotionCalibration,
    origin: Origin,
) -> dict[str, Any]:
    """
    Return the parameters of a calibration: noise, bounds, mechanism and encoders.

    The second harmonic and the fraction of a count that the zero count leaves are a table of
    `TABLE_VALUES` values over the turn for each encoder.

    Parameters
    ----------
    calibration : MotionCalibration
        Result of a calibration from free motion.
    origin : Origin
        Where the calibration comes from.

    Returns
    -------
    dict
        Values by dotted name; angles in deg.

    """
    c = calibration
    layout = calibration.layout
    zeros, rest = zero_counts(c, origin.counts_per_turn)
    first, _ = layout.harmonics(c.vector)
    geometry = layout.geometry(c.vector)
    joints = ALL_JOINT_NAMES[: layout.sensors]
    # The second harmonic, and the fraction of a count that the whole zero count leaves.
    second = c.vector.copy()
    second[layout.slices['first harmonics']] = 0.0
    at = np.arange(TABLE_VALUES)[:, None] * tau / TABLE_VALUES
    tables = {
        f'encoders.table_deg.{joint}': rounded(values)
        for joint, values in zip(
            joints,
            (rest + layout.harmonic_deviation(at, second)[0]).T,
            strict=True,
        )
    }
    return {
        'calibration': f'motion, {origin.date}',
        **sensors_entry(joints),
        **dict(sorted(origin.settings.items())),
        'sigma_deg': rounded(c.noise),
        'bias_deg': rounded(c.bias),
        'parity_bias_deg': round(degrees(c.parity_bias), 6),
        'geometry.proximal_deg': rounded(geometry.alphas),
        'geometry.distal_deg': rounded(geometry.betas),
        **{
            f'geometry.{name}': [
                round(float(component), 12) for component in np.ravel(getattr(geometry, name))
            ]
            for name in ('base_axes', 'platform_axes')
        },
        'encoders.counts_per_turn': origin.counts_per_turn,
        'encoders.direction': c.direction,
        'encoders.direction_verified': [True] * len(joints),
        'encoders.zero_count': zeros,
        'encoders.harmonic_cos_deg': rounded(first[:, 0]),
        'encoders.harmonic_sin_deg': rounded(first[:, 1]),
        **tables,
    }


def motion_text(verdict: Verdict) -> str:
    """
    Return the text of the parameter file, with the verdict and a record of all figures.

    Parameters
    ----------
    verdict : Verdict
        The calibration, and what it is good for.

    Returns
    -------
    str
        A ROS parameter file; the verdict and the cautions are its comment.

    """
    c = verdict.calibration
    origin = verdict.origin
    region = verdict.calibration.region
    left = '; '.join(f'{group}: {reason}' for group, reason in c.left.items()) or 'none'
    return file_text(
        (
            f'Calibration of {origin.date} from free motion, a parameter file for all nodes: '
            '--params-file.',
            verdict.text,
            verdict.reached,
            f'bias_deg bounds the error of each sensor for {region.text}.',
            *(f'CAUTION: {caution}' for caution in verdict.cautions),
        ),
        motion_parameters(c, origin),
        {
            'method': 'motion',
            'date': origin.date,
            'recording': origin.recording,
            'checksum': origin.checksum,
            'version': origin.version,
            'received_sets': c.readings.sets,
            'seconds': round(float(c.readings.seconds[-1]), 1),
            'cut_percent': round(100.0 * c.cut, 2),
            'alert_limit_deg': verdict.alert_limit_deg,
            'checked_percent': [round(100.0 * share, 1) for share in verdict.checked.share],
            'all_checked_limit_deg': round(verdict.checked.least_limit_deg, 3),
            'published_percent': round(100.0 * verdict.published, 2),
            'region_tilt_deg': region.tilt_deg,
            'region_phi_deg': [region.from_deg, region.to_deg],
            'target_deg': verdict.target_deg,
            'region_error_deg': round(degrees(c.region_error), 6),
            'predicted_error_deg': round(degrees(c.error), 6),
            'parity_deg': round(degrees(rms(c.parity)), 6),
            'left_as_drawn': left,
            'advice': c.advice,
            'cautions': '; '.join(verdict.cautions),
            'parameters': c.layout.names,
            'values_deg': rounded(c.vector),
            'deviations_deg': rounded(c.deviations),
        },
    )
