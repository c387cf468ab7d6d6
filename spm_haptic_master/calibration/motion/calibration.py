# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The result of a calibration from free motion, and what an engineer should look at in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from spm_haptic_master.calibration.motion.coverage import (
    aligned_changes,
    orientation_error,
    Proposal,
)
from spm_haptic_master.calibration.motion.error_bound import Region, sensor_bounds
from spm_haptic_master.calibration.motion.mechanism_parameters import Array, Layout
from spm_haptic_master.calibration.motion.model import MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings

# Deviation from the drawing that is reported (standard deviations before the fit).
UNUSUAL = 3.5
# Variance between halves of the motion over that of noise that is reported (unit 1).
CONTRADICTION = 3.0
# Part of the sets with a spike, and of the samples that the fit cuts, that are reported (unit 1).
SPIKES, CUT = 0.001, 0.005


@dataclass(frozen=True, slots=True)
class MotionCalibration:
    """
    Result of a calibration from free motion.

    Attributes
    ----------
    layout : Layout
        Meaning of the parameters.
    vector : ndarray, shape (P,)
        Parameters, rad.
    covariance : ndarray, shape (P, P)
        Of their errors, those of the drawing's included that were left, rad^2.
    estimated : tuple of int
        Parameters that were estimated.
    left : dict of str to str
        Groups that were left as drawn, and why.
    direction : tuple of N int
        Directions of the encoders.
    noise, bias : ndarray, shape (N,)
        White noise of a reading (1 standard deviation) and bound of its systematic error over
        the region, rad.
    readings : MotionReadings
        What it was computed from.
    rotation : ndarray, shape (n, 3, 3)
        Orientation at each of its means; NaN where there is none.
    parity, parity_before : ndarray, shape (n,)
        Parity of each mean by the first four sensors, rad, with the result and with zeros and
        directions only.
    error, region_error : float
        Predicted error of the orientations by what is not known exactly, frames aligned, rad rms:
        over the motion, and over the region.
    region : Region
        Where bias and predicted error hold.
    unexplained : ndarray, shape (N,)
        Error of each sensor that no parameter explains, rad.
    advice : tuple of Proposal
        Motions that would determine more, the best first.
    unusual : tuple of str
        Names of the parameters that are farther from the drawing than `UNUSUAL` tolerances.
    contradiction : float
        Variance of the difference of the parameters by halves of the motion, over that by noise.
    cut : float
        Share of the samples that count as outliers or have no orientation (unit 1).

    """

    layout: Layout
    vector: Array
    covariance: Array
    estimated: tuple[int, ...]
    left: dict[str, str]
    direction: tuple[int, ...]
    noise: Array
    bias: Array
    readings: MotionReadings
    rotation: Array
    parity: Array
    parity_before: Array
    error: float
    region_error: float
    region: Region
    unexplained: Array
    advice: tuple[Proposal, ...]
    unusual: tuple[str, ...]
    contradiction: float
    cut: float

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


def over_region(calibration: MotionCalibration, model: MotionModel,
                region: Region) -> MotionCalibration:
    """Return a calibration with bias and predicted error of a region."""
    c = calibration
    poses = region.poses(model, c.vector)
    return replace(
        c, region=region,
        bias=sensor_bounds(model, c.vector, c.covariance, poses, c.unexplained),
        region_error=orientation_error(aligned_changes(model, poses, c.vector), c.covariance))
