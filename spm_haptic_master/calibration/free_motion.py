# Copyright 2026 The spm_haptic_master maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Calibration from free motion: zeros, directions, mechanism, harmonics, noise and bias.

The fourth sensor closes the loops of every sample up to one number, the parity. Over many poses
it determines the mechanism but for the choice of the frames. In this order: zeros and directions
from many guesses; then the groups of parameters, each where the motion determines it and a part
of the motion that was not used confirms it; then all of them on the whole motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import degrees, radians

import numpy as np
from numpy.typing import NDArray
from spm_haptic_master.calibration.mechanism_parameters import (
    Array,
    Layout,
    layout_of,
    Tolerances,
)
from spm_haptic_master.calibration.motion_coverage import (
    aligned_changes,
    inverse,
    orientation_error,
    Proposal,
    proposals,
    target_poses,
)
from spm_haptic_master.calibration.motion_fit import Fit, fit, normal_equations
from spm_haptic_master.calibration.motion_model import MotionModel
from spm_haptic_master.calibration.motion_readings import motion_readings, MotionReadings
from spm_haptic_master.calibration.motion_start import MotionStart, Start
from spm_haptic_master.calibration.parameter_choice import (
    Choice,
    considered_covariance,
    ParameterChoice,
)
from spm_haptic_master.calibration.slip_in_motion import slip_in_motion
from spm_haptic_master.exceptions import CalibrationError
from spm_haptic_master.joints import ALL_JOINT_NAMES
from spm_haptic_master.kinematics import Geometry

# Samples of the fit of the zeros, and of which the orientations' errors are predicted.
CHOICE_SAMPLES = 3000
# Length of the pieces of the motion in which slow errors are sought (s).
SLOW_SECONDS = 0.5
# Predicted orientation error of the zeros alone beyond which a motion does not determine them
# (rad).
ZEROS_LIMIT = radians(0.2)
# Predicted orientation error beyond which nothing is written (rad).
ERROR_LIMIT = radians(0.5)
# Standard deviations of the predicted error that the bias covers, its least value and unit (rad).
BIAS_SIGMAS = 2.0
BIAS_UNIT = radians(0.01)
# Deviation from the drawing that is reported (standard deviations before the fit).
UNUSUAL = 3.5
# Part of the pieces whose mean parity the bias covers (percent).
BIAS_PERCENT = 99.0


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
        White noise of a reading (1 standard deviation) and bound of what is left systematic, rad.
    readings : MotionReadings
        What it was computed from.
    rotation : ndarray, shape (n, 3, 3)
        Orientation at each of its means; NaN where there is none.
    parity, parity_before : ndarray, shape (n,)
        Parity of each mean by the first four sensors, rad, with the result and with zeros and
        directions only.
    error, target_error : float
        Predicted error of the orientations by what is not known exactly, frames aligned, rad rms:
        over the motion, and over the workspace.
    held_out : dict of str to float
        Parity of the held-out motion by the last group of the model, rad rms.
    advice : tuple of Proposal
        Motions that would determine more, the best first.
    unusual : tuple of str
        Names of the parameters that are farther from the drawing than `UNUSUAL` tolerances.

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
    target_error: float
    held_out: dict[str, float]
    advice: tuple[Proposal, ...]
    unusual: tuple[str, ...]

    @property
    def deviations(self) -> Array:
        """Return the standard deviation of each parameter's error, rad."""
        found: Array = np.sqrt(np.diag(self.covariance))
        return found


class MotionCalibrator:
    """
    Computes a calibration from the readings of a free motion.

    Parameters
    ----------
    nominal : Geometry
        The drawing.
    working_mode : tuple of 3 int
        Signs of the legs A, B, C.
    tolerances : Tolerances
        How far the rig may be from the drawing.
    progress : callable
        Called with what is done (str) and the part of the whole that is done (unit 1).

    """

    def __init__(self, nominal: Geometry, working_mode: tuple[int, int, int],
                 tolerances: Tolerances,
                 progress: Callable[[str, float], None] = lambda text, share: None):
        self._nominal = nominal
        self._working_mode = working_mode
        self._tolerances = tolerances
        self._progress = progress

    def calibrate(self, stamps: NDArray[np.int64], readings: Array,
                  given: Sequence[int] | None = None) -> MotionCalibration:
        """
        Return the calibration that a motion gives.

        Parameters
        ----------
        stamps : ndarray of int, shape (n,)
            Times, ns.
        readings : ndarray, shape (n, N)
            Angles by the counts alone, rad, on any turn.
        given : sequence of N int, optional
            Directions that are known; they are verified.

        Raises
        ------
        CalibrationError
            The motion does not determine the zeros, contradicts the drawing or the directions
            given, or two encoders are swapped.

        """
        means = motion_readings(stamps, readings)
        layout = layout_of(self._nominal, readings.shape[1])
        model = MotionModel(layout, self._working_mode, means.sigma)
        start = MotionStart(self._tolerances, self._progress).find(means, model)
        _check_directions(start.direction, given)
        return self._fitted(means, model, start)

    def _fitted(self, means: MotionReadings, model: MotionModel,
                start: Start) -> MotionCalibration:
        layout = model.layout
        turned = means.readings * np.array(start.direction)
        deviations = layout.deviations(self._tolerances)
        zeros = [*range(layout.sensors)]
        chosen = np.arange(0, len(turned), max(1, len(turned) // CHOICE_SAMPLES))
        factor = len(turned) / len(chosen)
        self._progress('zeros', 0.5)
        first = fit(model, turned[chosen], start.vector, zeros, deviations)
        self._check_zeros(model, first, factor, means.rate)
        choice = ParameterChoice(model, deviations, factor).choose(
            turned[chosen], means.seconds[chosen], first,
            lambda group, number: self._progress(group, 0.5 + 0.05 * number))
        self._progress('all parameters, whole motion', 0.8)
        rotation = model.orientations(turned, choice.vector)
        whole = fit(model, turned, choice.vector, choice.columns, deviations, rotation,
                    lambda: self._progress('all parameters, whole motion', 0.85))
        slip = slip_in_motion(model, turned, whole.normal.rotation, means.seconds, whole.vector,
                              choice.columns, deviations)
        if slip is not None:
            raise CalibrationError(
                f'{ALL_JOINT_NAMES[slip.sensor]} slipped by {degrees(slip.slip):+.2f} deg during '
                f'the motion, about {slip.seconds:.0f} s after its beginning; fasten the encoder '
                'and move the device again')
        slow = _slow_factor(means, whole)
        if slow > 1.0:
            model = MotionModel(layout, self._working_mode, model.sigma * np.sqrt(slow))
            whole = fit(model, turned, whole.vector, choice.columns, deviations,
                        whole.normal.rotation,
                        lambda: self._progress('all parameters, whole motion', 0.9))
        self._progress('errors', 0.95)
        return self._result(means, model, start, first, whole, choice, turned)

    def _check_zeros(self, model: MotionModel, first: Fit, factor: float,
                     rate: float) -> None:
        """Raise CalibrationError if a motion does not even determine the zeros."""
        changes = aligned_changes(model, target_poses(model, first.vector), first.vector)
        zeros = slice(model.layout.sensors)
        error = orientation_error(changes[:, :, zeros], inverse(first.normal.matrix * factor))
        if error > ZEROS_LIMIT:
            raise CalibrationError(
                'the motion does not determine the zeros: they leave a predicted error of '
                f'{degrees(error):.2f} deg, limit {degrees(ZEROS_LIMIT):g} deg; '
                f'{self._advice(model, first, factor, rate, changes)[0].text}')

    def _advice(self, model: MotionModel, found: Fit, factor: float, rate: float,
                changes: Array) -> list[Proposal]:
        """Return the motions that would determine more than a fit of a part of the samples."""
        rotation = found.normal.rotation[found.normal.kept]
        normal = normal_equations(model, model.readings(rotation, found.vector), rotation,
                                  found.vector, tuple(range(model.layout.count)))
        information = normal.matrix * factor + np.diag(
            model.layout.deviations(self._tolerances) ** -2.0)
        return proposals(model, found.vector, information, rate, changes)

    def _result(self, means: MotionReadings, model: MotionModel, start: Start, first: Fit,
                whole: Fit, choice: Choice, turned: Array) -> MotionCalibration:
        layout = model.layout
        deviations = layout.deviations(self._tolerances)
        every = tuple(range(layout.count))
        rotation = whole.normal.rotation
        normal = normal_equations(model, turned, rotation, whole.vector, every)
        covariance = considered_covariance(normal.matrix, deviations, whole.columns)
        inside = np.flatnonzero(whole.normal.kept)
        some = inside[::max(1, len(inside) // CHOICE_SAMPLES)]
        over_motion = aligned_changes(model, rotation[some], whole.vector)
        changes = aligned_changes(model, target_poses(model, whole.vector), whole.vector)
        error = orientation_error(over_motion, covariance)
        target_error = orientation_error(changes, covariance)
        advice = tuple(proposals(model, whole.vector, normal.matrix + np.diag(deviations ** -2.0),
                                 means.rate, changes))
        if error > ERROR_LIMIT:
            raise CalibrationError(
                'the motion does not determine the mechanism: predicted error of the orientation '
                f'{degrees(error):.2f} deg, limit {degrees(ERROR_LIMIT):g} deg; '
                f'{advice[0].text}')
        # The parity in rad of one standard deviation.
        scale = float(np.sqrt(np.mean(model.sigma ** 2)))
        parity = whole.normal.parity * scale
        before = normal_equations(model, turned, model.orientations(turned, first.vector),
                                  first.vector, ()).parity * scale
        spread_size = np.sqrt(np.mean(np.sum(model.linearised(
            turned[some], rotation[some], whole.vector, ()).spread ** 2, axis=(1, 2))))
        slow = [np.percentile(np.abs(_piece_means(means.seconds, column, whole.normal.kept)),
                              BIAS_PERCENT) for column in parity.T]
        each = max(BIAS_SIGMAS * error / spread_size, *slow)
        bias = np.full(layout.sensors, np.ceil(each / BIAS_UNIT) * BIAS_UNIT)
        return MotionCalibration(
            layout, whole.vector, covariance, whole.columns, choice.left, start.direction,
            means.noise, bias, means, rotation, parity[:, 0], before[:, 0], error, target_error,
            choice.held_out, advice, tuple(
                name for name, value, each in zip(
                    layout.names, whole.vector, deviations, strict=True)
                if abs(value) > UNUSUAL * each))


def _check_directions(found: tuple[int, ...], given: Sequence[int] | None) -> None:
    """Raise CalibrationError if directions that were given are not those found."""
    if given is None:
        return
    wrong = [f'{joint} turns with direction {sign:+d}, encoders.direction has {other:+d}'
             for joint, sign, other in zip(ALL_JOINT_NAMES, found, given, strict=False)
             if sign != other]
    if wrong:
        raise CalibrationError('; '.join(wrong))


def _piece_means(seconds: Array, parity: Array, kept: NDArray[np.bool_]) -> Array:
    """Return the mean parities of the motion's pieces of `SLOW_SECONDS`."""
    piece = _pieces(seconds)[kept]
    counts = np.bincount(piece)
    sums = np.bincount(piece, parity[kept])
    enough = counts > 0.5 * np.median(counts[counts > 0])
    found: Array = sums[enough] / counts[enough]
    return found


def _slow_factor(means: MotionReadings, whole: Fit) -> float:
    """Return the variance of the mean parities of pieces over that of white noise; 1 at least."""
    kept = whole.normal.kept
    piece = _pieces(means.seconds)[kept]
    counts = np.bincount(piece)
    factors = [counts[counts > 0] * (np.bincount(piece, column)[counts > 0]
                                     / counts[counts > 0]) ** 2
               for column in whole.normal.parity[kept].T]
    return max(1.0, float(np.mean(factors)))


def _pieces(seconds: Array) -> NDArray[np.intp]:
    """Return the number of the piece of `SLOW_SECONDS` that each time is in, without gaps."""
    found: NDArray[np.intp] = np.unique(
        np.floor(seconds / SLOW_SECONDS), return_inverse=True)[1]
    return found
