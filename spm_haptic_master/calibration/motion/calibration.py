# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The result of a calibration from free motion: its cautions, verdict and parameter file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import degrees, tau
from typing import Any

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.calibration_file import file_text, rounded, sensors_entry
from spm_haptic_master.calibration.motion import coverage
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.model import Array, Layout, MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Deviation from the drawing that is reported (standard deviations before the fit).
UNUSUAL = 3.5
# Variance between halves of the motion over that of noise that is reported (unit 1).
CONTRADICTION = 3.0
# Part of the sets with a spike, and of the samples that the fit cuts, that are reported (unit 1).
SPIKES, CUT = 0.001, 0.005
# Samples of which the orientations' error is predicted.
ERROR_SAMPLES = 3000
# Number of values of a table: exact for a constant, the first and the second harmonic.
TABLE_VALUES = 5


@dataclass(frozen=True)
class MotionCalibration:
    """Result of a calibration from free motion."""

    model: MotionModel  # with the white noise of the readings' means
    vector: Array  # parameters, rad, (P,)
    covariance: Array  # of their errors, with those of the drawing that were left, rad^2, (P, P)
    estimated: tuple[int, ...]  # parameters that were estimated
    left: dict[str, str]  # groups that were left as drawn, and why
    direction: tuple[int, ...]  # of the encoders, 1 or -1
    readings: MotionReadings  # means that it was computed from
    rotation: Array  # orientation at each of these, (n, 3, 3); NaN where there is none
    kept: NDArray[np.bool_]  # which of them are no outliers and have an orientation, (n,)
    drawn: Array  # parameters with the mechanism as drawn, rad, (P,)
    unexplained: Array  # error of each sensor that no parameter explains, rad, (N,)
    advice: str  # the motion that would determine most of the rest, as an instruction
    contradiction: float  # variance between halves of the motion over that of noise (unit 1)
    region: coverage.Region = coverage.WORKSPACE  # where `bias` and `region_error` hold

    @property
    def layout(self) -> Layout:
        """Return the meaning of the parameters."""
        return self.model.layout

    @property
    def turned(self) -> Array:
        """Return the readings by their directions, rad, (n, N)."""
        return self.readings.readings * np.array(self.direction)

    @property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter's error, rad."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def cut(self) -> float:
        """Return the share of the samples that the fit cuts (unit 1)."""
        return 1.0 - float(self.kept.mean())

    @cached_property
    def parity(self) -> Array:
        """Return the parity of each sample by the first four sensors, rad, (n,)."""
        return self._parity(self.rotation, self.vector)

    @cached_property
    def parity_before(self) -> Array:
        """Return the same with the mechanism as drawn."""
        return self._parity(self.model.orientations(self.turned, self.drawn), self.drawn)

    def _parity(self, rotation: Array, vector: Array) -> Array:
        found = normal_equations(self.model, self.turned, rotation, vector, ())
        # In rad of one standard deviation.
        return found.parity[:, 0] * rms(self.model.sigma)

    @cached_property
    def error(self) -> float:
        """Return the predicted error of the orientations over the motion, aligned, rad rms."""
        moved = self.rotation[self.kept]
        moved = moved[:: max(1, len(moved) // ERROR_SAMPLES)]
        return coverage.orientation_error(
            coverage.aligned_changes(self.model, moved, self.vector), self.covariance
        )

    @cached_property
    def _poses(self) -> Array:
        return self.region.poses(self.model, self.vector)

    @cached_property
    def bias(self) -> Array:
        """Return the bounds of the sensors' systematic errors over the region, rad, (N,)."""
        return coverage.sensor_bounds(
            self.model, self.vector, self.covariance, self._poses, self.unexplained
        )

    @cached_property
    def region_error(self) -> float:
        """Return the predicted error of the orientations over the region, rad rms."""
        return coverage.orientation_error(
            coverage.aligned_changes(self.model, self._poses, self.vector), self.covariance
        )

    @property
    def unusual(self) -> str:
        """Return which parameters are far from the drawing; empty if none is."""
        names = ', '.join(
            name
            for name, value, each in zip(
                self.layout.names, self.vector, self.layout.deviations, strict=True
            )
            if abs(value) > UNUSUAL * each
        )
        return names and (
            f'farther from the drawing than {UNUSUAL:g} tolerances: {names}; check the drawing, '
            'encoders.counts_per_turn and the mounting of these parts'
        )

    @property
    def misfit(self) -> str:
        """Return why the rig is another mechanism than that of the model; empty if it is not."""
        if self.contradiction <= CONTRADICTION:
            return ''
        return (
            f'halves of the motion contradict each other ({self.contradiction:.1f} times the '
            'variance of noise): look for play, axes that miss the centre, elastic links and '
            'encoders with further harmonics'
        )

    @property
    def cautions(self) -> tuple[str, ...]:
        """Return warnings for an engineer, a sentence each."""
        found = [self.unusual] if self.unusual else []
        if self.misfit:
            found.append(f'{self.misfit}; the true errors are larger than predicted')
        spikes = self.readings.spikes / self.readings.sets
        if spikes > SPIKES:
            found.append(
                f'{100.0 * spikes:.1f} % of the sets have a spike; fkm withholds ten orientations '
                'for each: check cables and encoders'
            )
        if self.cut > CUT:
            found.append(
                f'{100.0 * self.cut:.1f} % of the samples do not fit the others and were cut: an '
                'encoder that slipped for a part of the motion, or contact with an end stop'
            )
        return tuple(found)


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
    """Use of a calibration: alert limit, region, error."""

    calibration: MotionCalibration
    origin: Origin
    alert_limit_deg: float  # smallest one with which fkm publishes in the region, deg
    published: float  # share of the recorded motion that fkm publishes (unit 1)
    target_deg: float  # wanted error of the orientation, deg rms

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
    calibration: MotionCalibration, counts_per_turn: Sequence[int]
) -> tuple[tuple[int, ...], Array]:
    """Return the whole zero counts, and the reading that they leave at joint angle 0, rad."""
    sign, per_turn = np.array(calibration.direction), np.array(counts_per_turn)
    counts = sign * calibration.vector[calibration.layout.slices['zeros']] * per_turn / tau
    whole = np.rint(counts).astype(int)
    # reading = direction (count - zero count) tau / counts per turn
    return tuple((whole % per_turn).tolist()), sign * (counts - whole) * tau / per_turn


def rms(values: Array) -> float:
    """Return the root mean square of values, but for NaN."""
    return float(np.sqrt(np.nanmean(values**2)))


def motion_parameters(calibration: MotionCalibration, origin: Origin) -> dict[str, Any]:
    """Return the parameters of a calibration, by dotted name."""
    c, layout = calibration, calibration.layout
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
            joints, (rest + layout.harmonic_deviation(at, second)[0]).T, strict=True
        )
    }
    return {
        'calibration': f'motion, {origin.date}',
        **sensors_entry(joints),
        **dict(sorted(origin.settings.items())),
        'sigma_deg': rounded(c.readings.noise),
        'bias_deg': rounded(c.bias),
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
    """Return the text of the parameter file."""
    c, origin, region = verdict.calibration, verdict.origin, verdict.calibration.region
    left = '; '.join(f'{group}: {reason}' for group, reason in c.left.items()) or 'none'
    return file_text(
        (
            f'Calibration of {origin.date} from free motion, a parameter file for all nodes: '
            '--params-file.',
            verdict.text,
            verdict.reached,
            f'bias_deg bounds the error of each sensor for {region.text}.',
            *(f'CAUTION: {caution}' for caution in c.cautions),
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
            'published_percent': round(100.0 * verdict.published, 2),
            'region_tilt_deg': region.tilt_deg,
            'region_phi_deg': [region.from_deg, region.to_deg],
            'target_deg': verdict.target_deg,
            'region_error_deg': round(degrees(c.region_error), 6),
            'predicted_error_deg': round(degrees(c.error), 6),
            'parity_deg': round(degrees(rms(c.parity)), 6),
            'left_as_drawn': left,
            'advice': c.advice,
            'cautions': '; '.join(c.cautions),
            'parameters': c.layout.names,
            'values_deg': rounded(c.vector),
            'deviations_deg': rounded(c.deviations),
        },
    )
