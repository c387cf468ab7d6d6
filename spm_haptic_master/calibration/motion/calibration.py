# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The result of a calibration from free motion, and what an engineer should look at in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    orientation_error,
    Proposal,
)
from spm_haptic_master.calibration.motion.error_bound import Region, sensor_bounds, WORKSPACE
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, Layout
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings

# Deviation from the drawing that is reported (standard deviations before the fit).
UNUSUAL = 3.5
# Variance between halves of the motion over that of noise that is reported (unit 1).
CONTRADICTION = 3.0
# Part of the sets with a spike, and of the samples that the fit cuts, that are reported (unit 1).
SPIKES, CUT = 0.001, 0.005


@dataclass(frozen=True)
class MotionCalibration:
    """Result of a calibration from free motion."""

    model: MotionModel  # with the white noise of the readings' means
    vector: Array  # parameters, rad, (P,)
    covariance: Array  # of their errors, with those of the drawing that were left, rad^2, (P, P)
    estimated: tuple[int, ...]  # parameters that were estimated
    left: dict[str, str]  # groups that were left as drawn, and why
    direction: tuple[int, ...]  # of the encoders, 1 or -1
    noise: Array  # white noise of a reading, rad, 1 standard deviation, (N,)
    readings: MotionReadings  # means that it was computed from
    rotation: Array  # orientation at each of these, (n, 3, 3); NaN where there is none
    parity: Array  # of each by the first four sensors, rad, (n,)
    parity_before: Array  # the same with zeros and directions only
    error: float  # predicted error of the orientations over the motion, frames aligned, rad rms
    unexplained: Array  # error of each sensor that no parameter explains, rad, (N,)
    advice: tuple[Proposal, ...]  # motions that would determine more, the best first
    contradiction: float  # variance between halves of the motion over that of noise (unit 1)
    cut: float  # share of the samples that are outliers or have no orientation (unit 1)
    region: Region = WORKSPACE  # where `bias` and `region_error` hold

    @cached_property
    def _poses(self) -> Array:
        return self.region.poses(self.model, self.vector)

    @cached_property
    def bias(self) -> Array:
        """Return the bounds of the sensors' systematic errors over the region, rad, (N,)."""
        return sensor_bounds(self.model, self.vector, self.covariance, self._poses,
                             self.unexplained)

    @cached_property
    def region_error(self) -> float:
        """Return the predicted error of the orientations over the region, rad rms."""
        return orientation_error(
            aligned_changes(self.model, self._poses, self.vector), self.covariance)

    @property
    def layout(self) -> Layout:
        """Return the meaning of the parameters."""
        return self.model.layout

    @property
    def unusual(self) -> tuple[str, ...]:
        """Return the parameters that are farther from the drawing than `UNUSUAL` tolerances."""
        return tuple(name for name, value, each in zip(
            self.layout.names, self.vector, self.layout.deviations, strict=True)
            if abs(value) > UNUSUAL * each)

    @property
    def misfit(self) -> str:
        """Return why the rig is another mechanism than that of the model; empty if it is not."""
        if self.contradiction <= CONTRADICTION:
            return ''
        return (f'halves of the motion contradict each other ({self.contradiction:.1f} times the '
                'variance of noise): look for play, axes that miss the centre, elastic links and '
                'encoders with further harmonics')

    @property
    def _unusual(self) -> str:
        return (f'farther from the drawing than {UNUSUAL:g} tolerances: '
                f'{", ".join(self.unusual)}; check the drawing, encoders.counts_per_turn and the '
                'mounting of these parts')

    @property
    def cause(self) -> str:
        """Return what another motion would not mend, empty where it would."""
        return self.misfit or (self._unusual if self.unusual else '')

    @property
    def cautions(self) -> tuple[str, ...]:
        """Return what an engineer should look at, a sentence each."""
        found = []
        if self.unusual:
            found.append(self._unusual)
        if self.misfit:
            found.append(f'{self.misfit}; the true errors are larger than predicted')
        spikes = self.readings.spikes / self.readings.sets
        if spikes > SPIKES:
            found.append(
                f'{100.0 * spikes:.1f} % of the sets have a spike; fkm withholds ten orientations '
                'for each: check cables and encoders')
        if self.cut > CUT:
            found.append(
                f'{100.0 * self.cut:.1f} % of the samples do not fit the others and were cut: an '
                'encoder that slipped for a part of the motion, or contact with an end stop')
        return tuple(found)

    @property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter's error, rad."""
        found: Array = np.sqrt(np.diag(self.covariance))
        return found
