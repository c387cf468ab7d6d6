# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""The result of a calibration from free motion: its parameters, their bounds, its cautions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import degrees

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.motion import coverage
from spm_haptic_master.calibration.motion.fit import normal_equations
from spm_haptic_master.calibration.motion.model import Array, Layout, MotionModel
from spm_haptic_master.calibration.motion.readings import MotionReadings
from spm_haptic_master.kinematics.joints import ALL_JOINT_NAMES

# Deviation from the drawing that is reported (standard deviations before the fit).
UNUSUAL = 3.5
# Variance between halves of the motion over that of noise that is reported (unit 1).
CONTRADICTION = 3.0
# Noise by differences of readings over that which the parity allows that is reported (unit 1).
IRREGULAR = 1.1
# Part of the sets with a spike, and of the samples that the fit cuts, that are reported (unit 1).
SPIKES = 0.001
CUT = 0.005
# Samples of which the orientations' error is predicted.
ERROR_SAMPLES = 3000


@dataclass(frozen=True)
class MotionCalibration:
    """
    Result of a calibration from free motion.

    P is the number of parameters, N of sensors, n of means of readings. Figures that take time are
    computed when they are asked for, once.

    Attributes
    ----------
    model : MotionModel
        Mechanism with its encoders, and the white noise of the readings' means.
    vector : ndarray, shape (P,)
        Parameters, rad.
    covariance : ndarray, shape (P, P)
        Covariance of the parameters' errors, with those of what was left as drawn, rad^2.
    information : ndarray, shape (P, P)
        Normal matrix of all parameters by the readings alone, 1/rad^2.
    estimated : tuple of int
        Places of the parameters that were estimated.
    left : dict of str to str
        Groups of parameters that were left as drawn, and why.
    direction : tuple of int
        Directions of the encoders, 1 or -1.
    readings : MotionReadings
        Means of readings that it was computed from.
    rotation : ndarray, shape (n, 3, 3)
        Orientation R_base_platform at each of these; NaN where there is none.
    kept : ndarray of bool, shape (n,)
        Which of them are no outliers and have an orientation.
    drawn : ndarray, shape (P,)
        Parameters with the mechanism as drawn, rad: the zeros alone are fitted.
    unexplained : ndarray, shape (N,)
        Error of each sensor that no parameter explains, rad.
    unexplained_parity : float
        Slow part of the parity that no parameter explains, rad.
    advice : str
        The motion that would determine most of the rest, as an instruction.
    advice_gain : float
        Variance of the orientations' error over that after such a motion.
    contradiction : float
        Variance between halves of the motion over that of noise (unit 1).
    region : coverage.Region
        Region of the workspace for which `bias` and `region_error` hold.

    """

    model: MotionModel
    vector: Array
    covariance: Array
    information: Array
    estimated: tuple[int, ...]
    left: dict[str, str]
    direction: tuple[int, ...]
    readings: MotionReadings
    rotation: Array
    kept: NDArray[np.bool_]
    drawn: Array
    unexplained: Array
    unexplained_parity: float
    advice: str
    advice_gain: float
    contradiction: float
    region: coverage.Region = coverage.WORKSPACE

    @property
    def layout(self) -> Layout:
        """Return the meaning of the parameters."""
        return self.model.layout

    @property
    def turned(self) -> Array:
        """Return the readings by their directions, rad, (n, N)."""
        turned: Array = self.readings.readings * np.array(self.direction)
        return turned

    @property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter's error, rad."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def noise(self) -> Array:
        """
        Return the white noise of one reading that the parity allows, rad, (N,).

        `model.sigma` is that of a mean of `readings.together` readings.
        """
        of_readings: Array = self.model.sigma * np.sqrt(self.readings.together)
        return of_readings

    @property
    def irregular(self) -> str:
        """
        Return a caution that the sets come at irregular times; empty if they do not.

        Differences of readings then show more noise than the parity, which no motion changes.
        """
        sensor = int(np.argmax(self.readings.noise / self.noise))
        if self.readings.noise[sensor] <= IRREGULAR * self.noise[sensor]:
            return ''
        return (
            f'the sets come at irregular times: differences of the readings of '
            f'{ALL_JOINT_NAMES[sensor]} look like a noise of '
            f'{degrees(self.readings.noise[sensor]):.3f} deg, the parity allows '
            f'{degrees(self.noise[sensor]):.3f} deg, which is its sigma_deg; a producer of SYNC '
            'with a constant period mends it'
        )

    @property
    def cut(self) -> float:
        """Return the share of the samples that the fit cuts (unit 1)."""
        return 1.0 - float(self.kept.mean())

    @cached_property
    def parity(self) -> Array:
        """
        Return the parity of each sample by the first four sensors, rad, (n,).

        `normal_equations` gives it in standard deviations; the rms of the sensors' noise is one.
        """
        return self._parity(self.rotation, self.vector)

    @cached_property
    def parity_before(self) -> Array:
        """Return the parity of each sample with the mechanism as drawn, rad, (n,)."""
        return self._parity(self.model.orientations(self.turned, self.drawn), self.drawn)

    def _parity(self, rotation: Array, vector: Array) -> Array:
        """Return the parity by orientations and parameters, rad, (n,); NaN where there is none."""
        found = normal_equations(
            self.model,
            self.turned,
            rotation,
            vector,
            (),
        )
        # In rad of one standard deviation.
        return found.parity[:, 0] * rms(self.model.sigma)

    @cached_property
    def error(self) -> float:
        """
        Return the predicted error of the orientations over the motion, rad rms.

        Without what a rotation of base and platform takes away, by at most some `ERROR_SAMPLES`
        samples.
        """
        moved = self.rotation[self.kept]
        moved = moved[:: max(1, len(moved) // ERROR_SAMPLES)]
        return coverage.orientation_error(
            coverage.aligned_changes(self.model, moved, self.vector), self.covariance
        )

    @cached_property
    def _poses(self) -> Array:
        """Return the poses at which the region is evaluated, (n, 3, 3)."""
        return self.region.poses(self.model, self.vector)

    @cached_property
    def bias(self) -> Array:
        """
        Return the bounds of the sensors' systematic errors over the region, rad, (N,).

        See `coverage.sensor_bounds`; this becomes the parameter `bias_deg`.
        """
        return coverage.sensor_bounds(
            self.model,
            self.vector,
            self.covariance,
            self._poses,
            self.unexplained,
        )

    @cached_property
    def parity_bias(self) -> float:
        """
        Return the bound of what these errors together do to the parity, rad.

        See `coverage.parity_bound`; this becomes the parameter `parity_bias_deg`.
        """
        return coverage.parity_bound(
            self.model,
            self.vector,
            self.covariance,
            self._poses,
            self.unexplained_parity,
        )

    @cached_property
    def region_error(self) -> float:
        """Return the predicted error of the orientations over the region, rad rms."""
        return coverage.orientation_error(
            coverage.aligned_changes(self.model, self._poses, self.vector), self.covariance
        )

    @property
    def cures(self) -> dict[str, float]:
        """
        Return what one could do, and by what it would divide the predicted error over the region.

        A motion twice as long doubles the information of the readings; half the tolerances have
        four times the information.

        Returns
        -------
        dict of str to float
            Factor by the cure, in words.

        """
        tolerance = np.diag(self.layout.deviations**-2.0)
        changes = coverage.aligned_changes(self.model, self._poses, self.vector)

        def error(information: Array) -> float:
            """Return the predicted error over the region with an information matrix, rad rms."""
            return coverage.orientation_error(changes, coverage.inverse(information))

        now = error(self.information + tolerance)
        return {
            f'a larger motion ({self.advice})': float(np.sqrt(self.advice_gain)),
            'a motion twice as long': now / error(2.0 * self.information + tolerance),
            'half of --mechanism-tolerance and --harmonic-tolerance, if the workshop guarantees '
            'that,': now / error(self.information + 4.0 * tolerance),
        }

    @property
    def unusual(self) -> str:
        """Return which parameters are far from the drawing; empty if none is."""
        names = ', '.join(
            name
            for name, value, each in zip(
                self.layout.names,
                self.vector,
                self.layout.deviations,
                strict=True,
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
        found = [text for text in (self.unusual, self.irregular) if text]
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


def rms(values: Array) -> float:
    """
    Return the root mean square of values, but for NaN.

    Parameters
    ----------
    values : ndarray
        Values of any shape; NaN do not count.

    Returns
    -------
    float
        In the unit of the values.

    """
    return float(np.sqrt(np.nanmean(values**2)))
